"""Sweeps of a scene over values of its inputs, for analyses that tests call with a scene."""

import numpy as np

from vibrosweep.analysis import basins as of_basins
from vibrosweep.analysis import bifurcation as of_bifurcation
from vibrosweep.analysis import windows as of_windows
from vibrosweep.scene.design import Design, GridAxis
from vibrosweep.scene.sweep import Sweep


def over(scene, windows=None, **axes):
    """Sweep over a grid of a scene that states its duration."""
    axes = {n: GridAxis(tuple(np.atleast_1d(v).tolist())) for n, v in axes.items()}
    design = Design("grid", axes)
    return Sweep("", "", None, scene, design, None, windows, stated=frozenset({"duration"}))


def find_windows(scene, e, scan, conditions, *, forcing="amplitude", threads=1, **options):
    sweep = over(scene, {"conditions": conditions, **options}, restitution=e, **{forcing: scan})
    return of_windows.find_windows(sweep, threads)


def bifurcation(scene, scan, *, forcing="amplitude", observable="rebound_velocity", samples=64):
    sweep = over(scene, **{forcing: scan})
    return of_bifurcation.bifurcation(sweep, observable, samples, 1, 1)


def basins(scene, times, speeds):
    launched = {"launch": tuple(map(float, times)), "particles": len(times)}
    scene = type(scene)(**{**vars(scene), **launched})
    return of_basins.basins(over(scene, launch_velocity=speeds), 1)
