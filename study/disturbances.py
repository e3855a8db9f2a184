"""Disturbances of a real table: noise, another waveform, e that falls with speed.

Sizes of noise are relative; speeds of the laws of restitution are relative to the impact speed of
the orbit, so that the restitution there is close to `restitution`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.optimize import brentq

from study.arrays import Array
from study.bases import HIGH_BOUNCE
from vibrosweep import simulate, theory
from vibrosweep.errors import SpecError

SIZES: Final = (0.01, 0.05)
HARMONICS: Final = ((1, 1.0, 0.0), (2, 0.4, 1.1))  # number, weight, phase in rad
YIELDING: Final = 0.8  # speed at which plastic balls begin to yield, over that of the orbit
OWN: Final = (
    "noise of the restitution, drawn for each impact",
    "noise of the kick, drawn for each impact",
)
DRIVE: Final = "noise of the drive, the same for all particles"
WAVEFORM: Final = "a base that does not move as a sine"
LAW: Final = "a restitution that falls with speed"
# Points in a period at which a waveform is evaluated
POINTS: Final = 200_000


@dataclass(frozen=True)
class Orbit:
    """Mode k at 1 Hz, where it attracts."""

    restitution: float
    periods: int
    amplitude: float  # m s-1
    phase: float  # of the landings, turns

    @property
    def velocity(self) -> float:
        """Velocity of the launch, m s-1."""
        return float(theory.locked_velocity(self.periods))


def disturbances(
    restitution: Any, amplitude: Any, periods: int
) -> dict[str, dict[str, dict[str, Any]]]:
    """Keys of `vibrosweep.simulate` for a scene near mode `periods`, as {kind: {name: keys}}."""
    speed = float(theory.locked_velocity(periods))
    noise: dict[str, tuple[str, Any]] = {
        OWN[0]: ("restitution_noise", restitution),
        OWN[1]: ("kick_noise", amplitude / (1.0 + restitution)),
        DRIVE: ("drive_noise", 1.0),
    }
    return {
        kind: {f"{100.0 * size:g} %": {key: size * whole} for size in SIZES}
        for kind, (key, whole) in noise.items()
    } | {
        WAVEFORM: {
            "parabolic": {"waveform": "parabolic"},
            "two tones": {"waveform": {"harmonics": [list(one) for one in HARMONICS]}},
        },
        LAW: {
            "plastic": {"restitution_law": "plastic", "restitution_speed": YIELDING * speed},
            "viscoelastic": {"restitution_law": "viscoelastic", "restitution_speed": speed},
        },
    }


def refusal(base: str, keys: Mapping[str, Any]) -> str:
    """Return the package's reason why a scene cannot be computed over a base; empty if it can."""
    given = {key: np.max(value) if np.ndim(value) else value for key, value in keys.items()}
    try:
        simulate(base=base, duration=1.0, **given)
    except SpecError as error:
        return str(error)
    return ""


def orbit(
    base: str,
    restitution: float,
    periods: int,
    keys: Mapping[str, Any],
    amplitude: float | None = None,
) -> Orbit:
    """Mode `periods` under the waveform and the law of restitution of a scene.

    Without an amplitude it is in the middle of its widest window.  In units of g / 2 f the orbit
    arrives with c and leaves with E(c); it lands where the kick is c - E(c), or, on a base that
    moves, where c + E(c) = 2 k and the velocity of the base is c - k.
    """
    unit = float(theory.locked_velocity(1))
    law = [keys[name] for name in ("restitution_law", "restitution_speed") if name in keys]

    def left(c: float) -> float:
        return c * float(theory.restitution_at(unit * c, restitution, *law))

    k = float(periods)
    fixed = base == HIGH_BOUNCE
    c = k if fixed else float(brentq(lambda v: v + left(v) - 2.0 * k, k, 2.0 * k, xtol=1e-14))
    e, q = left(c) / c, (left(1.000001 * c) - left(0.999999 * c)) / (2e-6 * c)
    # limit of the slope of the kick, or of twice the acceleration of the base in g
    limit = 2.0 * (1.0 + q) if fixed else 4.0 * (1.0 + q * e) / ((1.0 + q) * (1.0 + e))
    scale = unit if fixed else unit * (1.0 + restitution)
    windows = []
    for turns, velocity in _falling(keys.get("waveform", "sine")):
        kick = (c - (left(c) if fixed else k)) / velocity
        attracting = np.logical_and.accumulate(-kick * np.gradient(velocity, turns) < limit)
        windows.append((scale * kick[attracting], turns[attracting]))
    amplitudes, turns = max(
        (one for one in windows if amplitude is None or one[0][0] <= amplitude <= one[0][-1]),
        key=lambda one: float(np.ptp(one[0])),
    )
    middle = 0.5 * float(amplitudes[0] + amplitudes[-1]) if amplitude is None else amplitude
    return Orbit(restitution, periods, middle, float(np.interp(middle, amplitudes, turns)) % 1.0)


def _falling(waveform: Any) -> Iterator[tuple[Array, Array]]:
    """Yield intervals of the phase, in turns, in which the velocity of the base decreases."""
    turns = np.arange(2 * POINTS) / POINTS
    velocity, _ = theory.base_motion(turns, waveform)
    falls = (np.diff(velocity, append=-np.inf) < 0.0) & (velocity > 0.0)
    begins = np.nonzero(falls[1:] & ~falls[:-1])[0] + 1
    for begin in begins[begins < POINTS]:
        end = begin + int(np.argmin(falls[begin:]))
        yield turns[begin:end], velocity[begin:end]
