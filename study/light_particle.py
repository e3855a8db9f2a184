"""One particle on the base of finite mass: windows of its locked orbits, and its final regimes.

Its state returns to within rounding, but rarely bit for bit, because the base keeps oscillating.
Therefore two successive intervals are compared, into which cycles of 1 to 6 periods fit exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from study.arrays import Array
from study.bases import MOVING, SPRUNG
from study.samples import MOUNT, Plan, measured
from vibrosweep import PARAMETERS, Regime, theory

STRETCH: Final = 60.0  # s at 1 Hz
ALIKE: Final = 1e-6  # relative, of heights
# Orbits settle by e per impact, or as the base's oscillation decays: by 1e-8 in this time at
# e = 0.99, s
SETTLED: Final = 2000.0


def _acceleration(amplitude: ArrayLike, restitution: ArrayLike) -> Array:
    """Acceleration in g of a base that kicks with an amplitude in m/s, at 1 Hz."""
    gravity = PARAMETERS["gravity"].default
    velocity = np.asarray(amplitude) / (1.0 + np.asarray(restitution))
    return np.asarray(2.0 * np.pi * velocity / gravity)


def landing_phase(k: ArrayLike, restitution: Array, amplitude: ArrayLike) -> Array:
    """Phase of mode k in turns; NaN where it does not exist."""
    gamma = _acceleration(amplitude, restitution)
    return theory.sprung.landing_phase(gamma, k, restitution, *MOUNT.values())


def apex(restitution: Array, amplitude: float) -> Array:
    """Maximum height in m of mode 1 at 1 Hz above the mean level."""
    gamma = _acceleration(amplitude, restitution)
    turn = 2.0 * np.pi * landing_phase(1, restitution, amplitude)
    ratio, natural, damping = MOUNT.values()
    left = 2.0 * ratio * theory.sprung.recoil_deviation(natural, damping)[0]
    surface = left - gamma / (2.0 * np.pi**2) * np.cos(turn)
    return np.asarray((surface + 0.25) * PARAMETERS["gravity"].default / 2.0)


def ends(k: Array, restitution: Array) -> tuple[Array, Array]:
    """Amplitudes in m/s at which mode k begins to exist, and first loses its stability.

    For modes that are stable where they begin.
    """
    unit = _acceleration(1.0, restitution)
    low = theory.sprung.locked_acceleration_min(k, restitution, *MOUNT.values()) / unit
    heavy = theory.amplitude_max(k, restitution, base=MOVING)

    def instability(amplitude: float, mode: float, e: float) -> float:
        base = theory.sprung.CoupledBase(e, float(_acceleration(amplitude, e)), *MOUNT.values())
        orbit = theory.sprung.staggered(base, int(mode), [0])
        return theory.sprung.spectral_radius(orbit) - 1.0

    high = [
        brentq(instability, 0.5 * (a + b), 1.1 * b, args=(mode, e))
        for a, b, mode, e in zip(low, heavy, k, restitution, strict=True)
    ]
    return low, np.array(high)


def _stretches(
    plan: Plan, parameters: Mapping[str, Any], begin: float
) -> tuple[xr.Dataset, xr.Dataset]:
    first, second = (
        measured(
            plan,
            SPRUNG,
            parameters,
            particles=1,
            transient=begin + i * STRETCH,
            duration=begin + (i + 1) * STRETCH,
        )
        for i in (0, 1)
    )
    return first, second


def regimes(plan: Plan, parameters: Mapping[str, Any]) -> NDArray[Any]:
    """Regime in which each particle ends; unsettled where the two stretches differ."""
    first, second = _stretches(plan, parameters, SETTLED)
    heights = first["rebound_height_mean"].values, second["rebound_height_mean"].values
    alike = np.isclose(*heights, rtol=ALIKE, atol=0.0, equal_nan=True)
    for name in ("impact_count", "rest_count"):
        alike &= first[name].values == second[name].values
    found = np.where(first["rest_count"].values > 0, Regime.RESTING, Regime.LOCKED)
    found = np.where(alike, found, Regime.UNSETTLED)
    return np.asarray(np.where(second["at_rest_count"].values > 0, Regime.AT_REST, found))


def returns(
    plan: Plan, k: Array, restitution: Array, amplitude: Array, offset: float
) -> NDArray[np.bool_]:
    """Return whether launches `offset` periods off the locked orbits of mode k reach them."""
    phase = landing_phase(k, restitution, amplitude)
    columns = {
        "restitution": restitution,
        "amplitude": amplitude,
        "launch_velocity": theory.locked_velocity(k),
        "phase": 2.0 * np.pi * (np.where(np.isnan(phase), 0.25, phase) + offset),
    }
    late = _stretches(plan, columns, 2.0 * SETTLED)[1]
    heights = late["rebound_height_max"].values / late["rebound_height_mean"].values
    each = (late["impact_count"].values == STRETCH / k) & (late["rest_count"].values == 0)
    return np.asarray(each & (np.abs(heights - 1.0) <= ALIKE))
