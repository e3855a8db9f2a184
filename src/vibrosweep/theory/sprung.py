"""Closed forms of particles on a sprung base of finite mass, derived in `study/ordering.md`.

Every quantity is dimensionless: times in forcing periods, phases in turns, speeds in g / (2 f).
Arguments that several functions share: the acceleration Gamma of the base without particles, in g;
the mode k, the number of forcing periods between two impacts of a particle; the ratio mu of the
mass of one particle to that of the base; the ratio of the natural frequency of the mount to that of
the forcing; the damping ratio of the mount.
"""

from __future__ import annotations

from vibrosweep.model.coupled_theory import (
    CoupledBase,
    Cycle,
    landing_phase,
    locked_acceleration_min,
    recoil_deviation,
    reversing_separation,
    spectral_radius,
    staggered,
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


def __dir__() -> list[str]:
    return sorted(__all__)
