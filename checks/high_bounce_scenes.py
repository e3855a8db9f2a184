"""Scenes that high_bounce_cost.py computes on both bases, and the regimes of their particles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from vibrosweep.engine.measure import measure
from vibrosweep.model.measures import Regime
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, PARAMETERS
from vibrosweep.scene.design import open_design
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import read_spec

BOTH = HIGH_BOUNCE, MOVING
PAPER = read_spec(Path(__file__).parents[1] / "sweeps" / "paper.toml")
GRAVITY = PARAMETERS["gravity"].default
SETTLED = 20_000.0  # s at 1 Hz; a locked orbit of e = 0.98 recurs within 7,500 periods
PIECE = 2000  # realizations at a time


def gamma_of(e, amplitude, frequency=1.0):
    """Largest acceleration of the base in g: A = (1 + e) V0, Gamma = 2 pi f V0 / g."""
    return 2.0 * np.pi * frequency * amplitude / ((1.0 + e) * GRAVITY)


def amplitude_of(e, gamma, frequency=1.0):
    """Kick amplitude A in m/s on a base of that acceleration."""
    return (1.0 + e) * gamma * GRAVITY / (2.0 * np.pi * frequency)


def settled(particles=20, launch="staggered", duration=SETTLED):
    """Observe orbits until they settle, and measure the last tenth of the time."""
    asked = Measures(0.9 * duration, regimes=True, lyapunov=True, per_particle=True)
    return Scene(particles, launch, duration, "rest", asked)


def measured(values, observation, base, workers):
    """Measure realizations on one base, some at a time."""
    size = values["restitution"].size
    full = {n: np.broadcast_to(values.get(n, p.default), size) for n, p in PARAMETERS.items()}
    found = []
    for start in range(0, size, PIECE):
        piece = {n: np.array(v[start : start + PIECE], float) for n, v in full.items()}
        found.append(measure(piece, replace(observation, base=base), workers))
    whole = {name: np.concatenate([part[name] for part in found]) for name in found[0]}
    assert (whole["status"] == 0).all()
    return whole


def regime_of(found):
    """Regime of each particle; orbits without recurrence are one regime, UNSETTLED."""
    return np.minimum(found["regime"], Regime.UNSETTLED)


def of_paper():
    """Restitution and amplitude of the realizations of sweeps/paper.toml."""
    return open_design(PAPER).take(0, PAPER.design.realizations)


def independent(seed, count):
    """Realizations of paper.toml's ranges with one particle each, launched at a random phase."""
    random = np.random.default_rng(seed)
    ranges = {name: (drawn.low, drawn.high) for name, drawn in PAPER.design.sampled.items()}
    ranges["phase"] = (0.0, 2.0 * np.pi)
    return {name: random.uniform(*bounds, count) for name, bounds in ranges.items()}
