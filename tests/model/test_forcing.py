"""The four ways to give the forcing are one quantity."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.errors import ParameterError
from vibrosweep.kernels.impact import KIND_OF
from vibrosweep.kernels.restitution import REBOUND_OF
from vibrosweep.model.forcing import (
    FORCINGS,
    INPUTS,
    completed,
    differing,
    forcing_of,
    refuse_extreme,
)
from vibrosweep.model.parameters import (
    BASES,
    LAWS,
    LAWS_OF,
    NOISE,
    OF_MOUNT,
    OF_RESTITUTION,
    PARAMETERS,
)

TABLE_1 = {name: np.array([p.default]) for name, p in PARAMETERS.items()}
OTHERS = {name: values for name, values in TABLE_1.items() if name != "amplitude"}
VALUES = st.floats(1e-3, 1e3)


def test_the_base_of_table_1():
    found = completed(TABLE_1)
    assert found["base_acceleration"].item() == pytest.approx(
        2 * math.pi * 1.2 / (1.9 * 9.81), rel=1e-15
    )
    for name, value in (("base_velocity", 1.2 / 1.9), ("base_displacement", 0.6 / 1.9 / math.pi)):
        again = completed(OTHERS | {name: np.array([value])})
        assert again["amplitude"].item() == pytest.approx(1.2, rel=1e-15)


@given(e=st.floats(0.0, 1.0), f=VALUES, g=VALUES, v=VALUES)
def test_all_ways_lead_to_one_amplitude(e, f, g, v):
    omega = 2.0 * math.pi * f
    ways = {
        "amplitude": (1.0 + e) * v,
        "base_velocity": v,
        "base_displacement": v / omega,
        "base_acceleration": omega * v / g,
    }
    assert ways.keys() == FORCINGS.keys()
    own = OTHERS | {
        n: np.array([x])
        for n, x in zip(("restitution", "frequency", "gravity"), (e, f, g), strict=True)
    }
    for name, value in ways.items():
        found = completed(own | {name: np.array([value])})
        assert found[name].item() == value  # to the bit
        assert found["amplitude"].item() == pytest.approx(ways["amplitude"], rel=1e-15)
        assert found["base_acceleration"].item() == pytest.approx(
            ways["base_acceleration"], rel=2e-15
        )
        assert [*found] == [n for n in INPUTS if n in found]


@pytest.mark.parametrize("forcing", FORCINGS)
@pytest.mark.parametrize("varied", [name for name in INPUTS if name not in OF_MOUNT])
def test_only_quantities_that_follow_from_the_varied_input_differ(forcing, varied):
    if varied in FORCINGS and varied != forcing:
        return
    own = OTHERS | dict.fromkeys((*OF_RESTITUTION, *NOISE), np.array([0.4]))
    own |= {forcing: np.array([0.7])}
    one, other = completed(own), completed(own | {varied: np.array([0.5])})
    changed = {name for name in one if one[name] != other[name]}
    assert changed == {*differing([varied], forcing)}


@pytest.mark.parametrize("first", FORCINGS)
@pytest.mark.parametrize("second", FORCINGS)
def test_two_forcings_are_refused(first, second):
    if first == second:
        assert forcing_of(["phase", first]) == first
        return
    with pytest.raises(ParameterError) as caught:
        forcing_of([first, second])
    assert first in str(caught.value)
    assert second in str(caught.value)


def test_the_default_forcing_is_the_amplitude():
    assert forcing_of(["restitution"]) == "amplitude"


@pytest.mark.parametrize("forcing", FORCINGS)
def test_no_extreme_overflows_and_too_large_amplitudes_are_refused(forcing):
    ends = {n: (INPUTS[n].low, INPUTS[n].high) for n in (*PARAMETERS, forcing)}
    for which in np.ndindex(*(2,) * 4):
        names = ("restitution", "frequency", "gravity", forcing)
        own = OTHERS | {n: np.array([ends[n][k]]) for n, k in zip(names, which, strict=True)}
        found = completed(own)
        assert all(np.isfinite(values).all() for values in found.values())
        if PARAMETERS["amplitude"].accepts(found["amplitude"]).all():
            refuse_extreme(found, forcing, "constant")
        else:
            assert forcing in ("base_displacement", "base_acceleration")
            with pytest.raises(ParameterError, match=f"{forcing}: makes an amplitude"):
                refuse_extreme(found, forcing, "constant")


def test_the_laws_of_all_bases_are_those_of_the_kernels():
    assert set(KIND_OF) < set(BASES) == set(LAWS_OF)
    assert set(LAWS) == set(REBOUND_OF)
