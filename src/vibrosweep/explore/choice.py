"""The scene that a page shows, and the visitor's changes to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import vibrosweep as vs
from vibrosweep.model.forcing import inputs_of
from vibrosweep.model.parameters import LAWS, SPRUNG, STAGGERED, Periods, Time, amount
from vibrosweep.model.shapes import SINE
from vibrosweep.scene.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

# Most forcing periods drawn at first, and fewest from which regimes and exponents are computed
MOST_PERIODS: Final = 100.0
OBSERVED_PERIODS: Final = 2000.0


@dataclass(frozen=True)
class Spread:
    """Launches at equal intervals."""

    first: float = 0.0  # launch of the first particle, forcing periods
    width: float = 1.0  # forcing periods over which they are spread; 1 is ``launch = "staggered"``


@dataclass(frozen=True)
class Choice:
    """A scene to simulate, and further selections of the visitor."""

    # In the choice that all points of a result share, without the inputs in which they differ
    scene: Scene
    # Beginning and end of the window of the result, over which separations are taken; None for all
    # of the drawn motion
    window: tuple[Time, Time] | None = None
    spread: Spread | None = Spread()  # None where the scene lists its launches
    # Parameters of a mount, which sliders keep while the base has no mount
    mount: Mapping[str, float] = field(default_factory=dict)

    @property
    def inputs(self) -> dict[str, float]:
        """Values of all sliders by the names of `vibrosweep.model.forcing.INPUTS`."""
        return {**self.mount, **self.scene.inputs}

    @property
    def launch_time(self) -> tuple[float, ...]:
        """Launch time of each particle, s."""
        scene, spread = self.scene, self.spread or Spread()
        if not isinstance(scene.launch, str):
            return scene.launch
        frequency = scene.inputs["frequency"]
        staggered = np.arange(scene.particles) / (scene.particles * frequency)
        return tuple((staggered * spread.width + spread.first / frequency).tolist())

    @property
    def periods(self) -> float:
        """End of the drawn motion, in forcing periods."""
        number, end = amount(self.scene.duration), self.scene.duration
        return number if isinstance(end, Periods) else number * self.scene.inputs["frequency"]

    def shortened(self, most: float = MOST_PERIODS) -> Choice:
        """Return the same choice, drawn for at most that many forcing periods."""
        return self.lasting(most) if self.periods > most else self

    def lasting(self, periods: float) -> Choice:
        """Return the same choice, drawn for another number of forcing periods."""
        return self._changed(duration=Periods(periods))

    def with_inputs(self, **values: float) -> Choice:
        """Return the same choice with other values of parameters."""
        unused = {**self.inputs, **values}
        names = [name for name in inputs_of(unused, self.scene.base) if name in unused]
        used = {name: unused.pop(name) for name in names}
        return replace(self._changed(inputs=used, given=frozenset(used)), mount=unused)

    def over(self, base: str) -> Choice:
        """Return the choice over another base, with the law of rebound that every base has."""
        if base == self.scene.base:
            return self
        return self._changed(base=base, rebound=LAWS[0]).with_inputs()

    def with_particles(self, particles: int) -> Choice:
        """Return the choice with another number of particles; listed launches become staggered."""
        if particles == self.scene.particles:
            return self
        return self.launched(self.spread or Spread(), particles)

    def launched(self, spread: Spread, particles: int | None = None) -> Choice:
        """Return the choice with launches at equal intervals."""
        number = particles or self.scene.particles
        return replace(self._changed(particles=number, launch=STAGGERED), spread=spread)

    def _changed(self, **fields: Any) -> Choice:
        return replace(self, scene=replace(self.scene, **fields))

    def keywords(self) -> dict[str, Any]:
        """Keywords of `vibrosweep.simulate`."""
        return {**self.scene.inputs, **self.sweep_keywords()}

    def sweep_keywords(self) -> dict[str, Any]:
        """Keywords of `vibrosweep.sweep` for the same particles, without physical parameters."""
        # staggered launches are exact phases of the forcing; in seconds they would be rounded
        scene, staggered = self.scene, self.spread == Spread()
        return {
            "particles": scene.particles,
            "launch": STAGGERED if staggered else list(self.launch_time),
            **_timed("duration", scene.duration),
            "base": scene.base,
            "rebound": scene.rebound,
            **({} if scene.waveform == SINE else {"waveform": scene.waveform.value}),
        }

    def simulate(self) -> xr.Dataset:
        """Every landing, as `vibrosweep.simulate` returns it."""
        return vs.simulate(**self.keywords())

    def observe(self) -> xr.Dataset:
        """Measures over the window of the result, as `vibrosweep.sweep` returns them."""
        begin, end = self.window or (0.0, self.scene.duration)
        until_end = replace(self, scene=replace(self.scene, duration=end))
        coupled = {"joint": True} if self.scene.base == SPRUNG else {}
        return until_end._sweep(separation=True, **_timed("transient", begin), **coupled)

    def settle(self) -> xr.Dataset:
        """Regimes and exponents after `OBSERVED_PERIODS`, as `vibrosweep.sweep` returns them."""
        longer = self.lasting(max(OBSERVED_PERIODS, self.periods))
        return longer._sweep(regimes=True, lyapunov=True)

    def _sweep(self, **measured: Any) -> xr.Dataset:
        return vs.sweep(progress=False, **self.keywords(), **measured)


def _timed(name: str, time: Time) -> dict[str, float]:
    """Return the keyword of a time, in s or in forcing periods."""
    return {f"{name}_periods" if isinstance(time, Periods) else name: amount(time)}
