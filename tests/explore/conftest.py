"""Shared by the tests of the page: small results of every base and kind, and their points."""

from pathlib import Path

import pytest

import vibrosweep as vs
from vibrosweep.explore.points import of_result

SWEEPS = {
    "high-bounce": {
        "restitution": (0.80, 0.98),
        "amplitude": (0.2, 3.5),
        "realizations": 30,
        "seed": 1,
        "particles": 5,
        "separation": True,
    },
    "moving": {
        "restitution": [0.8, 0.9],
        "base_acceleration": [0.5, 0.9, 1.5],
        "frequency": [1.0, 1.7],
        "particles": 3,
        "base": "moving",
        "duration_periods": 12.5,
        "regimes": True,
    },
    "sprung": {
        "base_mass": [0.5, 1.0],
        "particle_mass": 0.001,
        "mount_frequency": [0.37, 0.8],
        "particles": 3,
        "launch": [0.0, 0.2, 0.45],
        "base": "sprung",
        "duration": 9.0,
    },
}


@pytest.fixture(params=SWEEPS)
def base(request):
    return request.param


class Results(dict):
    """Sweeps by their bases, each computed when it is first asked for."""

    def __missing__(self, base):
        self[base] = vs.sweep(SWEEPS[base], progress=False)
        return self[base]


@pytest.fixture(scope="session")
def results():
    return Results()


@pytest.fixture(scope="session")
def points(results):
    """Points of the sweep over the high-bounce base."""
    return of_result(results["high-bounce"], Path("out.h5"), "sweep")
