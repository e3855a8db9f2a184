"""A sound dataset passes; whatever is changed in it by hand is found."""

import math
import shutil

import h5py
import numpy as np
import pytest

from vibrosweep.errors import DataError, ParameterError
from vibrosweep.variables import PER_PARTICLE, RECORD, REGIMES, SWEEP, TRUST
from vibrosweep.verify import verify
from vibrosweep.verify.reading import read_sample
from vibrosweep.verify.report import State

MEASURED = {**SWEEP, **PER_PARTICLE, **REGIMES, **TRUST}
NUMBERS = [name for name, v in MEASURED.items() if v.dtype == "float64"]
CODES = [name for name, v in MEASURED.items() if v.flags]
COUNTS = [name for name in MEASURED if name not in NUMBERS + CODES]


def everything(path, **options):
    return verify(path, sample=10**9, **options)


def test_sound_dataset(claimed):
    report = everything(claimed)
    assert report.passed
    assert report.count(State.COMPARED) == report.total == 3
    found = report.variables()
    assert set(found) == {*MEASURED, *(f"record/{name}" for name in RECORD)}
    for name, variable in found.items():
        assert variable.errors, name
        assert not variable.outside
        assert not variable.undecided
        # the proof is about these very numbers, and it leaves them digits
        assert not variable.digits or max(variable.digits) > 8.0
    lines = list(report.lines())
    assert lines[-1].startswith("passed")
    assert {line.split()[0] for line in lines} >= set(found)


def test_sound_dataset_without_bounds(bare):
    report = everything(bare)
    assert report.passed
    assert not report.claimed
    assert report.count(State.COMPARED) == 5
    assert "landing_time_error" not in report.variables()
    assert any("computed anew" in line for line in report.lines())


def moved(value):
    """Move a number by a millionth, and further than zero."""
    return value * (1 + 1e-6) + 1e-9


def caught(change, name):
    report = everything(change.path)
    assert not report.passed
    found = report.variables()
    assert found[name].outside == {change.place}
    assert any(c.startswith(change.place) and f" {name} " in c for c in report.complaints())
    return found


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("new", [moved, lambda _: np.nan, lambda _: np.inf])
def test_changed_number(claimed, changed, name, new):
    caught(changed(claimed, name, new), name)


@pytest.mark.parametrize("name", COUNTS)
@pytest.mark.parametrize("step", [-1, 1])
def test_changed_count(claimed, changed, name, step):
    found = caught(changed(claimed, name, lambda n: n + step), name)
    assert [n for n in found if found[n].outside] == [name]


@pytest.mark.parametrize("name", CODES)
@pytest.mark.parametrize("new", [lambda code: 1 - code, lambda _: -1, lambda _: 2])
def test_changed_code(claimed, changed, name, new):
    found = caught(changed(claimed, name, new), name)
    assert [n for n in found if found[n].outside] == [name]


@pytest.mark.parametrize("name", ["restitution", "amplitude"])
def test_changed_parameter(claimed, changed, name):
    change = changed(claimed, name, lambda value: value * (1 + 1e-6))
    caught(change, "rebound_height_mean")


@pytest.mark.parametrize("name", ["dt_min", "rebound_height_max", "flight_time_mean"])
def test_changed_number_without_bounds(bare, changed, name):
    caught(changed(bare, name, moved, realization=3), name)


@pytest.mark.parametrize("name", RECORD)
def test_changed_record(claimed, tmp_path, name):
    path = tmp_path / "changed.h5"
    shutil.copy(claimed, path)
    with h5py.File(path, "r+") as file:
        variable = file["record"][name]
        where = (0, 1, 1)[: variable.ndim]
        integer = np.issubdtype(variable.dtype, np.integer)
        variable[where] = 1 - variable[where] if integer else moved(variable[where])
    report = everything(path)
    assert [n for n, v in report.variables().items() if v.outside] == [f"record/{name}"]
    assert next(report.complaints()).startswith("record, particle 1: ")


def test_invented_landing_in_record(claimed, tmp_path):
    path = tmp_path / "changed.h5"
    shutil.copy(claimed, path)
    with h5py.File(path, "r+") as file:
        last = file["record"]["landing_time"][0]
        particle = int(np.argmax(np.isnan(last[:, -1])))
        file["record"]["landing_time"][0, particle, -1] = 7.9
    assert not everything(path).passed


@pytest.mark.parametrize("name", ["landing_time_error", "rebound_velocity_error"])
def test_bound_that_is_too_small_is_disproved(claimed, tmp_path, name):
    path = tmp_path / "changed.h5"
    shutil.copy(claimed, path)
    with h5py.File(path, "r+") as file:
        file.attrs["source"] = "vibrosweep 0.0.1"  # which may have bounded otherwise
        known_worst = int(np.argmax(file[name][...]))
        file[name][known_worst] = 1e-18
    found = everything(path).variables()[name]
    assert found.outside == {f"realization {known_worst}"}
    assert max(found.errors) > 1e-18


def test_bounds_of_another_version_may_differ(claimed, changed):
    change = changed(claimed, "landing_time_error", lambda bound: 3.0 * bound)
    assert not everything(change.path).passed
    with h5py.File(change.path, "r+") as file:
        file.attrs["source"] = "vibrosweep 0.0.1"
    assert everything(change.path).passed


def test_tolerance_that_is_not_kept(claimed, tmp_path):
    path = tmp_path / "changed.h5"
    shutil.copy(claimed, path)
    with h5py.File(path, "r+") as file:
        file.attrs["tolerance"] = 1e-18
        file["landing_time_error"][...] = np.maximum(file["landing_time_error"][...], 1e-15)
    assert everything(path).variables()["trusted_until"].outside


def test_sample_is_seeded_and_without_replacement(bare):
    def drawn(size, seed):
        return read_sample(bare, size, seed)[0].rows.tolist()

    assert drawn(2, 5) == drawn(2, 5)
    assert len({tuple(drawn(2, seed)) for seed in range(6)}) > 1
    assert all(drawn(4, seed) == sorted(set(drawn(4, seed))) for seed in range(3))
    assert drawn(5, 1) == drawn(6, 2) == list(range(5))
    outcomes = verify(bare, sample=2, seed=5).outcomes
    assert [outcome.realization for outcome in outcomes] == drawn(2, 5)


def test_too_long(claimed):
    report = everything(claimed, max_landings=200)
    assert report.passed
    assert 0 < report.count(State.TOO_LONG) < 3
    assert report.count(State.TOO_LONG) + report.count(State.COMPARED) == 3
    assert any("--max-landings" in line for line in report.lines())


CHAOS = """
title = "An orbit that loses all digits"
[scene]
particles = 2
restitution = 0.9
amplitude = 4.0
duration = 1000.0
[measure]
trust = true
impact_budget = {budget}
"""


@pytest.mark.parametrize(("budget", "state"), [(10**6, State.NO_CLAIM), (40, State.NOT_COMPLETED)])
def test_no_claim(computed, budget, state):
    report = everything(computed(CHAOS.format(budget=budget)))
    assert report.passed
    assert [outcome.state for outcome in report.outcomes] == [state]
    assert list(report.lines())[-1] == "nothing was compared"


def test_tie_is_undecided(computed):
    # e v = v_rest without excitation, in doubles that are not exact: u' = 0.5 u = r
    text = """
title = "A landing at the very end"
[scene]
particles = 1
gravity = 2.0
launch_velocity = 1.0
launch = [0.0]
amplitude = 0.0
restitution = 0.5
duration = 1.0
"""
    report = everything(computed(text))
    assert report.passed
    assert report.outcomes[0].state is State.NO_CLAIM


def test_landing_at_the_edge_of_the_window_is_undecided(computed):
    text = """
title = "The first landing is at the beginning of the window"
[scene]
particles = 1
gravity = 2.0
launch_velocity = 1.0
launch = [0.0]
duration = 3.0
[measure]
transient = 1.0
"""
    report = everything(computed(text))
    assert report.passed
    found = report.variables()
    for name in ("impact_count", "rebound_height_mean", "flight_time_mean"):
        assert found[name].undecided == {"realization 0"}
    assert found["at_rest_count"].errors == [0.0]


def test_progress(bare):
    seen = []
    everything(bare, advance=lambda done, total: seen.append((done, total)))
    assert seen == [(n, 5) for n in range(1, 6)]


def test_nothing_sampled(computed):
    report = everything(computed('title = "One realization"\n[scene]\nparticles = 2\n'))
    assert report.passed
    assert report.total == report.count(State.COMPARED) == 1


@pytest.mark.parametrize(
    "options", [{"sample": 0}, {"seed": -1}, {"max_landings": 0}], ids=lambda o: next(iter(o))
)
def test_numbers_out_of_range(claimed, options):
    with pytest.raises(ParameterError, match=f"{next(iter(options))} = .* at least"):
        verify(claimed, **options)


def test_missing_file(tmp_path):
    with pytest.raises(DataError, match="no such result file"):
        verify(tmp_path / "none.h5")


def test_damaged_file(claimed, tmp_path):
    path = tmp_path / "half.h5"
    path.write_bytes(claimed.read_bytes()[: claimed.stat().st_size // 2])
    with pytest.raises(DataError, match="damaged"):
        verify(path)


def without_status(file):
    del file["status"]


def with_restitution(file):
    file["restitution"][0] = 1.5


def with_duration(file):
    file["duration"][...] = math.nan


def with_rebound(file):
    file.attrs["rebound"] = "bounce"


def with_particle_status(file):
    file.attrs["particles"] = 5


@pytest.mark.parametrize(
    "harm", [without_status, with_restitution, with_duration, with_rebound, with_particle_status]
)
def test_what_no_sweep_writes(claimed, tmp_path, harm):
    path = tmp_path / "harmed.h5"
    shutil.copy(claimed, path)
    with h5py.File(path, "r+") as file:
        harm(file)
    what = harm.__name__.partition("_")[2]
    with pytest.raises(DataError, match=f"{what}.*: is not what vibrosweep run writes"):
        everything(path)
