"""Scenes: particles, a base with its waveform, and the measures taken of them."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import quoted
from vibrosweep.model.forcing import (
    ANSWERS,
    FORCINGS,
    completed,
    differing,
    forcing_of,
    inputs_of,
    only_parameters,
)
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    LAWS,
    NOISE,
    STAGGERED,
    STREAM,
    Periods,
    Time,
    amount,
    in_seconds,
)
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import (
    FORMS,
    HARMONICS_NAME,
    MOST_HARMONICS,
    PARABOLIC_NAME,
    SINE,
    SINE_NAME,
    FittedTrace,
    Waveform,
    harmonics_of,
    name_in,
)

__all__ = ["Launch", "Scene", "stored"]

Launch = str | tuple[float, ...]


@dataclass(frozen=True)
class Scene:
    """A scene: particles, base and times, shared by all realizations of a sweep or an analysis.

    Raises
    ------
    ParameterError
        The base or the waveform is unknown, or the base does not implement the law of rebound.
    """

    particles: int = 1  # number of particles per realization
    launch: Launch = STAGGERED  # ``"staggered"`` or the launch times of all particles in s
    duration: Time = 12.0  # end of the observation: a number in s, or `Periods`
    rebound: str = LAWS[0]  # one of `vibrosweep.model.parameters.LAWS`
    measures: Measures = field(default_factory=Measures)
    # True to add the remaining cycles exactly instead of simulating them; False for records of
    # landings, and for comparison
    skip: bool = True
    base: str = HIGH_BOUNCE  # one of `vibrosweep.model.parameters.BASES`
    waveform: Waveform = SINE
    # One of `vibrosweep.model.restitution_laws.RESTITUTION_LAWS`
    restitution_law: str = CONSTANT
    # Physical parameters that do not vary, defaults included, by the names of
    # `vibrosweep.model.forcing.INPUTS` and in their units: at most one forcing, and parameters of
    # the mount for a sprung base only.  The engine takes arrays of all parameters instead.
    inputs: Mapping[str, float] = field(default_factory=dict)
    given: frozenset[str] = frozenset()  # names of the inputs that were stated
    noise_seed: int = 0

    def __post_init__(self) -> None:
        if wrong := refusal(self.base, law=self.rebound, waveform=self.waveform.name):
            raise ParameterError(wrong)

    def with_measures(self, **changes: Any) -> Scene:
        """Return the same scene with other values of some keys of [measure]."""
        return replace(self, measures=replace(self.measures, **changes))

    def recorded(self, impact_budget: int | None = None) -> Scene:
        """Return the same scene without measures, with a window that holds every landing."""
        budget = impact_budget or self.measures.impact_budget
        every = Measures(transient=-math.inf, tolerance=math.inf, impact_budget=budget)
        return replace(self, measures=every)

    def only(self, **measured: bool) -> Scene:
        """Return the same scene with the measures that are named, and no others."""
        kept = {"transient": self.measures.transient, "impact_budget": self.measures.impact_budget}
        return replace(self, measures=Measures(**kept, **measured))  # type: ignore[arg-type]

    @property
    def mechanics(self) -> tuple[str, str, Waveform, str]:
        """Return base, laws and waveform as the kernels' `base_of` takes them."""
        return self.base, self.rebound, self.waveform, self.restitution_law

    @property
    def budget(self) -> int:
        """Impacts after which a particle is abandoned: the impact budget, rounded up."""
        from vibrosweep.kernels.advance import LOOK_AFTER  # slow to import

        return -(-self.measures.impact_budget // LOOK_AFTER) * LOOK_AFTER

    @property
    def windowed(self) -> bool:
        """True where landings before the window are possible."""
        # a launch before a window that begins at 0 is early in any unit
        begin = amount(self.measures.transient)
        early_launch = not isinstance(self.launch, str) and min(self.launch) < begin
        return begin > 0.0 or early_launch

    @property
    def times(self) -> dict[str, Time]:
        """End of the observation, and the beginning of the window of measures if it is finite."""
        begin = self.measures.transient
        windowed = {"transient": begin} if math.isfinite(amount(begin)) else {}
        return {"duration": self.duration, **windowed}

    def forcing(self, varied: Collection[str] = ()) -> str:
        """Return the name of the forcing; a varying one replaces that of the scene."""
        return forcing_of([name for name in varied if name in FORCINGS] or self.given)

    def quantities(self, varied: Mapping[str, Array], size: int = 0) -> dict[str, Array]:
        """Return all quantities of realizations in which some `INPUTS` vary.

        `varied` and the result hold arrays of shape (realization,); without a varying input there
        are `size` realizations.  The result holds the stated inputs, all of
        `vibrosweep.model.parameters.PARAMETERS`, for a sprung base all of
        `vibrosweep.model.parameters.MOUNT`, the acceleration of the base, and with noise the random
        stream of each realization, by default its index.
        """
        size = size or max((values.size for values in varied.values()), default=1)
        others = [name for name in (*varied, *self._given) if name not in FORCINGS]
        names = inputs_of([self.forcing(varied), *others], self.base)
        found = completed(
            {
                n: np.ascontiguousarray(varied[n]) if n in varied else np.full(size, self.inputs[n])
                for n in names
            },
            self.waveform,
        )
        if self.noise(varied):
            found[STREAM] = varied.get(STREAM, np.arange(size, dtype=np.float64))
        return found

    @property
    def _given(self) -> list[str]:
        """Names of the inputs that were stated, except a noise of zero."""
        return [name for name in self.given if name not in NOISE or self.inputs.get(name) != 0.0]

    def noise(self, varied: Collection[str] = ()) -> tuple[str, ...]:
        """Return the names of `vibrosweep.model.parameters.NOISE` that vary or are not zero."""
        return tuple(name for name in NOISE if name in (*varied, *self._given))

    def parameters(self, varied: Mapping[str, Array], size: int = 0) -> dict[str, Array]:
        """Return the parameters that the engine takes, each of shape (realization,)."""
        return only_parameters(self.quantities(varied, size))

    def timed(self, varied: Mapping[str, Array], size: int = 0) -> dict[str, Array]:
        """Return the `quantities` of these realizations, and their times in s."""
        found = self.quantities(varied, size)
        return found | {n: in_seconds(t, found["frequency"]) for n, t in self.times.items()}

    def varying(self, varied: Collection[str]) -> tuple[str, ...]:
        """Return the names of quantities and times that differ if some inputs vary."""
        times = [name for name, time in self.times.items() if isinstance(time, Periods)]
        inputs = [name for name in varied if name != STREAM]
        found = differing(inputs, self.forcing(varied))
        found = (*found, STREAM) if self.noise(varied) else found
        return (*found, *times) if "frequency" in varied else found


COLUMNS: Final = ("height", "acceleration")  # of a trace
_STORED: Final = (HARMONICS_NAME, *FittedTrace._fields)  # keys of a fitted trace in a result


@dataclass(frozen=True)
class Traced:
    """A waveform that is given by the path of a trace."""

    trace: str
    column: str
    harmonics: int


def waveform_of(value: object) -> Waveform | Traced:
    """Return the waveform that a key gives, or raise a ValueError that says what is allowed."""
    if value in (SINE_NAME, PARABOLIC_NAME):
        return Waveform(str(value))
    if isinstance(value, Mapping) and set(value) == {"trace", "column", HARMONICS_NAME}:
        return _traced(**value)
    if not isinstance(value, Mapping) or set(value) not in ({HARMONICS_NAME}, {*_STORED}):
        word = value.lower() if isinstance(value, str) else ""
        answer = f"; {ANSWERS[word]}" if word in ANSWERS else ""
        raise ValueError(f"{FORMS}{answer}")
    origin = FittedTrace(*(value[name] for name in FittedTrace._fields)) if "trace" in value else ()
    return harmonics_of(value[HARMONICS_NAME], origin)


def stored(attributes: Mapping[str, Any]) -> Waveform:
    """Return the waveform that attributes of a result hold; by default the sine."""
    text = str(attributes.get("waveform", SINE_NAME))
    value = text if name_in(attributes) == text else tomllib.loads(f"waveform = {text}")["waveform"]
    found = waveform_of(value)
    return found if isinstance(found, Waveform) else SINE


def _traced(trace: object, column: object, harmonics: Any) -> Traced:
    """Check the description of a trace; a ValueError says what is wrong with it."""
    if not isinstance(trace, str) or not trace:
        raise ValueError('the trace must be the path of a CSV file, as in "shaker.csv"')
    if column not in COLUMNS:
        raise ValueError(f"the column of the trace must be {quoted(COLUMNS)}")
    whole = isinstance(harmonics, int) and not isinstance(harmonics, bool)
    if not whole or not 1 <= harmonics <= MOST_HARMONICS:
        raise ValueError(f"harmonics of a trace: must be a whole number from 1 to {MOST_HARMONICS}")
    return Traced(trace, column, harmonics)
