"""``vibrosweep examples``: lists and copies the sweeps that come with the package."""

from pathlib import Path

import pytest

from vibrosweep.cli import main
from vibrosweep.commands.sweeps import examples_in
from vibrosweep.errors import DataError

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
    assert "paper.toml: exists and is kept" in capsys.readouterr().err
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
