"""What is published: the wheel, its description, and how to cite it."""

import importlib.util
import re
import tomllib
import zipfile
from email.parser import BytesParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
ADDRESSES = PROJECT["tool"]["hatch"]["metadata"]["hooks"]["custom"]


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
        for p in (ROOT / "sweeps").rglob("*.toml")
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
    named = {key.title() for key, address in ADDRESSES.items() if key != "files" and address}
    assert {url.partition(",")[0] for url in metadata.get_all("Project-URL", [])} == named


def test_addresses_reach_the_description(hook):
    readme = (
        "a\n![One](docs/one.png)\n![Two](docs/two.png)\n[model](docs/model.md), [x](https://x)\n"
    )
    assert hook.described(readme, "") == "a\nmodel, [x](https://x)\n"
    assert hook.described(readme, "https://files/v1/") == (
        "a\n![One](https://files/v1/docs/one.png)\n![Two](https://files/v1/docs/two.png)\n"
        "[model](https://files/v1/docs/model.md), [x](https://x)\n"
    )
    metadata = {}
    given = {"source": "https://source", "issues": "", "files": "https://files"}
    hook.Hook(str(ROOT), given).update(metadata)
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
