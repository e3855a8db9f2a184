"""Indices of sensitivity, and analyses over a base of finite mass."""

import numpy as np
import pytest
import xarray as xr

from tests.cases import each_of
from vibrosweep import sobol, sweep
from vibrosweep.analysis.records import moves, recoils
from vibrosweep.analysis.sensitivity import sobol_indices
from vibrosweep.errors import DataError, ParameterError, SpecError
from vibrosweep.model.forcing import INPUTS
from vibrosweep.scene.sweep import keyword_spec

# Sobol' indices of functions whose indices are known.

RANGES = {"restitution": (0.8, 0.98), "amplitude": (0.2, 3.5), "gravity": (9.0, 10.0)}


def indices(ranges=RANGES, outputs=("dt_min",), **keywords):
    return sobol_indices(keyword_spec({**ranges, **keywords}), outputs, 0.95, 1)


def test_intervals_hold_the_indices():
    found = indices(duration=3.0, outputs=["rebound_height_max"], realizations=512)
    for name in ("first_order", "total_order"):
        low, high = found[f"{name}_low"].values, found[f"{name}_high"].values
        assert np.all(low <= found[name].values + 1e-12)
        assert np.all(found[name].values <= high + 1e-12)
        assert 0.0 < high[0, 1] - low[0, 1] < 0.3


MOUNTED = {"base": "sprung", "particle_mass": 0.02, "mount_frequency": 0.7}


@pytest.mark.parametrize(
    ("ranges", "scene"),
    [
        ({"restitution": (0.5, 0.9), "base_acceleration": (0.5, 0.9)}, {"gravity": 5.0}),
        ({"base_displacement": (0.05, 0.1), "frequency": (1.0, 1.5)}, {"base": "moving"}),
        ({"base_mass": (1.0, 3.0), "mount_damping": (0, 1)}, MOUNTED),
    ],
    ids=["acceleration", "displacement", "masses"],
)
def test_any_forcing_and_masses_may_vary(ranges, scene):
    """The mean over the sample is that of a sweep over the same ranges."""
    found = indices(ranges, ["flight_time_mean"], realizations=256, duration=4.0, **scene)
    swept = sweep(**ranges, **scene, realizations=512, design="sobol", duration=4.0)
    mean = float(swept.flight_time_mean.mean())
    np.testing.assert_allclose(found["mean"], [mean], rtol=0.02)
    assert found.parameter.values.tolist() == [n for n in INPUTS if n in ranges]


def test_a_missing_parameter_of_the_mount_is_named():
    with pytest.raises(SpecError) as caught:
        indices({"base_mass": (1.0, 3.0)}, base="sprung", particle_mass=2.0, realizations=64)
    assert [mistake.key for mistake in caught.value.mistakes] == ["scene.mount_frequency"]


def test_indices_repeat_with_the_seed():
    given = {"outputs": ["rebound_height_max"], "duration": 3.0, "realizations": 64}
    runs = [indices(**given, seed=s) for s in (1, 1, 2)]
    xr.testing.assert_identical(runs[0], runs[1])
    assert not runs[0].equals(runs[2])


def test_indices_of_one_impact_follow_from_its_height():
    """Without excitation the first rebound is e^2 v0^2 / 2g high: a product of functions."""
    ranges = {"restitution": (0.5, 0.9), "launch_velocity": (4.0, 5.0)}
    zero = {"amplitude": (0.0, 1e-12)}
    found = indices(ranges | zero, ["rebound_height_max"], duration=1.1, realizations=1024)
    # mean of x^2 and of x^4 for x uniform in each range
    ((m1, s1), (m2, s2)) = (
        [(b**n - a**n) / n / (b - a) for n in (3, 5)] for a, b in ranges.values()
    )
    total = s1 * s2 - (m1 * m2) ** 2
    first = [(s1 - m1**2) * m2**2 / total, 0.0, m1**2 * (s2 - m2**2) / total]
    whole = [(s1 - m1**2) * s2 / total, 0.0, s1 * (s2 - m2**2) / total]
    np.testing.assert_allclose(found["first_order"][0], first, atol=0.02)
    np.testing.assert_allclose(found["total_order"][0], whole, atol=0.02)
    speed = 9.81 * 2  # mean height e^2 v0^2 / 2g
    np.testing.assert_allclose(found["mean"], [m1 * m2 / speed], rtol=1e-2)


def test_the_base_sample_is_a_power_of_2():
    with pytest.raises(ParameterError, match="power of 2"):
        indices(realizations=100)
    with pytest.raises(SpecError, match="ranges"):
        indices({"amplitude": 1.0}, realizations=64)


def test_outputs_must_be_measured_and_defined():
    with pytest.raises(ParameterError, match="height is not"):
        indices(outputs=["height"], realizations=2)
    with pytest.raises(DataError, match="undefined in 10 of 10"):
        indices(outputs=["rebound_height_max"], duration=0.1, launch=[0.0, 0.5], realizations=2)


COUPLED = {"base": "sprung", "mass_ratio": 0.01, "mount_frequency": 0.5}


@each_of(
    ("output", "options"),
    [
        # the impact budget runs out before it is known
        ("collision_free", {"launch": [0.0, 0.3], "impact_budget": 20}),
        ("dt_min_resolved", {"launch": [0.0, 0.3], "impact_budget": 20, "base": "moving"}),
        ("base_shared", {"launch": [0.0, 0.3], "impact_budget": 20, **COUPLED}),
        ("rebound_height_max", {"impact_budget": 3}),
        # no cycle is found, for which 0 is stored
        ("joint_cycle_impacts", {"launch": [0.0, 0.3], "duration": 3.0, **COUPLED}),
        ("joint_cycle_rests", {"launch": [0.0, 0.3], "duration": 3.0, **COUPLED}),
    ],
)
def test_codes_for_unknown_values_are_not_used_as_numbers(output, options):
    with pytest.raises(DataError, match=r"did not complete|is undefined in \d+ of"):
        sobol(
            restitution=(0.7, 0.95),
            amplitude=(0.3, 3.0),
            realizations=4,
            outputs=[output],
            **{"duration": 12.0} | options,
        )


@pytest.mark.parametrize("output", ["status", "joint_regime", "regime", "particle_impact_count"])
def test_codes_and_variables_of_particles_have_no_indices(output):
    ranges = {"restitution": (0.7, 0.95), "amplitude": (0.3, 3.0)}
    with pytest.raises(
        ParameterError, match=f"outputs: {output} (is a code|has a number for each)"
    ):
        sobol(
            **ranges, realizations=4, outputs=[output], duration=3.0, launch=[0.0, 0.3], **COUPLED
        )


# Bases that move, and those that recoil.

SPRUNG = xr.Dataset(attrs={"base": "sprung"})


def test_a_sprung_base_moves_and_recoils():
    assert moves(SPRUNG)
    assert recoils(SPRUNG)
    for base, moving in (("high-bounce", False), ("moving", True)):
        other = SPRUNG.assign_attrs(base=base)
        assert (moves(other), recoils(other)) == (moving, False)
