"""The physical parameters, their units and ranges, and their dimensionless form.

A realization is one set of physical parameters.  The kernels take only dimensionless combinations:
phases in turns, flight times in forcing periods.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import cut


@dataclass(frozen=True)
class Periods:
    """A time in forcing periods; in s it depends on the frequency of the realization."""

    number: float


Time = float | Periods  # a plain number is in s


def amount(time: Time) -> float:
    """Return the number of seconds or periods."""
    return time.number if isinstance(time, Periods) else time


def fraction_of(time: Time, share: float) -> Time:
    """Return a share of a time, in the same unit."""
    return Periods(time.number * share) if isinstance(time, Periods) else time * share


def in_seconds(time: Time, frequency: Array) -> Array:
    """Return a time in s for each realization; `frequency` in Hz, shape (realization,)."""
    if isinstance(time, Periods):
        return np.asarray(time.number / frequency)
    return np.full(frequency.shape, time)


def in_periods(time: Time, frequency: Array) -> Array:
    """Return a time in periods for each realization; `frequency` in Hz, shape (realization,)."""
    if isinstance(time, Periods):
        return np.full(frequency.shape, time.number)
    return np.asarray(frequency * time)


def precedes(first: Time, second: Time, frequency: Array) -> bool:
    """Return whether one time is before another at every frequency (Hz)."""
    if isinstance(first, Periods) == isinstance(second, Periods):
        return amount(first) < amount(second)
    return bool(np.all(in_seconds(first, frequency) < in_seconds(second, frequency)))


def unit_of(time: Time) -> str:
    """Return the unit of a time in words, for messages."""
    return "forcing periods" if isinstance(time, Periods) else "s"


HIGH_BOUNCE: Final = "high-bounce"
MOVING: Final = "moving"
SPRUNG: Final = "sprung"

# The laws of rebound that each base implements
LAWS_OF: Final[dict[str, tuple[str, ...]]] = {
    HIGH_BOUNCE: ("rest", "reflect"),
    MOVING: ("rest",),
    SPRUNG: ("rest",),
}
BASES: Final = tuple(LAWS_OF)
LAWS: Final = tuple(dict.fromkeys(law for laws in LAWS_OF.values() for law in laws))
STAGGERED: Final = "staggered"

# Whole periods are counted in float64, exactly up to 2**53; this leaves room for the last flights
MAX_PERIODS: Final = 2.0**51

# Between these limits, in SI units, no product of parameters that is computed, and no square of a
# flight time in forcing periods or seconds, leaves the range of normal doubles
SMALLEST: Final = 1e-30
LARGEST: Final = 1e30


@dataclass(frozen=True)
class Parameter:
    """One physical parameter: its name in code and files, its unit and its allowed range.

    Attributes
    ----------
    name, symbol, units, long_name
        Name in code and files, symbol in formulas, unit as in CF (``"1"`` for a pure number), and
        name in words.
    default
        Default value; NaN for none.
    low, high
        Ends of the allowed range, both included.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> isinstance(vs.PARAMETERS["restitution"], vs.Parameter)
    True
    >>> {name: p.default for name, p in vs.PARAMETERS.items() if p.units == "m s-1"}
    {'amplitude': 1.2, 'launch_velocity': 5.0}
    """

    name: str
    symbol: str
    units: str
    long_name: str
    default: float
    low: float
    high: float

    @property
    def allowed(self) -> str:
        """The allowed range in words, for error messages."""
        unit = "" if self.units == "1" else f" {self.units}"
        return f"at least {self.low:g} and at most {self.high:g}{unit}"

    def accepts(self, values: ArrayLike) -> NDArray[np.bool_]:
        """Return, element by element, whether values lie in the allowed range; NaN never does."""
        array = np.asarray(values, dtype=np.float64)
        return np.asarray((array >= self.low) & (array <= self.high))


def by_name(*parameters: Parameter) -> Mapping[str, Parameter]:
    """Return parameters by their names, in the same order."""
    return {parameter.name: parameter for parameter in parameters}


PARAMETERS: Final = by_name(
    Parameter("restitution", "e", "1", "coefficient of restitution", 0.90, 0.0, 1.0),
    Parameter("amplitude", "A", "m s-1", "amplitude of the kick", 1.20, 0.0, LARGEST),
    Parameter("frequency", "f", "Hz", "forcing frequency", 1.0, SMALLEST, 1e9),
    Parameter("phase", "phi", "rad", "forcing phase at t = 0", 0.0, -1e9, 1e9),
    Parameter("gravity", "g", "m s-2", "free-fall acceleration", 9.81, SMALLEST, LARGEST),
    Parameter("launch_velocity", "v0", "m s-1", "speed at launch", 5.0, 0.0, LARGEST),
    Parameter("contact_time", "tau_c", "s", "contact time", 1e-4, SMALLEST, LARGEST),
)

# Parameters of a sprung base; a default of NaN means none
MOUNT: Final = by_name(
    Parameter("mass_ratio", "mu", "1", "particle mass / base mass", math.nan, 0.0, 1e3),
    Parameter("mount_frequency", "f0", "Hz", "mount natural frequency", math.nan, SMALLEST, 1e9),
    Parameter("mount_damping", "zeta", "1", "damping ratio of the mount", 0.05, 0.0, 1e3),
)

RELATIVE_NOISE: Final = "restitution_noise_relative"
# Standard deviations of noise, all optional; that of the restitution is absolute, or relative to
# the nominal restitution
NOISE: Final = by_name(
    Parameter("restitution_noise", "sigma_e", "1", "noise of the restitution", 0.0, 0.0, LARGEST),
    Parameter(RELATIVE_NOISE, "sigma_e/e", "1", "relative restitution noise", 0.0, 0.0, LARGEST),
    Parameter("kick_noise", "sigma_V", "m s-1", "noise of the kick", 0.0, 0.0, LARGEST / 4),
    Parameter("drive_noise", "sigma_A", "1", "noise of the amplitude", 0.0, 0.0, 1e6),
)
STREAM: Final = "noise_stream"  # index of the random stream of each realization
# Numbers of streams, and of particles in each, that the counter of `vibrosweep.kernels.noise` holds
STREAMS: Final = 2**36
STREAM_PARTICLES: Final = 2**26

# Parameters of a law of restitution that depends on the speed; a default of NaN means none
OF_RESTITUTION: Final = by_name(
    Parameter("restitution_speed", "v_r", "m s-1", "speed of the law", math.nan, SMALLEST, LARGEST),
)


def refuse_masked(name: str, values: object) -> None:
    """Raise a ParameterError for masked values, whose numbers numpy would take for data."""
    listed = values if isinstance(values, list | tuple) else ()
    if np.ma.is_masked(values) or any(value is np.ma.masked for value in listed):
        raise ParameterError(f"{name}: holds masked values, which are not data; leave them out")


class Strengths(NamedTuple):
    """Noise of realizations; arrays of shape (realization,), or None for a kind that is off."""

    restitution: Array | None  # standard deviation of e
    # Standard deviation (1 + e) 2 f sigma_V / g of the flight after an impact, in forcing periods
    kick: Array | None
    drive: Array | None  # relative standard deviation of a in each forcing period
    stream: Array  # indices of random streams, whole numbers
    turns: Array  # whole turns in the phase of the forcing at t = 0, which its reduction leaves out


class Dimensionless(NamedTuple):
    """Dimensionless form of realizations, for the kernels; every array has shape (realization,)."""

    restitution: Array  # e
    # v_r, speed of the law of restitution as the duration of a flight; 0 for a constant one
    restitution_speed: Array
    kick: Array  # a = 2 f A / g, forcing periods
    launch_flight: Array  # u0 = 2 f v0 / g, duration of the first flight in forcing periods
    rest_flight: Array  # r = f tau_c, the longest flight time at which a particle comes to rest
    # Phase in turns, in [0, 1/4], at which the kick rises through r and a resting particle lifts
    # off; 0 if that never happens (a <= r)
    liftoff_phase: Array
    phase: Array  # phase of the forcing at t = 0 in turns, reduced to [-1/2, 1/2]
    begin_count: Array  # beginning of the window: whole periods
    begin_phase: Array  # beginning of the window: reduced phase
    end_count: Array  # end of the window: whole periods
    end_phase: Array  # end of the window: reduced phase
    noise: Strengths | None = None  # None: nothing is random


class Mounts(NamedTuple):
    """Bases of finite mass on their mounts; every array has shape (realization,)."""

    mass_ratio: Array  # mu, mass of one particle in units of that of the base
    natural: Array  # nu = f0 / f, natural frequency of the mount in units of that of the forcing
    damping: Array  # zeta, damping ratio of the mount
    # As kernels take them:
    restitution: Any  # law of restitution
    waveform: Any  # shape of the motion of the base without particles
    noise: Any = None  # random quantities of impacts


class Launches(NamedTuple):
    """Launch times in forcing periods, as whole periods and reduced phase.

    The phase of the forcing at t = 0 is not included.  Both arrays have shape (1, particle) if all
    realizations share them, else (realization, particle).
    """

    whole: Array
    phase: Array


def dimensionless(
    parameters: Mapping[str, Array], duration: Time, transient: Time = 0.0
) -> Dimensionless:
    """Convert realizations to the dimensionless form.

    Every parameter of `PARAMETERS`, and of `OF_RESTITUTION` if the law has one, is of shape
    (realization,) and within its range.  The transient is the beginning of the window of measures;
    -inf includes every landing.  Raises a ParameterError for a time of more forcing periods than
    can be counted exactly.
    """
    frequency = parameters["frequency"]
    per_velocity = 2.0 * frequency / parameters["gravity"]
    kick = per_velocity * parameters["amplitude"]
    (speed,) = (parameters.get(name) for name in OF_RESTITUTION)
    rest_flight = frequency * parameters["contact_time"]
    lifts = kick > rest_flight
    ratio = np.divide(rest_flight, kick, out=np.zeros_like(kick), where=lifts)
    turns = turns_of_radians(parameters["phase"])
    end_count, end_phase = _instant("duration", frequency, duration, turns)
    if math.isfinite(amount(transient)):
        begin_count, begin_phase = _instant("transient", frequency, transient, turns)
    else:
        begin_count, begin_phase = np.full_like(turns, amount(transient)), np.zeros_like(turns)
    return Dimensionless(
        # a copy: for read-only or non-contiguous arrays numba would compile the kernels again
        restitution=np.array(parameters["restitution"]),
        restitution_speed=np.zeros_like(kick) if speed is None else per_velocity * speed,
        kick=kick,
        launch_flight=per_velocity * parameters["launch_velocity"],
        rest_flight=rest_flight,
        liftoff_phase=arcsin_turns(ratio),
        phase=turns,
        begin_count=begin_count,
        begin_phase=begin_phase,
        end_count=end_count,
        end_phase=end_phase,
        noise=_strengths(parameters, per_velocity, turns),
    )


def _strengths(
    parameters: Mapping[str, Array], per_velocity: Array, turns: Array
) -> Strengths | None:
    """Return the noise of realizations, with their random streams; `turns` is the reduced phase."""
    if NOISE.keys().isdisjoint(parameters):
        return None
    kick = parameters.get("kick_noise")
    if kick is not None:
        kick = (1.0 + parameters["restitution"]) * per_velocity * kick
    slip, drive = (parameters.get(name) for name in ("restitution_noise", "drive_noise"))
    if RELATIVE_NOISE in parameters:
        slip = parameters[RELATIVE_NOISE] * parameters["restitution"]
    # copies, as for the restitution
    restitution, drive = (None if values is None else np.array(values) for values in (slip, drive))
    whole = np.rint(parameters["phase"] / math.tau - turns)
    return Strengths(restitution, kick, drive, np.array(parameters[STREAM], np.float64), whole)


def taken(problem: Dimensionless, which: Any) -> Dimensionless:
    """Return the arrays of some realizations; `which` indexes each array."""

    def row(values: Any) -> Any:
        if isinstance(values, tuple):
            return type(values)(*map(row, values))
        return None if values is None else values[which]

    return Dimensionless(*map(row, problem))


def mounts(
    parameters: Mapping[str, Array], restitution: Any, waveform: Any, noise: Any = None
) -> Mounts:
    """Convert the mounts of realizations to the dimensionless form."""
    ratio, frequency, damping = (parameters[name] for name in MOUNT)
    natural = frequency / parameters["frequency"]
    return Mounts(ratio, natural, damping, restitution, waveform, noise)


def _instant(what: str, frequency: Array, time: Time, turns: Array) -> tuple[Array, Array]:
    """Return whole periods and phase of the forcing at a time."""
    _require_countable(what, frequency, time)
    rate = 1.0 if isinstance(time, Periods) else frequency
    return reduced_turns(rate, amount(time), turns)


def launches(launch: str | tuple[float, ...], particles: int, frequency: Array) -> Launches:
    """Return launch times in forcing periods; frequencies in Hz have shape (realization,).

    `launch` holds times in s, or is ``"staggered"``: particle j starts at j / (particles
    frequency), so that launches are spread evenly over one forcing period.
    """
    if isinstance(launch, str):
        instants = np.arange(particles, dtype=np.float64) / particles
        count, phase = reduced_turns(1.0, instants[np.newaxis, :], 0.0)
        return Launches(count, phase)
    times = np.asarray(launch, dtype=np.float64)[np.newaxis, :]
    rate = frequency[:1] if np.all(frequency == frequency[:1]) else frequency
    _require_countable("launch time", rate, float(np.max(np.abs(times))))
    count, phase = reduced_turns(rate[:, np.newaxis], times, 0.0)
    return Launches(count, phase)


def representable(parameters: Mapping[str, Array], times: Iterable[Time]) -> NDArray[np.bool_]:
    """Return which realizations `dimensionless` and `launches` accept; shape (realization,).

    The parameters are within their ranges, except for an amplitude that follows from another
    forcing and a mass ratio that follows from masses, which may be too large.  Times are launch
    times, transient and duration; infinite ones are ignored.
    """
    usable = PARAMETERS["amplitude"].accepts(parameters["amplitude"])
    if "mass_ratio" in parameters:
        usable &= MOUNT["mass_ratio"].accepts(parameters["mass_ratio"])
    longest = {float: 0.0, Periods: 0.0}
    for time in times:
        number, unit = abs(amount(time)), Periods if isinstance(time, Periods) else float
        if math.isfinite(number):
            longest[unit] = max(longest[unit], number)
    usable &= _countable(parameters["frequency"], longest[float])
    return usable & _countable(parameters["frequency"], Periods(longest[Periods]))


def _countable(frequency: Array, time: Time) -> NDArray[np.bool_]:
    if isinstance(time, Periods):
        return np.full(frequency.shape, abs(time.number) <= MAX_PERIODS)
    # divided, because the product of time and frequency may overflow
    return np.asarray(abs(time) <= MAX_PERIODS / frequency)


def _require_countable(what: str, frequency: Array, time: Time) -> None:
    if not _countable(frequency, time).all():
        number, remedy = abs(amount(time)), "lower it"
        if not isinstance(time, Periods):
            number, remedy = number * float(np.max(frequency)), "lower it or the frequency"
        raise ParameterError(
            f"{what} = {amount(time):g} {unit_of(time)} is {number:.3g} forcing periods: at most "
            f"{MAX_PERIODS:.3g} can be counted exactly; {remedy}"
        )


# --- Angles in turns ------------------------------------------------------------------------------


def _split_product(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the product of a and b as rounded value and exact rounding error (Dekker 1971)."""

    def halves(v: Array) -> tuple[Array, Array]:
        shifted = 134217729.0 * v  # 2**27 + 1
        high = shifted - (shifted - v)
        return high, v - high

    product = a * b
    a_high, a_low = halves(a)
    b_high, b_low = halves(b)
    error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, error


def reduced_turns(rate: ArrayLike, time: ArrayLike, phase: ArrayLike) -> tuple[Array, Array]:
    """Split ``rate * time + phase`` into whole turns and a phase in [-1/2, 1/2].

    The arguments are in turns per second, seconds and turns; they broadcast.  The product is
    computed with its rounding error, so that the phase after 10**9 periods is as accurate as an
    early one.
    """
    rate, time, offset = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.float64) for v in (rate, time, phase))
    )
    product, error = _split_product(rate, time)
    count = np.rint(product)
    turns = ((product - count) + error) + offset
    carry = np.rint(turns)
    return count + carry, turns - carry


def turns_of_radians(phi: Array) -> Array:
    """Return phi / 2 pi, reduced to [-1/2, 1/2] and corrected for the rounding of 2 pi."""
    two_pi, two_pi_low = 2.0 * math.pi, 2.4492935982947064e-16
    quotient = phi / two_pi
    product, error = _split_product(quotient, np.asarray(two_pi))
    correction = (((phi - product) - error) - quotient * two_pi_low) / two_pi
    turns = (quotient - np.rint(quotient)) + correction
    return np.asarray(turns - np.rint(turns))


# Bound of the relative error, proved by checks/elementary_error.py
ARCSINE_ERROR = 6.3 * 2.0**-53
# 1 / (2 pi) as a sum of two doubles; a single one would cost half an ulp
ARCSINE_FIRST, ARCSINE_FIRST_LOW = 0.15915494309189535, -9.839338337591243e-18
# Polynomial in x^2 for (arcsin(x) / x - 1) / x^2 in turns, for x^2 <= 1/4, highest power first: the
# minimax of the relative error of the arcsine (9.8e-19), by the Remez exchange with 60 digits
ARCSINE_HIGHER = (
    0.005200684761607661,
    -0.0033545498665686958,
    0.003463765046412365,
    0.0005861756317760742,
    0.0017167290890160065,
    0.0018140124485332078,
    0.002225139116032715,
    0.002761592926005343,
    0.003560648710192094,
    0.004835436358835583,
    0.007105131393165858,
    0.011936620731844823,
    0.026525823848649373,
)


def arcsin_turns(x: Any) -> Any:
    """Return the phase in turns, from 0 to 1/4, whose sine is x, from 0 to 1."""
    far = x > 0.5
    z = far * (0.5 * (1.0 - x)) + (1 - far) * (x * x)
    root = far * np.sqrt(z) + (1 - far) * x
    higher = 0.0
    for coefficient in ARCSINE_HIGHER:
        higher = higher * z + coefficient
    near = root * ARCSINE_FIRST + root * (z * higher + ARCSINE_FIRST_LOW)
    return far * (0.25 - 2.0 * near) + (1 - far) * near


P = ParamSpec("P")
R = TypeVar("R")

# Ranges of arguments that are not parameters of a scene
_RANGES: Final = {
    "k": (SMALLEST, LARGEST),
    "natural": (SMALLEST, LARGEST),
    "turns": (-LARGEST, LARGEST),
    **dict.fromkeys(("acceleration", "kick", "velocity"), (0.0, LARGEST)),
    **dict.fromkeys(("launch_speed", "launch_flight", "rest_flight"), (0.0, LARGEST)),
}
_ARGUMENTS: Final[Mapping[str, Parameter]] = {
    **PARAMETERS,
    **OF_RESTITUTION,
    "mass_ratio": MOUNT["mass_ratio"],
    "damping": MOUNT["mount_damping"],
    **{name: Parameter(name, name, "1", name, math.nan, *ends) for name, ends in _RANGES.items()},
}


def physical(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function refuse NaN, and arguments outside the range of the parameter they name."""
    names = inspect.signature(function)

    @functools.wraps(function)
    def refusing(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            bound = names.bind(*args, **kwargs)
        except TypeError as error:
            raise TypeError(f"{function.__name__}() {error}") from None
        for name, given in bound.arguments.items():
            if name in _ARGUMENTS:
                allowed, values = _ARGUMENTS[name], as_numbers(name, given)
                if values.ndim and names.parameters[name].annotation == "float":
                    raise ParameterError(f"{name} = {cut(repr(given))}: must be one number")
                refused = values[~allowed.accepts(values)]
                if refused.size:
                    raise ParameterError(f"{name} = {refused[0]:g}: must be {allowed.allowed}")
                if np.asarray(given).dtype == object:  # of fractions and decimals
                    bound.arguments[name] = values[()]
        return function(*bound.args, **bound.kwargs)

    return refusing


def as_numbers(name: str, given: object) -> Array:
    """Return an argument as an array of floats; a ParameterError unless it holds real numbers."""
    try:
        found = np.asarray(given)
        if found.dtype.kind in "biufO":
            return np.asarray(found, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ParameterError(f"{name} = {cut(repr(given))}: must be a number, or an array of numbers")


MASS_RATIO: Final = "mass_ratio"

# Both masses together may replace their ratio
MASSES: Final = by_name(
    Parameter("particle_mass", "m", "kg", "mass of one particle", math.nan, 0.0, LARGEST),
    Parameter("base_mass", "M", "kg", "mass of the base", math.nan, SMALLEST, LARGEST),
)

# All parameters by which a mount may be given, in the order of files
OF_MOUNT: Final = {MASS_RATIO: MOUNT[MASS_RATIO], **MASSES, **MOUNT}


def noise_mistakes(given: Collection[str]) -> dict[str, str]:
    """Return the mistake of a noise of the restitution that is given in two ways."""
    absolute, relative, *_ = NOISE
    text = f"{absolute}, which is absolute, is given too; keep one of the two"
    return {relative: text} if absolute in given and relative in given else {}


def mount_mistakes(base: str, given: Collection[str]) -> dict[str, str]:
    """Return mistakes in the given parameters of the mount of a base, by parameter.

    Each text says what to change; there is none if the names are complete and consistent.
    """
    found = [name for name in OF_MOUNT if name in given]
    if base != SPRUNG:
        text = f'belongs to a base of finite mass: write base = "{SPRUNG}", or leave it out'
        return dict.fromkeys(found, text)
    mistakes = {}
    masses = [name for name in MASSES if name in given]
    if MASS_RATIO in given and masses:
        mistakes[masses[0]] = f"{MASS_RATIO} is given too; keep it or both masses"
    elif len(masses) == 1:
        (lacking,) = MASSES.keys() - {*masses}
        mistakes[lacking] = f"is missing; {masses[0]} needs it (in kg)"
    elif MASS_RATIO not in given and not masses:
        mistakes[MASS_RATIO] = (
            f'is missing; base = "{SPRUNG}" needs it (mass of one particle in units of that of the '
            f"base), or {' and '.join(MASSES)} in kg"
        )
    if "mount_frequency" not in given:
        mistakes["mount_frequency"] = (
            f'is missing; base = "{SPRUNG}" needs it (natural frequency in Hz)'
        )
    return mistakes
