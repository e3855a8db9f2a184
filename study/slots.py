"""Particles in separate slots, for which the claims about order are true."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from study.arrays import Array
from study.bases import SPRUNG
from study.samples import MOUNT, Plan, Setting
from vibrosweep import simulate, theory

POPULATIONS: Final = (5, 10, 20, 50, 100)
RESTITUTION: Final = 0.98
# Parameters on the base of finite mass, whose mount must not be in resonance with the mode
LIGHT: Final[dict[str, Any]] = {"restitution": 0.9, "base_acceleration": 0.6, **MOUNT}
# Launches are this far from the exact instants, s
SCATTER: Final = 1e-3
# Separations to which a decay is fitted, in forcing periods: larger ones depart from the linearised
# map by more than a part in a thousand, and smaller ones are as inexact by the rounding of times
LARGEST: Final = 1e-4
SMALLEST: Final = 1e-9
FEWEST: Final = 8  # equations of a fit


def populations(base: str, largest: int = POPULATIONS[-1]) -> tuple[int, ...]:
    """Numbers of particles, up to the largest, for which an orbit with a slot for each exists."""
    return (2,) if base == SPRUNG else tuple(n for n in POPULATIONS if n <= largest)


def own_slots_setting(base: str) -> Setting:
    """Setting under which `own_slots` is computed."""
    if base == SPRUNG:
        return Setting("separate slots", constants=LIGHT)
    given = {"restitution": RESTITUTION, "amplitude": "middle of the window of mode N"}
    return Setting("separate slots", constants=given)


def own_slots(particles: int, base: str, plan: Plan, impacts: int = 20) -> xr.Dataset:
    """Every landing of N particles in the N slots of mode N, at 1 Hz.

    The locked orbit of mode N spans N forcing periods; one particle is launched into it in each of
    N successive periods, up to 1 ms off, at e = 0.98 and the amplitude in the middle of its window,
    or, on a base of finite mass, at e = 0.9 and 0.6 g.
    """
    if base == SPRUNG:
        forcing, phase = LIGHT, landing_phase(particles)
    else:
        low = theory.amplitude_min(particles, RESTITUTION)
        high = theory.amplitude_max(particles, RESTITUTION, base=base)
        amplitude = 0.5 * float(low + high)
        forcing = {"restitution": RESTITUTION, "amplitude": amplitude}
        phase = float(theory.locked_phase(particles, RESTITUTION, amplitude))
    scatter = np.random.default_rng(particles).uniform(-SCATTER, SCATTER, particles)
    return simulate(
        **forcing,
        base=base,
        launch_velocity=float(theory.locked_velocity(particles)),
        launch_time=phase + np.arange(particles) + scatter,
        duration=float(impacts * particles),
        threads=plan.threads,
    )


def decay_in_slot(plan: Plan, base: str, amplitude: float, apart: float) -> xr.Dataset:
    """Decay of the separation of two particles of mode 1 at Table 1, except for the amplitude.

    They are launched `apart` s from each other, the first one on the orbit.  Dim ``impact``:
    ``separation`` (s).  Scalars: ``modulus_fitted`` and ``modulus_predicted`` of the leading
    multiplier, fitted (NaN if there is too little to fit) and from the closed form, and
    ``closing_time`` (s), in which the separation falls from half a forcing period to the contact
    time, as predicted.
    """
    phase = float(theory.locked_phase(1, 0.9, amplitude))
    pair = simulate(
        amplitude=amplitude,
        launch_velocity=4.905,
        launch_time=[phase, phase + apart],
        duration=450.0,
        base=base,
        threads=plan.threads,
    )
    times = pair["landing_time"].values[0]
    separation = separations(*(one[np.isfinite(one)] for one in times))
    frequency, contact = float(pair["frequency"]), float(pair["contact_time"])
    predicted = float(np.abs(theory.multipliers(1, 0.9, amplitude, base=base)).max())
    return xr.Dataset(
        {
            "separation": ("impact", separation),
            "modulus_fitted": fitted_modulus(separation * frequency),
            "modulus_predicted": predicted,
            "closing_time": np.log(2.0 * frequency * contact) / np.log(predicted) / frequency,
        }
    )


def separations(first: Array, second: Array) -> Array:
    """Signed separations of corresponding landings, which are counted back from the last ones."""
    # start from the last landings that are nearest in time: one particle may have landed once more
    middle = min(first[-1], second[-1])
    i, j = (int(np.argmin(np.abs(t - middle))) for t in (first, second))
    count = min(i, j) + 1
    return second[j + 1 - count : j + 1] - first[i + 1 - count : i + 1]


def fitted_modulus(d: Array) -> float:
    """Modulus of the leading multiplier, from separations in forcing periods.

    Near a locked orbit they obey d_(m+2) = c_1 d_(m+1) + c_0 d_m, where the roots of
    z^2 - c_1 z - c_0 are the multipliers.  Both coefficients are fitted by least squares, each
    equation weighted by the size of its separations (Prony's method).
    """
    size = np.maximum(np.abs(d[:-1]), np.abs(d[1:]))
    # the fit begins after the last separation that is too large for the linearised map
    begin = int(np.max(np.flatnonzero(np.abs(d) > LARGEST), initial=-1)) + 1
    small = np.flatnonzero(size[begin:] < SMALLEST)
    end = begin + int(small[0]) if small.size else size.size
    rows = np.arange(begin, max(end - 1, begin))
    if rows.size < FEWEST:
        return np.nan
    weight = 1.0 / size[rows]
    columns = np.stack([d[rows + 1] * weight, d[rows] * weight], axis=1)
    (c1, c0), *_ = np.linalg.lstsq(columns, d[rows + 2] * weight, rcond=None)
    return float(np.max(np.abs(np.roots([1.0, -c1, -c0]))))


def landing_phase(k: int) -> float:
    """Phase in turns of mode k on the base of finite mass."""
    forcing = LIGHT["base_acceleration"], k, LIGHT["restitution"]
    return float(theory.sprung.landing_phase(*forcing, *MOUNT.values()))


def height_needed(particles: int) -> float:
    """Height in m to which each of N particles must fly for N slots of one orbit at 1 Hz."""
    return float(theory.locked_height(particles))


def smallest_separation(record: xr.Dataset) -> float:
    """Smallest time in s between two landings of a record of one realization."""
    times = np.sort(record["landing_time"].values, axis=None)
    return float(np.min(np.diff(times[np.isfinite(times)])))
