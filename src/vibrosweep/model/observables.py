"""What is measured of a scene: the requested measures, their window, and observables.

An observable is a function of a user that is called with every landing.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from types import FunctionType
from typing import Any, Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.functions import changes_its_arguments, digest_of, plain, source_of
from vibrosweep.model.measures import ALWAYS, MEASURES, RESERVED, TRANSIENT_PERIODS, Variable
from vibrosweep.model.parameters import SPRUNG, Time
from vibrosweep.model.restitution_laws import VISCOELASTIC


class Landing(NamedTuple):
    """A landing in the window, the argument of an observable's function.

    Attributes
    ----------
    phase
        Phase of the forcing in turns, -1/2 to 1/2; 0 where the velocity of the base rises through
        zero.
    flight_time
        Duration in forcing periods of the flight that ends here.
    impact_speed, rebound
        Speeds relative to the base, before the impact and at lift-off, in units of g / (2 f): from
        a base at rest, a flight with rebound 1 lasts one forcing period.  If the particle rests,
        `rebound` is the speed at the end of the rest.
    rests
        True if the particle rests on the base.

    Examples
    --------
    >>> import numpy as np, vibrosweep as vs
    >>> def rests(totals, landing):
    ...     totals[0] += landing.rests
    >>> totals = np.zeros(1)
    >>> rests(totals, vs.Landing(0.1, flight_time=0.5, impact_speed=0.5, rebound=0.0, rests=True))
    >>> totals
    array([1.])
    """

    phase: float
    flight_time: float
    impact_speed: float
    rebound: float
    rests: bool


# Ways in which totals of particles combine to those of a realization
COMBINED: Final = {"sum": np.add, "max": np.fmax, "min": np.fmin, "each": None}
# Ways in which the numbers of a particle's landings combine, with the neutral element of each
NEUTRAL: Final = {"sum": 0.0, "max": -np.inf, "min": np.inf}
UNIT: Final = re.compile(r"(m|s)(-?\d+)?")


@dataclass(frozen=True)
class Observable:
    """A function of every landing, compiled into the kernel, and its variable in a result.

    Parameters
    ----------
    name
        Name of the variable in the result.
    function
        Plain Python that numba compiles, in one of two forms.  ``function(landing)`` returns a
        number for a `Landing` in the window, in vector code if it has no branch; ``landings`` says
        how the numbers of a particle's landings combine.  An accumulator,
        ``function(totals, landing)``, is called for the landings of each particle in their order.
        It changes the `totals` of the particle, a float64 array with one number for each of
        `values`, or with one number, and returns nothing.
    meaning
        Long name of the variable.
    units
        Unit of the totals: ``"1"``, or a product of powers of m and s, as in ``"m s-1"``.  The
        function computes in forcing periods (1 / f) and lengths of g / (2 f^2); totals are
        converted.
    along, values
        Name of a dimension of the variable, and its coordinate: increasing numbers, such as the
        middles of the bins of a histogram.  None by default.
    landings
        Way in which the numbers of a particle's landings combine: ``"sum"``, ``"max"`` or
        ``"min"``; empty for a function that changes totals.  With one of the three, repetitions of
        a cycle are added exactly, as for every statistic, and `vibrosweep.verify`
        compares the values with proved ones.  A maximum or minimum of no landings is NaN.
    particles
        Way in which the totals of particles combine: ``"sum"``, ``"max"``, ``"min"``; or ``"each"``
        for a variable of each particle.  By default as `landings`, else ``"sum"``.
    initial
        Initial value of `totals`, ``float("inf")`` for a minimum; a particle without a landing in
        the window keeps it.

    Raises
    ------
    ParameterError
        A parameter is not allowed, the function draws random numbers, or it uses anything from
        outside except numbers, texts, numpy, math, and functions of the same kind, which need not
        be compiled: other values could change without notice.

    Examples
    --------
    >>> import numpy as np, vibrosweep as vs
    >>> def fastest(totals, landing):
    ...     totals[0] = max(totals[0], landing.impact_speed)
    >>> impact = vs.Observable("fastest_impact", fastest, "fastest impact", "m s-1",
    ...                         particles="max")
    >>> found = vs.sweep(amplitude=0.0, restitution=0.9, observables=[impact])
    >>> print(found.fastest_impact.values, found.fastest_impact.units)
    [5.] m s-1
    """

    name: str
    function: Callable[..., Any] = field(compare=False)
    meaning: str
    units: str = "1"
    along: str = ""
    values: tuple[float, ...] = ()
    particles: str = ""
    initial: float = 0.0
    landings: str = ""
    code: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "function", plain(self.function))
        object.__setattr__(self, "values", _numbers(self.name, self.values))
        object.__setattr__(self, "particles", self.particles or self.landings or "sum")
        wrong = next(self._mistakes(), "")
        if wrong:
            raise ParameterError(f"observable {self.name!r}: {wrong}")
        digest = digest_of([plain(self.function)], f"observable {self.name!r}")
        object.__setattr__(self, "code", digest)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without `code`, which another process computes from its own function."""
        given = (self.name, self.function, self.meaning, self.units, self.along, self.values)
        return type(self), (*given, self.particles, self.initial, self.landings)

    def _mistakes(self) -> Iterator[str]:
        for key, word in {"name": self.name, "along": self.along or "none"}.items():
            if not isinstance(word, str) or not word.isidentifier():
                yield f"{key} = {word!r} must be a word of letters, digits and _"
            elif word in RESERVED or word in INPUTS:
                yield f"{key} = {word!r} is a name that results already use; choose another"
        if self.name == self.along:
            yield f"along = {self.along!r} must be another word than the name"
        if not isinstance(self.function, FunctionType):
            yield f"function = {self.function!r} must be a Python function"
        else:
            yield from self._mistakes_of_function()
        if not isinstance(self.meaning, str) or not self.meaning.strip():
            yield f"meaning = {self.meaning!r} must say in words what it is"
        if self.units != "1" and not all(map(UNIT.fullmatch, str(self.units).split(" "))):
            yield f"units = {self.units!r} must be '1' or powers of m and s, as 'm s-1'"
        steps = np.diff(self.values)
        if bool(self.along) != bool(self.values) or not np.all(steps > 0.0):
            yield "along must be given with values, which are numbers that increase"
        if not np.all(np.isfinite(self.values)):
            yield "values must be finite"
        if self.particles not in COMBINED:
            yield f"particles = {self.particles!r} must be one of {', '.join(COMBINED)}"
        if not isinstance(self.initial, int | float):
            yield f"initial = {self.initial!r} must be a number"

    def _mistakes_of_function(self) -> Iterator[str]:
        arguments = len(inspect.signature(self.function).parameters)
        if not self.landings:
            if arguments != 2:
                yield (
                    "function must take two arguments, as in function(totals, landing), or one, "
                    "with landings, as in function(landing)"
                )
            elif not changes_its_arguments(plain(self.function)):
                yield "function must change totals, as in totals[0] += 1.0; it changes nothing"
            return
        if self.landings not in NEUTRAL:
            yield f"landings = {self.landings!r} must be one of {', '.join(NEUTRAL)}"
        if arguments != 1:
            yield "function must take one argument with landings, as in function(landing)"
        if self.along or self.initial != 0.0:
            yield "along and initial belong to functions that change totals, without landings"

    @property
    def source(self) -> str:
        """Source text of the function; empty if Python does not have it."""
        return source_of(self.function)

    @property
    def width(self) -> int:
        """Number of totals of a particle."""
        return max(1, len(self.values))

    @property
    def variable(self) -> Variable:
        """Variable that the observable adds to a result."""
        dims: tuple[str, ...] = ("realization",)
        dims += ("particle",) if self.particles == "each" else ()
        dims += (self.along,) if self.along else ()
        return Variable(self.name, dims, "float64", self.units, self.meaning)

    def combined(self, totals: Array) -> Array:
        """Combine totals of shape (realization, particle, total), in the order of particles."""
        if self.landings in ("max", "min"):
            totals = np.where(totals == NEUTRAL[self.landings], np.nan, totals)
        rule = COMBINED[self.particles]
        if rule is not None:
            combined = totals[:, 0].copy()
            for k in range(1, totals.shape[1]):
                rule(combined, totals[:, k], out=combined)
            totals = combined
        return totals if self.along else totals[..., 0]

    def scale(self, frequency: Any, gravity: Any) -> Any:
        """Return the factor from the units of the function to `units` in each realization."""
        factor = 1.0 + 0.0 * frequency
        for unit, power in UNIT.findall(self.units):
            base = 1.0 / frequency if unit == "s" else gravity / (2.0 * frequency * frequency)
            factor = factor * base ** int(power or 1)
        return factor


def observables_of(given: Iterable[Observable]) -> tuple[Observable, ...]:
    """Check the observables of a sweep, and take their functions as they are now.

    Raises a ParameterError for anything but an `Observable`, and for two with a common name, or
    with a common dimension but different values.
    """
    if not isinstance(given, Iterable):
        raise ParameterError(f"observables = {given!r}: must be a list of vibrosweep.Observable")
    for observable in (given := tuple(given)):
        if not isinstance(observable, Observable):
            raise ParameterError(f"observables: {observable!r} must be a vibrosweep.Observable")
    # a number that a function uses may have changed since the observable was made
    found = tuple(replace(observable) for observable in given)
    names = [o.name for o in found] + list({o.along for o in found if o.along})
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ParameterError(
            f"observables: names that occur more than once: {', '.join(twice)}; every observable "
            f"and every dimension needs a unique name"
        )
    lengths = {(o.along, o.values) for o in found if o.along}
    if len(lengths) > len({along for along, _ in lengths}):
        raise ParameterError("observables: those along one dimension must have the same values")
    return found


def _numbers(name: str, values: object) -> tuple[float, ...]:
    """Return values as a tuple; a ParameterError unless they are a list of numbers."""
    try:
        array = np.array(values, np.float64)
    except (TypeError, ValueError):
        array = np.empty(())
    if array.ndim != 1:
        raise ParameterError(f"observable {name!r}: values = {values!r} must be a list of numbers")
    return tuple(array.tolist())


@dataclass(frozen=True)
class Measures:
    """Values of the keys of [measure], and the observables of Python, which have no key.

    The keys are those of `MEASURES` and `OPTIONS` of `vibrosweep.model.measures`.  A measure
    switches on the measures that it requires.
    """

    transient: Time = 0.0
    separation: bool = False
    per_particle: bool = False
    regimes: bool = False
    lyapunov: bool = False
    trust: bool = False
    ordering: bool = False
    undecided: bool = False
    joint: bool = False
    impact_speed: bool = False
    tolerance: float = 1e-9
    impact_budget: int = 10_000_000
    observables: tuple[Observable, ...] = ()

    def __post_init__(self) -> None:
        taken = [measure for key, measure in MEASURES.items() if getattr(self, key)]
        for required in {key for measure in taken for key in measure.requires}:
            object.__setattr__(self, required, True)

    def over(self, base: str, restitution_law: str) -> Measures:
        """Return these measures and those that are always taken with this base or this law."""
        limited = restitution_law == VISCOELASTIC
        return replace(
            self,
            ordering=self.ordering or base == SPRUNG,
            undecided=self.undecided or base == SPRUNG,
            impact_speed=self.impact_speed or limited,
        )

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Variables of a result, in their order."""
        taken = (measure for key, measure in MEASURES.items() if getattr(self, key))
        return (
            *ALWAYS,
            *(variable for measure in taken for variable in measure.variables),
            *(observable.variable for observable in self.observables),
        )

    @property
    def observable_names(self) -> set[str]:
        """Names of the variables and dimensions of observables."""
        return {o.name for o in self.observables}.union(self.observable_dims)

    @property
    def observable_dims(self) -> dict[str, tuple[float, ...]]:
        """Dimensions of observables, with their coordinates."""
        return {o.along: o.values for o in self.observables if o.along}


# The keys of [measure] with their defaults; None for an alternative to another key
KEYS: Final[Mapping[str, bool | float | None]] = {
    "transient": 0.0,
    TRANSIENT_PERIODS: None,
    **{f.name: getattr(Measures(), f.name) for f in fields(Measures) if f.name != "observables"},
}
