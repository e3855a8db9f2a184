"""House rules: length of functions, number of parameters, one name for one thing."""

import ast
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


@pytest.mark.parametrize("name", FILES)
def test_functions_are_short_and_take_few_parameters(name):
    for function in functions(FILES[name]):
        taken, long = parameters(function), body(function)
        assert taken <= MOST_PARAMETERS, f"{function.name} takes {taken} parameters"
        assert long <= LONGEST_BODY, f"{function.name}: {long} lines"


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
