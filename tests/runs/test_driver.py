"""A sweep and its file."""

import io
import math
import re
import shutil
from itertools import pairwise
from pathlib import Path
from time import sleep

import h5py
import numpy as np
import pytest
import xarray as xr

from tests.cases import each_of
from vibrosweep import open_record, open_sweep, simulate, sweep, waiting
from vibrosweep.cli import main
from vibrosweep.commands.describe import describe
from vibrosweep.errors import ParameterError, RunError, TableError
from vibrosweep.figures.registry import FIGURES, available
from vibrosweep.figures.style import for_file
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.measures import OF_REALIZATIONS, VARIABLES, Status
from vibrosweep.proof.verifying import verify
from vibrosweep.runs import chunks, driver
from vibrosweep.runs import driver as module
from vibrosweep.runs.chunks import differences, identity
from vibrosweep.runs.driver import InMemory, run_sweep
from vibrosweep.runs.plan import make_plan
from vibrosweep.runs.result import Summary
from vibrosweep.scene.sweep import parse_spec, read_spec
from vibrosweep.store.reading import has_record
from vibrosweep.waiting import reporting, silent

# From a sweep file to its result: the same bits however it is divided, and nothing unfinished.

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
    for threads, chunk in ((1, 1), (2, 7)):
        assert bits(compute(text, threads=threads, chunk=chunk)) == expected


@pytest.mark.parametrize("design", DESIGNS)
def test_every_design_in_chunks(compute, design):
    assert bits(compute(DESIGNS[design], threads=1, chunk=7)) == bits(compute(DESIGNS[design]))


def test_the_seed_decides(compute):
    assert bits(compute(DRAWN)) == bits(compute(DRAWN))
    assert bits(compute(DRAWN)) != bits(compute(DRAWN.replace("seed = 3", "seed = 4")))


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
# the same sweep for several numbers of particles
NUMBERED = re.compile(r"_\d+$")


# these need machine code that no other test needs, or take long
RARE = {"steel_ball", "two_tones", "noisy_lock"}
PICTURED = set()  # figures that were drawn from an earlier file


@pytest.mark.parametrize(
    "spec",
    [
        pytest.param(p, id=p.stem, marks=[pytest.mark.weekly] * (p.stem in RARE))
        for p in SWEEPS
        if not NOT_RUN.match(p.stem)
    ],
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
        for entry in (FIGURES[name] for name in drawn if name not in PICTURED):
            figure = for_file(entry.draw, sweep if entry.source == "sweep" else record)
            figure.draw_without_rendering()
        PICTURED.update(drawn)


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
    assert "90 realizations of them are from the earlier run" in capsys.readouterr().out


def test_a_huge_sweep_does_not_fill_memory_before_it_starts(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "require_disk", lambda output, needed: None)  # 14 GiB
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


# A parameter that a sweep file does not state is reported to be at its default.

SHAKER = "[scene]\nfrequency = 17.0\nrestitution = 0.8\nphase = 0.0\n"
TABLE_DEFAULTS = '[scene]\nphase = 0.0\n[sample]\ndesign = "rows.csv"\n'


@pytest.mark.parametrize("text", [SHAKER, TABLE_DEFAULTS])
@pytest.mark.parametrize("chunk", [None, 1])
def test_defaults_are_told(compute, tmp_path, capsys, text, chunk):
    (tmp_path / "rows.csv").write_text("restitution,amplitude,frequency\n0.8,1.0,17\n0.9,1.0,17\n")
    expected = ["gravity", "launch_velocity", "contact_time"]
    expected = expected if "rows" in text else ["amplitude", *expected]
    path = compute(text, chunk=chunk)
    assert xr.load_dataset(path).attrs["defaults"].split() == expected
    told = [line.split()[0] for line in describe(path) if line.endswith(" (default)")]
    assert told == expected
    words = [str(path.with_suffix(".toml")), "-o", str(tmp_path / "new.h5")]
    for command, head in (("plan", "defaults"), ("run", "defaults")):
        assert main([command, *words]) == 0
        said = next(x for x in capsys.readouterr().out.splitlines() if x.startswith(head))
        values = said.removeprefix(head).split(", ")
        assert [value.split()[0] for value in values] == ["base", *expected]
        assert "gravity 9.81 m s-2" in said


@pytest.mark.parametrize(
    ("text", "subjects"),
    [
        ("base_acceleration = 2.0\n", {"defaults", "base"}),
        ('base_acceleration = 2.0\nbase = "high-bounce"\n', {"defaults"}),
        ("amplitude = 1.0\nfrequency = 60.0\n", {"defaults", "launch"}),
        ("amplitude = 1.0\nfrequency = 60.0\nlaunch_velocity = 1.0\n", {"defaults"}),
    ],
)
def test_a_base_that_stands_still_and_a_launch_that_is_long_are_told(compute, text, subjects):
    notes = xr.load_dataset(compute(f"[scene]\n{text}")).attrs["notes"]
    assert {one.partition(":")[0] for one in notes.split("; ") if ": " in one} >= subjects
    for other in {"base", "launch"} - subjects:
        assert f"{other}: " not in notes


def test_nothing_is_said_of_table_1_as_it_stands(compute):
    path = compute("")
    assert xr.load_dataset(path).attrs["defaults"] == ""
    assert not any("default" in line for line in describe(path))


@pytest.mark.parametrize(("transient", "duration"), [(0.0, 12.0), (1000.0, 1010.0), (0.0, 64.0)])
def test_a_window_too_short_for_exponents_is_told(compute, transient, duration):
    path = compute(
        f"[scene]\nduration = {duration}\n[measure]\nregimes = true\ntransient = {transient}\n"
    )
    told = "never aperiodic" in xr.load_dataset(path).attrs["notes"]
    assert told == (duration - transient < 64.0)


def test_an_observation_too_short_to_recognise_locked_orbits_is_told(compute, tmp_path, capsys):
    text = """
[scene]
restitution = 0.9
amplitude = 1.2
duration = {duration}
[measure]
regimes = {regimes}
"""
    needed = 150.0 / abs(math.log(0.9))
    for duration, regimes, told in (
        (0.99 * needed, "true", True),
        (1.01 * needed, "true", False),
        (12.0, "false", False),
    ):
        path = compute(text.format(duration=duration, regimes=regimes))
        assert ("unsettled" in xr.load_dataset(path).attrs["notes"]) == told
        for command in ("plan", "run", "info"):
            options = ["-o", str(tmp_path / "again.h5"), "--force"] if command == "run" else []
            file = path if command == "info" else path.with_suffix(".toml")
            assert main([command, str(file), *options]) == 0
            assert ("may be called unsettled" in capsys.readouterr().out) == told


@pytest.mark.parametrize(
    ("forcing", "told"),
    [
        ("base_displacement = 0.5", "up to 1258 g"),
        ("base_displacement = 0.0005", ""),
        ("base_acceleration = [1.0, 101.0]", "up to 101 g"),
    ],
)
def test_a_base_that_no_shaker_drives_is_told(compute, capsys, forcing, told):
    place = '[sample]\ndesign = "grid"\n' if "[" in forcing else "[scene]\nfrequency = 25.0\n"
    path = compute(f"{place}{forcing}\n")
    notes = xr.load_dataset(path).attrs["notes"]
    assert told in notes
    assert bool(told) == ("shakers" in notes)
    assert main(["plan", str(path.with_suffix(".toml"))]) == 0
    assert ("shakers" in capsys.readouterr().out) == bool(told)


# Results, proofs, retries and identities, however the forcing and the times are given.

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
    derived = "base_acceleration" if way != "base_acceleration" else "amplitude"
    changed = (derived, "duration", "transient")
    copy = shutil.copy(path, tmp_path / "copy.h5")
    with h5py.File(copy, "r+") as file:
        for name in changed:
            file[name][1] *= 1.0 + 1e-15
    found = verify(copy, sample=7).variables()
    assert {way, "amplitude", "base_acceleration", "duration"} <= found.keys()
    outside = {n: one.outside for n, one in found.items() if one.outside}
    assert outside == {name: {"realization 1"} for name in changed}


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


# A sweep over a base of finite mass, from its file to its figures.

TEXT_SPRUNG = """
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
def path_sprung(tmp_path_factory):
    path = tmp_path_factory.mktemp("sprung") / "whole.h5"
    run_sweep(parse_spec(TEXT_SPRUNG), path, threads=2)
    return path


def test_a_result_holds_the_mount_and_the_masses(path_sprung):
    with open_sweep(path_sprung) as sweep, open_record(path_sprung) as record:
        for dataset in (sweep, record):
            assert dataset.attrs["base"] == "sprung"
            assert float(dataset["mount_damping"]) == 0.05
            assert float(dataset["base_mass"]) == 1.0
        assert np.array_equal(sweep["mass_ratio"], sweep["particle_mass"])
        assert float(record["mass_ratio"]) == 0.1


def test_the_result_depends_on_neither_threads_nor_chunks(path_sprung, tmp_path):
    run_sweep(parse_spec(TEXT_SPRUNG), tmp_path / "other.h5", threads=1, chunk=1)
    for group in (None, "record"):
        whole, other = (
            xr.load_dataset(p, engine="h5netcdf", group=group)
            for p in (path_sprung, tmp_path / "other.h5")
        )
        for name in whole.variables:
            assert whole[name].values.tobytes() == other[name].values.tobytes(), name


def test_the_record_is_that_of_simulate(path_sprung):
    with open_record(path_sprung) as record:
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


def test_a_sweep_is_described_and_planned(path_sprung, workers):
    told = "\n".join(describe(path_sprung))
    assert "particle_mass                   0 ... 0.1 kg" in told
    assert "mount_damping                   0.05 (default)" in told
    plan = make_plan(parse_spec(TEXT_SPRUNG), workers)
    assert plan.cost.known
    assert plan.chunks == 1


def test_every_figure_is_drawn(path_sprung):
    with open_sweep(path_sprung) as sweep, open_record(path_sprung) as record:
        names = available(sweep, record)
        assert {"height_time", "height_time_all", "return_map"} <= {*names}
        for entry in map(FIGURES.get, names):
            figure = for_file(entry.draw, sweep if entry.source == "sweep" else record)
            figure.draw_without_rendering()


# A result in memory: values that were not computed are never filled in.


@each_of("rows", [0, 3])
@each_of("name", ["impact_count", "dt_min", "status", "restitution"])
def test_a_result_in_which_values_are_missing_is_refused(name, rows):
    found = InMemory()
    found.dimensions({"realization": 4})
    found.coordinate("restitution", ("realization",), {})
    for variable in ("impact_count", "dt_min", "status"):
        found.variable(VARIABLES[variable])
    for other in {"impact_count", "dt_min", "status", "restitution"} - {name}:
        found.write(other, 0, np.ones(4))
    found.write(name, 0, np.ones(rows))
    assert found.awaits(name)
    with pytest.raises(RunError, match=f"the result: {name}: rows are missing"):
        found.dataset()
    found.write(name, rows, np.ones(4 - rows))
    assert not found.awaits(name)
    assert found.dataset()[name].values.tolist() == [1.0] * 4


@each_of("name", sorted(VARIABLES))
def test_every_variable_begins_with_its_code_for_no_value(name, monkeypatch):
    memory = np.empty  # the memory that it returns may still hold old numbers
    found, variable = InMemory(), VARIABLES[name]
    with monkeypatch.context() as patch:
        patch.setattr(np, "empty", lambda *a, **k: np.full_like(memory(*a, **k), 1))
        found.dimensions({"realization": 2, "particle": 3})
        found.coordinate("amplitude", ("realization",), {})
        found.variable(variable)
    values, amplitude = (found._arrays[one][1] for one in (name, "amplitude"))
    assert np.isnan(amplitude).all()
    if variable.dtype == "float64":
        assert np.isnan(values).all()
    else:
        codes = dict(variable.flags) or {-1: ""}
        assert (values == (-1 if -1 in codes else Status.REFUSED)).all()


@pytest.mark.parametrize("grid", [False, True])
def test_a_sweep_that_loses_rows_or_columns_gives_no_result(grid, monkeypatch):
    real = driver.compute_rows
    asks = {"amplitude": [0.5, 1.0, 2.0], "duration": 3.0} if grid else {"realizations": 3}
    if not grid:
        asks |= {"amplitude": (0.5, 2.0)}

    def without_rows(*arguments):
        return ({n: v[:-1] for n, v in columns.items()} for columns in real(*arguments))

    def without_a_column(*arguments):
        return (
            {n: v for n, v in columns.items() if n != "rest_count"} for columns in real(*arguments)
        )

    def without_pieces(*arguments):
        return iter(())

    for fault in (without_rows, without_a_column, without_pieces):
        monkeypatch.setattr(driver, "compute_rows", fault)
        with pytest.raises(RunError, match="please report it"):
            sweep(asks)


COUNTS = np.array([3, 4, 5])
HEIGHTS = np.array([1.0, np.nan, 2.5])
CODES = np.array([0, 0, 1], np.int8)


def chunk(first, last):
    rows = slice(first, last)
    return {
        "impact_count": COUNTS[rows],
        "rebound_height_max": HEIGHTS[rows],
        "dt_min": np.full(3, np.nan)[rows],
        "landing_time_error": np.array([1e-9, np.inf, 1e-8])[rows],
        "status": CODES[rows],
        "particle_status": np.zeros((3, 2))[rows],
    }


def lines(*cuts):
    summary = Summary()
    for first, last in pairwise(cuts):
        summary.add(chunk(first, last))
    return summary, list(summary.lines())


def test_a_sum_of_landings_has_every_unit():
    """Each count fits into a double, but their sum neither into a double nor into 64 bits."""
    counts = np.full(3000, 2**53 - 1)
    summary = Summary()
    summary.add({"impact_count": counts, "status": np.zeros(3000, np.int8)})
    assert summary.landings == 3000 * (2**53 - 1)


def test_a_table_of_what_is_known():
    summary, text = lines(0, 3)
    assert (summary.realizations, summary.landings) == (3, 12)
    assert [line.split() for line in text[:5]] == [
        ["min", "mean", "max"],
        ["impact_count", "3", "4", "5"],
        ["rebound_height_max", "(m)", "1", "1.75", "2.5", "undefined", "in", "1"],
        ["dt_min", "(s)", "undefined", "in", "every", "realization"],
        ["landing_time_error", "(s)", "1e-09", "5.5e-09", "1e-08", "inf", "in", "1"],
    ]
    assert text[5].split(maxsplit=1) == [
        "status",
        "completed 2 (66.7%), budget_exceeded 1 (33.3%)",
    ]
    assert text[6] == f"budget_exceeded: {Status.BUDGET_EXCEEDED.sentence}"
    assert len(text) == 7


def test_chunks_add_up():
    assert lines(0, 1, 3)[1] == lines(0, 1, 2, 3)[1] == lines(0, 3)[1]


def test_columns_stand_below_their_heads():
    head, *rows = lines(0, 3)[1]
    assert (
        len({len(re.split("   (undefined|inf) in", row)[0]) for row in (head, rows[0], rows[1])})
        == 1
    )


@each_of(
    ("values", "said"),
    [
        ([-np.inf, -np.inf], "-inf in every realization"),
        ([np.nan, np.nan], "undefined in every realization"),
        ([-np.inf, np.nan], "-inf in 1, undefined in 1"),
        ([-np.inf, np.inf], "-inf in 1, inf in 1"),
        ([-np.inf, 2.0], "2 2 2 -inf in 1"),
        ([np.nan, 2.0], "2 2 2 undefined in 1"),
        ([2.0, 2.0], "2 2 2"),
    ],
)
def test_infinite_and_undefined_values_are_told_apart(values, said):
    """An infinite number is not undefined; the division into chunks plays no part."""
    summary = Summary()
    for value in values:
        one = {"impact_count": np.ones(1, np.int64), "lyapunov_max": np.array([value])}
        summary.add(one)
    line = next(text for text in summary.lines() if text.startswith("lyapunov_max"))
    assert line.split() == ["lyapunov_max", "(per", "impact)", *said.split()]


def test_an_empty_summary_is_not_an_error():
    assert len(list(Summary().lines())) == 1


@each_of("name", sorted(OF_REALIZATIONS))
def test_codes_for_no_value_enter_no_mean(name):
    variable = OF_REALIZATIONS[name]
    if variable.flags:
        return  # codes are counted, each by its name
    none = np.nan if variable.dtype == "float64" else 0 if variable.cycle else -1
    measured = {"impact_count": np.array([2, 4]), variable.cycle or name: np.array([none, 6.0])}
    measured[name] = np.array([none, 6.0]).astype(variable.dtype)
    summary = Summary()
    summary.add(measured)
    (line,) = [line for line in summary.lines() if line.split()[:1] == [name]]
    assert line.split()[-6:] == ["6", "6", "6", "undefined", "in", "1"]


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Gone(io.StringIO):
    """A log or terminal that nobody reads any more."""

    def __init__(self, terminal):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal

    def write(self, text):
        raise BrokenPipeError


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(waiting.time, "monotonic", lambda: now[0])
    return now


def test_a_log_gets_a_line_now_and_then(clock):
    stream = io.StringIO()
    with reporting(stream) as advance:
        for second in range(0, 31, 3):
            clock[0] = float(second)
            advance(second, 30)
    assert stream.getvalue().splitlines() == [
        "12 of 30 realizations, 1 per second, 18 s remaining",
        "24 of 30 realizations, 1 per second, 6 s remaining",
    ]


def test_a_continued_run_reports_its_own_speed(clock):
    """Its speed counts only its own work, and it reports nothing before there is some."""
    stream = io.StringIO()
    with reporting(stream) as advance:
        for second, done in ((15.0, 600), (30.0, 600), (45.0, 630), (60.0, 660)):
            clock[0] = second
            advance(done, 1000)
    assert stream.getvalue().splitlines() == [
        "630 of 1000 realizations, 1 per second, 370 s remaining",
        "660 of 1000 realizations, 1.333 per second, 255 s remaining",
    ]


def test_a_short_run_says_nothing():
    stream = io.StringIO()
    with reporting(stream) as advance:
        advance(1, 1)
    assert stream.getvalue() == ""


def test_a_terminal_gets_a_bar():
    stream = Terminal()
    with reporting(stream, delay=1e-9) as advance:
        advance(0, 4)
        sleep(0.2)  # the bar is drawn ten times a second
        advance(3, 4)
        advance(4, 4)
    assert "75%" in stream.getvalue()
    assert stream.getvalue().endswith("\r")  # wiped at the end


def test_the_bar_of_a_continued_run_shows_its_own_speed(monkeypatch):
    """What an earlier run has finished is no work of this one."""
    stream, now = Terminal(), [1000.0]
    for clock in ("time.time", "tqdm.std.time"):
        monkeypatch.setattr(clock, lambda: now[0])
    with reporting(stream, delay=1e-9) as advance:
        now[0] += 50.0  # planning
        advance(40_000, 50_000)
        for done in range(40_100, 41_001, 100):
            now[0] += 1.0
            advance(done, 50_000)
    speeds = [float(s) for s in re.findall(r"([0-9.]+) realizations/s", stream.getvalue())]
    assert speeds
    assert speeds == pytest.approx([100.0] * len(speeds), rel=0.01)


@pytest.mark.parametrize("terminal", [True, False])
def test_a_closed_stream_does_not_end_a_run(clock, terminal):
    with reporting(Gone(terminal), delay=1e-9) as advance:
        clock[0] = 100.0
        advance(1, 2)
        clock[0] = 200.0
        advance(2, 2)


def test_silence():
    silent(1, 2)
