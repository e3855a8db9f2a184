"""The bare map; run with ``pytest benchmarks/test_bare_map.py -s``."""

from __future__ import annotations

import pytest

from methods.timing import SETTLE
from test_kernels import THREADS


@pytest.mark.parametrize("way", ["default", "fastest"])
def test_bare_map_against_the_ensemble_call_of_pynamicalsys(race, way):
    dynamical = pytest.importorskip("methods.dynamical")
    bare = dynamical.BareMap(THREADS)
    ratio = race(
        bare.ours,
        bare.theirs(way),
        work_subject=bare.impacts,
        work_reference=bare.their_impacts,
        settle=SETTLE,
    )
    assert ratio >= (100.0 if way == "default" else 40.0)
