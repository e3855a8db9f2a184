"""One particle on the base of finite mass: closed forms against simulations."""

import numpy as np
import pytest

from study import claims_on_heights, claims_on_windows, light_particle
from study.bases import MOVING, SPRUNG
from study.samples import MOUNT, Plan, Setting
from study.verdict import Verdict
from vibrosweep import Regime, theory
from vibrosweep.errors import ParameterError

K = np.array([1.0, 2.0, 1.0])
E = np.array([0.7, 0.9, 0.9])


@pytest.fixture(scope="module")
def ends():
    return light_particle.ends(K, E)


def test_windows_end_where_the_orbit_ceases_to_exist_or_to_attract(ends):
    low, high = ends
    for k, e, begin, end in zip(K, E, low, high, strict=True):
        gamma = 2.0 * np.pi / ((1.0 + e) * 9.81)  # per m/s of amplitude, at 1 Hz

        def radius(amplitude, k=k, e=e, gamma=gamma):
            base = theory.sprung.CoupledBase(e, gamma * amplitude, *MOUNT.values())
            return theory.sprung.spectral_radius(theory.sprung.staggered(base, int(k), [0]))

        with pytest.raises(ParameterError, match="can be locked"):
            radius(begin * (1.0 - 1e-9))
        assert radius(begin * (1.0 + 1e-9)) < 1.0
        assert radius(end * (1.0 - 1e-6)) < 1.0 < radius(end * (1.0 + 1e-6))
    # the particle is light, so that the ends are close to those over a heavy table
    np.testing.assert_allclose(low, theory.amplitude_min(K, E), rtol=0.02)
    np.testing.assert_allclose(high, theory.amplitude_max(K, E, base=MOVING), rtol=0.02)


def test_launches_return_inside_the_window_only(ends):
    low, high = ends
    width = high - low
    inside = (low + 0.02 * width, low + 0.5 * width, high - 0.02 * width)
    outside = (0.98 * low, high + 0.02 * width)
    for amplitudes, expected in ((inside, True), (outside, False)):
        for amplitude in amplitudes:
            found = light_particle.returns(Plan(), K, E, amplitude, 1e-3)
            assert (found == expected).all()


def test_where_particles_end():
    """Locked to mode 1; at rest for good below 1 g; resting in each period at 1.4 g, e = 0.3."""
    e = np.array([0.9, 0.9, 0.3])
    amplitude = np.array([1.2, 0.1, 1.4 * 1.3 * 9.81 / (2.0 * np.pi)])
    speed = np.array([float(theory.locked_velocity(1)), 5.0, 0.1])
    phase = 2.0 * np.pi * np.array([0.44, 0.0, 0.0])
    columns = {"restitution": e, "amplitude": amplitude, "launch_velocity": speed, "phase": phase}
    found = light_particle.regimes(Plan(), columns)
    assert found.tolist() == [Regime.LOCKED, Regime.AT_REST, Regime.RESTING]


def test_claims_on_one_particle_are_judged_where_the_base_recoils(monkeypatch):
    plan = Plan(seeds=2, realizations=8)
    setting = Setting("one", {"restitution": (0.8, 0.9), "amplitude": (1.0, 1.4)}, part=1.0)
    for module in (claims_on_heights, claims_on_windows):
        monkeypatch.setattr(module, "settings_of", lambda base: (setting,))
    monkeypatch.setattr(claims_on_heights, "LAUNCHES", {claims_on_heights.ANYWHERE: 1})
    heights = claims_on_heights.plateau(plan, SPRUNG)
    assert heights.conditions[0].passed  # among its tests: followed heights are those of `apex`
    windows = claims_on_windows.windows(plan, SPRUNG)
    assert windows.conditions[0].passed
    assert windows.verdict is Verdict.CONDITIONAL
