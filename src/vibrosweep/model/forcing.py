"""Inputs of a scene: the four ways to give the forcing of the base, and hints on unknown keywords.

The base has the velocity V0 sin(2 pi f t + phi).  At a landing, a particle gains (1 + e) times the
velocity of the base, which is the kick of the high-bounce map:

    A = (1 + e) V0        V0 = 2 pi f B        Gamma = 2 pi f V0 / g

For another waveform V0 is the factor of the given velocity, B half the height from the lowest to
the highest level, and Gamma the greatest downward acceleration, from which a particle lifts off.

The kernels take the amplitude A, and this double defines the realization.  In the same way the
masses of a particle and of the base may be given in place of their ratio.

An unknown keyword gets a hint: the key to use, or why there is none.  The page
docs/limits.md tells more.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import nearest
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    LARGEST,
    MASS_RATIO,
    MASSES,
    MOUNT,
    NOISE,
    OF_MOUNT,
    OF_RESTITUTION,
    PARAMETERS,
    SPRUNG,
    STREAM,
    Parameter,
    by_name,
)
from vibrosweep.model.restitution_laws import range_mistake
from vibrosweep.model.shapes import SINE, Waveform

AMPLITUDE: Final = "amplitude"
ACCELERATION: Final = "base_acceleration"

FORCINGS: Final = by_name(
    PARAMETERS[AMPLITUDE],
    # so that A <= 2 V0 is at most LARGEST; for the other two, A depends on f and g
    Parameter("base_velocity", "V0", "m s-1", "peak base velocity", math.nan, 0.0, LARGEST / 2),
    Parameter("base_displacement", "B", "m", "peak base displacement", math.nan, 0.0, LARGEST),
    Parameter(
        ACCELERATION,
        "Gamma",
        "1",
        "base acceleration in g",
        math.nan,
        0.0,
        LARGEST,
    ),
)

# All inputs of a realization, in the order of files: the parameters, with the four forcings in
# place of the amplitude, then those of a law of restitution and of a mount, and noise
INPUTS: Final[Mapping[str, Parameter]] = {
    "restitution": PARAMETERS["restitution"],
    **FORCINGS,
    **PARAMETERS,
    **OF_RESTITUTION,
    **OF_MOUNT,
    **NOISE,
}

# Parameters that relate each forcing to V0
_SOURCES: Final[Mapping[str, frozenset[str]]] = {
    AMPLITUDE: frozenset({"restitution"}),
    "base_velocity": frozenset(),
    "base_displacement": frozenset({"frequency"}),
    ACCELERATION: frozenset({"frequency", "gravity"}),
}


def forcing_of(given: Collection[str]) -> str:
    """Return the forcing among given names; by default the amplitude.

    Raises a ParameterError if there are two or more.
    """
    found = [name for name in FORCINGS if name in given]
    if len(found) > 1:
        raise ParameterError(
            f"{' and '.join(found)}: each gives the forcing; give exactly one of them"
        )
    return found[0] if found else AMPLITUDE


def inputs_of(given: Collection[str], base: str) -> tuple[str, ...]:
    """Return the names of the inputs that describe a realization, given or by default.

    The given names must be free of mistakes that `vibrosweep.model.parameters.mount_mistakes` and
    `vibrosweep.model.restitution_laws.speed_mistakes` find.  Raises a ParameterError for two
    forcings.
    """
    optional = {*OF_RESTITUTION, *NOISE}
    excluded = (FORCINGS.keys() - {forcing_of(given)}) | (optional - {*given})
    if base != SPRUNG:
        excluded |= OF_MOUNT.keys()
    else:
        excluded |= MASSES.keys() if MASSES.keys().isdisjoint(given) else {MASS_RATIO}
    return tuple(name for name in INPUTS if name not in excluded)


def differing(varied: Collection[str], forcing: str) -> tuple[str, ...]:
    """Return the quantities that differ between realizations: varied inputs, and derived ones.

    `forcing` is the name of the given forcing, varied or not.
    """
    derived = [n for n in (AMPLITUDE, ACCELERATION, MASS_RATIO) if n not in (forcing, *varied)]
    return (*varied, *(name for name in derived if not sources(name, forcing).isdisjoint(varied)))


def sources(name: str, forcing: str) -> frozenset[str]:
    """Return the inputs from which a derived quantity follows.

    The quantity is the amplitude, the acceleration of the base, or the ratio of masses.
    """
    if name == MASS_RATIO:
        return frozenset(MASSES)
    return _SOURCES[forcing] | _SOURCES[name] | {forcing}


def completed(given: Mapping[str, Array], waveform: Waveform = SINE) -> dict[str, Array]:
    """Add the amplitude and acceleration of the base, and the ratio of masses, to given inputs.

    The inputs are those of `inputs_of`, each of shape (realization,); the result has the order of
    `INPUTS`.  An amplitude that follows from a displacement or an acceleration, and a ratio of
    masses, may be above their ranges; `vibrosweep.model.parameters.representable` finds these.
    """
    name, e = forcing_of(given), given["restitution"]
    value, frequency, gravity = given[name], given["frequency"], given["gravity"]
    fall = waveform.fall * frequency
    if name == AMPLITUDE:
        velocity = value / (1.0 + e)
    elif name == "base_displacement":
        velocity = waveform.per_displacement * frequency * value
    elif name == ACCELERATION:
        velocity = value * gravity / fall
    else:
        velocity = value
    found = {AMPLITUDE: (1.0 + e) * velocity, ACCELERATION: fall * velocity / gravity}
    if not MASSES.keys().isdisjoint(given):
        particle, base = (given[mass] for mass in MASSES)
        with np.errstate(over="ignore"):  # `representable` finds it later
            found[MASS_RATIO] = particle / base
    every = found | dict(given)
    return {name: every[name] for name in INPUTS if name in every}


def only_parameters(values: Mapping[str, Array]) -> dict[str, Array]:
    """Return the parameters that the engine takes; optional ones only if they are given."""
    others = [name for name in (*OF_RESTITUTION, *MOUNT, *NOISE, STREAM) if name in values]
    return {name: values[name] for name in (*PARAMETERS, *others)}


def refuse_extreme(values: Mapping[str, Array], forcing: str, law: str) -> None:
    """Raise a ParameterError for an amplitude, a ratio of masses or a restitution out of range.

    The values are those of `completed`.  The error names the given forcing or the masses.  The
    range of the restitution is that of its law.
    """
    if wrong := range_mistake(law, values["restitution"]):
        raise ParameterError(wrong)
    allowed = PARAMETERS[AMPLITUDE]
    if not np.all(allowed.accepts(values[AMPLITUDE])):
        raise ParameterError(
            f"{forcing}: gives an amplitude of {float(np.max(values[AMPLITUDE])):.3g} m s-1, which "
            f"must be {allowed.allowed}"
        )
    allowed = MOUNT[MASS_RATIO]
    if MASS_RATIO in values and not np.all(allowed.accepts(values[MASS_RATIO])):
        raise ParameterError(
            f"{' and '.join(MASSES)}: give a {MASS_RATIO} of "
            f"{float(np.max(values[MASS_RATIO])):.3g}, which must be {allowed.allowed}"
        )


# Share of equal letters from which the name of a column is that of a parameter, misspelled
ALMOST: Final = 0.8
_PAGE: Final = "; docs/limits.md lists what to use instead"
_RANDOM: Final = (
    "noise is given by restitution_noise, kick_noise or drive_noise, each a standard deviation; "
    "restitution_noise is absolute, restitution_noise_relative in units of restitution"
)
_SHAPE: Final = (
    'the shape of the motion of the base is its waveform: "sine", "parabolic", or harmonics with '
    "number, weight and phase, as in [[1, 1.0, 0.0], [2, 0.4, 1.1]]"
)
_LAW: Final = (
    'rebound sets what follows a kick that points down, "rest" or "reflect"; restitution_law sets '
    "what share of the impact speed remains, and vibrosweep.register_law adds laws"
)
_FALLS: Final = (
    "a restitution that falls with the speed of the impact is a law of restitution: give "
    'restitution_law = "plastic", "viscoelastic" or "power", with restitution_speed, or "points"'
)
_AIR: Final = f"flights are parabolas: air has no drag and no buoyancy{_PAGE}"
_TURNS: Final = f"balls do not rotate and have no friction; kick_noise may stand for it{_PAGE}"
_VERTICAL: Final = f"balls and base move along one vertical line: nothing is tilted{_PAGE}"
_WALLS: Final = f"there is one base and no other wall, stop or ceiling{_PAGE}"
_MEETINGS: Final = f"balls are points that pass through each other in the air{_PAGE}"
_CONTACT: Final = f"an impact takes no time; contact_time is the shortest stay on the base{_PAGE}"
_RAMP: Final = (
    f"frequency and forcing are constant: an axis of a grid, or bifurcation, takes values in turn"
    f"{_PAGE}"
)

_WORDS: Final = {
    _RANDOM: "noise sigma random stochastic randomness restitution_std noise_level "
    "noise_amplitude white_noise",
    _SHAPE: "shape wave wave_form profile harmonics harmonic tones forcing2 amplitude2 frequency2 "
    "phase2 second_frequency second_amplitude second_harmonic triangle square sawtooth signal",
    _LAW: "law rebound_law impact_law collision_law",
    _FALLS: "velocity_exponent",
    _AIR: "drag air air_drag air_resistance drag_coefficient viscosity buoyancy wind",
    _TURNS: "spin rotation rotate angular_velocity inertia friction friction_coefficient "
    "tangential_restitution rolling",
    _VERTICAL: "tilt angle incline inclination slope tilt_angle horizontal x_velocity",
    _WALLS: "wall walls second_wall gap stop stops ceiling lid box container impact_pair",
    _MEETINGS: "collision collisions ball_radius particle_radius radius diameter size interaction",
    _CONTACT: "stiffness contact_stiffness elasticity deformation hertz",
    _RAMP: "ramp frequency_ramp chirp sweep_rate ramp_rate frequency_end amplitude_end "
    "frequency_stop envelope",
}
ANSWERS: Final = {word: answer for answer, words in _WORDS.items() for word in words.split()}


def answer_to(word: str, known: Collection[str]) -> str:
    """Return the answer to a word, or a question for the known key that it abbreviates, or ""."""
    meant = another_name(word)
    question = f'did you mean "{meant}"?' if meant in known else ""
    return ANSWERS.get(word.lower().replace("-", "_"), question)


def another_name(word: str) -> str | None:
    """Return the parameter that a word abbreviates: by its symbol, or by a part of its name."""
    short, known = word.lower(), _known(HIGH_BOUNCE)
    if meant := _of_symbol(word, known):
        return meant
    for name in known:
        if short and name.startswith(short):
            return name
    parts = [name for name in known if short in name.split("_")]
    return parts[0] if len(parts) == 1 else None


def _of_symbol(word: str, known: Mapping[str, Parameter]) -> str | None:
    exact = (name for name, parameter in known.items() if word == parameter.symbol)
    alike = (n for n, parameter in known.items() if word.lower() == parameter.symbol.lower())
    return next(exact, None) or next(alike, None)  # v0 is not V0


def misspelled(word: str, base: str = HIGH_BOUNCE) -> str | None:
    """Return the parameter that a column means by its symbol, its beginning or almost its name.

    Any other column is a label: `time` and `case` look like parts of names only.
    """
    short, known = word.lower(), _known(base)
    begun = (name for name in known if len(short) > 2 and name.startswith(short))
    return _of_symbol(word, known) or next(begun, None) or nearest(word, known, ALMOST)


def likely_parameter(word: str) -> str | None:
    """Return the parameter that an unknown word probably means."""
    return another_name(word) or nearest(word, _known(HIGH_BOUNCE))


def _known(base: str) -> dict[str, Parameter]:
    return {n: p for n, p in INPUTS.items() if base == SPRUNG or n not in OF_MOUNT}
