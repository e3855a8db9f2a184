"""Scenes that ordering.py computes with the engine, and the outcomes of their particles."""

from __future__ import annotations

import numpy as np

from vibrosweep import simulate
from vibrosweep.theory import sprung as coupled_theory

E, GAMMA, GRAVITY = 0.9, 0.6, 9.81
STAGGERED, BUNCHED, OTHER, UNLOCKED, DEAD = range(5)
WINDOW = 40.0  # periods at the end in which an outcome is judged
CONTACT_TIME = 1e-2  # s; the shorter, the longer particles chatter before they rest
NEAR = 0.3  # periods by which flights of a bunch may differ from their mode


def scene(launch, mass_ratio, natural, damping, k=2, duration=400.0):
    """Every landing, times in periods; mass_ratio and natural are arrays over realizations."""
    return simulate(
        base="sprung",
        restitution=E,
        base_acceleration=GAMMA,
        launch_velocity=k * GRAVITY / 2.0,
        launch_time=np.asarray(launch),
        mass_ratio=np.asarray(mass_ratio),
        mount_frequency=np.asarray(natural),
        mount_damping=damping,
        contact_time=CONTACT_TIME,
        duration=duration,
    )


def phase_of(k, mass_ratio=0.0, natural=0.37, damping=0.05):
    """Phase of landing of a single particle in mode k."""
    return float(coupled_theory.landing_phase(GAMMA, k, E, mass_ratio, natural, damping))


def modes(landings):
    """Mode in which each particle is locked at the end; 0 if it is in none, -1 if it lands no more.

    Returns
    -------
    mode, last
        Shape (realization, particle): mode, and time of the last landing.
    """
    times, rested = landings["landing_time"].values, landings["rested"].values
    late = times > float(landings["duration"]) - WINDOW
    last = np.nanmax(np.where(late, times, -np.inf), axis=-1)
    flights = np.where(late[..., :-1], np.diff(times, axis=-1), np.nan)
    count = np.maximum(np.isfinite(flights).sum(axis=-1), 1)
    mode = np.rint(np.nansum(flights, axis=-1) / count)
    off = np.abs(flights - mode[..., np.newaxis])
    held = ~(off > NEAR).any(axis=-1) & ~(late & (rested == 1)).any(axis=-1) & (mode > 0)
    return np.where(np.isfinite(last), np.where(held, mode, 0), -1), last


def outcomes(landings, k=2):
    """Final state of the particles of each realization; shape (realization,).

    Staggered: all in mode k, equally many in each slot; bunched: all in one slot.
    """
    mode, last = modes(landings)
    middle = phase_of(k) - 0.5  # a slot begins half a period before the landings
    slot = np.floor(np.where(np.isfinite(last), last, 0.0) - middle) % k
    found = np.full(mode.shape[0], UNLOCKED)
    found[(mode == -1).all(axis=1)] = DEAD
    found[(mode > 0).all(axis=1)] = OTHER
    in_mode = (mode == k).all(axis=1)
    even = (np.array([(slot == one).sum(axis=1) for one in range(k)]) == slot.shape[1] / k).all(
        axis=0
    )
    found[in_mode & even] = STAGGERED
    found[in_mode & (slot == slot[:, :1]).all(axis=1)] = BUNCHED
    return found
