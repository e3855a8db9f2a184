"""Closed forms of particles on a base of finite mass, which recoils; derived in `docs/ordering.md`.

Everything is dimensionless: times in forcing periods, phases in turns, speeds in g / (2 f).
Arguments that several functions share are the acceleration Gamma of the base without particles, in
g; the mode k, the forcing periods between two impacts of a particle; the mass mu of one particle
over that of the base; the natural frequency of the mount over that of the forcing; and its damping
ratio.
"""

from __future__ import annotations

from vibrosweep.model.coupled_cycles import CoupledBase, Cycle, spectral_radius, staggered
from vibrosweep.model.coupled_theory import (
    landing_phase,
    locked_acceleration_min,
    recoil_deviation,
    reversing_separation,
)

__all__ = [
    "CoupledBase",
    "Cycle",
    "landing_phase",
    "locked_acceleration_min",
    "recoil_deviation",
    "reversing_separation",
    "spectral_radius",
    "staggered",
]
