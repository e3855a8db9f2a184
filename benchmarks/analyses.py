"""Processor time of every analysis on a grid of (restitution, amplitude) with twenty particles.

Usage: python benchmarks/analyses.py [points per axis, default 200]
"""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import xarray as xr

from vibrosweep import analysis, simulate
from vibrosweep.analysis.separations import separation_against, separation_distribution
from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.scene.scene import Scene

PARTICLES = 20
CHUNK = 1000

spent: dict[str, float] = defaultdict(float)


@contextmanager
def timed(name: str) -> Iterator[None]:
    before = time.process_time()
    yield
    spent[name] += time.process_time() - before


def measured(e: np.ndarray, amplitude: np.ndarray) -> xr.Dataset:
    """The sweep itself, with separations and regimes, over 12 s."""
    plain = Scene(PARTICLES, "staggered", 12.0, "rest").recorded(10**6)
    scene = plain.with_measures(transient=0.0, separation=True, regimes=True)
    parameters = all_parameters({"restitution": e, "amplitude": amplitude})
    with Workers(2) as workers:
        found = measure(parameters, scene, workers)
    names = ("dt_min", "collision_free", "rebound_height_max", "rebound_height_mean")
    return xr.Dataset(
        {name: ("realization", found[name]) for name in names},
        coords={
            **{name: ("realization", values) for name, values in parameters.items()},
            "duration": 12.0,
        },
    )


def main(points: int) -> None:
    axes = np.linspace(0.80, 0.98, points), np.linspace(0.2, 3.5, points)
    e, amplitude = (v.ravel() for v in np.meshgrid(*axes))
    measured(e[:50], amplitude[:50])  # compiles
    with timed("sweep with separations and regimes"):
        sweep = measured(e, amplitude)
    with timed("separation_distribution, separation_against"):
        separation_distribution(sweep)
        for parameter in ("restitution", "amplitude"):
            separation_against(sweep, parameter)
    for start in range(0, e.size, CHUNK):
        part = slice(start, start + CHUNK)
        with timed("simulate, every landing"):
            record = simulate(
                restitution=e[part],
                amplitude=amplitude[part],
                launch_time=np.arange(PARTICLES) / PARTICLES,
                duration=12.0,
            )
        with timed("order_against_chance"):
            analysis.order_against_chance(record, surrogates=1)
        with timed("return_map, landing_separations"):
            for realization in range(record.sizes["realization"]):
                analysis.return_map(record, realization=realization)
                analysis.landing_separations(record, realization=realization)
    print(f"{e.size} realizations of {PARTICLES} particles, processor time in s")
    for name, seconds in spent.items():
        print(f"{seconds:8.1f}  {name}")
    print(f"{sum(spent.values()):8.1f}  all")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
