"""Sweeps from Python: in memory and in a file the same, from keywords, a mapping or a file."""

import inspect
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.errors import ExistingOutputError, ParameterError, SpecError
from vibrosweep.runs import inmemory, progress
from vibrosweep.spec.schema import SECTIONS

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
    one = without_circumstances(vs.sweep(**DRAWN, threads=1))
    monkeypatch.setattr(inmemory, "TRAJECTORIES_PER_PIECE", 15)
    monkeypatch.setattr(inmemory, "PIECES", 8)
    told = []
    monkeypatch.setattr(progress, "silent", lambda done, total: told.append((done, total)))
    xr.testing.assert_identical(one, without_circumstances(vs.sweep(**DRAWN, threads=2)))
    assert told == [(done, 40) for done in range(5, 41, 5)]


def test_a_finished_result_is_opened_and_another_kept(tmp_path):
    path = tmp_path / "out.h5"
    vs.run(DRAWN, path).close()
    before = path.read_bytes()
    vs.run(DRAWN, path).close()
    with pytest.raises(ExistingOutputError, match="seed: was 2, is 3"):
        vs.run({**DRAWN, "seed": 3}, path)
    assert path.read_bytes() == before


def test_a_bar_is_shown_where_it_is_wanted(capsys, monkeypatch):
    monkeypatch.setattr(progress, "SECONDS_BEFORE_BAR", 0.0)
    vs.sweep(**DRAWN)
    assert capsys.readouterr().err == ""
    vs.sweep(**DRAWN, progress=True)
    assert "realizations/s" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "ipykernel", None)  # as in a notebook
    vs.sweep(**DRAWN)
    assert "realizations/s" in capsys.readouterr().err


def test_what_does_not_fit_into_memory_is_refused(monkeypatch):
    monkeypatch.setattr(inmemory, "physical_memory", lambda: 10_000)
    with pytest.raises(ParameterError, match=r"write them to a file with vibrosweep\.run"):
        vs.sweep(**DRAWN)


def test_mistakes_of_the_call_itself():
    with pytest.raises(ParameterError, match="particles: not beside a sweep file or a mapping"):
        vs.sweep("sweep.toml", particles=3)
    with pytest.raises(ParameterError, match="int: is no sweep"):
        vs.sweep(3)
    with pytest.raises(ParameterError, match="threads = 0: must be a whole number"):
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


def test_importing_loads_nothing_heavy():
    code = (
        "import sys, vibrosweep as vs; vs.errors; "
        "print({'numba', 'numpy', 'xarray', 'scipy', 'matplotlib', 'h5py'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_one_realization_without_any_keyword():
    found = vs.sweep()
    assert dict(found.sizes) == {"realization": 1, "particle": 1}
    assert np.isfinite(found.rebound_height_max).all()
