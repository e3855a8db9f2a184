"""Remove each private name of numba: `run` gives the same bits, `doctor` says so.

    python checks/numba_names.py

Each name is removed for the package alone, in processes of their own with an empty cache of
machine code, which takes about ten seconds for each.  The exit code is 1 if anything is wrong.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

import vibrosweep

PACKAGE = Path(vibrosweep.__file__).parent
HOME = PACKAGE / "kernels" / "_numba.py"

SWEEP = """
title = "Two balls"
[scene]
particles = 2
duration = 3.0
[sample]
design = "grid"
restitution = [0.5, 0.9]
amplitude = [1.0, 1.2]
"""

# the command of vibrosweep, to which numba lacks a name
WITHOUT = """
import builtins, sys
name = sys.argv.pop(1)
genuine = builtins.__import__
def importing(module, globals=None, locals=None, fromlist=(), level=0):
    ours = str((globals or {}).get("__name__")).startswith("vibrosweep.")
    if ours and module.startswith("numba") and name in (fromlist or ()):
        raise ImportError(f"cannot import name {name!r} from {module!r} (/a/path)")
    return genuine(module, globals, locals, fromlist, level)
builtins.__import__ = importing
from vibrosweep.cli import main
sys.exit(main())
"""


def from_numba(path: Path) -> Iterator[str]:
    """Yield the names that a file imports from numba or a module of it."""
    text = path.read_text("utf-8")
    for node in ast.walk(ast.parse(text)) if "numba" in text else ():
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "numba":
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (one.name for one in node.names if one.name.startswith("numba."))


def command_without(name: str, *arguments: str, place: Path) -> tuple[int, str]:
    """Run a command where numba lacks a name; return its exit code and all that it prints."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(PACKAGE.parent),
        "NUMBA_CACHE_DIR": str(place / "cache"),
    }
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, name, *arguments],
        cwd=place,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=600,
    )
    return done.returncode, done.stdout


def complaints(name: str, code: int, text: str) -> Iterator[str]:
    """Yield what is wrong with how `doctor` ended without a name."""
    if code != 1 or text.count("WRONG: ") != 1 or "Traceback" in text:
        yield f"doctor ended with {code}: {text}"
    if f"cannot import name {name!r}" not in text or "were tried" not in text:
        yield f"doctor does not name it: {text}"


def values(path: Path) -> dict[str, bytes]:
    """Return the bytes of every variable of a result."""
    with h5py.File(path) as file:
        found = {name: one for name, one in file.items() if isinstance(one, h5py.Dataset)}
        return {name: np.asarray(one[()]).tobytes() for name, one in found.items()}


def judged(name: str, expected: dict[str, bytes] | None) -> tuple[list[str], dict[str, bytes]]:
    """Return what is wrong without a name, and the result if there is one."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place)
        (path / "two.toml").write_text(SWEEP)
        code, text = command_without(name, "run", "two.toml", "-o", "two.h5", place=path)
        wrong, found = [], {}
        if code:
            wrong.append(f"run ended with {code}: {text}")
        else:
            found = values(path / "two.h5")
            if expected is not None and found != expected:
                wrong.append("run gave other bits")
        if expected is not None:
            wrong += complaints(name, *command_without(name, "doctor", place=path))
    return wrong, found


def main() -> int:
    """Remove each name; return the exit code."""
    _, expected = judged("nothing at all", None)
    failed = 0
    for name in sorted(from_numba(HOME)):
        wrong, _ = judged(name, expected)
        print(f"{name:24}", "; ".join(wrong) or "ok", flush=True)
        failed += bool(wrong)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
