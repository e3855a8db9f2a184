"""Commands."""

import os
import shutil
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from tests.cases import each_of
from vibrosweep.cli import main
from vibrosweep.commands.describe import describe
from vibrosweep.commands.sweeps import examples_in
from vibrosweep.errors import DataError


def test_a_result_is_described(paper):
    text = "\n".join(describe(paper))
    lines = {line.split()[0]: line for line in text.splitlines()}
    assert text.startswith("Table 1 with 200 random realizations")
    assert "dimensions: realization 200, particle 20" in text
    assert lines["gravity"].split() == ["gravity", "9.81", "m", "s-2", "(default)"]
    assert lines["contact_time"].split() == ["contact_time", "0.0001", "s", "(default)"]
    assert lines["restitution"].split()[2] == "..."
    assert lines["duration"].split() == ["duration", "12", "s"]
    assert lines["rebound"].split() == ["rebound", "rest"]
    record = xr.load_dataset(paper, group="record")
    assert f"{int(record['impact_count'].sum())} landings, in the group 'record'" in text
    assert lines["source"].split() == ["source", "vibrosweep", "0.1.0"]
    assert "numba" in lines["libraries"]
    assert lines["impact_count"].split()[1] == "222"
    assert "completed 200 (100.0%)" in lines["status"]


def test_reading_rows_in_slices_gives_the_same_description(paper, monkeypatch):
    expected = list(describe(paper))
    monkeypatch.setattr("vibrosweep.store.arranged.ROWS_OF_A_SLICE", 64)
    assert list(describe(paper)) == expected


def damaged(data, rng):
    for _ in range(rng.integers(1, 200)):
        data[rng.integers(data.size)] = rng.integers(256)
    return data


# after a failed open the file object of h5netcdf complains again when it is garbage-collected
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("seed", range(8))
def test_damage_is_reported_or_harmless(paper, tmp_path, seed):
    rng = np.random.default_rng(seed)
    data = np.frombuffer(paper.read_bytes(), np.uint8).copy()
    data = damaged(data, rng) if seed % 2 else data[: rng.integers(data.size)]
    path = tmp_path / "bad.h5"
    path.write_bytes(data.tobytes())
    try:
        lines = list(describe(path))
    except DataError as error:
        lines = str(error).splitlines()
    said = ("is not a result of vibrosweep, or is damaged", "is damaged, or was changed")
    assert lines[0].startswith(("Table", *(f"{path}: {words}" for words in said)))


# ``vibrosweep examples``: lists and copies the sweeps that come with the package.

SWEEPS = Path(__file__).parents[2] / "sweeps"
NAMES = sorted(p.relative_to(SWEEPS).with_suffix("").as_posix() for p in SWEEPS.rglob("*.toml"))


def contents(directory):
    return {
        path.relative_to(directory).as_posix(): path.read_bytes()
        for path in directory.rglob("*")
        if path.is_file()
    }


def test_all_are_listed_with_their_titles(capsys):
    assert main(["examples"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:-2]] == NAMES
    assert "paper " in lines[NAMES.index("paper")]
    assert lines[NAMES.index("paper")].endswith("realizations of (restitution, amplitude)")


def test_some_are_copied(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["examples", "paper", "laboratory/table4.toml"]) == 0
    names = ["paper.toml", "laboratory/table4.toml", "sweep.schema.json"]
    assert contents(tmp_path) == {name: (SWEEPS / name).read_bytes() for name in names}
    assert [Path(line) for line in capsys.readouterr().out.splitlines()] == list(map(Path, names))


def test_all_are_copied_and_none_is_replaced_unasked(tmp_path, capsys):
    place = tmp_path / "sweeps"
    assert main(["examples", "--all", "-o", str(place)]) == 0
    assert contents(place) == contents(SWEEPS)
    (place / "paper.toml").write_text("mine", encoding="utf-8")
    (place / "basins.toml").unlink()
    assert main(["examples", "basins", "paper", "-o", str(place)]) == 2
    assert "paper.toml: exists and was not replaced" in capsys.readouterr().err
    assert (place / "paper.toml").read_text(encoding="utf-8") == "mine"
    assert not (place / "basins.toml").exists()
    assert main(["examples", "basins", "paper", "--force", "-o", str(place)]) == 0
    assert contents(place) == contents(SWEEPS)


def test_an_unknown_name_is_refused(tmp_path, capsys):
    assert main(["examples", "papers", "-o", str(tmp_path)]) == 2
    message = capsys.readouterr().err
    assert "no example is called papers; there are basin_shares, basins" in message
    assert contents(tmp_path) == {}


def test_a_package_without_examples_says_so(tmp_path):
    with pytest.raises(DataError, match="sweeps are missing; install vibrosweep again"):
        examples_in([tmp_path / "none"])


@pytest.mark.parametrize("inside", [True, False])
def test_examples_are_found_inside_or_beside_the_package(tmp_path, inside):
    """Examples inside the package are preferred to those beside it."""
    places = (tmp_path / "package" / "sweeps", tmp_path / "sweeps")
    for place in places[0 if inside else 1 :]:
        place.mkdir(parents=True)
        (place / f"{place.parent.name}.toml").write_text('title = "One"', encoding="utf-8")
    assert [*examples_in(places)] == ["package" if inside else tmp_path.name]


# The command that explores a result: its messages.


@pytest.fixture
def swept(compute):
    return compute("[sample]\nrestitution = [0.8, 0.9]\nrealizations = 2\n")


def test_a_missing_package_is_named_with_the_command_that_installs_it(swept, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "bokeh", None)
    assert main(["explore", str(swept)]) == 2
    assert 'pip install "vibrosweep[explore]"' in capsys.readouterr().err


def test_a_taken_port_is_reported(swept, capsys):
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["explore", str(swept), "--port", str(port)]) == 2
    assert f"port {port} is not available" in capsys.readouterr().err


@pytest.mark.parametrize("port", ["99999", "65536", "-1", "x"])
def test_a_number_that_is_no_port_is_reported(swept, capsys, port):
    with pytest.raises(SystemExit) as ended:
        main(["explore", str(swept), f"--port={port}"])
    assert ended.value.code == 2
    assert "at least 0 and at most 65535" in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt" or sys.platform == "darwin", reason="names there are Unicode")
def test_names_that_are_not_unicode_can_be_read_and_written(swept, tmp_path, capfd):
    """Names of a result and of a page, and a title that another program wrote."""
    odd = tmp_path / os.fsdecode(b"\xff.h5")
    page = tmp_path / os.fsdecode(b"\xff.html")
    shutil.copy(swept, odd)
    with h5py.File(odd, "r+") as file:
        file.attrs.create("title", np.bytes_(b"\xfftitle"), dtype=h5py.string_dtype())
    assert main(["explore", str(odd), "-o", str(page)]) == 0
    assert "written to " in capfd.readouterr().out
    assert "title" in page.read_text("utf-8")
    assert main(["explore", str(odd), "-o", str(page)]) == 2
    assert "exists and was not replaced" in capfd.readouterr().err
    assert main(["figures", str(odd), "-o", str(tmp_path / os.fsdecode(b"\xff"))]) == 0
    assert main(["info", str(odd)]) == 0


@each_of(
    "origin",
    [
        "hub",
        "hub.example.org",
        "https://",
        "https://a.org/b",
        "https://a.org; x",
        "*",
        "http://a b",
        "",
    ],
)
def test_an_origin_that_is_none_is_refused_in_words(origin, swept, capsys):
    """It would end up in a header of every answer."""
    with pytest.raises(SystemExit) as ended:
        main(["explore", str(swept), "--frame-in", origin])
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert "--frame-in" in message
    assert "such as https://hub.example.org" in message
