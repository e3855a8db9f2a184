"""Checks of `vibrosweep doctor`: here of installed versions, and of two HDF5 libraries."""

from __future__ import annotations

import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

from packaging.requirements import Requirement

import vibrosweep.kernels  # noqa: F401  (before numba: it reads the environment)
from vibrosweep._version import __version__
from vibrosweep.errors import VibrosweepError

LIBRARIES: Final = ("numpy", "numba", "llvmlite", "scipy", "xarray", "h5py", "h5netcdf")
# Libraries that extras of the package add, and the extra of each
OPTIONAL: Final = {"python-flint": "verify", "distributed": "cluster", "netCDF4": "test"}
PATIENCE: Final = 60.0  # s

# Runs in a separate process, since incompatible libraries may crash it.
TRIAL: Final = """
import sys
import h5netcdf, h5py
path, other = sys.argv[1], sys.argv[2] == "True"
with h5netcdf.File(path, "w") as file:
    file.dimensions["x"] = 3
    file.create_variable("v", ("x",), "f8")[...] = [1.0, 2.0, 3.0]
print(h5py.version.hdf5_version)
if other:
    import netCDF4
    print(netCDF4.__hdf5libversion__)
    with netCDF4.Dataset(path) as file:
        assert file["v"][:].tolist() == [1.0, 2.0, 3.0]
with h5netcdf.File(path) as file:
    assert file["v"][...].tolist() == [1.0, 2.0, 3.0]
print("read")
"""


class Finding(NamedTuple):
    """The result of one check."""

    subject: str
    state: str
    trouble: str = ""  # the trouble and its remedy; empty if there is none

    def lines(self) -> Iterator[str]:
        """Yield the finding as lines of text."""
        yield f"{self.subject:20}{self.state}"
        if self.trouble:
            yield f"{'':20}WRONG: {self.trouble}"


def findings(directory: Path) -> Iterator[Finding]:
    """Check everything that a run in `directory` depends on, in a few seconds."""
    yield from versions()
    try:
        from vibrosweep.doctor import machine
    except VibrosweepError as error:  # a numba with which nothing runs
        yield Finding("compiler", "none", str(error))
        return
    space = machine.disk(directory)
    place = None if space.trouble else directory
    yield hdf5_libraries(place)
    yield machine.processors()
    yield machine.compiler(place)
    yield machine.vector_registers()
    yield machine.kernel_cache()
    yield machine.memory()
    yield space


def versions() -> Iterator[Finding]:
    """Check Python and the libraries; name those that are too old for the package."""
    yield Finding("vibrosweep", __version__)
    yield Finding("python", f"{platform.python_version()} ({platform.python_implementation()})")
    too_old = [str(needed) for needed in _required() if not _satisfied(needed)]
    remedy = "python -m pip install --upgrade " + " ".join(f"'{needed}'" for needed in too_old)
    yield Finding(
        "libraries",
        ", ".join(f"{name} {_version(name) or 'missing'}" for name in LIBRARIES),
        f"needed: {', '.join(too_old)}; install with: {remedy}" if too_old else "",
    )
    extras = (f"{name} {_version(name) or f'missing ({use})'}" for name, use in OPTIONAL.items())
    yield Finding("optional libraries", ", ".join(extras))


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _required() -> list[Requirement]:
    """Return the requirements of the package on this system; none if it is not installed."""
    try:
        stated = requires("vibrosweep") or []
    except PackageNotFoundError:
        return []
    needed = [Requirement(text) for text in stated]
    return [r for r in needed if r.marker is None or r.marker.evaluate({"extra": ""})]


def _satisfied(needed: Requirement) -> bool:
    found = _version(needed.name)
    return found is not None and needed.specifier.contains(found, prereleases=True)


def hdf5_libraries(
    directory: Path | None, trial: str = TRIAL, patience: float = PATIENCE
) -> Finding:
    """Write a file and read it with every installed HDF5 library, in one process.

    The file is in `directory`, or in the system's temporary directory where that is None.  The
    program `trial` is abandoned after `patience` seconds.
    """
    other = find_spec("netCDF4") is not None
    with tempfile.TemporaryDirectory(dir=directory, prefix=".vibrosweep-doctor-") as place:
        command = [sys.executable, "-c", trial, f"{place}/trial.nc", str(other)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, check=False, timeout=patience
            )
            code, words, errors = done.returncode, done.stdout.split(), done.stderr
        except subprocess.TimeoutExpired:
            code, words, errors = -1, [], f"no answer within {patience:g} s"
    state = "h5py has " + (words[0] if words else "no HDF5 library that works")
    if other:
        state += f", netCDF4 has {words[1] if len(words) > 1 else 'none that works with it'}"
    if code == 0 and words[-1] == "read":
        return Finding("HDF5", f"{state}; a file was written and read again in one process")
    reason = errors.strip().splitlines()[-1] if errors.strip() else f"it ended with code {code}"
    return Finding(
        "HDF5", state, f"a trial file could not be written and read: {reason}; {_remedy(reason)}"
    )


def _remedy(reason: str) -> str:
    if "lock" in reason.lower() or "unavailable" in reason:
        return "this file system cannot lock files: set HDF5_USE_FILE_LOCKING=FALSE"
    return (
        "install h5py and netCDF4 from one source (both by pip, or both by conda), for example "
        "python -m pip install --force-reinstall h5py netCDF4"
    )
