"""Files of virtual experiments, and all their mistakes at once."""

import math
from pathlib import Path

import pytest

from vibrosweep.errors import SpecError
from vibrosweep.lab.experiment import LABORATORY, Experiment, read_experiments

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
