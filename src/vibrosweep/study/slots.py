"""Particles each in a slot of its own: what the claims about order are true of."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from vibrosweep import simulate
from vibrosweep.model import theory

__all__ = ["POPULATIONS", "own_slots", "smallest_separation"]

POPULATIONS: Final = (5, 10, 20, 50, 100)
RESTITUTION: Final = 0.98
# Launches are this far from the exact instants, s
SCATTER: Final = 1e-3


def own_slots(particles: int, threads: int, impacts: int = 20) -> xr.Dataset:
    """Every landing of N particles in the N slots of mode N, at 1 Hz and e = 0.98.

    The locked orbit of mode N spans N forcing periods; one particle is launched into it in each of
    N successive periods, up to 1 ms off, at the amplitude in the middle of its window.
    """
    ends = (
        theory.amplitude_min(particles, RESTITUTION),
        theory.amplitude_max(particles, RESTITUTION),
    )
    amplitude = 0.5 * float(ends[0] + ends[1])
    phase = float(theory.locked_phase(particles, RESTITUTION, amplitude))
    scatter = np.random.default_rng(particles).uniform(-SCATTER, SCATTER, particles)
    return simulate(
        restitution=RESTITUTION,
        amplitude=amplitude,
        launch_velocity=float(theory.locked_velocity(particles)),
        launch_time=phase + np.arange(particles) + scatter,
        duration=float(impacts * particles),
        threads=threads,
    )


def smallest_separation(record: xr.Dataset) -> float:
    """Smallest time in s between two landings of a record of one realization."""
    times = np.sort(record["landing_time"].values, axis=None)
    return float(np.min(np.diff(times[np.isfinite(times)])))
