"""Sweeps from keywords, a mapping or a file are the same in memory and in a result file."""

import inspect
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep import waiting
from vibrosweep.api.sweeps import as_sweep
from vibrosweep.cli import main
from vibrosweep.errors import ExistingOutputError, ParameterError, SpecError, TableError
from vibrosweep.figures import parameter_plane
from vibrosweep.runs import chunks
from vibrosweep.runs.driver import sweep_in_memory
from vibrosweep.scene.keys import SECTIONS

DRAWN = {
    "restitution": (0.8, 0.98),
    "amplitude": (0.2, 3.5),
    "realizations": 40,
    "seed": 2,
    "particles": 3,
    "separation": True,
    "per_particle": True,
}


def without_circumstances(dataset):
    kept = {k: v for k, v in dataset.attrs.items() if k not in ("created", "threads")}
    return dataset.assign_attrs().drop_attrs(deep=False).assign_attrs(kept)


def test_memory_and_file_hold_the_same(tmp_path):
    with vs.run(DRAWN, tmp_path / "out.h5") as stored:
        in_file = without_circumstances(stored.load())
    xr.testing.assert_identical(without_circumstances(vs.sweep(**DRAWN)), in_file)
    xr.testing.assert_identical(without_circumstances(vs.sweep(DRAWN)), in_file)


def test_a_sweep_file_and_its_tables_give_the_same(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(vs.sweep(**DRAWN).attrs["sweep_file"], encoding="utf-8")
    by_path = without_circumstances(vs.sweep(path))
    xr.testing.assert_identical(by_path, without_circumstances(vs.sweep(**DRAWN)))


def test_neither_threads_nor_pieces_change_a_sweep(monkeypatch):
    one, told = without_circumstances(vs.sweep(**DRAWN, threads=1)), []
    monkeypatch.setattr(chunks, "LEAST_PER_PIECE", 15)  # trajectories, of 5 realizations
    monkeypatch.setattr(chunks, "MOST_PER_PIECE", 15)

    def advance(done, total):
        told.append((done, total))

    found = sweep_in_memory(as_sweep(None, DRAWN), threads=2, advance=advance)
    xr.testing.assert_identical(one, without_circumstances(found))
    assert told == [(done, 40) for done in range(0, 41, 5)]


def test_a_sweep_in_memory_leaves_signals_alone(monkeypatch):
    """Only a file that is open must not be left half written."""
    monkeypatch.setattr("signal.signal", None)
    vs.sweep(**DRAWN)


def test_a_finished_result_is_opened_and_another_kept(tmp_path):
    path = tmp_path / "out.h5"
    vs.run(DRAWN, path).close()
    before = path.read_bytes()
    vs.run(DRAWN, path).close()
    with pytest.raises(ExistingOutputError, match="seed: was 2, is 3"):
        vs.run({**DRAWN, "seed": 3}, path)
    assert path.read_bytes() == before


def test_a_bar_is_shown_where_it_is_wanted(capsys, monkeypatch):
    monkeypatch.setattr(waiting, "SECONDS_BEFORE_BAR", 0.0)
    vs.sweep(**DRAWN)
    assert capsys.readouterr().err == ""
    vs.sweep(**DRAWN, progress=True)
    assert "realizations/s" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "ipykernel", None)  # as in a notebook
    vs.sweep(**DRAWN)
    assert "realizations/s" in capsys.readouterr().err


def test_a_sweep_that_does_not_fit_into_memory_is_refused(memory):
    memory(10_000)
    with pytest.raises(ParameterError, match=r"vibrosweep\.run"):
        vs.sweep(**DRAWN)


def test_mistakes_of_the_call_itself():
    with pytest.raises(ParameterError, match=r"^particles: "):
        vs.sweep("sweep.toml", particles=3)
    with pytest.raises(ParameterError, match=r"^int: "):
        vs.sweep(3)
    with pytest.raises(ParameterError, match="threads = 0:"):
        vs.sweep(threads=0)
    with pytest.raises(ParameterError, match=r"record: .* vibrosweep\.run"):
        vs.sweep(record={})
    with pytest.raises(SpecError, match="particles = 0"):
        vs.run({"particles": 0}, "out.h5")


def test_the_docstring_names_every_keyword():
    words = inspect.getdoc(vs.sweep)
    known = {"title", *(k for table in ("scene", "sample", "measure") for k in SECTIONS[table])}
    assert [name for name in known if name not in words] == []


def test_every_public_name_is_found_and_documented():
    assert dir(vs) == sorted(vs.__all__)
    for name in filter(lambda name: inspect.isfunction(getattr(vs, name)), vs.__all__):
        documented = inspect.getdoc(getattr(vs, name))
        for section in ("Parameters", "Returns", "Raises", "Examples"):
            assert f"{section}\n-----" in documented, (name, section)
    assert vs.theory.amplitude_min(1, 0.9) == pytest.approx(0.4905)
    assert issubclass(vs.errors.SpecError, vs.errors.VibrosweepError)


def test_one_realization_without_any_keyword():
    found = vs.sweep()
    assert dict(found.sizes) == {"realization": 1, "particle": 1}
    assert np.isfinite(found.rebound_height_max).all()


COUNTS = [np.uint8, np.int8, np.uint64, np.int64]


@pytest.mark.parametrize("kind", COUNTS)
def test_counts_may_be_numpy_integers(tmp_path, kind):
    """Arithmetic with counts would overflow in a small integer type of NumPy."""
    one = {"restitution": 0.9, "amplitude": 1.2, "duration": 4.0}
    whole, several = kind(100), kind(2)
    drawn = {"restitution": (0.8, 0.9), "amplitude": 1.0, "realizations": several, "seed": several}
    expected = vs.sweep({**drawn, "realizations": 2, "seed": 2}, threads=1)
    xr.testing.assert_equal(vs.sweep(**drawn, threads=several), expected)
    with vs.run(drawn, tmp_path / "out.h5", threads=several, chunk=several) as found:
        xr.testing.assert_equal(found.load(), expected)
    landings = vs.simulate(**one, impact_budget=whole, threads=several)
    xr.testing.assert_equal(landings, vs.simulate(**one, impact_budget=100, threads=1))
    scan = {"restitution": 0.5, "amplitude": [2.5, 2.6], "duration_periods": 400.0}
    diagram = vs.bifurcation(**scan, samples=whole, threads=several)
    xr.testing.assert_equal(diagram, vs.bifurcation(**scan, samples=100, threads=1))
    windows = vs.windows(restitution=[0.9], amplitude=[0.5, 1.0, 2.0], threads=several)
    assert windows.sizes["restitution"] == 1
    parts = vs.separations(**DRAWN, against="amplitude", bins=kind(3), threads=several)
    assert parts.sizes["part"] == 3


@pytest.mark.parametrize("switch", [np.array([True, False]), np.array([]), "yes", 1, [], {}])
@pytest.mark.parametrize("name", ["progress", "force"])
def test_a_switch_is_true_or_false(tmp_path, name, switch):
    with pytest.raises(ParameterError, match=f"{name} = .*: must be True or False"):
        vs.run(DRAWN, tmp_path / "out.h5", **{name: switch})
    if name == "progress":
        with pytest.raises(ParameterError, match=r"progress = .*: must be True or False"):
            vs.sweep(DRAWN, progress=switch)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "fixed", [{}, {"restitution": 0.9}, {"restitution": 0.9, "amplitude": 1.0}]
)
@pytest.mark.parametrize("table", [dict, xr.Dataset])
def test_a_table_without_columns_is_refused(tmp_path, fixed, table):
    with pytest.raises(TableError, match="no columns"):
        vs.sweep(design=table(), **fixed)
    with pytest.raises(TableError, match="has no columns"):
        vs.run({"design": table(), **fixed}, tmp_path / "out.h5")
    assert not list(tmp_path.iterdir())


PLAIN = {"restitution": [0.8, 0.9, 0.95], "amplitude": [1.0, 2.0, 3.0]}


def test_a_label_may_have_a_name_that_python_or_xarray_uses(tmp_path):
    names = ("self", "class", "None", "lambda", "dims", "values", "attrs")
    labels = {name: [3.0, 1.0, 2.0] for name in names}
    design = PLAIN | labels
    found = vs.sweep(design=design, separation=True, particles=2, columns=list(design))
    with vs.run({"design": design, "columns": list(design)}, tmp_path / "out.h5", chunk=2) as kept:
        for name, values in labels.items():
            assert kept[name].values.tolist() == found[name].values.tolist() == values
            assert vs.separations(found, against=name, bins=2).sizes["part"] == 2
            assert parameter_plane(found, name).axes
    for words in (["info"], ["verify", "--sample", "1"]):
        assert main([words[0], str(tmp_path / "out.h5"), *words[1:]]) == 0


def test_a_label_may_not_have_the_name_of_a_group_of_the_result(tmp_path):
    for name in ("record", "identity"):
        with pytest.raises(TableError, match=f'"{name}" has the name'):
            vs.run({"design": PLAIN | {name: [1.0, 2.0, 3.0]}}, tmp_path / "out.h5")


@pytest.mark.parametrize("character", ["\0", "\ud800"])
@pytest.mark.parametrize("chunk", [1, None])
def test_a_text_that_no_file_can_hold(tmp_path, character, chunk):
    """In a label it is refused before anything is computed; in an attribute it is replaced."""
    design = PLAIN | {"name": ["a", f"b{character}c", "d"]}
    for compute in (
        lambda: vs.run({"design": design}, tmp_path / "out.h5", chunk=chunk),
        lambda: vs.sweep(design=design),
    ):
        with pytest.raises(TableError, match=r'column "name", row 2 .*character'):
            compute()
    assert not list(tmp_path.iterdir())
    about = {"long_name": f"b{character}c"}
    labelled = xr.Dataset({n: ("realization", v) for n, v in PLAIN.items()})
    labelled["day"] = ("realization", [1.0, 2.0, 3.0], about)
    with vs.run({"design": labelled}, tmp_path / "out.h5", chunk=chunk) as found:
        assert found["day"].attrs["long_name"] == "b\N{REPLACEMENT CHARACTER}c"


def test_more_labels_than_a_file_can_hold(tmp_path):
    many = {f"label_{k}": [1.0, 2.0, 3.0] for k in range(4100)}
    with pytest.raises(TableError, match=r" 4100 columns .* 3900"):
        vs.run({"design": PLAIN | many, "columns": [*PLAIN, *many]}, tmp_path / "out.h5")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("setting", "words", "module"),
    [
        ("NUMBA_NUM_THREADS=0", "takes no number below 1", "kernels.fixed"),
        ("MPLBACKEND=nope", "is not a backend", "figures"),
    ],
)
def test_an_environment_that_stops_a_library_is_named(tmp_path, setting, words, module):
    """The command prints one message, and Python raises one error; commands draw into files."""
    variable, _, value = setting.partition("=")
    source = str(Path(vs.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": source, variable: value}
    if variable != "MPLBACKEND":
        done = subprocess.run(
            [sys.executable, "-m", "vibrosweep", "doctor"],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith(f"vibrosweep: {setting}: ")
        assert words in done.stderr
        assert "unset it" in done.stderr
        assert len(done.stderr.splitlines()) == 1
    script = f"""
import pytest
from vibrosweep.errors import VibrosweepError
with pytest.raises(VibrosweepError, match={setting!r}):
    import vibrosweep.{module}
"""
    subprocess.run([sys.executable, "-c", script], env=environment, check=True)
