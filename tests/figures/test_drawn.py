"""Every figure shows the numbers of its dataset: positions, extents and colours, at random."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgba

import vibrosweep as vs
from tests.cases import each_of
from tests.figures.drawn import (
    bars,
    colour_at,
    curves,
    drawn,
    legend,
    marked,
    meshes,
    near,
    scale,
    scattered,
)
from vibrosweep import figures
from vibrosweep.errors import DataError

SEEDS = range(4)
PLAIN = {"phase": 0.0, "gravity": 9.81, "contact_time": 1e-4, "frequency": 1.0}
UNITS = {"restitution": "1", "amplitude": "m s-1"}


@pytest.fixture(params=SEEDS)
def random(request):
    return np.random.default_rng(request.param)


def shuffled(dataset, random):
    """The dataset with the values along each of its dims in another order."""
    order = {d: random.permutation(n) for d, n in dataset.sizes.items() if d in dataset.indexes}
    return dataset.isel(order)


# ---------------------------------------------------------------------------------- sweeps


def random_sweep(make_sweep, random, **changed):
    """A sweep in which some realizations did not complete, and some have no value."""
    count = 40
    sweep = make_sweep(count, 2, int(random.integers(99)), duration=3.0, **changed)
    sweep["status"].values[random.choice(count, 6)] = random.integers(1, 4, 6)
    for name in ("dt_min", "rebound_height_max"):
        sweep[name].values[random.choice(count, 4)] = np.nan
    return sweep.isel(realization=random.permutation(count))


def on_kicks(random):
    """Parameters whose kicks 2 f A / g differ although the amplitudes are equal."""
    return {
        "frequency": random.choice([8.0, 12.5, 35.0], 40),
        "amplitude": random.uniform(0.1, 0.2, 40),
        "launch_velocity": 0.3,
    }


@each_of("several", [False, True])
@each_of("name", ["dt_min", "rebound_height_max", "impact_count", "status"])
def test_dots_of_a_plane(name, several, random, make_sweep):
    sweep = random_sweep(make_sweep, random, **(on_kicks(random) if several else {}))
    plot, *bar = drawn(figures.parameter_plane, sweep, name)
    height = 2.0 * sweep.frequency * sweep.amplitude / sweep.gravity if several else sweep.amplitude
    values = sweep[name].values.astype(float)
    if name != "status":
        values[sweep.status.values != 0] = np.nan
    names = legend(plot)
    if name == "status":
        words = sweep[name].attrs["flag_meanings"].split()
        colours = [names[words[int(code)].replace("_", " ")] for code in values]
    else:
        of_number = scale(bar[0])
        colours = [names["no value"] if np.isnan(v) else of_number(v) for v in values]
        if name == "dt_min":
            together = names.get("landing or resting together")
            colours = [together if v == 0.0 else c for v, c in zip(values, colours, strict=True)]
    near(scattered(plot), list(zip(sweep.restitution.values, height.values, colours, strict=True)))


def test_cells_of_a_plane(random, make_sweep):
    e, a = np.sort(random.uniform(0.5, 0.95, 5)), np.sort(random.uniform(0.2, 3.0, 4))
    x, y = (axis.ravel() for axis in np.meshgrid(np.tile(e, 2), a))
    sweep = random_sweep(make_sweep, random, restitution=x, amplitude=y)
    plot, bar = drawn(figures.parameter_plane, sweep, "rebound_height_max")
    of_number, nothing = scale(bar), legend(plot).get("no value")
    height = sweep.rebound_height_max.where(sweep.status == 0).values
    for at_e in e:
        for at_a in a:
            here = (sweep.restitution.values == at_e) & (sweep.amplitude.values == at_a)
            known = np.sort(height[here & np.isfinite(height)])
            expected = of_number(known[(known.size - 1) // 2]) if known.size else nothing
            assert colour_at(plot, at_e, at_a) == expected


def test_kicks_that_differ_by_rounding_are_one_row(make_sweep):
    f = np.array([1.0, 3.0, 7.0, 11.0])
    e, kick, at = (axis.ravel() for axis in np.meshgrid([0.8, 0.9], [0.1, 0.3, 0.7], f))
    launches = {"launch_velocity": 0.3, "duration": 1.0}
    sweep = make_sweep(24, 2, restitution=e, amplitude=kick / at, frequency=at, **launches)
    products = np.unique(2.0 * sweep.frequency.values * sweep.amplitude.values / 9.81)
    assert products.size > 3  # in binary
    (mesh, *_) = meshes(drawn(figures.parameter_plane, sweep, "rebound_height_max")[0])
    assert np.shape(mesh.get_array()) == (3, 2)
    equal = kick == 0.1
    with pytest.raises(DataError, match="differ in amplitude"):
        drawn(figures.parameter_plane, sweep.isel(realization=equal), "rebound_height_max")
    assert len(drawn(figures.height_against_restitution, sweep.isel(realization=equal))) == 1


@each_of("several", [False, True])
def test_dots_of_heights(several, random, make_sweep):
    sweep = random_sweep(make_sweep, random, **(on_kicks(random) if several else {}))
    sweep["rebound_height_max"] -= 1.0
    plot, bar = drawn(figures.height_against_restitution, sweep.assign_attrs(base="moving"))
    unit = sweep.gravity / (8.0 * sweep.frequency**2) if several else 1.0
    forcing = (
        2.0 * sweep.frequency * sweep.amplitude / sweep.gravity if several else sweep.amplitude
    )
    rebound, flight = sweep.rebound_height_max / unit, sweep.flight_height_max / unit
    done = (sweep.status == 0).values
    known = done & np.isfinite(rebound.values)
    higher = done & ~(flight <= rebound).values
    colours = [scale(bar)(v) for v in forcing.values[known]]
    rows = list(zip(sweep.restitution.values[known], rebound.values[known], colours, strict=True))
    grey = to_rgba(figures.style.GREY)
    at = zip(sweep.restitution.values[higher], flight.values[higher], strict=True)
    near(scattered(plot), rows + [(*one, grey) for one in at])
    assert f"{int((~done).sum())} of 40 realizations did not complete" in (
        plot.get_legend().get_title().get_text().replace("\n", " ")
    )


@pytest.mark.parametrize("drop", [0.0, 20.0])
def test_many_heights_are_all_counted(drop, synthetic_sweep):
    sweep = synthetic_sweep(20_001)
    sweep["rebound_height_max"] -= drop
    sweep["status"] = ("realization", (np.arange(20_001) % 50 == 7).astype(np.int8))
    plot, _ = drawn(figures.height_against_restitution, sweep.assign_attrs(base="moving"))
    (mesh,) = meshes(plot)
    kept = sweep.isel(realization=sweep.status.values == 0)
    across, up = mesh.get_coordinates()[0, :, 0], mesh.get_coordinates()[:, 0, 1]
    counts, _, _ = np.histogram2d(kept.rebound_height_max, kept.restitution, (up, across))
    np.testing.assert_array_equal(mesh.get_array().filled(0.0), counts)
    assert counts.sum() == kept.sizes["realization"]


# ----------------------------------------------------------------------------- separations


def step_at(curve, x):
    """Value of a curve of steps just right of an x."""
    return curve[1][np.searchsorted(curve[0], x, side="right") - 1]


def test_distributions_of_separations(random):
    parts = [10.0 ** random.uniform(-7.0, 1.0, n) for n in (30, 7)]
    sweeps = [
        xr.Dataset(
            {
                "dt_min": ("realization", part),
                "collision_free": ("realization", np.ones(part.size, np.int8)),
                "status": ("realization", (np.arange(part.size) % 5 == 2).astype(np.int8)),
            },
            coords={"duration": 12.0},
        )
        for part in parts
    ]
    found = [vs.separations(one) for one in sweeps]
    (plot,) = drawn(figures.separation_distributions, found, ["a", "b"], [1e-4, 1e-5])
    steps = [one for one in curves(plot) if one[2] in (legend(plot)["a"], legend(plot)["b"])]
    for (x, y, *_), part in zip(steps, parts, strict=True):
        assert np.all(np.diff(x) >= 0.0)
        assert x[-1] <= plot.get_xlim()[1]
        done = part[np.arange(part.size) % 5 != 2]
        for at in 10.0 ** random.uniform(np.log10(x[0]), 1.0, 20):
            assert step_at((x, y), at) == pytest.approx(np.mean(done <= at), abs=1e-15)
    (band,) = bars(plot)
    assert band[:2] == pytest.approx((1e-5, 1e-4), rel=1e-12)
    (line,) = [
        c
        for c in curves(drawn(figures.separation_distributions, found, "ab", 1e-4)[0])
        if c[2] == (0.0, 0.0, 0.0, 1.0)
    ]
    assert set(line[0]) == {1e-4}


def test_separations_below_the_axis_are_bars_that_say_so(random):
    edge, shares = 1e-9, []
    found = []
    for n in (30, 7):
        gap = 10.0 ** random.uniform(-11.0, -1.0, n)
        gap[: n // 3] = 0.0
        shares.append(np.mean(gap < edge))
        whole = ("realization", np.ones(n, np.int8))
        sweep = {"dt_min": ("realization", gap), "collision_free": whole}
        found.append(vs.separations(xr.Dataset(sweep, coords={"duration": 12.0})))
    (plot,) = drawn(figures.separation_distributions, found, ["a", "b"], 1e-4)
    below = bars(plot)
    assert [top for *_, top, _ in below] == pytest.approx(shares)
    assert [c[:3] for *_, c in below] == [legend(plot)[name][:3] for name in "ab"]
    begin = plot.get_xlim()[0]
    least = min(one.separation.values[one.separation.values >= edge].min() for one in found)
    assert begin < below[-1][1] <= least * (1.0 + 1e-12)
    assert any(text.get_text().startswith("below $10^{-") for text in plot.texts)


def test_distributions_over_chance(random):
    ratio = 10.0 ** random.uniform(-2.0, 2.0, 25)
    ratio[random.choice(25, 5)] = np.nan
    found = xr.Dataset({"dt_min_over_chance": ("realization", ratio)})
    (plot,) = drawn(figures.separations_over_chance, [found], ["sweep"])
    steps, _ = curves(plot)
    known = ratio[np.isfinite(ratio)]
    for at in 10.0 ** random.uniform(-2.0, 2.0, 20):
        assert step_at(steps, at) == pytest.approx(np.mean(known <= at), abs=1e-15)


def test_shares_against_a_parameter(random):
    edges = np.sort(random.uniform(0.1, 3.0, 6))
    shares = np.sort(random.random((2, 3, 5)), axis=1)
    ends = {"amplitude_low": ("part", edges[:-1]), "amplitude_high": ("part", edges[1:])}
    names = ("share_low", "share", "share_high")
    found = [
        xr.Dataset({n: ("part", one[k]) for k, n in enumerate(names)}, coords=ends)
        for one in shares
    ]
    (plot,) = drawn(figures.share_curves, found, ["a", "b"])
    middle = (edges[:-1] + edges[1:]) / 2.0
    expected = [
        (x, y, legend(plot)[name], True)
        for name, one in zip("ab", shares, strict=True)
        for x, y in zip(middle, one[1], strict=True)
    ]
    near(marked(plot), expected)
