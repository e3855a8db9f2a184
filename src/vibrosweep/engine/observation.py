"""What is watched and measured, for every realization alike."""

from __future__ import annotations

from dataclasses import dataclass

from vibrosweep.kernels.advance import LOOK_AFTER

__all__ = ["Observation"]


@dataclass(frozen=True)
class Observation:
    """What is launched, how long it is watched and what is measured.

    Attributes
    ----------
    particles
        Number of particles per realization.
    launch
        ``"staggered"`` or the launch times of all particles in s.
    duration
        End of the observation in s.
    rebound
        ``"rest"`` or ``"reflect"``.
    transient
        Beginning of the window that measures cover, in s.
    separation
        Whether separations between particles are measured.
    per_particle
        Whether measures are kept for each particle.
    regimes
        Whether orbits that repeat exactly are recognised; they are then not followed any further.
    trust
        Whether an error bound is carried along each trajectory.
    tolerance
        Error of a landing time in s up to which it is trusted.
    impact_budget
        Impacts after which a particle is given up, see `budget`.
    lyapunov
        Whether Lyapunov exponents, distinct orbits and slots are found; regimes then are, too.
    skip
        Whether what is known already is counted instead of followed; off where every landing is
        kept, and to compare.
    """

    particles: int
    launch: str | tuple[float, ...]
    duration: float
    rebound: str
    transient: float
    separation: bool
    per_particle: bool
    regimes: bool
    trust: bool
    tolerance: float
    impact_budget: int
    lyapunov: bool = False
    skip: bool = True

    def __post_init__(self) -> None:
        if self.lyapunov:  # the exponents of a cycle are those of its multipliers
            object.__setattr__(self, "regimes", True)

    @property
    def budget(self) -> int:
        """Impacts after which a particle is given up: the budget up to a whole number of looks."""
        return -(-self.impact_budget // LOOK_AFTER) * LOOK_AFTER

    @property
    def windowed(self) -> bool:
        """Whether landings before the window are possible."""
        starts_late = self.transient > 0.0
        early_launch = not isinstance(self.launch, str) and min(self.launch) < self.transient
        return starts_late or early_launch
