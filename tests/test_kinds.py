"""Every kind of result that this package writes is known to info, figures, verify and Python."""

import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.api import result_kinds
from vibrosweep.cli import main
from vibrosweep.errors import DataError
from vibrosweep.store.reading import KIND, SWEEP, ResultKind, load_dataset, read_kind

KINDS = {
    kind.name: kind
    for kind in (SWEEP, *vars(result_kinds).values())
    if isinstance(kind, ResultKind)
}

GRID = 'title = "A grid"\n[scene]\nparticles = 2\nduration = 40.0\n[sample]\ndesign = "grid"\n'
SPECS = {
    "sweep": ("run", 'title = "A sweep"\n[measure]\nseparation = true\n[record]\n'),
    "windows": (
        "windows",
        GRID + 'amplitude = [0.4, 1.0]\n[windows]\nconditions = ["locked(1)"]\n',
    ),
    "bifurcation": ("bifurcation", GRID + "amplitude = [1.0, 2.0]\n"),
    "orbits": ("orbits", 'title = "Orbits"\n[scene]\namplitude = 1.2\n'),
    "branches": ("branches", GRID + "amplitude = [0.4, 4.0]\n"),
    "boundaries": ("boundaries", GRID + "amplitude = [0.4, 4.0]\nrestitution = [0.5, 0.9]\n"),
    "basins": ("basins", GRID + "launch_velocity = [1.0, 3.0]\n"),
}
FILM = """title = "A film"
[scene]
restitution = 0.85
amplitude = 0.12
particles = 2
duration = 4.0
[measure]
transient = 2.0
"""
LAB = {"impacts": "impacts", "comparison": "compare"}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A file of each kind, as its command writes it."""
    folder = tmp_path_factory.mktemp("kinds")
    made = {}
    for kind, (command, text) in SPECS.items():
        spec = folder / f"{kind}.toml"
        spec.write_text(text)
        made[kind] = folder / f"{kind}.h5"
        assert main([command, str(spec), "-o", str(made[kind])]) == 0
    (folder / "film.toml").write_text(FILM)
    assert main(["lab", "synthesize", str(folder / "film.toml"), "-o", str(folder / "film")]) == 0
    track = next(p for p in (folder / "film").iterdir() if "truth" not in p.name)
    for kind, part in LAB.items():
        made[kind] = folder / f"{kind}.h5"
        words = ["lab", part, str(track), "-o", str(made[kind])]
        assert main(words if part == "impacts" else [*words, "--draws", "4"]) == 0
    drops, made["restitution"] = folder / "drops.csv", folder / "restitution.h5"
    drops.write_text("time (s)\n0.0\n0.8\n1.48\n2.06\n2.55\n")
    assert main(["lab", "restitution", str(drops), "-o", str(made["restitution"])]) == 0
    return made


@pytest.fixture
def said(capsys):
    def call(code, *words):
        capsys.readouterr()
        assert main([str(word) for word in words]) == code
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return captured.err if code else captured.out

    return call


def test_a_file_of_every_kind_is_made(results):
    assert results.keys() == KINDS.keys()
    for name, path in results.items():
        assert read_kind(path) is KINDS[name]
        assert xr.load_dataset(path, engine="h5netcdf").attrs[KIND] == name


@pytest.mark.parametrize("name", KINDS)
def test_info(results, said, name):
    text = said(0, "info", results[name])
    assert "dimensions: " in text
    assert "no seal" not in text
    if name != "sweep":
        assert f"result of {KINDS[name].command}" in text
        for line in KINDS[name].lines(load_dataset(results[name])):
            assert line in text


@pytest.mark.parametrize("name", KINDS)
def test_figures(results, said, name, tmp_path):
    words = ("figures", results[name], "-o", tmp_path)
    if name == "impacts":
        assert "vibrosweep lab impacts TRACKS --figures DIR" in said(2, *words)
        return
    printed = said(0, *words)
    drawn = {path.suffix for path in tmp_path.iterdir() if str(path) in printed}
    assert drawn == {".png", ".pdf"}
    if name != "sweep":
        assert {path.stem for path in tmp_path.iterdir()} == {KINDS[name].stem}


@pytest.mark.parametrize("name", KINDS)
def test_verify(results, said, name):
    pytest.importorskip("flint")
    if not KINDS[name].unverified:
        assert "passed" in said(0, "verify", results[name])
        return
    message = said(2, "verify", results[name])
    assert f"is a result of {KINDS[name].command}, which cannot be verified: " in message
    assert KINDS[name].unverified in message


@pytest.mark.parametrize("name", [name for name in KINDS if name != "sweep"])
def test_python_names_the_kind(results, name):
    with pytest.raises(DataError, match=f"a result of {KINDS[name].command}; .* xarr"):
        vs.open_sweep(results[name])


def test_a_kind_of_a_later_version(tmp_path, said):
    path = tmp_path / "later.h5"
    xr.Dataset(attrs={KIND: "echo"}).to_netcdf(path, engine="h5netcdf")
    for command in ("info", "figures", "verify"):
        message = said(2, command, path)
        assert f"{path}: is a result of the kind 'echo', which this version" in message
