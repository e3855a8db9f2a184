"""Shares against a parameter, of realizations, particles and replicas."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import binomtest

import vibrosweep as vs
from vibrosweep.analysis import share_against
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.figures import share_curves


def made(free, locked, amplitude):
    """A sweep of four particles that holds nothing but what shares need."""
    return xr.Dataset(
        {
            "collision_free": ("realization", np.asarray(free, np.int8)),
            "locked_count": ("realization", np.asarray(locked)),
        },
        coords={"amplitude": ("realization", np.asarray(amplitude, float))},
        attrs={"particles": 4},
    )


def test_shares_are_those_of_the_realizations_between_the_ends():
    random = np.random.default_rng(0)
    a, locked = random.uniform(0.5, 3.5, 400), random.integers(0, 5, 400)
    sweep = made(a > 2.0, locked, a)
    for of, values in (("collision_free", a > 2.0), ("locked", locked / 4.0)):
        found = share_against(sweep, "amplitude", of=of, bins=5)
        assert found.sizes["part"] == 5
        for one in (found.isel(part=k) for k in range(5)):
            low, high = float(one.amplitude_low), float(one.amplitude_high)
            own = (a >= low) & ((a < high) | (high == a.max()))
            assert float(one.share) == pytest.approx(values[own].mean())
            assert float(one.share_low) <= float(one.share) <= float(one.share_high)


def test_intervals_are_exact_and_each_value_of_a_grid_has_its_own():
    free = [1, 1, 0, -1, 0, 0, 0, 0, -1, -1]
    found = share_against(
        made(free, [0] * 10, [1.0] * 4 + [2.0] * 4 + [3.0] * 2), "amplitude", of="collision_free"
    )
    np.testing.assert_array_equal(found.amplitude_low, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(found.amplitude_high, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found.share, [2.0 / 3.0, 0.0, np.nan])
    for k, (held, tried) in enumerate([(2, 3), (0, 4)]):
        exact = binomtest(held, tried).proportion_ci(0.95, method="exact")
        ends = [float(found[f"share_{side}"][k]) for side in ("low", "high")]
        np.testing.assert_allclose(ends, [exact.low, exact.high], rtol=1e-9)


def test_regimes_of_a_grid_add_up_and_are_drawn():
    sweep = vs.sweep(
        restitution=[0.8, 0.9, 0.95], amplitude=[1.0, 2.0, 4.0, 7.0], particles=3, duration=60.0,
        separation=True, per_particle=True, regimes=True,
    )  # fmt: skip
    names = [regime.meaning for regime in vs.Regime]
    found = [share_against(sweep, "amplitude", of=name) for name in names]
    np.testing.assert_allclose(sum(one.share for one in found), 1.0)
    np.testing.assert_array_equal(found[0].amplitude_low, [1.0, 2.0, 4.0, 7.0])
    axes = share_curves(found, names)
    for line, one in zip(axes.lines, found, strict=True):
        np.testing.assert_array_equal(line.get_xdata(), one.amplitude_low)
        np.testing.assert_array_equal(line.get_ydata(), one.share)
    assert "$A$" in axes.get_xlabel()
    other = share_against(sweep, "restitution", of="locked")
    with pytest.raises(ParameterError, match=r"one parameter .*amplitude, restitution"):
        share_curves([found[0], other], ["a", "b"])
    with pytest.raises(ParameterError, match="labels: 1 of them for 2"):
        share_curves(found[:2], ["a"])
    with pytest.raises(DataError, match="result of share_against"):
        share_curves([sweep], ["a"])


def test_shares_of_windows_under_noise_are_those_of_the_replicas():
    windows = vs.windows(
        restitution=0.9, amplitude=[0.4, 0.6, 1.2], kick_noise=0.05, duration_periods=50.0,
        noise_replicas=20, tolerance=0.5,
    )  # fmt: skip
    found = share_against(windows, "amplitude", of="locked(1)")
    np.testing.assert_array_equal(found.share, windows.share.values.ravel())
    np.testing.assert_array_equal(found.amplitude_high, [0.4, 0.6, 1.2])
    assert found.share.values[0] == 0.0 < found.share.values[2]
    assert share_against(windows.isel(restitution=0), "amplitude", of="locked(1)").equals(found)
    with pytest.raises(ParameterError, match=r'of = .locked.*"locked\(1\)"'):
        share_against(windows, "amplitude", of="locked")
    with pytest.raises(ParameterError, match="must be amplitude"):
        share_against(windows, "restitution", of="locked(1)")
    with pytest.raises(DataError, match="one restitution"):
        share_against(windows.isel(restitution=[0, 0]), "amplitude", of="locked(1)")
    with pytest.raises(DataError, match="under noise"):
        share_against(windows.drop_vars("share"), "amplitude", of="locked(1)")


def test_what_a_sweep_does_not_know_is_named():
    sweep = made([1, 0], [4, 0], [1.0, 2.0])
    with pytest.raises(ParameterError, match=r"of = .chaos.: must be .*unsettled"):
        share_against(sweep, "amplitude", of="chaos")
    with pytest.raises(DataError, match=r"resting_count .*regimes = true"):
        share_against(sweep, "amplitude", of="resting")
    with pytest.raises(DataError, match="differ in amplitude"):
        share_against(sweep.isel(realization=[0]), "amplitude", of="locked")
    with pytest.raises(DataError, match="is not a dataset"):
        share_against("out.h5", "amplitude", of="locked")
