"""A parameter that a sweep file does not state is reported to be at its default."""

import math

import pytest
import xarray as xr

from vibrosweep.cli import main
from vibrosweep.commands.describe import describe

SHAKER = "[scene]\nfrequency = 17.0\nrestitution = 0.8\nphase = 0.0\n"
TABLE = '[scene]\nphase = 0.0\n[sample]\ndesign = "rows.csv"\n'


@pytest.mark.parametrize("text", [SHAKER, TABLE])
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
