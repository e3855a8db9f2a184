"""Virtual experiments over every base: landings equal those of the engine."""

import math

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.errors import ParameterError, SpecError
from vibrosweep.lab.experiment import LABORATORY, Camera, Experiment, Variation
from vibrosweep.lab.trials import perform_trials

G = LABORATORY["gravity"]
SHARP = Camera(noise=0.0, whole_pixels=False)
MOUNT = {"mass_ratio": 0.01, "mount_frequency": 7.4, "mount_damping": 0.05}
# The recoiling base is interpolated between instants 50 us apart: 1e-8 m over a squared frame time.
PUSHED = {"moving": -1e-9, "sprung": -1e-3}
OMEGA = 2.0 * math.pi * LABORATORY["frequency"]


def scene(gamma, **changes):
    """The scene of the laboratory at another acceleration of the base."""
    one = {**LABORATORY, **changes}
    return {**one, "amplitude": (1.0 + one["restitution"]) * gamma * G / OMEGA}


PLASTIC = {"restitution_law": "plastic", "restitution_speed": G / (2.0 * LABORATORY["frequency"])}


def filmed(base, physical, **changes):
    plan = {"particles": 2, "repeats": 1, "transient": 0.0, "duration": 1.0, "camera": SHARP}
    return perform_trials(Experiment(**physical, base=base, **{**plan, **changes}))[0]


@pytest.mark.parametrize(("base", "mount"), [("moving", {}), ("sprung", MOUNT)])
def test_the_landings_are_those_of_simulate_and_the_film_shows_them(base, mount):
    physical = {**scene(1.5, restitution=0.5), **mount}
    trial = filmed(base, physical)
    launch = [0.0, 0.5 / LABORATORY["frequency"]]
    truth = vs.simulate(**physical, launch_time=launch, duration=1.0, base=base)
    for name, values in trial.record._asdict().items():
        np.testing.assert_array_equal(values, truth[name].values[0])
    assert (trial.record.rested == 1).any()
    # flights are parabolas, and between them the particle is on the base
    time, height = trial.tracks["time"].values, trial.tracks["height"].values
    bent = np.diff(height, 2, axis=0) * 240.0**2 + G
    for p in range(2):
        assert (bent[time[:-2] > launch[p], p] > PUSHED[base]).all()
        lands = trial.record.landing_time[p]
        flying = np.searchsorted(lands[np.isfinite(lands)], time)
        within = (flying[2:] == flying[:-2]) & (trial.record.rested[p, flying[2:] - 1] == 0)
        within &= (time[:-2] > launch[p]) & (flying[2:] > 0)
        assert within.sum() > 20
        np.testing.assert_allclose(bent[within, p], 0.0, atol=1e-6)


def test_particles_of_different_restitution_share_one_base():
    spread = Variation(restitution_spread=0.05, level_spread=1e-3)
    trial = filmed("moving", scene(1.5), variation=spread, particles=3)
    size = 1.5 * G / OMEGA**2
    assert np.ptp(trial.restitution) > 0.01
    assert np.ptp(trial.level) > 1e-4
    for p, e in enumerate(trial.restitution):
        time = trial.record.landing_time[p]
        leave = trial.record.rebound_velocity[p]
        bounced = np.flatnonzero(trial.record.rested[p] == 0)
        bounced = bounced[np.isin(bounced - 1, bounced)]
        height, velocity = -size * np.cos(OMEGA * time), OMEGA * size * np.sin(OMEGA * time)
        lasted = time[bounced] - time[bounced - 1]
        # flights begin and end on the base, and e applies to the relative speed
        risen = height[bounced] - height[bounced - 1]
        np.testing.assert_allclose(
            leave[bounced - 1] * lasted - 0.5 * G * lasted**2, risen, atol=1e-12
        )
        arrive = leave[bounced - 1] - G * lasted - velocity[bounced]
        np.testing.assert_allclose(leave[bounced] - velocity[bounced], -e * arrive, atol=1e-11)


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_restitution_falls_with_the_speed_of_impact(base):
    physical = scene(2.0, restitution=0.8)
    trial = filmed(base, physical, **PLASTIC)
    moves = 1.0 if base == "moving" else 0.0
    velocity = physical["amplitude"] / 1.8 * np.sin(OMEGA * trial.record.landing_time)
    bounced = (trial.record.rested[:, 1:] == 0) & (trial.record.rested[:, :-1] == 0)
    leave = trial.record.rebound_velocity[:, 1:]
    bounced &= np.isfinite(leave)
    before = trial.record.rebound_velocity[:, :-1]
    arrive = G * np.diff(trial.record.landing_time, axis=1) - before + moves * velocity[:, 1:]
    # v' = e(v) v + A sin over a base at rest, where v is the speed of arrival
    kick = physical["amplitude"] * np.sin(OMEGA * trial.record.landing_time[:, 1:])
    leave = leave - np.where(moves, velocity[:, 1:], kick)
    fast = bounced & (arrive > 0.05)
    unit = G / (2.0 * LABORATORY["frequency"])
    expected = 0.8 * np.maximum(arrive[fast] / unit, 1.0) ** -0.25
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose((leave / arrive)[fast], expected, atol=1e-10)


def test_experiments_that_a_base_does_not_allow_are_refused():
    with pytest.raises(ParameterError, match=r"variation\.frequency_jitter: cannot be computed"):
        Experiment(base="moving", variation=Variation(frequency_jitter=0.01))
    with pytest.raises(ParameterError, match=r"variation\.restitution_spread: cannot"):
        Experiment(
            base="sprung",
            **MOUNT,
            variation=Variation(restitution_spread=0.1),
        )
    with pytest.raises(SpecError) as caught:
        Experiment(base="sprung", mass_ratio=0.1)
    assert [mistake.key for mistake in caught.value.mistakes] == ["scene.mount_frequency"]
    with pytest.raises(ParameterError, match=r"Experiment\(amplitude="):
        Experiment(scene=LABORATORY)
    with pytest.raises(ParameterError, match="amplitude: an experiment takes one number"):
        Experiment(amplitude=[0.1, 0.2])
    with pytest.raises(SpecError, match="has no meaning with base"):
        Experiment(base="moving", rebound="reflect")
