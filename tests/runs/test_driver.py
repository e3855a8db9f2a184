"""From a sweep file to its result: the same bits however it is divided, and nothing unfinished."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from vibrosweep import open_record, open_sweep, simulate
from vibrosweep.api.results import has_record
from vibrosweep.cli import main
from vibrosweep.errors import ParameterError, TableError
from vibrosweep.figures.registry import FIGURES, available
from vibrosweep.figures.style import for_file
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.runs import chunks
from vibrosweep.runs import driver as module
from vibrosweep.scene.sweep import parse_spec, read_spec

SWEEPS = sorted((Path(__file__).parents[2] / "sweeps").glob("*.toml"))
ALL_MEASURES = "[measure]\nseparation = true\nper_particle = true\ntrust = true\nregimes = true\n"
DRAWN = """
[scene]
particles = 5
duration = 8.0
[sample]
design = "uniform"
seed = 3
realizations = 40
restitution = [0.8, 0.98]
amplitude = [0.2, 3.5]
frequency = [0.5, 3.0]
"""
DESIGNS = {
    **{name: DRAWN.replace("uniform", name) for name in ("uniform", "latin", "sobol")},
    "grid": '[sample]\ndesign = "grid"\nrestitution = [0.8, 0.9]\n'
    "amplitude = { start = 0.5, stop = 3.0, num = 11 }\n",
}


def bits(path):
    """Every variable and coordinate of a result, to the last bit."""
    with h5py.File(path) as file:
        found = {n: v for n, v in file.items() if isinstance(v, h5py.Dataset)}
        return {n: (v.shape, v.dtype, v[()].tobytes()) for n, v in found.items()}


@pytest.mark.parametrize("physics", ['rebound = "reflect"', 'rebound = "rest"', 'base = "moving"'])
def test_bits_depend_on_neither_threads_nor_chunks(compute, physics):
    text = DRAWN.replace("particles", f"{physics}\nparticles").replace("= 40", "= 11")
    text += ALL_MEASURES
    expected = bits(compute(text, threads=2))
    for threads, chunk in ((1, 1), (1, None), (2, 7), (2, 1000)):
        assert bits(compute(text, threads=threads, chunk=chunk)) == expected


@pytest.mark.parametrize("design", DESIGNS)
def test_every_design_in_chunks(compute, design):
    assert bits(compute(DESIGNS[design], threads=1, chunk=7)) == bits(compute(DESIGNS[design]))


def test_the_seed_decides(compute):
    assert bits(compute(DRAWN)) == bits(compute(DRAWN))
    assert bits(compute(DRAWN)) != bits(compute(DRAWN.replace("seed = 3", "seed = 4")))


def test_measures_are_those_of_the_landings(compute):
    """Sampled frequencies, staggered launches: every fifth realization against its own record."""
    path = compute(DRAWN + ALL_MEASURES + "transient = 2.0\n")
    sweep = xr.load_dataset(path)
    assert np.ptp(sweep["frequency"].values) > 1
    for i in range(0, sweep.sizes["realization"], 5):
        one = sweep.isel(realization=i)
        scene = "".join(f"{name} = {float(one[name])!r}\n" for name in PARAMETERS)
        alone = compute(f"[scene]\nparticles = 5\nduration = 8.0\n{scene}[record]\n")
        found = open_record(alone).load().isel(realization=0)
        seen = found["landing_time"] >= 2.0
        speed = found["rebound_velocity"].where(seen)
        height, flight = speed**2 / (2 * 9.81), 2 * speed / 9.81
        assert one["status"] == 0
        assert one["impact_count"] == seen.sum()
        assert one["rest_count"] == found["rested"].where(seen).sum()
        np.testing.assert_allclose(one["rebound_height_max"], height.max(), rtol=1e-12)
        np.testing.assert_allclose(one["rebound_height_mean"], height.mean(), rtol=1e-12)
        np.testing.assert_allclose(one["flight_time_mean"], flight.mean(), rtol=1e-12)
        for name, expected in {
            "particle_impact_count": seen.sum("impact"),
            "particle_rest_count": found["rested"].where(seen).sum("impact"),
            "particle_rebound_height_max": height.max("impact"),
            "particle_rebound_height_mean": height.mean("impact"),
            "particle_flight_time_mean": flight.mean("impact"),
        }.items():
            np.testing.assert_allclose(one[name], expected, rtol=1e-12)


def test_the_launch_counts_for_the_height_of_flights_only(compute):
    scene = "[scene]\namplitude = 0.1\nrestitution = 0.5\nlaunch = [0.5]\n"
    launch = 5.0**2 / (2 * 9.81)
    early = xr.load_dataset(compute(scene))
    late = xr.load_dataset(compute(scene + "[measure]\ntransient = 0.6\n"))
    assert early["flight_height_max"] == pytest.approx(launch)
    assert early["rebound_height_max"] < launch
    assert late["flight_height_max"] == late["rebound_height_max"] == early["rebound_height_max"]


def test_without_landings_measures_of_flights_are_undefined(compute):
    result = xr.load_dataset(compute("[scene]\nparticles = 2\nduration = 0.5\n" + ALL_MEASURES))
    assert result["impact_count"] == 0
    undefined = ("rebound_height_mean", "rebound_height_max", "flight_time_mean", "dt_min")
    assert all(np.isnan(result[name]).all() for name in undefined)
    assert result["flight_height_max"] == pytest.approx(5.0**2 / (2 * 9.81))
    assert result["collision_free"] == 1


def test_a_spent_budget_is_reported_and_harms_no_other_realization(compute):
    text = "[scene]\nparticles = 2\n[sample]\nrealizations = 20\namplitude = [0.001, 3.0]\n"
    limited = xr.load_dataset(compute(text + ALL_MEASURES + "impact_budget = 64\n"))
    free = xr.load_dataset(compute(text + ALL_MEASURES))
    spent = limited["status"] == 1
    assert 0 < spent.sum() < 20
    assert (limited["base_shared"].where(spent, -1) == -1).all()
    assert np.isnan(limited["dt_min"].where(spent)).all()
    kept = ~spent.values
    assert limited["dt_min"][kept].equals(free["dt_min"][kept])


# figures of the sweeps of the repository
RECORDED = ("height_time", "height_time_all", "return_map")
SAMPLED = {
    "moving": ("height_against_restitution", "plane_of_heights"),
    "paper": ("height_against_restitution", "plane_of_heights"),
    "steel_ball": ("height_against_restitution", "plane_of_heights"),
    "two_tones": ("height_against_restitution", "plane_of_heights"),
    "population": ("height_against_restitution", "plane_of_heights"),
    "sensitivity": ("height_against_restitution",),
    "separations": ("height_against_restitution", "plane_of_heights"),
}
TABLE = {
    "restitution": [0.8, 0.85, 0.9],
    "amplitude": [1.0, 1.1, 1.2],
    "frequency": [1.0, 2.0, 3.0],
}


@pytest.mark.parametrize("ending", ["csv", "nc"])
def test_a_table(compute, tmp_path, ending):
    table = xr.Dataset({name: ("row", values) for name, values in TABLE.items()})
    if ending == "nc":
        table.to_netcdf(tmp_path / "table.nc", engine="h5netcdf")
    else:
        table.to_dataframe().to_csv(tmp_path / "table.csv", index=False)
    path = compute(f'[scene]\nparticles = 2\n[sample]\ndesign = "table.{ending}"\n', chunk=2)
    result = xr.load_dataset(path)
    for name, values in TABLE.items():
        assert result[name].values.tolist() == values
    assert result["restitution"].dims == ("realization",)
    assert result.attrs["design"] == "table"
    last = {name: values[-1] for name, values in TABLE.items()}
    expected = simulate(**last, launch_time=[0.0, 1 / 6])["impact_count"].sum()
    assert result["impact_count"][-1] == expected


def test_a_bad_table_leaves_nothing(compute, tmp_path):
    (tmp_path / "table.csv").write_text("restitution,amplitude\n0.9,nan\n")
    with pytest.raises(TableError, match="nan"):
        compute('[sample]\ndesign = "table.csv"\n')
    assert not list(tmp_path.glob("*.h5"))
    assert not list(tmp_path.glob(".*"))


# long, or the files of other commands, whose own tests run them
NOT_RUN = re.compile("million|plane|basin|bifurcation|boundaries|branches|orbits|windows|shaker")
# the same sweep for several numbers of particles; its figures are drawn once
NUMBERED = re.compile(r"_\d+$")


@pytest.mark.parametrize("spec", SWEEPS, ids=lambda p: p.stem)
def test_every_sweep_of_the_repository_is_valid(spec):
    assert read_spec(spec).title


@pytest.mark.parametrize(
    "spec", [p for p in SWEEPS if not NOT_RUN.match(p.stem)], ids=lambda p: p.stem
)
def test_every_sweep_of_the_repository(spec, tmp_path):
    path = tmp_path / "out.h5"
    summary = module.run_sweep(read_spec(spec), path, threads=2)
    with open_sweep(path) as sweep:
        record = open_record(path) if has_record(path) else None
        assert (sweep["status"] == 0).all()
        assert sweep["impact_count"].sum() == summary.landings > 0
        drawn = available(sweep, record)
        sampled = SAMPLED.get(NUMBERED.sub("", spec.stem), ())
        separated = ("separation_distribution",) if "dt_min" in sweep else ()
        # over a base of finite mass every realization has a particle that rests or is locked
        if separated and "particle_impact_count" in sweep and spec.stem != "ordering":
            separated += ("separation_over_chance",)
        if "plane_of_heights" in sampled:
            measured = {"dt_min": "parameter_plane", "regime": "plane_of_regimes"}
            measured |= {"lyapunov_max": "plane_of_exponents", "slot_count": "plane_of_slots"}
            sampled += tuple(figure for name, figure in measured.items() if name in sweep)
        recorded = RECORDED if record is not None else ()
        assert drawn == [name for name in FIGURES if name in (*recorded, *sampled, *separated)]
        for name in () if NUMBERED.search(spec.stem) else drawn:
            entry = FIGURES[name]
            figure = for_file(entry.draw, sweep if entry.source == "sweep" else record)
            figure.savefig(tmp_path / f"{name}.png", dpi=30)


@pytest.mark.parametrize(
    ("chunk", "steps"), [(None, [0, 200]), (90, [0, 90, 180, 200]), (200, [0, 200])]
)
def test_progress_ends_with_all(tmp_path, chunk, steps):
    seen = []
    spec = read_spec(next(p for p in SWEEPS if p.stem == "paper"))
    module.run_sweep(
        spec, tmp_path / "out.h5", threads=1, chunk=chunk, advance=lambda *told: seen.append(told)
    )
    assert seen == [(done, 200) for done in steps]


def test_a_chunk_beyond_memory_is_refused(compute, tmp_path):
    with pytest.raises(ParameterError, match=r"1 realizations of 1000000000 particles.*GiB"):
        compute("[scene]\nparticles = 1_000_000_000\n")
    with pytest.raises(ParameterError, match="lower chunk="):
        compute(DRAWN.replace("= 40", "= 1_000_000_000_000"), chunk=10**12)
    assert [p.suffix for p in tmp_path.iterdir()] == [".toml", ".toml"]


def test_a_resumed_run_says_what_it_has_not_computed(tmp_path, capsys):
    """Its time is that of the others."""
    path = tmp_path / "paper.toml"
    path.write_text(next(p for p in SWEEPS if p.stem == "paper").read_text())

    def first_chunk(job, indices, tick):
        chunks.compute_chunk(job, indices[0], 1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        module.run_sweep(
            read_spec(path), tmp_path / "out.h5", threads=1, chunk=90, runner=first_chunk
        )
    assert main(["run", str(path), "-o", str(tmp_path / "out.h5"), "--threads", "1"]) == 0
    assert "90 realizations of them kept from the run before" in capsys.readouterr().out


def test_a_huge_sweep_does_not_fill_memory_before_it_starts(tmp_path):
    batches = []

    def first_chunk(job, indices, tick):
        chunks.compute_chunk(job, indices[0], 1, batches.append)
        columns = job.parts.read(indices[0], job.parts.finished()[indices[0]])
        assert sum(values.nbytes for values in columns.values()) < 100e6
        raise KeyboardInterrupt

    spec = parse_spec('title = "x"' + DRAWN.replace("= 40", "= 100_000_000"))
    with pytest.raises(KeyboardInterrupt):
        module.run_sweep(spec, tmp_path / "out.h5", threads=2, runner=first_chunk)
    assert max(batches) <= chunks.MOST_PER_PIECE // 5


def test_per_particle_variables_come_only_when_asked_for(compute):
    names = {variable.name for variable in MEASURES["per_particle"].variables}
    assert not names & set(bits(compute(DRAWN)))
    assert names <= set(bits(compute(DRAWN + ALL_MEASURES)))
