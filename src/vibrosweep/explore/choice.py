"""The realization that a page shows: its parameters, launches and base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import vibrosweep as vs
from vibrosweep.model.forcing import inputs_of
from vibrosweep.model.parameters import HIGH_BOUNCE, LAWS, SPRUNG, STAGGERED
from vibrosweep.model.times import Periods, Time, amount

if TYPE_CHECKING:
    import xarray as xr

# Forcing periods that are drawn at first, and from which regimes and exponents are computed
MOST_PERIODS: Final = 100.0
OBSERVED_PERIODS: Final = 2000.0


@dataclass(frozen=True)
class Spread:
    """Launches at equal intervals."""

    first: float = 0.0  # launch of the first particle, forcing periods
    width: float = 1.0  # forcing periods over which they are spread; 1 is ``launch = "staggered"``


@dataclass(frozen=True)
class Choice:
    """A realization to simulate."""

    # Name of `vibrosweep.model.forcing.INPUTS` -> value, exactly one forcing among them; parameters
    # of a mount are used over a sprung base only
    inputs: Mapping[str, float]
    # base, rebound: as in `vibrosweep.simulate`
    base: str = HIGH_BOUNCE
    rebound: str = LAWS[0]
    particles: int = 1  # number of particles
    # A `Spread`, or the launch time of each particle in s
    launch: Spread | tuple[float, ...] = Spread()
    end: Time = 12.0  # end of the drawn motion, in s or in forcing periods

    @property
    def launch_time(self) -> tuple[float, ...]:
        """Launch time of each particle, s."""
        if not isinstance(self.launch, Spread):
            return self.launch
        frequency = self.inputs["frequency"]
        staggered = np.arange(self.particles) / (self.particles * frequency)
        times = staggered * self.launch.width
        return tuple((times + self.launch.first / frequency).tolist())

    @property
    def periods(self) -> float:
        """End of the drawn motion, in forcing periods."""
        number = amount(self.end)
        return number if isinstance(self.end, Periods) else number * self.inputs["frequency"]

    def shortened(self, most: float = MOST_PERIODS) -> Choice:
        """Return the same choice, drawn for at most that many forcing periods."""
        return self.lasting(most) if self.periods > most else self

    def lasting(self, periods: float) -> Choice:
        """Return the same choice, drawn for another number of forcing periods."""
        return replace(self, end=Periods(periods))

    def with_inputs(self, **values: float) -> Choice:
        """Return the same choice with other values of parameters."""
        return replace(self, inputs={**self.inputs, **values})

    def over(self, base: str) -> Choice:
        """Return the choice over another base, with the law of rebound that every base has."""
        return self if base == self.base else replace(self, base=base, rebound=LAWS[0])

    def with_particles(self, particles: int) -> Choice:
        """Return the choice with another number of particles; listed launches become staggered."""
        if particles == self.particles:
            return self
        launch = self.launch if isinstance(self.launch, Spread) else Spread()
        return replace(self, particles=particles, launch=launch)

    def keywords(self) -> dict[str, Any]:
        """Keywords of `vibrosweep.simulate`."""
        used = inputs_of(self.inputs, self.base)
        return {
            **{name: self.inputs[name] for name in used},
            "launch_time": list(self.launch_time),
            **self._observed(),
        }

    def sweep_keywords(self) -> dict[str, Any]:
        """Keywords of `vibrosweep.sweep` for the same particles, without physical parameters."""
        staggered = self.launch == Spread()
        launch = STAGGERED if staggered else list(self.launch_time)
        return {"particles": self.particles, "launch": launch, **self._observed()}

    def _observed(self) -> dict[str, Any]:
        end = "duration_periods" if isinstance(self.end, Periods) else "duration"
        return {end: amount(self.end), "base": self.base, "rebound": self.rebound}

    def simulate(self) -> xr.Dataset:
        """Every landing, as `vibrosweep.simulate` returns it."""
        return vs.simulate(**self.keywords())

    def observe(self) -> xr.Dataset:
        """Regimes, exponents and separations, as `vibrosweep.sweep` returns them.

        The observation lasts `OBSERVED_PERIODS`; over a base of finite mass, which couples the
        particles and takes far longer for each landing, only as long as the drawn motion.
        """
        coupled = self.base == SPRUNG
        longer = self if coupled else self.lasting(max(OBSERVED_PERIODS, self.periods))
        keywords: dict[str, Any] = {
            **{name: self.inputs[name] for name in inputs_of(self.inputs, self.base)},
            **longer.sweep_keywords(),
            **dict.fromkeys(("joint",) if coupled else ("regimes", "lyapunov"), True),
        }
        return vs.sweep(separation=True, progress=False, **keywords)
