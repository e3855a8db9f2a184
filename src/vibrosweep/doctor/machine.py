"""Checks of disk, memory, processors and the compiler; machine code compiled in advance."""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import numba
import numpy as np

from vibrosweep.abilities import refusal
from vibrosweep.doctor import Finding
from vibrosweep.errors import OutputError
from vibrosweep.kernels._jit import Deferred, cache_directory, jit, kernel, read_only_caches
from vibrosweep.kernels._numba import HAS_CACHE, VARIABLE, lost, remedy, target, vector_bits
from vibrosweep.model.parameters import LAWS, SPRUNG
from vibrosweep.runs.chunks import TRAJECTORIES_PER_BATCH
from vibrosweep.runs.driver import available_threads
from vibrosweep.runs.plan import BYTES_PER_TRAJECTORY
from vibrosweep.system import available_memory, physical_memory

GROUP: Final = Path("/sys/fs/cgroup")
# Bytes; about the result of a sweep of a million realizations
LITTLE_DISK: Final = 1 << 28
# Bytes; the libraries alone take a third of this
LITTLE_MEMORY: Final = (1 << 29) + BYTES_PER_TRAJECTORY * TRAJECTORIES_PER_BATCH


def processors(group: Path = GROUP) -> Finding:
    """Check the processors, and the limit of a control group (a container) on CPU time."""
    usable, words = available_threads(), _group_limit(group, "cpu.max")
    limited = len(words) == 2 and words[0] != "max"
    quota = int(words[0]) / int(words[1]) if limited else usable
    state = f"{usable} of {os.cpu_count()} may be used; vibrosweep run uses {usable} threads"
    if quota > usable - 0.5:
        return Finding("processors", state)
    advice = f"give --threads {max(1, round(quota))}, or raise the limit of the container"
    return Finding(
        "processors", state, f"the container limits CPU time to {quota:g} processors: {advice}"
    )


def _group_limit(group: Path, name: str) -> list[str]:
    """Read a limit of a control group, in words; none without a control group."""
    try:
        return (group / name).read_text(encoding="ascii").split()
    except OSError:
        return []


def memory(group: Path = GROUP) -> Finding:
    """Check the memory, and the limit of a control group (a container) on it."""
    available = available_memory()
    state = f"{available / 2**30:.3g} GiB of {physical_memory() / 2**30:.3g} GiB are available"
    limit = _group_limit(group, "memory.max")
    if limit and limit[0] != "max":
        used = _group_limit(group, "memory.current")
        available = min(available, int(limit[0]) - int(used[0] if used else 0))
        state += f", of which this container may take {max(0, available) / 2**30:.3g} GiB"
    if available >= LITTLE_MEMORY:
        return Finding("memory", state)
    advice = "close other programs, or lower --chunk when running"
    return Finding("memory", state, f"less than {LITTLE_MEMORY / 2**30:.2g} GiB: {advice}")


def disk(directory: Path) -> Finding:
    """Check the disk to which results are written."""
    free = shutil.disk_usage(directory).free
    state = f"{free / 2**30:.3g} GiB free in {directory}"
    try:
        with tempfile.TemporaryFile(dir=directory) as file:
            file.write(b"\0" * 4096)
            file.flush()
    except OSError as error:
        advice = "choose another directory for results with -o"
        return Finding("disk", state, f"nothing can be written here ({error.strerror}): {advice}")
    if free < LITTLE_DISK:
        advice = "free some space, or choose another place for results with -o"
        return Finding("disk", state, f"less than {LITTLE_DISK / 2**20:.0f} MiB: {advice}")
    return Finding("disk", state)


# Processor features by LLVM's names: the bits of their vectors; those with fused multiply-add.
WIDTHS: Final = {"avx": 256, "avx2": 256, "avx512f": 512, "neon": 128}
FUSED: Final = ("fma", "neon")


@jit
def half(x: float) -> float:
    """A piece."""
    return x / 2.0


def quarter(x: float) -> float:
    """A kernel."""
    return half(half(x))


def compiler(directory: Path | None) -> Finding:
    """Compile a kernel and its piece, store the machine code, and load it again.

    It is stored in `directory`, or in the system's temporary directory where that is None.
    """
    subject, state = "compiler", f"numba {numba.__version__}"
    if numba.config.DISABLE_JIT:
        return Finding(subject, f"{state}, not used: nothing is compiled")
    with tempfile.TemporaryDirectory(dir=directory, prefix=".vibrosweep-doctor-") as place:
        made, loaded = (kernel(quarter, Path(place)) for _ in range(2))
        try:
            values = made(1.0), loaded(1.0)
            hits = sum(loaded.dispatcher.stats.cache_hits.values())  # type: ignore[attr-defined]
        except Exception as error:  # a version with other private parts may fail in any way
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            return Finding(subject, state, f"a kernel cannot be compiled: {reason}; {remedy()}")
    if values != (0.25, 0.25):
        return Finding(subject, state, f"a quarter of 1 is computed as {values}; {remedy()}")
    if lost:
        costs = "; ".join(f"{cost} ({name})" for name, cost in lost.items())
        return Finding(subject, state, f"results are correct, but {costs}; {remedy()}")
    if not hits:
        return Finding(subject, state, f"stored machine code is not loaded; {remedy()}")
    return Finding(subject, f"{state} compiled a kernel, stored it, and loaded it again")


def vector_registers() -> Finding:
    """Check the instruction set that numba compiles for, which the environment can change."""
    subject = "vector registers"
    if numba.config.DISABLE_JIT:
        return Finding(subject, "none: nothing is compiled", _unset("NUMBA_DISABLE_JIT"))
    _, processor, stated = target()
    features = re.findall(r"\+([\w.-]+)", stated)
    fused = any(name in features for name in FUSED)
    # without the instruction each fused multiply-add is a function call, which is never vectorised
    bits = max((WIDTHS[name] for name in features if name in WIDTHS), default=64) if fused else 64
    words = "fused multiply-add by instruction" if fused else "no fused multiply-add"
    requested = vector_bits()
    choice = "the compiler's choice" if requested is None else f"{requested} bits requested"
    state = (
        f"{min(bits, requested or bits)} bits, {words}, compiled for {processor}; {choice}, which "
        f"{VARIABLE} changes"
    )
    if fused and numba.config.OPT == 3:
        return Finding(subject, state)
    return Finding(subject, state, f"results are correct, but slow: {_reason_for_scalar_code()}")


def _reason_for_scalar_code() -> str:
    if numba.config.OPT != 3:
        return _unset("NUMBA_OPT")
    if numba.config.CPU_NAME or numba.config.CPU_FEATURES:
        return _unset("NUMBA_CPU_NAME and NUMBA_CPU_FEATURES")
    return "this processor has no fused multiply-add; use one that has (x86-64-v3, or AArch64)"


def _unset(variable: str) -> str:
    return f"the environment switches the compiler's optimisation off: unset {variable}"


def kernel_cache(
    directory: Path | None = cache_directory, read_only: tuple[Path, ...] = read_only_caches
) -> Finding:
    """Check the machine code of exactly these sources that is cached on disk."""
    subject = "kernel cache"
    if numba.config.DISABLE_JIT:
        return Finding(subject, "not used: nothing is compiled")
    if not HAS_CACHE:
        return Finding(subject, "none, as the compiler lacks a part")
    from vibrosweep.kernels._cache import Variants, variants  # needs what HAS_CACHE says

    advice = "set NUMBA_CACHE_DIR to a directory that can be written"
    uses = dict.fromkeys(read_only, "can only be read")
    if directory is not None:
        uses[directory] = "can be written"
    counts = [Variants(0, 0, 0), *map(variants, uses)]
    usable, foreign, damaged = (sum(column) for column in zip(*counts, strict=True))
    if not usable and directory is None:
        return Finding(subject, "none", f"each run compiles the kernels again: {advice}")
    files = (file for place in uses for file in place.rglob("*"))
    size = sum(file.stat().st_size for file in files if file.is_file())
    state = f"{usable} compiled variants of these sources for this processor"
    if foreign:
        state += f", {foreign} for others"
    places = ", and ".join(f"{place}, which {use}" for place, use in uses.items())
    state += f", {size / 2**20:.1f} MiB in {places}"
    if directory is None:
        state += f"; a run compiles the variants that are missing there each time, or {advice}"
    elif usable == 0:
        state += "; a run compiles the variants that it needs, vibrosweep warmup all of them"
    if damaged:
        trouble = (
            f"damaged or missing files: {damaged}; they are not used, vibrosweep warmup "
            f"writes them again, or delete {' and '.join(map(str, uses))}"
        )
        return Finding(subject, state, trouble)
    return Finding(subject, state)


class Compiled(NamedTuple):
    """Result of warming up."""

    made: int  # variants that were compiled
    kept: int  # variants that were on disk already
    directory: Path  # of the machine code


def warm_up() -> Compiled:
    """Compute a small scene over every base, with every law and kind of measure.

    Raises an OutputError if machine code cannot be stored on this disk.
    """
    if not HAS_CACHE:
        raise OutputError("machine code cannot be stored: vibrosweep doctor says why")
    if cache_directory is None:
        raise OutputError(
            "machine code cannot be stored next to the package nor in the home directory; set "
            "NUMBA_CACHE_DIR to a directory that can be written, and unset NUMBA_DISABLE_JIT"
        )
    from vibrosweep.analysis.basins import basins
    from vibrosweep.analysis.conditions import Locked, locked
    from vibrosweep.analysis.continuation import FIX_E
    from vibrosweep.analysis.orbits import Plane, branches_along, orbits
    from vibrosweep.engine.coupled import base_track
    from vibrosweep.engine.landings import all_parameters, record_landings
    from vibrosweep.engine.measure import PERIODS_TO_RECUR, measure
    from vibrosweep.engine.workers import Workers
    from vibrosweep.kernels.impact import KIND_OF
    from vibrosweep.model.forcing import AMPLITUDE
    from vibrosweep.model.observables import Measures
    from vibrosweep.scene.scene import Scene
    from vibrosweep.scene.sweep import batch, keyword_spec

    ways = [(base, law) for base, law in product(KIND_OF, LAWS) if not refusal(base, law=law)]
    # a moving base below and above 1 g
    batches = [all_parameters({"amplitude": np.array([a])}) for a in (1.0, 6.0)]
    with Workers(1) as workers:
        for (base, rebound), transient, regimes in product(ways, (0.0, 1.0), (False, True)):
            endless = Scene(2, "staggered", 2.0, rebound, base=base).recorded(1000)
            record_landings(batches[0], endless, workers)
            measures = Measures(transient, separation=True, lyapunov=regimes, trust=True)
            measures = replace(measures, ordering=True)
            # long enough for orbits to recur
            longer = replace(endless, duration=2.0 * PERIODS_TO_RECUR)
            for parameters in batches:
                measure(parameters, replace(endless, measures=measures), workers)
                measure(parameters, longer.with_measures(transient=transient), workers)
        for base, rebound in ways:
            point = {"restitution": np.array([0.9]), "amplitude": np.array([1.2])}
            one, _ = batch({"base": base, "rebound": rebound, "duration": 2000.0})
            locked(one, Locked(1), point, workers)
            launched = {"launch": [0.0], "launch_velocity": [5.0], "duration": 2000.0}
            launches = keyword_spec({"base": base, "rebound": rebound, **launched})
            basins(launches, 1)
            orbits(launches, 1, impacts=1, periods=1, seeds=1)
            plane = Plane(one, AMPLITUDE, np.array([0.5]), np.array([1.0, 5.0]), 100)
            branches_along(plane, FIX_E, (1, 1), 1, workers)
        mount = {"mass_ratio": 0.01, "mount_frequency": 0.5, "mount_damping": 0.05}
        parameters = all_parameters({name: np.array([value]) for name, value in mount.items()})
        coupled = Scene(2, "staggered", 2.0, base=SPRUNG).recorded(1000)
        measure(parameters, replace(coupled, measures=Measures(joint=True)), workers)
        base_track(parameters, coupled, workers).at(np.array([1.0]))
    counts = [kernel.dispatcher.stats for kernel in kernels()]
    made = sum(sum(count.cache_misses.values()) for count in counts)
    kept = sum(sum(count.cache_hits.values()) for count in counts)
    return Compiled(made, kept, cache_directory)


def kernels() -> list[Deferred]:
    """Return all kernels of the modules that are imported, each once."""
    modules = [vars(m) for n, m in sys.modules.items() if n.startswith("vibrosweep.kernels.")]
    found = [value for names in modules for value in names.values()]
    return [*dict.fromkeys(one for one in found if isinstance(one, Deferred))]
