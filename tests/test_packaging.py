"""The published package: the wheel, its description, and how to cite it."""

import importlib.util
import re
import shutil
import tomllib
import zipfile
from email.parser import BytesParser
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from vibrosweep import __version__

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
    assert stated["abstract"].rstrip(".") == metadata["Summary"]
    assert stated.get("repository-code", "") == ADDRESSES["source"]


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
