"""The reference: every public name has its page, with parameters, results, errors, an example."""

import inspect
import re
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import vibrosweep

PAGE = (Path(__file__).parents[1] / "docs" / "reference" / "python.rst").read_text(encoding="utf-8")
LISTED = re.findall(r"^   (vibrosweep\.[\w.]+)$", PAGE, re.MULTILINE)


def namespaces(module):
    """A public module, and the modules among its public names."""
    yield module
    for name in module.__all__:
        if isinstance(getattr(module, name), ModuleType):
            yield from namespaces(getattr(module, name))


NAMESPACES = {module.__name__: module for module in namespaces(vibrosweep)}
PUBLIC = {
    f"{home}.{name}": getattr(module, name)
    for home, module in NAMESPACES.items()
    for name in module.__all__
    if not isinstance(getattr(module, name), ModuleType)
}
FUNCTIONS = [n for n in vibrosweep.__all__ if inspect.isfunction(getattr(vibrosweep, n))]
TOLD = {"vibrosweep.__version__", "vibrosweep.errors.OPTIONS"}  # names that need no entry


def found(path):
    """Return the object of a dotted name."""
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


def test_the_page_lists_the_public_names_and_no_others():
    assert {path for path, thing in PUBLIC.items() if callable(thing)} == {*LISTED}
    data = {path for path, thing in PUBLIC.items() if not callable(thing)} - TOLD
    assert {path for path in data if not re.search(rf"\b{path.split('.')[-1]}``", PAGE)} == set()


@pytest.mark.parametrize("home", NAMESPACES)
def test_no_public_name_is_that_of_a_hidden_module(home):
    """Once the module is imported, the name would refer to it."""
    folders = getattr(NAMESPACES[home], "__path__", [])
    beside = {path.stem for folder in folders for path in Path(folder).iterdir()}
    names = {path.rpartition(".")[2] for path in PUBLIC if path.rpartition(".")[0] == home}
    assert names & beside == set()


@pytest.mark.parametrize("home", NAMESPACES)
def test_names_that_are_loaded_late_are_those_that_are_public(home):
    late = getattr(NAMESPACES[home], "_HOMES", None)
    if late is not None:
        assert {*late} == {*NAMESPACES[home].__all__} - {"__version__"}


def test_every_parameter_is_documented():
    for path in LISTED:
        thing = found(path)
        if inspect.isclass(thing):
            assert inspect.getdoc(thing), path
            continue
        told = sections(thing)
        asked = thing.__annotations__.keys() - {"return"}
        assert asked - documented(told.get("Parameters", "")) == set(), path
        assert "Returns" in told, path


def test_every_name_shows_an_example():
    """Sphinx runs them when the site is checked."""
    for path in LISTED:
        if not path.startswith("vibrosweep.errors."):
            name, shown = path.rpartition(".")[2], sections(found(path)).get("Examples", "")
            assert re.search(rf"^(>>>|\.\.\.) .*\b{name}\b", shown, re.MULTILINE), path


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_tells_its_errors_and_shows_an_example(name):
    told = sections(getattr(vibrosweep, name))
    assert re.search(r"^\w+Error", told["Raises"], re.MULTILINE)
    assert f"vs.{name}(" in told["Examples"]
    if inspect.signature(getattr(vibrosweep, name)).return_annotation == "xr.Dataset":
        assert re.search(r"\b[Dd]ims?\b|As `", told["Returns"])
