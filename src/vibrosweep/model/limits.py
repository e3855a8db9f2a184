"""Answers to words that are not keys: the key to use, or why there is none.

The page docs/limits.md answers at length.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

from vibrosweep.mistakes import nearest
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.mount import OF_MOUNT
from vibrosweep.model.parameters import HIGH_BOUNCE, SPRUNG, Parameter

# Share of equal letters from which the name of a column is that of a parameter, misspelled
ALMOST: Final = 0.8
_PAGE: Final = "; docs/limits.md says what to use then"
_RANDOM: Final = (
    "noise is given by restitution_noise, kick_noise or drive_noise, each a standard deviation"
)
_SHAPE: Final = (
    'the shape of the motion of the base is its waveform: "sine", "parabolic", or harmonics with '
    "number, weight and phase, as in [[1, 1.0, 0.0], [2, 0.4, 1.1]]"
)
_LAW: Final = (
    'rebound says what follows a kick that points down, "rest" or "reflect"; restitution_law says '
    "what share of the impact speed remains, and vibrosweep.register_law adds laws"
)
_FALLS: Final = (
    "a restitution that falls with the speed of the impact is a law of restitution: give "
    'restitution_law = "plastic", the power -1/4, or "viscoelastic", with restitution_speed'
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
    _RANDOM: "noise sigma random stochastic randomness noise_level noise_amplitude white_noise",
    _SHAPE: "shape wave wave_form profile harmonics harmonic tones forcing2 amplitude2 frequency2 "
    "phase2 second_frequency second_amplitude second_harmonic triangle square sawtooth signal",
    _LAW: "law rebound_law impact_law collision_law",
    _FALLS: "restitution_exponent velocity_exponent",
    _AIR: "drag air air_drag air_resistance drag_coefficient viscosity buoyancy wind",
    _TURNS: "spin rotation rotate angular_velocity inertia friction friction_coefficient "
    "tangential_restitution rolling",
    _VERTICAL: "tilt incline inclination slope tilt_angle horizontal x_velocity",
    _WALLS: "wall walls stop stops ceiling lid box container impact_pair",
    _MEETINGS: "collision collisions ball_radius particle_radius radius diameter size interaction",
    _CONTACT: "stiffness contact_stiffness elasticity deformation hertz",
    _RAMP: "ramp chirp sweep_rate ramp_rate frequency_end amplitude_end frequency_stop envelope",
}
ANSWERS: Final = {word: answer for answer, words in _WORDS.items() for word in words.split()}


def answer_to(word: str, known: Collection[str]) -> str:
    """Return the answer to a word, or a question for the known key that it abbreviates, or ""."""
    meant = another_name(word)
    question = f'did you mean "{meant}"?' if meant in known else ""
    return ANSWERS.get(word.lower().replace("-", "_"), question)


def another_name(word: str, base: str = HIGH_BOUNCE) -> str | None:
    """Return the parameter that a word abbreviates: by its symbol, or by a part of its name."""
    short, known = word.lower(), _known(base)
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


def likely_parameter(word: str, base: str = HIGH_BOUNCE) -> str | None:
    """Return the parameter of a base that an unknown word probably means."""
    return another_name(word, base) or nearest(word, _known(base))


def _known(base: str) -> dict[str, Parameter]:
    return {n: p for n, p in INPUTS.items() if base == SPRUNG or n not in OF_MOUNT}
