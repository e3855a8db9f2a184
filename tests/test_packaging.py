"""The published package: the wheel, its description, and how to cite it."""

import importlib.util
import re
import shutil
import tomllib
import zipfile
from email.parser import BytesParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GIVEN = tomllib.loads((ROOT / "MAINTAINERS.toml").read_text(encoding="utf-8"))
ADDRESSES = GIVEN["addresses"]


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
