"""Particles in slots of their own, for which the claims about order are true."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from study.bases import SPRUNG
from study.samples import MOUNT, Plan, Setting
from vibrosweep import simulate, theory
from vibrosweep.analysis import slot_decay

POPULATIONS: Final = (5, 10, 20, 50, 100)
RESTITUTION: Final = 0.98
# Parameters on the base of finite mass, whose mount must not be in resonance with the mode
LIGHT: Final[dict[str, Any]] = {"restitution": 0.9, "base_acceleration": 0.6, **MOUNT}
# Launches are this far from the exact instants, s
SCATTER: Final = 1e-3


def populations(base: str, largest: int = POPULATIONS[-1]) -> tuple[int, ...]:
    """Numbers of particles, up to the largest, for which an orbit with a slot for each exists."""
    return (2,) if base == SPRUNG else tuple(n for n in POPULATIONS if n <= largest)


def own_slots_setting(base: str) -> Setting:
    """Setting under which `own_slots` is computed."""
    if base == SPRUNG:
        return Setting("slots of their own", constants=LIGHT)
    given = {"restitution": RESTITUTION, "amplitude": "middle of the window of mode N"}
    return Setting("slots of their own", constants=given)


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
    """Apply `slot_decay` to two particles of mode 1 at Table 1, except for the amplitude.

    They are launched `apart` s from each other, the first one on the orbit.
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
    return slot_decay(pair)


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
