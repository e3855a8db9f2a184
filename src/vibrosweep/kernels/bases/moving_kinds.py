"""The moving base for every waveform, with all implementations of its generic functions."""

from __future__ import annotations

from vibrosweep.kernels.bases import (
    chained_errors,  # noqa: F401 -- implementations
    moving_errors,  # noqa: F401
    moving_lanes,  # noqa: F401
    shaped,  # noqa: F401
    shaped_errors,  # noqa: F401
)
from vibrosweep.kernels.bases.moving import Chained, Moving, Shaped
from vibrosweep.model.shapes import PARABOLIC_NAME, SINE, Waveform


def kind_of(waveform: Waveform) -> type:
    """Return the named tuple of the moving base with this waveform."""
    if waveform == SINE:
        return Moving
    return Chained if waveform.name == PARABOLIC_NAME else Shaped
