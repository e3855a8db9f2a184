"""Results over a base of finite mass: a sound one passes, a changed one does not."""

import h5py
import pytest

from vibrosweep.cli import main
from vibrosweep.model.measures import RECORD
from vibrosweep.model.parameters import MOUNT
from vibrosweep.proof.report import State
from vibrosweep.proof.verifying import verify

SPRUNG = """
title = "Coupled particles"
[scene]
base = "sprung"
particles = 3
launch = [0.0, 0.2, 0.2]
duration = 2.5
contact_time = 5e-3
mount_damping = 0.05
[sample]
realizations = 2
seed = 4
restitution = [0.3, 0.6]
amplitude = [2.0, 3.0]
mass_ratio = [0.0, 0.2]
mount_frequency = [0.3, 2.0]
[measure]
transient = 0.5
separation = true
per_particle = true
[record]
restitution = 0.6
amplitude = 2.2
mass_ratio = 0.05
mount_frequency = 0.37
duration = 1.5
"""


@pytest.fixture(scope="module")
def sprung(computed):
    return computed(SPRUNG)


def test_sound_dataset(sprung):
    report = verify(sprung)
    assert report.passed
    assert report.count(State.COMPARED) == 2
    assert not report.not_compared()
    found = report.variables()
    assert {f"record/{name}" for name in RECORD} < set(found)
    assert not any(variable.undecided for variable in found.values())
    deviations = [o.deviation for o in report.outcomes if o.realization is not None]
    assert all(0.0 <= error < estimate for error, estimate in deviations)
    lines = list(report.lines())
    assert lines[1].startswith("no error bounds are proved for coupled particles")
    assert lines[2].startswith("largest error of a recomputed landing")
    assert lines[-1].startswith("passed")


CHANGES = {
    "impact_count": 1,
    "particle_rest_count": 1,
    "rebound_height_mean": 1e-3,
    "dt_min": 1e-3,
    "order_1": -1e-3,
    "gap_median": 1e-3,
    "order_changes": 1,
    "undecided_count": 1,
}


def test_changed_numbers_are_found(sprung, edited):
    with edited(sprung) as (path, file):
        for name, change in CHANGES.items():
            values = file[name][...]
            values[0] += change
            file[name][...] = values
    complaints = list(verify(path).complaints())
    for name in CHANGES:
        assert any(c.startswith("realization 0") and f": {name} is" in c for c in complaints), name


def test_changed_coordinates_of_the_mount_are_found(sprung, edited):
    with edited(sprung) as (path, file):
        for name in MOUNT:
            values = file[name]
            values[(1,) * values.ndim] *= 1 + 1e-6
            file["record"][name][()] *= 1 + 1e-6
    found = verify(path).variables()
    for name in MOUNT:
        varies = name != "mount_damping"
        assert found[name].outside == {"realization 1" if varies else "dataset"}, name
        assert found[f"record/{name}"].outside == {"record"}, name


def test_command_leaves_out_what_is_too_long(sprung, capsys):
    assert main(["verify", str(sprung), "--max-landings", "2"]) == 0
    assert "2 left out: too many landings" in capsys.readouterr().out


def test_landings_before_the_window_count_as_too_many(sprung):
    with h5py.File(sprung) as file:
        in_window = int(file["impact_count"][...].max())
    report = verify(sprung, max_landings=in_window)
    assert report.count(State.TOO_LONG) > 0
    assert report.count(State.TOO_LONG) + report.count(State.COMPARED) == 2


def test_without_landings_no_error_of_a_landing_is_reported(computed):
    text = SPRUNG.replace("duration = 2.5", "duration = 1e-3").replace("transient = 0.5", "")
    text = text.replace("launch = [0.0, 0.2, 0.2]", "launch = [0.0, 0.0, 0.0]")
    report = verify(computed(text[: text.index("[record]")]))
    assert report.passed
    assert report.count(State.COMPARED) == 2
    assert not any(line.startswith("largest error of a") for line in report.lines())
