"""Results, proofs, retries and identities, however the forcing and the times are given."""

import shutil

import h5py
import numpy as np
import pytest
import xarray as xr

from vibrosweep import simulate
from vibrosweep.commands.describe import describe
from vibrosweep.errors import RunError
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.proof.verifying import verify
from vibrosweep.runs.chunks import differences, identity
from vibrosweep.runs.driver import retry_failed, run_sweep
from vibrosweep.scene.sweep import parse_spec

TEXT = """
title = "Shaken in one of four ways"
[scene]
particles = 2
{scene}
[sample]
realizations = 7
restitution = [0.5, 0.9]
frequency = [1.0, 3.0]
{sample}
[measure]
{measure}
separation = true
regimes = true
trust = true
[record]
restitution = 0.9
frequency = 2.0
{record}
"""
WAYS = {
    "amplitude": [0.5, 2.0],
    "base_velocity": [0.3, 1.0],
    "base_displacement": [0.02, 0.1],
    "base_acceleration": [0.2, 2.0],
}


def spec_of(way, *, base="high-bounce", measure="transient_periods = 2", **own):
    text = TEXT.format(
        scene=own.get("scene", f'duration_periods = 12\nbase = "{base}"'),
        sample=f"{way} = {WAYS[way]}",
        measure=measure,
        record=f"{way} = {WAYS[way][1]}",
    )
    return parse_spec(text)


def loaded(path, group=None):
    return xr.load_dataset(path, engine="h5netcdf", group=group)


@pytest.fixture(scope="module", params=WAYS)
def result(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("forcing") / "whole.h5"
    run_sweep(spec_of(request.param), path, threads=2)
    return request.param, path


def test_a_result_says_how_the_forcing_was_given_and_what_follows(result):
    way, path = result
    for found in (loaded(path), loaded(path, "record")):
        e, f, g, a, gamma = (
            found[n].values
            for n in ("restitution", "frequency", "gravity", "amplitude", "base_acceleration")
        )
        assert found.attrs["forcing"] == way
        assert found.attrs["base"] == "high-bounce"
        assert {n for n in FORCINGS if n in found.variables} == {
            "amplitude",
            "base_acceleration",
            way,
        }
        velocity = a / (1.0 + e)
        assert np.allclose(gamma, 2.0 * np.pi * f * velocity / g, rtol=1e-14)
        expected = {"amplitude": a, "base_velocity": velocity, "base_acceleration": gamma}
        expected["base_displacement"] = velocity / (2.0 * np.pi * f)
        assert np.allclose(found[way], expected[way], rtol=1e-14)
        assert np.array_equal(found["duration"], 12.0 / f)
        assert found.attrs["duration_periods"] == 12.0
    assert np.array_equal(loaded(path)["transient"], 2.0 / loaded(path)["frequency"])
    lines = "\n".join(describe(path))
    assert "high-bounce" in lines
    assert "(12 forcing periods)" in lines


def test_a_result_does_not_depend_on_chunks_and_is_proved(result, tmp_path):
    way, path = result
    run_sweep(spec_of(way), tmp_path / "cut.h5", threads=1, chunk=3)
    for group in (None, "record"):
        one, other = loaded(path, group), loaded(tmp_path / "cut.h5", group)
        xr.testing.assert_equal(one, other)
    report = verify(path, sample=7)
    assert report.passed
    assert {way, "amplitude", "base_acceleration", "duration"} <= report.variables().keys()
    derived = "base_acceleration" if way != "base_acceleration" else "amplitude"
    changed = (derived, "duration", "transient")
    copy = shutil.copy(path, tmp_path / "copy.h5")
    with h5py.File(copy, "r+") as file:
        for name in changed:
            file[name][1] *= 1.0 + 1e-15
    found = verify(copy, sample=7).variables()
    assert {n for n in changed if found[n].outside == {"realization 1"}} == {*changed}


def test_the_amplitude_of_a_result_gives_its_numbers_again(result):
    record = loaded(result[1], "record")
    again = simulate(
        amplitude=record["amplitude"].item(),
        restitution=0.9,
        frequency=2.0,
        launch_time=record["launch_time"].values,
        duration_periods=12,
    )
    assert np.array_equal(again["landing_time"][0], record["landing_time"][0], equal_nan=True)


def test_incomplete_realizations_are_retried(tmp_path):
    few = spec_of("base_displacement", measure="transient_periods = 2\nimpact_budget = 6")
    path = tmp_path / "few.h5"
    run_sweep(few, path, threads=1)
    _, number = retry_failed(few, path, threads=1, impact_budget=10_000_000)
    assert number > 0
    run_sweep(spec_of("base_displacement"), tmp_path / "all.h5", threads=1)
    xr.testing.assert_equal(loaded(path), loaded(tmp_path / "all.h5"))


def test_another_base_or_forcing_or_unit_of_time_is_another_sweep():
    one = identity(spec_of("amplitude"))
    assert differences(one, identity(spec_of("amplitude", base="moving"))) == [
        "scene.base: was high-bounce, is moving",
        "record.base: was high-bounce, is moving",
    ]
    seconds = spec_of("amplitude", scene='duration = 12\nbase = "high-bounce"')
    changed = differences(one, identity(seconds))
    assert any(line.startswith("scene.duration") for line in changed)
    assert differences(one, identity(spec_of("base_velocity")))


def test_a_run_is_not_continued_under_another_base(tmp_path):
    path = tmp_path / "out.h5"
    spec = spec_of("amplitude")
    run_sweep(spec, path, threads=1)
    with pytest.raises(RunError, match=r"scene\.base: was high-bounce, is moving"):
        retry_failed(spec_of("amplitude", base="moving"), path, threads=1)


def test_a_result_without_a_base_attribute_is_of_the_high_bounce_base(tmp_path):
    path = tmp_path / "old.h5"
    run_sweep(spec_of("amplitude"), path, threads=1)
    with h5py.File(path, "r+") as file:
        for group in (file, file["record"]):
            del group.attrs["base"]
            del group.attrs["forcing"]
            del group["base_acceleration"]
    assert any(line.split() == ["base", "high-bounce"] for line in describe(path))
    assert verify(path, sample=7).passed
