"""The reference: every public name has its page, with parameters, results, errors, an example."""

import inspect
import re
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import vibrosweep

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "python.rst"
LISTED = re.findall(r"^   (vibrosweep\.[\w.]+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
PUBLIC = [name for name in vibrosweep.__all__ if name != "__version__"]
FUNCTIONS = [name for name in PUBLIC if inspect.isfunction(getattr(vibrosweep, name))]


def found(path):
    """What a dotted name stands for."""
    home, _, name = path.rpartition(".")
    return getattr(import_module(home), name)


def sections(thing):
    """Sections of a numpydoc docstring, by their titles."""
    parts = re.split(r"^(\w[\w ]+)\n-+$", inspect.getdoc(thing), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(section):
    """Names that head the entries of a section."""
    heads = re.findall(r"^(\*{0,2}\w.*)$", section, re.MULTILINE)
    return {name.strip(" *") for head in heads for name in head.partition(":")[0].split(",")}


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_listed(name):
    thing = getattr(vibrosweep, name)
    if not isinstance(thing, ModuleType):
        assert f"vibrosweep.{name}" in LISTED
        return
    listed = [found(path) for path in LISTED]
    own = {name: getattr(thing, name) for name in thing.__all__}
    assert {n for n, each in own.items() if callable(each) and each not in listed} == set()


@pytest.mark.parametrize("path", LISTED)
def test_every_parameter_is_documented(path):
    thing = found(path)
    if inspect.isclass(thing):
        assert inspect.getdoc(thing)
        return
    told = sections(thing)
    asked = set(inspect.signature(thing).parameters)
    assert asked - documented(told.get("Parameters", "")) == set()
    assert "Returns" in told


@pytest.mark.parametrize("path", [p for p in LISTED if not p.startswith("vibrosweep.errors.")])
def test_every_name_shows_an_example(path):
    """Sphinx runs them when the site is checked."""
    name = path.rpartition(".")[2]
    shown = sections(found(path))["Examples"]
    assert re.search(rf"^(>>>|\.\.\.) .*\b{name}\b", shown, re.MULTILINE)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_tells_its_errors_and_shows_an_example(name):
    told = sections(getattr(vibrosweep, name))
    assert re.search(r"^\w+Error", told["Raises"], re.MULTILINE)
    assert f"vs.{name}(" in told["Examples"]
    assert re.search(r"\b[Dd]ims?\b|As of `", told["Returns"])
