"""Names that a user may have meant."""

from __future__ import annotations

from vibrosweep.mistakes import nearest
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.mount import OF_MOUNT
from vibrosweep.model.parameters import HIGH_BOUNCE, SPRUNG


def likely_parameter(word: str, base: str = HIGH_BOUNCE) -> str | None:
    """Return the physical parameter of a base that an unknown word was probably meant to be."""
    short = word.lower()
    known = {n: p for n, p in INPUTS.items() if base == SPRUNG or n not in OF_MOUNT}
    for name, parameter in known.items():
        if word == parameter.symbol:  # v0 is not V0
            return name
    for name, parameter in known.items():
        if short and (short == parameter.symbol.lower() or name.startswith(short)):
            return name
    return nearest(word, known)
