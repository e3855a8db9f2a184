"""Fixed orbits from Newton's method on the map against their closed forms."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from vibrosweep import theory
from vibrosweep.kernels.fixed import ABSENT, ATTRACTS, REPELS, empty_fixed, find_fixed
from vibrosweep.kernels.impact import base_of
from vibrosweep.model.parameters import PARAMETERS, dimensionless

UNITS = {"frequency": 1.0, "gravity": 2.0}  # an amplitude is then its kick


def solved(e, a, k, r=1e-4, sign=1.0):
    e, a, k, r = (np.array(v) for v in np.broadcast_arrays(e, a, k, r))
    given = {name: np.full(e.size, p.default) for name, p in PARAMETERS.items()}
    given |= {name: np.full(e.size, value) for name, value in UNITS.items()}
    given |= {"restitution": e.astype(float), "amplitude": a.astype(float), "contact_time": r}
    found, base = empty_fixed(e.size), base_of("high-bounce", "rest" if sign > 0.0 else "reflect")
    find_fixed(0, e.size, base, dimensionless(given, 1.0), k, sign, found)
    return found


@pytest.mark.parametrize("k", [1, 2, 3, 4])
@pytest.mark.parametrize("e", [0.0, 0.3, 0.7, 0.9, 0.99])
def test_states_change_at_the_edges_of_the_closed_forms(k, e):
    near = np.array([-1e-3, -1e-9, -1e-12, 1e-12, 1e-9])
    lower = float(theory.amplitude_min(k, e, **UNITS)) * (1.0 + near)
    upper = float(theory.amplitude_max(k, e, **UNITS)) * (1.0 + near)
    assert solved(e, lower, k).state.tolist() == [ABSENT] * 3 + [ATTRACTS] * 2
    assert solved(e, upper, k).state.tolist() == [ATTRACTS] * 3 + [REPELS] * 2


@pytest.mark.parametrize("k", [1, 3])
def test_the_phase_is_the_closed_form(k):
    e = np.linspace(0.3, 0.99, 40)
    low, high = theory.amplitude_min(k, e, **UNITS), theory.amplitude_max(k, e, **UNITS)
    a = low + 0.4 * (high - low)
    assert solved(e, a, k).phase == pytest.approx(theory.locked_phase(k, e, a, **UNITS), abs=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_orbit_attracts_where_its_jacobian_contracts(sign):
    random = np.random.default_rng(4)
    e, a, k = random.uniform(0.0, 1.0, 400), random.uniform(0.0, 3.0, 400), 1
    found = solved(e, a, k, sign=sign)
    assert np.array_equal(found.state == ABSENT, a < (1.0 - sign * e) * k)
    slope = 2.0 * np.pi * a * np.cos(2.0 * np.pi * found.phase)
    for state, s, one in zip(found.state, slope, e, strict=True):
        if state != ABSENT:
            jacobian = np.array([[1.0, 1.0], [sign * s, sign * (one + s)]])
            assert (np.abs(np.linalg.eigvals(jacobian)).max() < 1.0) == (state == ATTRACTS)
    assert set(found.state.tolist()) == {ABSENT, ATTRACTS, REPELS}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_nothing_attracts_where_no_energy_is_lost(sign):
    a = np.linspace(0.0, 5.0, 20_001)
    assert ATTRACTS not in solved(1.0, a, 1, sign=sign).state


def test_an_orbit_with_flights_no_longer_than_a_contact_does_not_exist():
    assert solved(0.9, 0.3, 1, r=np.array([0.9, 1.0, 2.0])).state.tolist() == [
        ATTRACTS,
        ABSENT,
        ABSENT,
    ]


def test_plain_python_gives_the_bits_of_the_machine_code():
    script = """
import json, numpy as np
from vibrosweep.kernels.fixed import empty_fixed, find_fixed
from vibrosweep.kernels.impact import base_of
from vibrosweep.model.parameters import PARAMETERS, dimensionless
given = {name: np.full(3, p.default) for name, p in PARAMETERS.items()}
given["restitution"], given["gravity"] = np.array([0.9, 0.5, 0.3]), np.full(3, 2.0)
given["amplitude"] = np.array([0.3, 0.2, 0.75])
problem = dimensionless(given, 1.0)
for kind in (("high-bounce", "rest"), ("high-bounce", "reflect"), ("moving", "rest")):
    for sign in (1.0, -1.0):
        found = empty_fixed(3)
        find_fixed(0, 3, base_of(*kind), problem, np.ones(3, int), sign, found)
        print(json.dumps([found.state.tolist(), found.phase.tolist()]))
"""
    outputs = [
        subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_DISABLE_JIT": off},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for off in ("0", "1")
    ]
    assert outputs[0] == outputs[1]
    lines = [json.loads(line)[0] for line in outputs[0].splitlines()]
    assert len(lines) == 6
    assert lines[0] == lines[4] == [ATTRACTS, ABSENT, ATTRACTS]
