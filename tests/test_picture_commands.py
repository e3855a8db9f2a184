"""``vibrosweep windows``, ``bifurcation`` and ``basins``: what they write, what they refuse."""

from pathlib import Path

import pytest
import xarray as xr

from vibrosweep import theory
from vibrosweep.cli import main

SWEEPS = Path(__file__).parents[1] / "sweeps"
SPEC = """
title = "Windows of a test"
[scene]
particles = 2
duration = 100.0
[sample]
design = "grid"
restitution = [0.7, 0.8, 0.9]
amplitude = { start = 0.2, stop = 4.0, num = 12 }
[windows]
conditions = ["locked(1)", "periodic"]
"""


@pytest.fixture
def spec(tmp_path):
    def write(text=SPEC):
        path = tmp_path / "w.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_windows_and_their_picture_are_written(spec, tmp_path, capsys):
    output = tmp_path / "found.h5"
    assert main(["windows", str(spec()), "-o", str(output), "--threads", "2"]) == 0
    printed = capsys.readouterr().out
    assert "locked(1)" in printed
    assert "holds at 3 of 3 restitutions" in printed
    with xr.open_dataset(output, engine="h5netcdf") as found:
        one = found.sel(condition="locked(1)", direction="launch").isel(window=0)
        exact = theory.amplitude_min(1, found["restitution"].values)
        assert one["A_min"].values == pytest.approx(exact, rel=1e-8)
        assert found.attrs["title"] == "Windows of a test"
        assert found.attrs["sweep_file"] == SPEC
        assert found.attrs["Conventions"].startswith("CF")
        assert found["A_min"].attrs["units"] == "m s-1"
    assert output.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("conditions", "duration", "told"),
    [
        ('["locked(1)", "periodic"]', 100.0, True),
        ('["locked(1)", "periodic"]', 2000.0, False),
        ('["locked(1)", "separated"]', 100.0, False),  # no orbit has to be recognised
    ],
)
def test_too_short_an_observation_is_told(conditions, duration, told, spec, tmp_path, capsys):
    text = SPEC.replace('["locked(1)", "periodic"]', conditions)
    output = tmp_path / "found.h5"
    file = spec(text.replace("duration = 100.0", f"duration = {duration}"))
    assert main(["windows", str(file), "-o", str(output)]) == 0
    assert ("may be called unsettled" in capsys.readouterr().out) == told
    with xr.open_dataset(output, engine="h5netcdf") as found:
        assert bool(found.attrs["notes"]) == told


def test_an_existing_output_is_kept_unless_forced(spec, tmp_path, capsys):
    output = tmp_path / "found.h5"
    output.with_suffix(".png").write_bytes(b"mine")
    assert main(["windows", str(spec()), "-o", str(output)]) == 2
    assert "found.png: exists and is kept" in capsys.readouterr().err
    assert output.with_suffix(".png").read_bytes() == b"mine"
    assert main(["windows", str(spec()), "-o", str(output), "--force"]) == 0


def test_launches_of_basins_may_be_listed_in_any_order(spec, tmp_path):
    text = SPEC.replace("amplitude = {", "launch_velocity = {").replace("restitution = [", "# [")
    text = text[: text.index("[windows]")]
    times = [0.7, 0.1, 0.4, 0.1]
    sketch = "particles = 4\nlaunch = {}"
    pictures = []
    for launch in (times, sorted(times)):
        output = tmp_path / f"{len(pictures)}.h5"
        listed = text.replace("particles = 2", sketch.format(launch))
        assert main(["basins", str(spec(listed)), "-o", str(output)]) == 0
        with xr.open_dataset(output, engine="h5netcdf") as found:
            assert found["launch_time"].values.tolist() == [0.1, 0.4, 0.7]
        pictures.append(output.with_suffix(".png").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '[windows]\nconditions = ["locked(1)", "periodic"]',
            "",
            ["[windows] is missing", "ordered"],
        ),
        ('"periodic"', '"periodical"', ["windows.conditions", "'periodical' is not known"]),
        ('["locked(1)", "periodic"]', "[]", ["windows.conditions", "one or more names"]),
        ("[windows]", "[windows]\ntolerance = 2.0", ["windows.tolerance = 2.0", "below 1"]),
        ("[windows]", "[windows]\nalong = 1", ["windows.along = 1", "continuation"]),
        ("amplitude = { start = 0.2, stop = 4.0, num = 12 }", "", ["sample.design", "amplitude"]),
        ("[sample]", "[sample]\nfrequency = [1.0, 2.0]", ["sample.frequency", "axis of amplitude"]),
        ("[windows]", "[windows]\ncontinuation = 1", ["windows.continuation = 1", "true or false"]),
    ],
)
def test_mistakes_are_named_before_anything_is_written(old, new, words, spec, tmp_path, capsys):
    assert old in SPEC
    output = tmp_path / "found.h5"
    assert main(["windows", str(spec(SPEC.replace(old, new))), "-o", str(output)]) == 2
    message = capsys.readouterr().err
    for word in [*words, "w.toml"]:
        assert word in message
    assert "Traceback" not in message
    assert list(tmp_path.iterdir()) == [tmp_path / "w.toml"]


GRID = """
title = "A grid of a test"
[scene]
particles = 8
duration = 600.0
[sample]
design = "grid"
"""


@pytest.mark.parametrize(
    ("command", "axis", "words", "variable"),
    [
        (
            "bifurcation",
            "amplitude = [1.0, 1.5, 2.0]",
            ["amplitude up", "rest"],
            "rebound_velocity",
        ),
        (
            "bifurcation",
            "base_acceleration = [0.5, 0.6, 0.7]",
            ["acceleration down"],
            "rebound_velocity",
        ),
        ("basins", "launch_velocity = [1.0, 3.0, 5.0]", ["/ 1 period", "%"], "basin"),
    ],
)
def test_a_diagram_and_its_picture_are_written(
    command, axis, words, variable, spec, tmp_path, capsys
):
    output = tmp_path / "found.h5"
    assert main([command, str(spec(GRID + axis)), "-o", str(output)]) == 0
    printed = capsys.readouterr().out
    for word in ["A grid of a test", *words]:
        assert word in printed
    with xr.open_dataset(output, engine="h5netcdf") as found:
        assert 8 in found[variable].shape
        assert found.attrs["title"] == "A grid of a test"
    assert output.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("orbits", "1 impact / 1 period"),
        ("branches", "period doubling at 3.57576764885 m s-1"),
        ("boundaries", "saddle node"),
    ],
)
def test_the_examples_of_orbits_are_computed_and_drawn(command, words, tmp_path, capsys):
    output = tmp_path / "found.h5"
    limits = ["--impacts", "1", "--periods", "1"]
    assert main([command, str(SWEEPS / f"{command}.toml"), "-o", str(output), *limits]) == 0
    assert words in capsys.readouterr().out
    assert output.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("command", "axis", "options", "words"),
    [
        (
            "bifurcation",
            "restitution = [0.8, 0.9]",
            [],
            ["sample.restitution", "axis of amplitude"],
        ),
        ("bifurcation", "amplitude = [1.0, 2.0]", ["--observable", "height"], ["rebound_height"]),
        ("basins", "amplitude = [1.0, 2.0]", [], ["sample.design", "axis of launch_velocity"]),
        (
            "windows",
            'frequency = [0.5, 1.0]\n[windows]\nconditions = ["locked(1)"]',
            [],
            ["sample.frequency", "axis of amplitude"],
        ),
    ],
)
def test_a_grid_of_the_wrong_axes_is_refused(command, axis, options, words, spec, tmp_path, capsys):
    output = tmp_path / "found.h5"
    assert main([command, str(spec(GRID + axis)), "-o", str(output), *options]) == 2
    message = capsys.readouterr().err
    for word in words:
        assert word in message
    assert not output.exists()
