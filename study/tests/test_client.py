"""The study uses the package as any user does: by its public names."""

import ast
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import study
import vibrosweep

ROOM = Path(study.__file__).parent
FILES = sorted(ROOM.rglob("*.py"))


def namespaces(module):
    """Yield a public module and the modules among its public names, with their dotted names."""
    yield module.__name__, module
    for name in module.__all__:
        if isinstance(getattr(module, name), ModuleType):
            yield from namespaces(getattr(module, name))


PUBLIC = dict(namespaces(vibrosweep))


def used(tree):
    """Modules of the package, and the names that a file takes from each."""
    known = {}

    def module_of(node):
        if isinstance(node, ast.Name):
            return known.get(node.id)
        home = module_of(node.value) if isinstance(node, ast.Attribute) else None
        found = getattr(home, node.attr, None) if home else None
        return found if isinstance(found, ModuleType) else None

    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for one in node.names:
                root, *rest = one.name.split(".")
                if root == "vibrosweep":
                    yield from [(one.name, None)] if rest else []
                    module = import_module(one.name)
                    known[one.asname or root] = module if one.asname else vibrosweep
        elif isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "vibrosweep":
            for one in node.names:
                yield node.module, one.name
                known[one.asname or one.name] = getattr(import_module(node.module), one.name, None)
    known = {name: one for name, one in known.items() if isinstance(one, ModuleType)}
    for node in ast.walk(tree):
        home = module_of(node.value) if isinstance(node, ast.Attribute) else None
        if home and not node.attr.startswith("__"):
            yield home.__name__, node.attr


def hidden(text):
    return {
        (module, name)
        for module, name in used(ast.parse(text))
        if module not in PUBLIC or (name is not None and name not in PUBLIC[module].__all__)
    }


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOM).as_posix())
def test_only_public_names_are_used(path):
    assert hidden(path.read_text(encoding="utf-8")) == set()


@pytest.mark.parametrize(
    "text",
    [
        "from vibrosweep.kernels import arithmetic",
        "from vibrosweep.analysis.records import return_map",
        "from vibrosweep.analysis import datasets",
        "import vibrosweep.model",
        "import vibrosweep.model.parameters as parameters",
        "import vibrosweep as vs; vs.store",
        "import vibrosweep as vs; vs.theory.sprung.coupled_cycles",
        "from vibrosweep import theory; theory.locked_theory",
    ],
)
def test_a_hidden_name_is_found(text):
    assert hidden(text)


def test_the_command_line_of_the_package_does_not_know_the_study():
    """The study is not installed with the package."""
    source = Path(vibrosweep.__file__).parent
    for path in source.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert "study" not in {name.partition(".")[0] for name in names}, path
