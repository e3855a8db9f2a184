"""Statistics of separations, and their decay inside a slot."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep import theory
from vibrosweep.analysis.separations import (
    compare_separations,
    separation_against,
    separation_distribution,
)
from vibrosweep.engine.measure import measure
from vibrosweep.errors import DataError, ParameterError


def made(dt, free, **coordinates):
    """A sweep that holds nothing but separations."""
    return xr.Dataset(
        {
            "dt_min": ("realization", np.asarray(dt, float)),
            "collision_free": ("realization", np.asarray(free, np.int8)),
        },
        coords={
            "duration": 12.0,
            **{name: ("realization", np.asarray(v, float)) for name, v in coordinates.items()},
        },
        attrs={"particles": 7},
    )


def test_distribution_is_that_of_the_values():
    found = separation_distribution(
        made([0.3, 0.0, np.nan, 0.1, 0.0, 0.2], [1, 0, -1, 1, 0, 1]), quantiles=[0.0, 0.5, 1.0]
    )
    assert int(found["known"]) == 5
    np.testing.assert_array_equal(found["separation"], [0.0, 0.0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(found["cumulative_fraction"], [0.2, 0.4, 0.6, 0.8, 1.0])
    np.testing.assert_array_equal(found["separation_quantile"], [0.0, 0.1, 0.3])
    assert float(found["zero_fraction"]) == 0.4
    assert float(found["collision_free_fraction"]) == 0.6
    # Wilson: (p + z^2 / 2n -+ z sqrt(p q / n + z^2 / 4n^2)) / (1 + z^2 / n), z = 1.959964
    np.testing.assert_allclose(found["collision_free_low"], 0.2307, atol=1e-4)
    np.testing.assert_allclose(found["collision_free_high"], 0.8824, atol=1e-4)


def test_bins_hold_the_realizations_between_their_ends():
    random = np.random.default_rng(0)
    e, dt = random.uniform(0.8, 0.98, 400), random.uniform(0, 1, 400)
    found = separation_against(made(dt, dt > 0.5, restitution=e), "restitution", bins=5)
    np.testing.assert_array_equal(found["known"], [80] * 5)
    for part in range(5):
        low, high = (float(found[f"restitution_{end}"][part]) for end in ("low", "high"))
        own = (e >= low) & ((e <= high) if part == 4 else (e < high))
        assert float(found["collision_free_fraction"][part]) == np.mean(dt[own] > 0.5)


def test_sweeps_are_compared_by_particles_and_duration():
    found = compare_separations([made([0.1], [1]), made([0.0], [0]).assign_attrs(particles=9)])
    np.testing.assert_array_equal(found["particles"], [7, 9])
    np.testing.assert_array_equal(found["duration"], [12.0, 12.0])
    np.testing.assert_array_equal(found["collision_free_fraction"], [1.0, 0.0])


def test_mistakes_are_named():
    with pytest.raises(DataError, match=r"dt_min .*separation = true in the \[measure\]"):
        separation_distribution(made([0.1], [1]).drop_vars("dt_min"))
    with pytest.raises(ParameterError, match="measure = 'gap'"):
        separation_distribution(made([0.1], [1]), measure="gap")
    for quantiles in ([2.0], 0.5, "half", [float("nan")]):
        with pytest.raises(ParameterError, match=r"^quantiles = "):
            separation_distribution(made([0.1], [1]), quantiles=quantiles)
    with pytest.raises(DataError, match="differ in restitution"):
        separation_against(made([0.1, 0.2], [1, 1], restitution=[0.9, 0.9]), "restitution")


def test_measured_separation_decays_at_the_rate_of_the_multiplier(parameters, observe, workers):
    # dt_min of two particles in one slot, in later and later windows of the same length; the
    # multipliers are real here: with complex ones the separation oscillates while it decays, and
    # the smallest of a few does not follow the rate closely
    amplitude = 0.993 * float(theory.amplitude_max(1, 0.5))
    phase = float(theory.locked_phase(1, 0.5, amplitude))
    multipliers = theory.multipliers(1, 0.5, amplitude)
    assert np.all(multipliers.imag == 0.0)
    begins = np.arange(50.0, 250.0, 10.0)
    scene = parameters(launch_velocity=4.905, amplitude=amplitude, restitution=0.5)
    dt = [
        measure(
            scene,
            observe((phase, phase + 1e-3), duration=t + 10.0, transient=t, separation=True),
            workers,
        )["dt_min"][0]
        for t in begins
    ]
    slope = np.polyfit(begins, np.log(dt), 1)[0]
    assert dt[0] > 1e3 * dt[-1] > 0.0
    np.testing.assert_allclose(slope, np.log(np.abs(multipliers).max()), rtol=0.01)
