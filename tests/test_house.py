"""House rules: length of functions, number of parameters, one name for one thing."""

import ast
import importlib
from collections import defaultdict
from pathlib import Path

import pytest

import vibrosweep

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


ROOMS = ("explorer", "proof")  # rooms of their own: they use what other modules list in __all__
OPEN = ("abilities", "arrays", "errors", "lazy", "model", "system", "theory")  # to every room


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
