"""Names of numba that no version promises to keep: without each of them, one after another."""

import builtins
import importlib.util
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numba
import pytest
from numba.core.compiler import DefaultPassBuilder
from numba.core.registry import cpu_target
from packaging.requirements import Requirement

from numba_names import HOME, PACKAGE, command_without, complaints, from_numba
from vibrosweep.kernels import _numba, _pieces

ROOT = Path(__file__).parents[2]
NAMES = sorted(from_numba(HOME))
PUBLIC = {"njit", "types", "intrinsic", "overload"}  # documented for those who extend numba
IN_PIECES = {
    *("CompilerBase", "DefaultPassBuilder", "JITCodeLibrary", "LoweringPass", "NativeLowering"),
    *("make_function", "register_pass"),
}
IN_CACHE = {
    *("CompileResultCacheImpl", "FunctionCache", "IndexDataCacheFile"),
    "UserProvidedCacheLocator",
}
compiles = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def test_private_names_are_imported_in_one_file_only():
    others = {name for f in PACKAGE.rglob("*.py") if f != HOME for name in from_numba(f)}
    assert others <= PUBLIC
    assert PUBLIC.isdisjoint(NAMES)
    assert set(NAMES) >= IN_PIECES | IN_CACHE


@pytest.mark.parametrize("name", NAMES)
def test_without_a_name(name, monkeypatch):
    """It is noted with what it costs."""
    genuine = builtins.__import__

    def importing(module, space=None, own=None, fromlist=(), level=0):
        if name in (fromlist or ()) and module.startswith("numba"):
            raise ImportError(f"cannot import name {name!r} from {module!r} (/a/path)")
        return genuine(module, space, own, fromlist, level)

    spec = importlib.util.spec_from_file_location("vibrosweep.kernels._numba_again", HOME)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setattr(builtins, "__import__", importing)
    spec.loader.exec_module(module)
    ((text, cost),) = module.lost.items()
    assert text.startswith(f"cannot import name {name!r} from 'numba")
    assert "path" not in text
    assert cost
    assert (name not in IN_PIECES) == module.HAS_PIECES
    assert (name not in IN_CACHE) == module.HAS_CACHE


@compiles
@pytest.mark.parametrize("name", ["JITCodeLibrary", "FunctionCache"])
def test_doctor_says_in_one_line_what_is_lost(name, tmp_path):
    code, text = command_without(name, "doctor", place=tmp_path)
    assert list(complaints(name, code, text)) == []


def test_everything_is_there():
    """Also the passes that are left out, which are known by their names alone."""
    assert _numba.lost == {}
    flags = {"auto_parallel": SimpleNamespace(enabled=False), "no_rewrites": False}
    state = SimpleNamespace(flags=SimpleNamespace(**flags, enable_ssa=True), func_ir=None)
    passes = DefaultPassBuilder.define_nopython_pipeline(state).passes
    assert {one.__name__ for one, _ in passes} >= _pieces.NEEDLESS


@compiles
def test_the_target_is_the_one_in_the_keys_of_machine_code():
    cpu_target.target_context.refresh()
    assert _numba.target() == cpu_target.target_context.codegen().magic_tuple()


def test_the_oldest_version_tried_is_the_oldest_allowed():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    needed = {one.name: one.specifier for one in map(Requirement, project["dependencies"])}
    assert str(needed["numba"]) == f">={_numba.OLDEST.removesuffix('.0')}"
