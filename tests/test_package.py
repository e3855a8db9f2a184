"""The package as a whole: what is published, who imports whom, what is imported first."""

import ast
import contextlib
import importlib
import importlib.util
import inspect
import re
import shutil
import tomllib
import zipfile
from collections import defaultdict
from decimal import Decimal
from email.parser import BytesParser
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from packaging.requirements import Requirement

import vibrosweep
import vibrosweep as vs
from tests.cases import each_of
from vibrosweep import __version__
from vibrosweep.api import result_kinds
from vibrosweep.cli import main
from vibrosweep.errors import DataError, ParameterError, VibrosweepError
from vibrosweep.model.forcing import INPUTS
from vibrosweep.store.reading import KIND, SWEEP, ResultKind, load_dataset, read_kind

# The published package: the wheel, its description, and how to cite it.

ROOT = Path(__file__).parents[1]
GIVEN = tomllib.loads((ROOT / "MAINTAINERS.toml").read_text(encoding="utf-8"))
ADDRESSES = GIVEN["addresses"]
STATED = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT, BUILD = STATED["project"], STATED["build-system"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The contents of the wheel, by their names."""
    from hatchling.builders.wheel import WheelBuilder

    (path,) = WheelBuilder(str(ROOT)).build(
        directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"]
    )
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


@pytest.fixture(scope="module")
def metadata(wheel):
    (name,) = (name for name in wheel if name.endswith("/METADATA"))
    return BytesParser().parsebytes(wheel[name])


@pytest.fixture
def hook():
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_wheel_holds_all_of_the_package_and_the_examples(wheel):
    source = ROOT / "src" / "vibrosweep"
    files = {
        path.relative_to(source).as_posix(): path
        for path in source.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    files |= {
        f"sweeps/{p.relative_to(ROOT / 'sweeps').as_posix()}": p
        for p in (ROOT / "sweeps").rglob("*.*")
    }
    packed = {
        name.removeprefix("vibrosweep/"): data
        for name, data in wheel.items()
        if name.startswith("vibrosweep/")
    }
    assert packed == {name: path.read_bytes() for name, path in files.items()}
    assert {"py.typed", "sweeps/paper.toml"} <= packed.keys()
    assert not any(name.startswith("study/") for name in wheel)


def test_the_description_shows_no_picture_that_an_index_cannot_find(metadata):
    text = metadata.get_payload()
    assert "# vibrosweep" in text
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert target.startswith("https://"), target
    shown = ("source", "documentation", "changelog", "issues")
    named = {key.title() for key in shown if ADDRESSES[key]}
    assert {url.partition(",")[0] for url in metadata.get_all("Project-URL", [])} == named


def test_names_and_addresses_reach_the_description(hook, tmp_path):
    readme = (
        "a\n![One](docs/one.png)\n![Two](docs/two.png)\n[model](docs/model.md), [x](https://x)\n"
    )
    assert hook.described(readme, "") == "a\nmodel, [x](https://x)\n"
    assert hook.described(readme, "https://files/v1/") == (
        "a\n![One](https://files/v1/docs/one.png)\n![Two](https://files/v1/docs/two.png)\n"
        "[model](https://files/v1/docs/model.md), [x](https://x)\n"
    )
    shutil.copy(ROOT / "README.md", tmp_path)
    (tmp_path / "MAINTAINERS.toml").write_text(
        '[[authors]]\nname = "A"\nemail = "a@b"\n[[authors]]\nname = "B"\nemail = ""\n'
        '[addresses]\nsource = "https://source"\nissues = ""\nfiles = "https://files"\n',
        encoding="utf-8",
    )
    metadata = {}
    hook.Hook(str(tmp_path), {}).update(metadata)
    assert metadata["authors"] == [{"name": "A", "email": "a@b"}, {"name": "B"}]
    assert metadata["urls"] == {"Source": "https://source"}
    assert "](https://files/docs/images/" in metadata["readme"]["text"]


def test_the_oldest_python_that_is_named_is_the_one_required(metadata):
    named = re.findall(r"Python :: 3\.(\d+)", "\n".join(metadata.get_all("Classifier")))
    assert metadata["Requires-Python"] == f">=3.{min(map(int, named))}"


def test_the_citation_is_of_this_version(metadata):
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    stated = dict(re.findall(r"^([\w-]+): (.+)$", text, re.MULTILINE))
    assert stated["title"] == metadata["Name"]
    assert stated["version"] == metadata["Version"]
    assert stated["license"] == metadata["License-Expression"]
    assert stated.get("repository-code", "") == ADDRESSES["source"]


def test_the_abstract_of_the_citation_is_the_summary_of_the_paper():
    citation, paper = ((ROOT / p).read_text("utf-8") for p in ("CITATION.cff", "paper/paper.md"))
    abstract = re.search(r"^abstract: >-\n((?:  .*\n)+)", citation, re.MULTILINE)[1]
    summary = re.search(r"^# Summary\n(.*?)^# ", paper, re.MULTILINE | re.DOTALL)[1]
    plain = re.sub(r" \[@[^]]*\]|`", "", summary)
    assert abstract.split() == plain.split()
    assert 200 < len(plain.split()) <= 250


@pytest.mark.parametrize("path", ["CITATION.cff", "paper/paper.md"])
def test_authors_are_those_that_the_maintainers_give(path):
    text = (ROOT / path).read_text(encoding="utf-8")
    listed = re.search(r"^authors:.*\n((?:  .*\n)+)", text, re.MULTILINE)[1]
    assert re.findall(r"name: (.+)", listed) == [one["name"] for one in GIVEN["authors"]]


def test_everything_that_the_paper_cites_is_in_its_bibliography():
    paper, library = (
        (ROOT / "paper" / name).read_text("utf-8") for name in ("paper.md", "paper.bib")
    )
    cited = set(re.findall(r"@(\w+)", paper))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", library, re.MULTILINE))


SYSTEMS = {"linux": "linux", "darwin": "osx", "win32": "win"}  # as Python and as conda call them
OF_CONDA = {"matplotlib": "matplotlib-base"}


def chosen(entries, system):
    """Requirements of a recipe on one system, without those that only name the system."""
    for entry in entries:
        if isinstance(entry, str):
            entries_of_it = [] if entry.startswith("__") else [entry]
        else:
            wanted = entry["if"] == SYSTEMS[system]
            found = entry.get("then" if wanted else "else", [])
            entries_of_it = chosen([found] if isinstance(found, str) else found, system)
        yield from entries_of_it


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_recipe_asks_for_what_the_package_asks_for(system):
    recipe = yaml.safe_load((ROOT / "packaging" / "recipe.yaml").read_text("utf-8"))
    least = PROJECT["requires-python"]
    needed = {"python": ">=${{ python_min }}"}
    for one in map(Requirement, PROJECT["dependencies"]):
        if one.marker is None or one.marker.evaluate({"sys_platform": system}):
            needed[OF_CONDA.get(one.name, one.name)] = str(one.specifier)  # the later is stricter
    stated = [r.split(maxsplit=1) for r in chosen(recipe["requirements"]["run"], system)]
    assert dict(stated) == needed
    assert recipe["context"] == {"version": __version__, "python_min": least.removeprefix(">=")}
    built_with = {"python ${{ python_min }}.*", "pip", *BUILD["requires"]}
    assert {r.replace(" >=", ">=") for r in recipe["requirements"]["host"]} == built_with
    (script,) = PROJECT["scripts"].items()
    assert recipe["build"]["python"]["entry_points"] == [" = ".join(script)]
    assert recipe["about"]["summary"] == PROJECT["description"]
    assert recipe["about"]["license"] == PROJECT["license"]


def test_the_image_has_a_python_that_was_tried_and_all_that_the_package_is_built_from():
    text = (ROOT / "packaging" / "Dockerfile").read_text("utf-8")
    tried = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.search(r"3\.\d+$", c)]
    assert re.search(r"^FROM python:(\S+)-slim$", text, re.MULTILINE)[1] in tried
    copied = re.findall(r"^COPY (.+) \S+$", text, re.MULTILINE)
    names = {name for line in copied for name in line.split()}
    read = set(re.findall(r'"([\w.]+\.(?:md|toml))"', (ROOT / "hatch_build.py").read_text("utf-8")))
    assert names >= read | {"pyproject.toml", "hatch_build.py", "src", "sweeps"}
    assert names >= set(PROJECT["license-files"])


def test_continuous_integration_tries_every_python_that_is_named():
    text = (ROOT / ".github" / "workflows" / "checks.yml").read_text("utf-8")
    matrix = yaml.safe_load(text)["jobs"]["checks"]["strategy"]["matrix"]
    tried = {c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.search(r"3\.\d+$", c)}
    assert tried <= set(matrix["python"])
    assert min(matrix["python"]) == PROJECT["requires-python"].removeprefix(">=")


# Public functions refuse what is no dataset or no number, with an error of this package.

ABSURD = (None, -1, 1.5, float("nan"), float("inf"), "x", "", b"x", [], ["x"], {}, {"a": 1})
ABSURD += (object(), 10**400, 1j, [1j], np.datetime64("NaT", "s"), np.zeros((2, 2)), xr.Dataset())
PUBLIC = {
    f"{space.__name__}.{name}": getattr(space, name)
    for space in (vs.analysis, vs.figures, vs.theory, vs.theory.sprung)
    for name in space.__all__
} | {"positions": vs.positions, "rectangle": vs.rectangle}


def needed(function):
    """Return the names of the arguments that a function needs, if it is one."""
    if not inspect.isfunction(function):
        return []
    named = inspect.signature(function).parameters.values()
    varying = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    return [p.name for p in named if p.default is p.empty and p.kind not in varying]


@each_of("name", [name for name, one in PUBLIC.items() if needed(one)])
def test_absurd_arguments(name):
    for value in ABSURD:
        with contextlib.suppress(VibrosweepError):
            PUBLIC[name](**dict.fromkeys(needed(PUBLIC[name]), value))


def test_lists_of_datasets():
    for given in ([], (), None, xr.Dataset(), "x", [None]):
        with pytest.raises(DataError, match="dataset"):
            vs.analysis.compare_separations(given)
        with pytest.raises(DataError, match="dataset"):
            vs.figures.separation_distributions(given, ["x"], 1e-4)


def test_an_absurd_number_of_landings_to_verify():
    for value in ("x", 0, 1.5, float("nan"), []):
        with pytest.raises(ParameterError, match="max_landings = "):
            vs.verify("any.h5", max_landings=value)


def test_any_real_number_is_one():
    expected = vs.theory.locked_height(2)
    for k in (Fraction(2), Decimal(2), np.int8(2), np.float32(2)):
        assert vs.theory.locked_height(k) == expected
    assert len(vs.theory.locked_windows(Fraction(1), Decimal("0.85"))) == 1


# First questions of a new user, each in at most five lines of Python.


def test_a_random_sweep():
    found = vs.sweep(restitution=(0.80, 0.98), amplitude=(0.2, 3.5), realizations=200, seed=1)
    tallest = found.rebound_height_max.max().item()
    assert dict(found.sizes)["realization"] == 200
    assert tallest > found.rebound_height_mean.max().item() > 0.0


def test_windows_of_a_locked_orbit_beside_their_closed_form():
    e = np.linspace(0.5, 0.95, 10)
    found = vs.windows(restitution=e, amplitude=np.linspace(0.1, 5.0, 50), conditions=["locked(1)"])
    window = found.isel(condition=0, direction=0, window=0)
    closed = {"A_min": vs.theory.amplitude_min(1, e), "A_max": vs.theory.amplitude_max(1, e)}
    for end, values in closed.items():
        assert (abs(window[end] - values) <= window[f"{end}_bracket"]).all()


def test_a_bifurcation_diagram_as_a_table(tmp_path):
    found = vs.bifurcation(amplitude=np.linspace(1.2, 1.6, 5), launch=[0.125], duration=3000.0)
    found.rebound_velocity.to_series().dropna().to_csv(tmp_path / "diagram.csv")
    table = pd.read_csv(tmp_path / "diagram.csv")
    locked = table[table.direction == "up"]
    assert len(locked) == 5 * 64
    assert np.allclose(locked.rebound_velocity, vs.theory.locked_velocity(1), rtol=1e-12)


def test_basins():
    found = vs.basins(launch_velocity=np.linspace(3.0, 6.0, 8), particles=8, duration=2000.0)
    share = (found.basin == 0).mean().item()
    assert share == found.fraction[0].item()


def test_sobol_indices():
    found = vs.sobol(restitution=(0.8, 0.98), amplitude=(0.2, 3.5), realizations=256)
    total = found.total_order.sel(output="rebound_height_max")
    assert total.sel(parameter="amplitude") > 0.2
    assert (found.first_order <= found.total_order + 0.1).all()


def test_a_grid_in_the_units_of_a_shaker():
    e, gamma = np.linspace(0.3, 0.95, 60), np.linspace(0.5, 5.0, 60)
    asks = {"frequency": 17.0, "duration_periods": 200, "base": "moving"}
    found = vs.sweep(restitution=e, base_acceleration=gamma, **asks)
    mesh = found.flight_time_mean.plot()
    assert mesh.axes.get_title() == ""
    assert mesh.get_array().shape == (60, 60)
    assert found.flight_time_mean.dims == ("restitution", "base_acceleration")
    mesh.figure.clear()


def test_a_table_of_own_pairs():
    e, a = np.random.default_rng(1).uniform([[0.5], [0.3]], [[0.95], [3.0]], (2, 50))
    pairs = pd.DataFrame({"restitution": e, "amplitude": a, "ball": ["steel", "glass"] * 25})
    found = vs.sweep(design=pairs, particles=2)
    heights = found.rebound_height_max.groupby("ball").mean()
    assert sorted(heights["ball"].values) == ["glass", "steel"]
    assert found.restitution.values.tolist() == e.tolist()
    assert found["ball"].values.tolist() == pairs["ball"].tolist()


def test_plots_of_a_record_are_headed_by_what_was_chosen(tmp_path):
    alone = vs.simulate(launch_time=[0.0, 0.125])
    vs.run({"record": {"launch": [0.0, 0.125]}}, tmp_path / "out.h5").close()
    with vs.open_record(tmp_path / "out.h5") as kept:
        for found in (alone, kept):
            (line,) = found.rebound_velocity.isel(realization=0, particle=1).plot()
            assert line.axes.get_title() == "launch_time = 0.125 [s]"
            line.figure.clear()
            assert found.amplitude.dims == found.duration.dims == ()


@each_of("parameter", [*INPUTS.values()])
def test_labels_of_axes_fit_into_one_line(parameter):
    """Matplotlib would cut off a label that xarray breaks into two lines."""
    assert len(f"{parameter.long_name} [{parameter.units}]") <= 30


# Every kind of result that this package writes is known to info, figures, verify and Python.

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


@each_of("name", KINDS)
def test_info(results, said, name):
    text = said(0, "info", results[name])
    assert "dimensions: " in text
    assert "no seal" not in text
    if name != "sweep":
        assert f"result of {KINDS[name].command}" in text
        for line in KINDS[name].lines(load_dataset(results[name])):
            assert line in text


@each_of("name", [name for name in KINDS if name != "sweep"])  # test_cli.py draws a sweep
def test_figures(results, said, name, tmp_path, monkeypatch):
    monkeypatch.setattr("vibrosweep.figures.registry.DOTS_PER_INCH", 40)
    place = tmp_path / name
    words = ("figures", results[name], "-o", place)
    if name == "impacts":
        assert "vibrosweep lab impacts TRACKS --figures DIR" in said(2, *words)
        return
    printed = said(0, *words)
    drawn = {path.suffix for path in place.iterdir() if str(path) in printed}
    assert drawn == {".png", ".pdf"}
    assert {path.stem for path in place.iterdir()} == {KINDS[name].stem}


@each_of("name", KINDS)
def test_verify(results, said, name):
    pytest.importorskip("flint")
    if not KINDS[name].unverified:
        assert "passed" in said(0, "verify", results[name])
        return
    message = said(2, "verify", results[name])
    assert f"is a result of {KINDS[name].command}, which cannot be verified: " in message
    assert KINDS[name].unverified in message


@each_of("name", [name for name in KINDS if name != "sweep"])
def test_python_names_the_kind(results, name):
    with pytest.raises(DataError, match=f"a result of {KINDS[name].command}; .* xarr"):
        vs.open_sweep(results[name])


def test_a_kind_of_a_later_version(tmp_path, said):
    path = tmp_path / "later.h5"
    xr.Dataset(attrs={KIND: "echo"}).to_netcdf(path, engine="h5netcdf")
    for command in ("info", "figures", "verify"):
        message = said(2, command, path)
        assert f"{path}: is a result of the kind 'echo', which this version" in message


# House rules: length of functions, number of parameters, one name for one thing.

PACKAGE = Path(vibrosweep.__file__).parent
FILES = {str(path.relative_to(PACKAGE)): path for path in sorted(PACKAGE.rglob("*.py"))}
LONGEST_BODY = 60  # lines of a function, without its docstring
MOST_PARAMETERS = 8
# Packages in which a file is named after the thing that it commands, draws, reads or proves.
BY_THE_NAME_OF = ("commands", "figures", "scene", "theory", "proof", "proof/reference")


def functions(path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def parameters(function):
    """Number of parameters; keyword-only parameters of a public function do not count."""
    given = function.args
    by_place = len(given.posonlyargs) + len(given.args)
    return by_place + (len(given.kwonlyargs) if function.name.startswith("_") else 0)


def body(function):
    """Lines of a function without its docstring."""
    first = function.body[1 if ast.get_docstring(function) and len(function.body) > 1 else 0]
    return function.body[-1].end_lineno - first.lineno + 1


def test_functions_are_short_and_take_few_parameters():
    complaints = []
    for name, path in FILES.items():
        for function in functions(path):
            taken, long = parameters(function), body(function)
            if taken > MOST_PARAMETERS:
                complaints.append(f"{name}: {function.name} takes {taken} parameters")
            if long > LONGEST_BODY:
                complaints.append(f"{name}: {function.name}: {long} lines")
    assert complaints == []


def test_files_of_one_name_are_about_one_thing():
    rooms = defaultdict(list)
    for name in FILES:
        path = Path(name)
        if path.name != "__init__.py":
            rooms[path.name].append(path.parent.as_posix())
    for name, found in rooms.items():
        own = [room for room in found if room not in BY_THE_NAME_OF]
        assert len(own) <= 1, f"{name} stands in {', '.join(own)}"


def test_only_one_class_is_called_a_scene():
    classes = [
        f"{name}: {node.name}"
        for name, path in FILES.items()
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ClassDef) and "Scene" in node.name
    ]
    assert sorted(classes) == ["scene/scene.py: Scene"]


# rooms of their own: they use what other modules list in __all__, and what is open to every room
ROOMS = ("explorer", "lab", "proof")
OPEN = ("abilities", "arrays", "errors", "mistakes", "model", "system", "theory", "waiting")


def imported(room):
    """File, module and name of all that a room imports from other rooms."""
    for path in sorted((PACKAGE / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            home = node.module.split(".") if isinstance(node, ast.ImportFrom) else [""]
            if home[0] == "vibrosweep" and home[1:] and home[1] not in (room, *OPEN):
                yield from ((path.name, node.module, alias.name) for alias in node.names)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_of_its_own_imports_what_others_list(room):
    complaints = []
    for file, module, name in imported(room):
        if name not in getattr(importlib.import_module(module), "__all__", ()):
            complaints.append(f"{room}/{file}: {module} does not list {name} in __all__")
    assert complaints == []
