"""Compile the kernels of common scenes: a sine, a constant restitution, no noise."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vibrosweep.abilities import refusal
from vibrosweep.analysis.basins import basins
from vibrosweep.analysis.conditions import Locked, locked
from vibrosweep.analysis.continuation import FIX_E
from vibrosweep.analysis.orbits import Plane, branches_along, orbits
from vibrosweep.engine.coupled import base_track
from vibrosweep.engine.landings import all_parameters, record_landings
from vibrosweep.engine.measure import PERIODS_TO_RECUR, measure
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import OutputError
from vibrosweep.kernels import _jit
from vibrosweep.kernels._numba import HAS_CACHE
from vibrosweep.kernels.impact import KIND_OF
from vibrosweep.model.forcing import AMPLITUDE
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import LAWS, SPRUNG
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import batch, keyword_spec


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
    if _jit.cache_directory is None:
        raise OutputError(
            "machine code cannot be stored next to the package nor in the home directory; set "
            "NUMBA_CACHE_DIR to a directory that can be written, and unset NUMBA_DISABLE_JIT"
        )
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
    return Compiled(made, kept, _jit.cache_directory)


def kernels() -> list[_jit.Deferred]:
    """Return all kernels of the modules that are imported, each once."""
    modules = [vars(m) for n, m in sys.modules.items() if n.startswith("vibrosweep.kernels.")]
    found = [value for names in modules for value in names.values()]
    return [*dict.fromkeys(one for one in found if isinstance(one, _jit.Deferred))]
