"""Normal deviates of a particle as the kernels draw them; for the reference they are exact."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.kernels.deviates import (
    LARGEST,
    OF_DRIVE,
    OF_KICK,
    OF_RESTITUTION,
    Word,
    draw,
    key_of,
)
from vibrosweep.proof.reference.motion import Deviates

BLOCK: Final = 512  # deviates that are drawn at a time


def deviates_of(seed: int, stream: float, particle: int) -> Deviates:
    """Return the deviates of a particle in a stream."""

    @cache
    def block(purpose: Word, index: int) -> Array:
        found, of_particle = np.empty(BLOCK), 0.0 if purpose == OF_DRIVE else float(particle)
        draw(key_of(seed), stream, of_particle, float(index * BLOCK), purpose, found)
        return found

    def of(purpose: Word, number: int) -> float:
        index, place = divmod(number, BLOCK)
        return float(block(purpose, index)[place])

    return Deviates(
        of_impact=lambda number: (of(OF_RESTITUTION, number), of(OF_KICK, number)),
        of_period=lambda number: of(OF_DRIVE, number),
        largest=LARGEST,
    )
