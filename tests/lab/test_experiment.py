"""Virtual experiments: their files, their landings over every base, and their films."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.engine.landings import record_landings
from vibrosweep.errors import ParameterError, SpecError
from vibrosweep.kernels.arithmetic import sin_turns
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.lab.experiment import (
    LABORATORY,
    LEVEL,
    Camera,
    Experiment,
    Motion,
    Variation,
    film,
    oscillating_surface,
    read_experiments,
)
from vibrosweep.lab.trials import perform_trials, phase_walk, wandering_record
from vibrosweep.model.parameters import dimensionless, launches

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


# --- Files of virtual experiments, and all their mistakes at once ---

FILES = sorted((Path(__file__).parents[2] / "sweeps" / "laboratory").glob("*.toml"))


@pytest.fixture
def read(tmp_path):
    def experiments(text):
        path = tmp_path / "experiment.toml"
        path.write_text(text, encoding="utf-8")
        return read_experiments(path)

    return experiments


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_the_files_of_the_repository_are_sound(path):
    spec = read_experiments(path)
    assert spec.title
    for one in spec.experiments:
        assert (one.repeats, one.window) == (4, (20.0, 60.0))


def test_the_cases_of_table_4():
    spec = read_experiments(next(p for p in FILES if p.stem == "table4"))
    assert [one.scene.particles for one in spec.experiments] == [1, 5, 20, 50]
    scene = spec.experiments[0].parameters
    kick = 2.0 * scene["frequency"] * scene["amplitude"] / scene["gravity"]
    assert kick == pytest.approx(0.244648, abs=1e-5)


def test_an_empty_file_is_the_default_experiment(read):
    (one,) = read("").experiments
    assert one == Experiment()
    assert one.parameters == LABORATORY


def test_all_mistakes_at_once(read):
    with pytest.raises(SpecError) as caught:
        read(
            "[scene]\nrestitution = 1.2\nparticles = [1, 0]\nlaunch = [0.0, 1.0]\n"
            "[camera]\nframerate = 240\npixel = 0.0\nwhole_pixels = 1\n"
            "[variation]\nfrequency_jitter = 0.5\n[trials]\nrepeats = 2.5\n[other]\n"
        )
    assert {mistake.key: mistake.value for mistake in caught.value.mistakes} == {
        "scene.restitution": 1.2,
        "scene.particles": [1, 0],
        "camera.framerate": 240,
        "camera.pixel": 0.0,
        "camera.whole_pixels": 1,
        "variation.frequency_jitter": 0.5,
        "trials.repeats": 2.5,
        "other": {},
    }
    assert 'did you mean "frame_rate"' in str(caught.value)


def test_the_window_of_a_recording_has_the_same_keys_as_in_a_sweep(read):
    with pytest.raises(SpecError) as caught:
        read("[trials]\ntransient = 2.0\nduration = 4.0\n")
    message = str(caught.value)
    assert "it belongs in [measure]" in message
    assert "it belongs in [scene]" in message
    (one,) = read("[scene]\nduration_periods = 200\n[measure]\ntransient = 2.0\n").experiments
    assert one.window == (2.0, 10.0)


def test_launches_must_fit_the_particles(read):
    with pytest.raises(SpecError, match=r"contradicts the 2 launch times of scene\.launch"):
        read("[scene]\nparticles = 3\nlaunch = [0.0, 0.1]\n")
    (one,) = read("[scene]\nparticles = 2\nlaunch = [0.0, 0.1]\n").experiments
    assert one.scene.launch == (0.0, 0.1)


@pytest.mark.parametrize("text", ["scene = 1\n", "title = 3\n", "[scene\n"])
def test_files_without_an_experiment_are_refused(read, text):
    with pytest.raises(SpecError):
        read(text)


def test_a_scene_has_any_base_and_forcing(read):
    (one,) = read('[scene]\nbase = "moving"\nbase_acceleration = 1.5\n').experiments
    assert one.scene.base == "moving"
    numbers = one.parameters
    velocity = numbers["amplitude"] / (1.0 + numbers["restitution"])
    assert 2.0 * math.pi * numbers["frequency"] * velocity == pytest.approx(1.5 * 9.81)
    text = '[scene]\nbase = "sprung"\nmass_ratio = 0.01\nmount_frequency = 7.0\n'
    (one,) = read(text).experiments
    assert one.parameters == {
        **LABORATORY,
        "mass_ratio": 0.01,
        "mount_frequency": 7.0,
        "mount_damping": 0.05,
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[scene]\nbase = "sprung"\n', "scene.mount_frequency"),
        ("[scene]\nmass_ratio = 0.1\n", "belongs to a base of finite mass"),
        ("[scene]\namplitude = 1.0\nbase_velocity = 1.0\n", "keep one of the two"),
        ('[scene]\nbase = "soft"\n', 'must be "high-bounce", "moving" or "sprung"'),
        (
            '[scene]\nbase = "moving"\n[variation]\nfrequency_jitter = 0.01\n',
            "variation.frequency_jitter: cannot be computed",
        ),
    ],
)
def test_keys_that_do_not_fit_the_base_are_refused(read, text, message):
    with pytest.raises(SpecError, match=message):
        read(text)


# --- Filmed heights: closed forms for parabolas and their means over an exposure ---

PLATFORM = {"restitution": 0.9, "amplitude": 0.06, "frequency": 20.0, "phase": 0.3}


@pytest.fixture
def motion():
    start = np.array([0.0, 0.1, 0.35])  # the particle rests between the second and the third
    velocity = np.array([0.1 * G / 2.0, 0.15 * G / 2.0, 0.2 * G / 2.0])
    return Motion(start, start + 2.0 * velocity / G, velocity, np.zeros(3), G, LEVEL)


@pytest.fixture
def on_a_moving_base():
    """A flight, a stay, and a flight that does not end."""
    surface, start, end = (
        oscillating_surface(PLATFORM),
        np.array([0.0, 0.35]),
        np.array([0.2, np.inf]),
    )
    rise = surface.height(start)
    fallen = surface.height(end[:1])[0] - rise[0]
    velocity = np.array([fallen / 0.2 + 0.1 * G, 0.7])
    return Motion(start, end, velocity, rise, G, surface)


def test_heights_are_parabolas_and_zero_while_resting(motion):
    time = np.array([0.0, 0.05, 0.1, 0.175, 0.3, 0.45, 9.0])
    top = [G * t * t / 8.0 for t in (0.1, 0.15, 0.2)]
    expected = [0.0, top[0], 0.0, top[1], 0.0, top[2], 0.0]
    np.testing.assert_allclose(motion.height(time), expected, atol=1e-15)


def test_a_moving_base_carries_what_rests_on_it(on_a_moving_base):
    time = np.array([-0.01, 0.1, 0.25, 0.3, 0.4])
    size = 0.06 / (1.9 * 2.0 * np.pi * 20.0)
    base = -size * np.cos(2.0 * np.pi * 20.0 * time + 0.3)
    found = on_a_moving_base.height(time)
    np.testing.assert_allclose(found[[0, 2, 3]], base[[0, 2, 3]], atol=1e-15)
    assert found[1] == pytest.approx(on_a_moving_base.apex[0], abs=1e-5)
    # without a jump at the landing
    np.testing.assert_allclose(
        *on_a_moving_base.height(np.array([0.2 - 1e-9, 0.2 + 1e-9])), atol=1e-8
    )


@pytest.mark.parametrize("which", ["motion", "on_a_moving_base"])
def test_the_mean_over_an_exposure_agrees_with_the_midpoint_rule(which, request):
    motion = request.getfixturevalue(which)
    time, exposure, parts = np.linspace(0.02, 0.5, 49), 0.02, 20_000
    inside = (np.arange(parts) + 0.5) / parts - 0.5
    fine = motion.height((time[:, np.newaxis] + exposure * inside).ravel()).reshape(49, -1)
    # because of kinks the error of the midpoint rule is of order speed * step
    np.testing.assert_allclose(motion.mean_height(time, exposure), fine.mean(axis=1), atol=1e-9)


def test_pixels_noise_scale_and_lost_frames():
    true = np.full((20_000, 2), 1.234e-3)
    rng = np.random.default_rng(0)
    plain = film(true, Camera(pixel=1e-4, noise=0.0), rng)
    assert set(np.unique(plain.round(12))) == {1.2e-3}
    scaled = film(true, Camera(noise=0.0, whole_pixels=False, scale_error=0.1), rng)
    np.testing.assert_allclose(scaled, 1.1 * true)
    noisy = film(true, Camera(pixel=1e-4, noise=2.0, whole_pixels=False, dropped=0.25), rng)
    lost = np.isnan(noisy)
    assert (lost[:, 0] == lost[:, 1]).all()
    assert lost[:, 0].mean() == pytest.approx(0.25, abs=0.02)
    assert np.nanstd(noisy) == pytest.approx(2e-4, rel=0.02)


# --- Landings under phase noise, and equality with the engine without it ---


def landings(parameters, walk, particles=4, duration=5.0, **scene):
    values = {**LABORATORY, **scene}
    given = {name: np.broadcast_to(value, particles) for name, value in values.items()}
    sets = parameters(**given)
    start = launches("staggered", particles, sets["frequency"][:1])
    batch = Batch(base_of("high-bounce", "rest"), dimensionless(sets, duration), start)
    return wandering_record(batch, walk, values["frequency"], values["gravity"])


@pytest.mark.parametrize("amplitude", [0.02, 0.06, 0.12])
def test_without_phase_noise_results_are_bitwise_those_of_the_engine(
    amplitude, parameters, observe, workers
):
    found = landings(parameters, np.zeros(2), amplitude=amplitude)
    observation = observe("staggered", particles=4, duration=5.0, transient=-np.inf)
    scene = parameters(**{**LABORATORY, "amplitude": amplitude})
    engine = record_landings(scene, observation, workers)
    for name, values in found._asdict().items():
        np.testing.assert_array_equal(values, engine[name][0])


def test_impacts_depend_on_the_wandering_phase(parameters):
    """Every bounce obeys the map with the interpolated phase of the walk."""
    jitter, frequency = 0.02, LABORATORY["frequency"]
    walk = phase_walk(np.random.default_rng(3), jitter, 110)
    found = landings(parameters, walk, frequency=frequency)
    arrive = LABORATORY["gravity"] / 2.0 * np.diff(found.landing_time, axis=1)
    time, leave = found.landing_time[:, 1:], found.rebound_velocity[:, 1:]
    bounced = (found.rested[:, 1:] == 0) & (found.rested[:, :-1] == 0) & np.isfinite(leave)
    periods = frequency * time
    phase = periods + np.interp(periods, np.arange(walk.size) - 1.0, walk)
    kick = LABORATORY["amplitude"] * np.sin(2.0 * np.pi * phase)
    expected = LABORATORY["restitution"] * arrive + kick
    assert bounced.sum() > 100
    np.testing.assert_allclose(leave[bounced], expected[bounced], atol=1e-11)


def test_a_resting_particle_leaves_at_the_wandered_phase(parameters):
    walk = phase_walk(np.random.default_rng(4), 0.02, 110)
    found = landings(parameters, walk, amplitude=0.02, contact_time=1e-3)
    lifted = (found.rested == 1) & np.isfinite(found.liftoff_time)
    periods = LABORATORY["frequency"] * found.liftoff_time[lifted]
    phase = periods + np.interp(periods, np.arange(walk.size) - 1.0, walk)
    kick = [0.02 * sin_turns(x) for x in phase - np.rint(phase)]
    assert len(kick) > 20
    np.testing.assert_allclose(kick, LABORATORY["gravity"] * 1e-3 / 2.0, atol=1e-9)
    assert (np.cos(2.0 * np.pi * phase) > 0.0).all()


def test_the_walk_has_the_given_variance():
    steps = np.diff(phase_walk(np.random.default_rng(0), 0.01, 100_000))
    assert steps.std() == pytest.approx(0.01, rel=0.01)
    assert phase_walk(np.random.default_rng(0), 0.01, 5)[0] == 0.0


def test_plain_python_gives_the_same_bits(parameters, tmp_path):
    """Without compilation, for a small case with bounces and rests."""
    walk = phase_walk(np.random.default_rng(5), 0.01, 20)
    found = landings(parameters, walk, particles=2, duration=0.5, amplitude=0.03)
    assert (found.rested == 1).any()
    assert (found.rested == 0).any()
    sets = parameters(**{**LABORATORY, "amplitude": np.full(2, 0.03)})
    np.savez(tmp_path / "given.npz", walk=walk, **sets)
    np.savez(tmp_path / "found.npz", **found._asdict())
    plain = """
import sys
import numpy as np
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.lab.trials import wandering_record
from vibrosweep.model.parameters import dimensionless, launches
given = dict(np.load(sys.argv[1] + "/given.npz"))
walk = given.pop("walk")
start = launches("staggered", 2, given["frequency"][:1])
frequency, gravity = float(given["frequency"][0]), float(given["gravity"][0])
batch = Batch(base_of("high-bounce", "rest"), dimensionless(given, 0.5), start)
record = wandering_record(batch, walk, frequency, gravity)
for name, values in np.load(sys.argv[1] + "/found.npz").items():
    np.testing.assert_array_equal(getattr(record, name), values)
"""
    subprocess.run(
        [sys.executable, "-c", plain, str(tmp_path)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        check=True,
    )
