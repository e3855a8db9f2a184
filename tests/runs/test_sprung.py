"""A sweep over a base of finite mass, from its file to its figures."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep import open_record, open_sweep, simulate
from vibrosweep.commands.describe import describe
from vibrosweep.figures import save_all
from vibrosweep.runs.driver import retry_failed, run_sweep
from vibrosweep.runs.plan import make_plan
from vibrosweep.scene.sweep import parse_spec

TEXT = """
title = "Balls of three masses"
[scene]
base = "sprung"
base_mass = 1.0
mount_frequency = 3.0
particles = 3
duration = 8.0
[sample]
design = "grid"
particle_mass = [0.0, 0.004, 0.1]
amplitude = [1.0, 1.8]
[measure]
separation = true
[record]
particle_mass = 0.1
amplitude = 1.8
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("sprung") / "whole.h5"
    run_sweep(parse_spec(TEXT), path, threads=2)
    return path


def test_a_result_holds_the_mount_and_the_masses(path):
    with open_sweep(path) as sweep, open_record(path) as record:
        for dataset in (sweep, record):
            assert dataset.attrs["base"] == "sprung"
            assert float(dataset["mount_damping"]) == 0.05
            assert float(dataset["base_mass"]) == 1.0
        assert np.array_equal(sweep["mass_ratio"], sweep["particle_mass"])
        assert float(record["mass_ratio"]) == 0.1


def test_the_result_depends_on_neither_threads_nor_chunks(path, tmp_path):
    run_sweep(parse_spec(TEXT), tmp_path / "other.h5", threads=1, chunk=1)
    for group in (None, "record"):
        whole, other = (
            xr.load_dataset(p, engine="h5netcdf", group=group)
            for p in (path, tmp_path / "other.h5")
        )
        for name in whole.variables:
            assert whole[name].values.tobytes() == other[name].values.tobytes(), name


def test_the_record_is_that_of_simulate(path):
    with open_record(path) as record:
        same = simulate(
            base="sprung",
            particle_mass=0.1,
            base_mass=1.0,
            mount_frequency=3.0,
            amplitude=1.8,
            launch_time=record["launch_time"].values,
            duration=8.0,
        )
        assert np.array_equal(record["impact_count"], same["impact_count"])


def test_a_sweep_is_described_and_planned(path, workers):
    told = "\n".join(describe(path))
    assert "particle_mass                   0 ... 0.1 kg" in told
    assert "mount_damping                   0.05 (default)" in told
    plan = make_plan(parse_spec(TEXT), workers)
    assert plan.cost.known
    assert plan.chunks == 1


def test_realizations_that_spent_their_budget_are_computed_again(path, tmp_path):
    few = parse_spec(TEXT.replace("separation", "impact_budget = 12\nseparation"))
    output = tmp_path / "few.h5"
    run_sweep(few, output, threads=1)
    failed = int(np.sum(xr.load_dataset(output)["status"] != 0))
    assert failed > 0
    _, again = retry_failed(few, output, threads=1, impact_budget=10_000_000)
    assert again == failed
    whole = xr.load_dataset(path)
    for name, values in xr.load_dataset(output).variables.items():
        assert values.values.tobytes() == whole[name].values.tobytes(), name


def test_every_figure_is_drawn(path, tmp_path):
    with open_sweep(path) as sweep, open_record(path) as record:
        files = save_all(sweep, record, tmp_path)
    assert {"fig1_height_time.png", "fig2_height_time_all.png"} <= {file.name for file in files}
