"""Every change that is made to a dataset by hand is found and named."""

import h5py
import numpy as np
import pytest
import xarray as xr

from vibrosweep.model.measures import MEASURE_OF, MEASURES, OF_TRAJECTORIES, RECORD, VARIABLES
from vibrosweep.model.parameters import NOISE, OF_MOUNT, OF_RESTITUTION, STREAM
from vibrosweep.proof.report import RECORDED
from vibrosweep.proof.sampling import RECORD_COORDINATES, SWEEP_COORDINATES
from vibrosweep.proof.verifying import JUDGES, verify

# those of coupled particles: test_verify_sprung.py
SINGLE = [n for n in VARIABLES if n not in MEASURE_OF or not MEASURES[MEASURE_OF[n]].coupled]
NUMBERS = [name for name in SINGLE if VARIABLES[name].dtype == "float64"]
CODES = [name for name in SINGLE if VARIABLES[name].flags]
COUNTS = [name for name in SINGLE if name not in NUMBERS + CODES]
# Coordinates that the files here lack: other forcings, mounts, noise, laws, ragged records.
OTHERS = {
    "base_velocity",
    "base_displacement",
    *OF_MOUNT,
    *NOISE,
    STREAM,
    *OF_RESTITUTION,
    *OF_TRAJECTORIES,
}
# Variables that are computed from others of the file are outside their claims with them.
FOLLOW = {
    "dt_min": {"dt_min_resolved"},
    "lyapunov_largest": {"lyapunov_max"},
    "lyapunov_largest_error": {"lyapunov_largest"},
    "lyapunov_sum_error": {"lyapunov_sum"},
    "cycle_uncertain": {
        "uncertain_cycle_count",
        "lyapunov_largest_error",
        "lyapunov_sum_error",
    },
    "orbit": {"orbit_count", "slot_count"},
    "slot": {"slot_count"},
}


def everything(path):
    return verify(path, sample=10**9)


def moved(value):
    """Change a number by a millionth and 1e-9, so that a zero changes, too."""
    return value * (1 + 1e-6) + 1e-9


def caught(change, name):
    report = everything(change.path)
    assert not report.passed
    assert name in list(report.lines())[-1].partition("claimed for them: ")[2].split(", ")
    found = report.variables()
    assert found[name].outside == {change.place}
    assert any(c.startswith(change.place) and f" {name} " in c for c in report.complaints())


@pytest.fixture(scope="module")
def honest(many):
    return everything(many).variables()


@pytest.fixture
def all_caught(many, honest, edited):
    """Change each variable in a realization of its own; verify must find each change there only."""

    def change_all(names, new):
        places = {}
        with edited(many) as (path, file):
            rows = list(np.argsort(file["landing_time_error"][...]))  # the best known first
            for name in names:
                values = file[name]
                row = next(
                    i
                    for i in rows
                    if np.isfinite(values[i]).any()
                    and f"realization {i}" not in honest[name].undecided
                )
                rows.remove(row)
                where = (row, int(np.argmax(np.isfinite(values[row]))))[: values.ndim]
                values[where] = new(values[where])
                places[name] = f"realization {row}"
        report = everything(path)
        listed = list(report.lines())[-1].partition("claimed for them: ")[2].split(", ")
        found, complaints = report.variables(), list(report.complaints())
        for name, place in places.items():
            followed = {places[n] for n in places if name in FOLLOW.get(n, set())}
            assert name in listed
            assert found[name].outside - followed == {place}, name
            assert any(c.startswith(place) and f" {name} " in c for c in complaints)
        for name, variable in found.items():
            strange = {n for n in places if places[n] in variable.outside} - {name}
            assert all(name in FOLLOW.get(n, set()) for n in strange), (name, strange)

    return change_all


def test_every_variable_has_a_judge():
    assert {variable.judged for variable in VARIABLES.values()} == set(JUDGES)
    assert {f"record/{name}" for name in RECORD} == set(RECORDED)


@pytest.mark.parametrize("new", [moved, lambda _: np.nan], ids=["moved", "NaN"])
def test_changed_numbers(all_caught, new):
    all_caught(NUMBERS, new)


@pytest.mark.parametrize("step", [-1, 1])
def test_changed_counts(all_caught, step):
    all_caught(COUNTS, lambda count: count + step)


@pytest.mark.parametrize("new", [lambda code: 1 - code, lambda _: -1], ids=["other", "-1"])
def test_changed_codes(all_caught, new):
    all_caught(CODES, new)


@pytest.mark.parametrize(
    "name", [name for name, key in MEASURE_OF.items() if key in ("lyapunov", "regimes")]
)
def test_changed_number_of_a_locked_orbit(locked, changed, name):
    caught(changed(locked, name, lambda value: moved(value) if value % 1 else value + 1), name)


def test_changed_coordinates(claimed, edited):
    present, recorded = set(SWEEP_COORDINATES) - OTHERS, set(RECORD_COORDINATES) - OTHERS
    with edited(claimed) as (path, file):
        for group, names in ((file, present), (file["record"], recorded)):
            for variable in (group[name] for name in names):
                where = (1,) * variable.ndim
                variable[where] = moved(variable[where])
    found = everything(path).variables()
    for name in present:
        varies = name in ("restitution", "amplitude", "base_acceleration")
        assert found[name].outside == {"realization 1" if varies else "dataset"}, name
    for name in recorded:
        assert found[f"record/{name}"].outside == {"record"}, name


def test_every_array_of_a_file_is_judged(claimed, edited):
    """Also arrays that HDF5 shows and readers of netCDF do not."""
    arrays = []
    with h5py.File(claimed) as file:
        file.visititems(lambda name, one: arrays.append(name) if hasattr(one, "dtype") else None)
    known = {
        *VARIABLES,
        *SWEEP_COORDINATES,
        *RECORDED,
        *(f"record/{n}" for n in RECORD_COORDINATES),
    }
    axes = set(arrays) - known
    assert {"realization", "particle", "record/record_impact"} <= axes
    for name in sorted(axes):
        with edited(claimed) as (path, file):
            file[name][1 % file[name].size] = 3.0
        (complaint,) = everything(path).complaints()
        assert complaint.startswith(f"dataset: {name} is 3.0 at ")


def test_axes_that_another_program_numbers_are_variables(claimed, tmp_path):
    path = tmp_path / "again.h5"
    with xr.open_dataset(claimed, engine="h5netcdf") as opened:
        held = opened.load().assign_coords(realization=np.arange(3), particle=np.arange(2))
    for changed in ({}, {"particle": np.array([0, 2])}, {"realization": np.array([0, 2, 1])}):
        held.assign_coords(changed).to_netcdf(path, engine="h5netcdf")
        report = everything(path)
        assert [c.split()[1] for c in report.complaints()] == list(changed)
        assert {"realization", "particle"} <= report.variables().keys()


@pytest.mark.parametrize("name", ["restitution", "amplitude"])
def test_changed_parameter(claimed, changed, name):
    change = changed(claimed, name, lambda value: value * (1 + 1e-6))
    caught(change, "rebound_height_mean")


@pytest.mark.parametrize("name", ["dt_min", "rebound_height_max", "flight_time_mean"])
def test_changed_number_without_bounds(bare, changed, name):
    caught(changed(bare, name, moved, realization=3), name)


@pytest.mark.parametrize("name", RECORD)
def test_changed_record(claimed, edited, name):
    with edited(claimed) as (path, file):
        variable = file["record"][name]
        where = (0, 1, 1)[: variable.ndim]
        integer = np.issubdtype(variable.dtype, np.integer)
        variable[where] = 1 - variable[where] if integer else moved(variable[where])
    report = everything(path)
    assert [n for n, v in report.variables().items() if v.outside] == [f"record/{name}"]
    assert next(report.complaints()).startswith("record, particle 1: ")


def test_invented_landing_in_record(claimed, edited):
    with edited(claimed) as (path, file):
        last = file["record"]["landing_time"][0]
        particle = int(np.argmax(np.isnan(last[:, -1])))
        file["record"]["landing_time"][0, particle, -1] = 7.9
    assert not everything(path).passed


@pytest.mark.parametrize("name", ["landing_time_error", "rebound_velocity_error"])
def test_bound_that_is_too_small_is_disproved(claimed, edited, name):
    with edited(claimed) as (path, file):
        file.attrs["source"] = "vibrosweep 0.0.1"  # whose bounds may be others
        known_worst = int(np.argmax(file[name][...]))
        file[name][known_worst] = 1e-18
    found = everything(path).variables()[name]
    assert found.outside == {f"realization {known_worst}"}
    assert max(found.errors) > 1e-18


def test_bounds_of_another_version_may_differ(claimed, changed, edited):
    change = changed(claimed, "landing_time_error", lambda bound: 3.0 * bound)
    assert not everything(change.path).passed
    with edited(change.path) as (_, file):
        file.attrs["source"] = "vibrosweep 0.0.1"
    assert everything(change.path).passed


def test_tolerance_that_is_not_kept(claimed, edited):
    with edited(claimed) as (path, file):
        file.attrs["tolerance"] = 1e-18
        file["landing_time_error"][...] = np.maximum(file["landing_time_error"][...], 1e-15)
    assert everything(path).variables()["trusted_until"].outside
