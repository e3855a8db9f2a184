"""What is drawn, where it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgba

import vibrosweep as vs
from tests.figures.drawn import (
    bars,
    colour_at,
    curves,
    drawn,
    layers,
    legend,
    marked,
    meshes,
    near,
    scale,
    scattered,
    segments,
)
from vibrosweep import figures
from vibrosweep.analysis.basins import name_of
from vibrosweep.analysis.branches import EVENTS
from vibrosweep.analysis.orbits import cycle_name
from vibrosweep.errors import DataError
from vibrosweep.figures.orbits import KINDS, TIES

# Every figure shows the numbers of its dataset: positions, extents and colours, at random.

SEEDS = range(4)
PLAIN = {"phase": 0.0, "gravity": 9.81, "contact_time": 1e-4, "frequency": 1.0}
UNITS = {"restitution": "1", "amplitude": "m s-1"}


@pytest.fixture(params=SEEDS)
def random_drawn(request):
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


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize("name", ["dt_min", "rebound_height_max", "impact_count", "status"])
def test_dots_of_a_plane(name, several, random_drawn, make_sweep):
    sweep = random_sweep(make_sweep, random_drawn, **(on_kicks(random_drawn) if several else {}))
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


def test_cells_of_a_plane(random_drawn, make_sweep):
    e, a = np.sort(random_drawn.uniform(0.5, 0.95, 5)), np.sort(random_drawn.uniform(0.2, 3.0, 4))
    x, y = (axis.ravel() for axis in np.meshgrid(np.tile(e, 2), a))
    sweep = random_sweep(make_sweep, random_drawn, restitution=x, amplitude=y)
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


@pytest.mark.parametrize("several", [False, True])
def test_dots_of_heights(several, random_drawn, make_sweep):
    sweep = random_sweep(make_sweep, random_drawn, **(on_kicks(random_drawn) if several else {}))
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


def test_distributions_of_separations(random_drawn):
    parts = [10.0 ** random_drawn.uniform(-7.0, 1.0, n) for n in (30, 7)]
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
        for at in 10.0 ** random_drawn.uniform(-8.0, 1.0, 20):
            assert step_at((x, y), at) == pytest.approx(np.mean(done <= at), abs=1e-15)
    (band,) = bars(plot)
    assert band[:2] == pytest.approx((1e-5, 1e-4), rel=1e-12)
    (line,) = [
        c
        for c in curves(drawn(figures.separation_distributions, found, "ab", 1e-4)[0])
        if c[2] == (0.0, 0.0, 0.0, 1.0)
    ]
    assert set(line[0]) == {1e-4}


def test_distributions_over_chance(random_drawn):
    ratio = 10.0 ** random_drawn.uniform(-2.0, 2.0, 25)
    ratio[random_drawn.choice(25, 5)] = np.nan
    found = xr.Dataset({"dt_min_over_chance": ("realization", ratio)})
    (plot,) = drawn(figures.separations_over_chance, [found], ["sweep"])
    steps, _ = curves(plot)
    known = ratio[np.isfinite(ratio)]
    for at in 10.0 ** random_drawn.uniform(-2.0, 2.0, 20):
        assert step_at(steps, at) == pytest.approx(np.mean(known <= at), abs=1e-15)


# Figures of orbits, basins, windows and indices show the numbers of their datasets, at random.

BLACK, WHITE = to_rgba("black"), to_rgba("white")
NOT_DRAWN = {"available", "save_all"}


@pytest.fixture(params=range(4))
def random_drawn_orbits(request):
    return np.random.default_rng(request.param)


def scene(**changed):
    return {name: ((), value) for name, value in (PLAIN | changed).items()}


def axis(random, count):
    """Values of an axis in any order."""
    return random.permutation(np.unique(random.uniform(0.1, 0.9, count)))


def random_orbits(random, **axes):
    """Up to five orbits of up to three impacts at each point of the axes."""
    shape = (*(values.size for values in axes.values()), 5)
    p, q = random.integers(0, 4, shape), random.integers(1, 3, shape)
    missing = np.arange(3) >= p[..., np.newaxis]
    dims, given = (*axes, "orbit"), {**scene(restitution=0.8, amplitude=1.2)}
    numbers = {
        name: ((*dims, "impact"), np.where(missing, np.nan, random.uniform(low, high, (*shape, 3))))
        for name, low, high in (("impact_phase", -0.5, 0.5), ("rebound_velocity", 1.0, 9.0))
    }
    codes = {
        "stable": (dims, np.where(p, random.integers(0, 2, shape), -1)),
        "admissible": (dims, np.where(p, random.integers(0, 2, shape), -2)),
        "cycle_impacts": (dims, p),
        "cycle_periods": (dims, np.where(p, q, 0)),
    }
    return xr.Dataset(numbers | codes, coords=given | {n: ((n,), v) for n, v in axes.items()})


@pytest.mark.parametrize("sizes", [(6, 5), (1, 4), (3, 1), (1, 1)])
def test_numbers_of_stable_orbits(sizes, random_drawn_orbits):
    e, a = (axis(random_drawn_orbits, size) for size in sizes)
    found = random_orbits(random_drawn_orbits, restitution=e, amplitude=a)
    plot, bar = drawn(figures.periodic_orbits, found)
    stable = ((found.stable == 1) & (found.admissible == 1)).sum("orbit")
    for at_e in e:
        for at_a in a:
            expected = scale(bar)(int(stable.sel(restitution=at_e, amplitude=at_a)))
            assert colour_at(plot, at_e, at_a) == expected
    low, high = plot.get_xlim()
    assert np.all((low < e) & (e < high))


def test_orbits_along_an_axis_and_at_one_point(random_drawn_orbits):
    line = random_orbits(random_drawn_orbits, amplitude=axis(random_drawn_orbits, 7))
    for found, along in ((line, "amplitude"), (line.isel(amplitude=2), "impact_phase")):
        (plot,) = drawn(figures.periodic_orbits, found)
        names, expected = legend(plot), []
        table = found.to_dataframe().reset_index()
        for one in table[(table.admissible == 1) & table.impact_phase.notna()].itertuples():
            colour = names[cycle_name(one.cycle_impacts, one.cycle_periods)]
            expected.append((getattr(one, along), one.rebound_velocity, colour, one.stable == 1))
        near(marked(plot), expected)


def random_basins(random, times=9, attractors=12):
    """Launches in any order, which lead to more attractors than the legend names."""
    at, v = np.linspace(0.0, 1.0, times, endpoint=False), axis(random, 6)
    codes = random.integers(-1, attractors, (v.size, times))
    shares = [np.mean(codes == i) for i in range(attractors)]
    numbers = {
        "basin": (("launch_velocity", "launch_time"), codes),
        "fraction": ("attractor", shares),
        "regime": ("attractor", random.integers(1, 3, attractors).astype(np.int8)),
        "cycle_impacts": ("attractor", np.arange(attractors) + 1),
        "cycle_periods": ("attractor", random.integers(1, 4, attractors)),
    }
    coords = {"launch_time": at, "launch_velocity": v, **scene(restitution=0.8, amplitude=1.2)}
    order = random.permutation(times)
    return xr.Dataset(numbers, coords=coords).isel(launch_time=order)


@pytest.mark.parametrize(("times", "attractors"), [(9, 12), (9, 3), (1, 2)])
def test_basins(times, attractors, random_drawn_orbits):
    basins = random_basins(random_drawn_orbits, times, attractors)
    (plot,) = drawn(figures.basins_of_attraction, basins)
    names = {text.rsplit(",", 1)[0]: colour for text, colour in legend(plot).items()}
    for t in basins.launch_time.values:
        for v in basins.launch_velocity.values:
            code = int(basins.basin.sel(launch_time=t, launch_velocity=v))
            name = "unsettled" if code < 0 else name_of(basins.isel(attractor=code))
            expected = names.get(name) or names["5 others"]
            assert colour_at(plot, t, v) == expected


def test_orbits_over_basins_lie_at_the_times_of_their_phases(random_drawn_orbits):
    shift = {"phase": 2.0, "frequency": 2.5}
    basins = random_basins(random_drawn_orbits).assign_coords(shift)
    basins["launch_time"] = basins.launch_time / 2.5
    orbits = random_orbits(random_drawn_orbits).assign_coords(frequency=2.5)  # of another phase
    (plot,) = drawn(figures.periodic_orbits, orbits, basins=basins)
    (edges,) = (mesh.get_coordinates()[0, :, 0] for mesh in meshes(plot))
    seen = [row for row in marked(plot) if row[0] >= edges[0]]
    table = orbits.to_dataframe().reset_index()
    table = table[(table.admissible == 1) & table.impact_phase.notna()]
    assert len(seen) == len(table)
    at = {round(y, 12): (x, edge) for x, y, edge, _ in seen}
    for one in table.itertuples():
        x, edge = at[round(one.rebound_velocity, 12)]
        assert edges[0] <= x <= edges[-1]
        turns = 2.5 * x + 2.0 / (2.0 * np.pi) - one.impact_phase
        assert abs(turns - np.rint(turns)) < 1e-12
        assert edge == (WHITE if one.stable == 1 else BLACK)


CONTRADICTIONS = [
    ("frequency", 2.0),
    ("gravity", 1.6),
    ("contact_time", 1e-2),
    ("base", "moving"),
    ("rebound", "reflect"),
    ("waveform", "square"),
    ("restitution_law", "plastic"),
]


def changed(dataset, name, value):
    named = dataset.assign_attrs if name in ("base", "rebound", "waveform") else dataset.assign
    named = dataset.assign_attrs if name == "restitution_law" else named
    return named({name: value})


@pytest.mark.parametrize(
    ("name", "value"), [*CONTRADICTIONS, ("amplitude", 1.3), ("restitution", 0.9)]
)
def test_orbits_that_contradict_the_basins_under_them_are_refused(name, value):
    random = np.random.default_rng(0)
    basins, orbits = random_basins(random), random_orbits(random)
    with pytest.raises(DataError, match=f"periodic_orbits cannot draw {name} = .* picture of"):
        drawn(figures.periodic_orbits, changed(orbits, name, value), basins=basins)


def random_shares(random, count):
    at = axis(random, count)
    shares = random.dirichlet(np.ones(4), at.size)[:, :3].T
    numbers = {
        "fraction": (("attractor", "amplitude"), shares),
        "basin": (("amplitude", "launch_velocity"), np.full((at.size, 2), -1)),
        "cycle_impacts": ("attractor", [1, 2, 3]),
        **{n: ("attractor", [1, 2, 2]) for n in ("regime", "cycle_periods")},
    }
    coords = {"amplitude": at, "launch_velocity": [3.0, 4.0], **scene(restitution=0.8)}
    return xr.Dataset(numbers, coords=coords, attrs={"along": "amplitude"})


@pytest.mark.parametrize("count", [6, 1])
def test_shares_are_as_thick_as_they_are_large(count, random_drawn_orbits):
    basins = random_shares(random_drawn_orbits, count)
    (plot,) = drawn(figures.basin_shares, basins)
    low, high = plot.get_xlim()
    for i, at in enumerate(basins.amplitude.values):
        assert low <= at <= high
        stack = layers(plot, low if count == 1 else at)
        below = 0.0
        for k, (bottom, top, colour) in enumerate(stack):
            assert bottom == pytest.approx(below, abs=1e-12)
            below += float(basins.fraction[k, i])
            assert top == pytest.approx(below, abs=1e-12)
            assert colour == legend(plot)[name_of(basins.isel(attractor=k))]


def test_a_bifurcation_diagram(random_drawn_orbits):
    at = axis(random_drawn_orbits, 5)
    dims, shape = ("direction", "amplitude", "particle"), (2, at.size, 3)
    exponent = random_drawn_orbits.normal(size=shape)
    exponent.flat[random_drawn_orbits.choice(exponent.size, 5)] = np.nan
    exponent.flat[random_drawn_orbits.choice(exponent.size, 4)] = -np.inf
    speed = random_drawn_orbits.uniform(1.0, 5.0, (*shape, 4))
    speed.flat[random_drawn_orbits.choice(speed.size, 9)] = np.nan
    numbers = {
        "lyapunov_largest": (dims, exponent),
        "rebound_velocity": ((*dims, "sample"), speed),
        "regime": (dims, np.full(shape, 3, np.int8)),
    }
    coords = {"amplitude": at, "direction": ["up", "down"], **scene(restitution=0.8)}
    attrs = {"observable": "rebound_velocity", "forcing": "amplitude"}
    diagram = xr.Dataset(numbers, coords=coords, attrs=attrs).isel(direction=[1, 0])
    upper, lower = drawn(figures.bifurcation_diagram, diagram)
    floor = lower.get_ylim()[0]
    names, expected, exponents = legend(upper), [], []
    for direction in ("up", "down"):
        colour = names[f"amplitude {direction}"]
        for i, x in enumerate(at):
            one = diagram.sel(direction=direction).isel(amplitude=i)
            expected += [(x, y, colour) for y in one.rebound_velocity.values.ravel()]
            exponents += [(x, y, colour, True) for y in one.lyapunov_largest.values]
    near(
        [row for row in scattered(upper) if np.isfinite(row[1])],
        [row for row in expected if np.isfinite(row[1])],
    )
    lowest = min(y for _, y, _, _ in marked(lower))
    resting = [row for row in exponents if row[1] == -np.inf]
    near(
        marked(lower),
        [row for row in exponents if np.isfinite(row[1])]
        + [(x, lowest, *others) for x, _, *others in resting],
    )
    assert floor < lowest < np.nanmin(exponent[np.isfinite(exponent)])


def random_lines(random, dim):
    """Three lines of up to eight points, of orbits of up to three impacts."""
    p, q = np.array([1, 2, 3]), random.integers(1, 4, 3)
    count = random.integers(3, 9, 3)
    beyond = np.arange(8) >= count[:, np.newaxis]

    def numbers(*size, low=0.1, high=2.0):
        values = random.uniform(low, high, (3, 8, *size))
        return np.where(beyond.reshape(3, 8, *(1 for _ in size)), np.nan, values)

    speed = numbers(3, low=1.0, high=9.0)
    speed[:, :, 1:][np.arange(1, 3) >= p[:, np.newaxis, np.newaxis] + np.zeros((1, 8, 1))] = np.nan
    return xr.Dataset(
        {
            "amplitude": ((dim, "point"), np.sort(numbers(), axis=1)),
            "restitution": ((dim, "point"), numbers(high=0.9)),
            "rebound_velocity": ((dim, "point", "impact"), speed),
            "impact_phase": ((dim, "point", "impact"), numbers(3, high=0.4)),
            "multiplier_real": ((dim, "point", "multiplier"), numbers(2)),
            "multiplier_imaginary": ((dim, "point", "multiplier"), 0.0 * numbers(2)),
            "cycle_impacts": (dim, p),
            "cycle_periods": (dim, q),
            "admissible": ((dim, "point"), random.integers(0, 2, (3, 8))),
            **scene(),
        },
        attrs={"along": "amplitude", "forcing": "amplitude"},
    )


def same_lines(found, expected):
    """Assert that lines of x, y, colour and width are these, in any order."""
    for x, y, colour, width in expected:
        assert any(
            np.array_equal(a, x, equal_nan=True)
            and np.array_equal(b, y, equal_nan=True)
            and (c, w) == (colour, width)
            for a, b, c, w, _ in found
        )


def test_branches(random_drawn_orbits):
    branches = random_lines(random_drawn_orbits, "branch")
    # each branch bifurcates at its second point
    codes = np.stack([random_drawn_orbits.integers(0, 7, 3), np.full(3, -1)], axis=1)
    at, phase = (branches[n].isel(point=[1, 2]) for n in ("amplitude", "impact_phase"))
    branches = branches.assign(
        bifurcation=(("branch", "event"), codes),
        bifurcation_amplitude=(("branch", "event"), at.values),
        bifurcation_phase=(("branch", "event", "impact"), phase.values),
    )
    branches["restitution"] = 0.8
    (plot,) = drawn(figures.orbit_branches, branches)
    names, widths = legend(plot), {one.get_label(): one.get_linewidth() for one in plot.lines}
    expected, events = [], []
    for i in range(3):
        one, p = branches.isel(branch=i), i + 1
        colour = names[cycle_name(p, int(one.cycle_periods))]
        stable = one.multiplier_real.values[:, 0] <= 1.0
        for k in range(p):
            x, y = one.amplitude.values, one.rebound_velocity.values[:, k]
            if p == 1:
                expected.append((x, y, colour, widths["unstable"]))
                expected.append((x, np.where(stable, y, np.nan), colour, widths["stable"]))
            events.append((x[1], y[1], BLACK, False))
    found = [(np.ravel(x), np.ravel(y), *others) for x, y, *others in curves(plot)]
    same_lines(found, expected)
    near(marked(plot), events)


def test_boundaries(random_drawn_orbits):
    lines = random_lines(random_drawn_orbits, "curve")
    lines = lines.assign(bifurcation=("curve", random_drawn_orbits.integers(0, 7, 3)))
    (plot,) = drawn(figures.orbit_boundaries, lines)
    expected = []
    for i in range(3):
        one = lines.isel(curve=i)
        names = [
            text
            for text in legend(plot)
            if text.startswith(cycle_name(i + 1, int(one.cycle_periods)))
        ]
        real = (one.admissible.values == 1) | (int(one.bifurcation) in (2, 3))
        x, y = one.restitution.values, one.amplitude.values
        expected.append((x, y, legend(plot)[names[0]], 0.5))
        expected.append((x, np.where(real, y, np.nan), legend(plot)[names[0]], 1.3))
    same_lines(curves(plot), expected)


def plane_under(random, **given):
    e, a = random.uniform(0.1, 0.9, 20), random.uniform(0.1, 2.0, 20)
    plane = {"restitution": ("realization", e), "amplitude": ("realization", a)}
    numbers = {"rebound_height_max": ("realization", random.uniform(0.0, 1.0, 20))}
    return xr.Dataset(numbers, coords=plane | scene(**given))


def test_boundaries_over_a_sweep_are_in_the_units_of_its_axis(random_drawn_orbits):
    lines = random_lines(random_drawn_orbits, "curve").assign(bifurcation=("curve", [0, 1, 5]))
    gamma = 2.0 * np.pi * lines.amplitude / (9.81 * (1.0 + lines.restitution))
    lines["base_acceleration"] = gamma
    sweep = plane_under(random_drawn_orbits)
    given = 2.0 * np.pi * sweep.amplitude / (9.81 * (1.0 + sweep.restitution))
    as_gamma = sweep.assign_coords(base_acceleration=given).assign_attrs(
        forcing="base_acceleration"
    )
    for under, name in ((sweep, "amplitude"), (as_gamma, "base_acceleration")):
        plot = drawn(figures.orbit_boundaries, lines, sweep=under)[0]
        near(
            [row[:2] for row in scattered(plot)],
            [*zip(under.restitution.values, under[name].values, strict=True)],
        )
        for i in range(3):
            x, y = (lines[n].values[i] for n in ("restitution", name))
            assert any(
                np.array_equal(b, y, equal_nan=True) and np.array_equal(a, x, equal_nan=True)
                for a, b, *_ in curves(plot)
            )


@pytest.mark.parametrize(("name", "value"), CONTRADICTIONS)
def test_boundaries_that_contradict_the_plane_under_them_are_refused(name, value):
    random = np.random.default_rng(0)
    lines = random_lines(random, "curve").assign(bifurcation=("curve", [0, 1, 5]))
    match = f"orbit_boundaries cannot draw {name} = .* picture of {name} = "
    with pytest.raises(DataError, match=match):
        drawn(figures.orbit_boundaries, changed(lines, name, value), sweep=plane_under(random))
    several = plane_under(random).assign_coords(
        frequency=("realization", np.linspace(1.0, 2.0, 20))
    )
    with pytest.raises(DataError, match="frequency = 1 Hz over a picture of frequency = 1 to 2 Hz"):
        drawn(figures.orbit_boundaries, lines, sweep=several)


@pytest.mark.parametrize("count", [5, 1])
def test_windows(count, random_drawn_orbits):
    e, scan = axis(random_drawn_orbits, count), np.sort(random_drawn_orbits.uniform(0.1, 3.0, 7))
    dims = ("condition", "direction", "restitution")
    names = ["locked(1)", "locked(2)", "periodic"]
    shape = (3, 1, e.size, 2)
    ends = np.sort(random_drawn_orbits.uniform(scan[0], scan[-1], (*shape, 2)), axis=-1)
    codes = random_drawn_orbits.integers(-1, 4, shape)
    low = np.where((codes < 0) | (codes == 1), np.nan, ends[..., 0])
    high = np.where((codes < 0) | (codes == 2), np.nan, ends[..., 1])
    windows = xr.Dataset(
        {
            "A_min": ((*dims, "window"), low),
            "A_max": ((*dims, "window"), high),
            "window_ends": ((*dims, "window"), codes),
            "holds": ((*dims, "scan"), random_drawn_orbits.integers(-1, 2, (3, 1, e.size, 7))),
        },
        coords={
            "condition": names,
            "direction": ["launch"],
            "restitution": e,
            "scan": scan,
            **scene(),
        },
        attrs={"forcing": "amplitude"},
    )
    edges = np.sort(e)
    for plot, shown in zip(
        drawn(figures.stability_windows, windows), (names[:2], names[2:]), strict=True
    ):
        expected = []
        for name in shown:
            colour = next(c for text, c in legend(plot).items() if text.startswith(name))
            for at in e:
                one = windows.sel(condition=name, direction="launch", restitution=at)
                for bottom, top, code in zip(
                    one.A_min.values, one.A_max.values, one.window_ends.values, strict=True
                ):
                    if code >= 0:
                        bottom = scan[0] if np.isnan(bottom) else bottom
                        top = scan[-1] if np.isnan(top) else top
                        expected.append((at, bottom, top, colour))
        found = [
            (next(x for x in edges if left < x < right), bottom, top, colour)
            for left, right, bottom, top, colour in bars(plot)
        ]
        near(found, expected)
        unknown = (windows.holds.sel(condition=shown) < 0).any(("condition", "direction"))
        for at in e:
            for forcing in scan:
                seen = colour_at(plot, at, forcing) is not None
                assert seen == bool(unknown.sel(restitution=at, scan=forcing))


def test_sobol_indices(random_drawn_orbits):
    dims, shape = ("output", "parameter"), (2, 3)
    parts = {}
    for name in ("first_order", "total_order"):
        parts[name] = (dims, random_drawn_orbits.uniform(0.0, 1.0, shape))
        ends = np.sort(
            random_drawn_orbits.uniform(-0.2, 1.2, (*shape, 2)), axis=-1
        )  # perhaps without the index
        parts |= {f"{name}_low": (dims, ends[..., 0]), f"{name}_high": (dims, ends[..., 1])}
    coords = {
        "output": ["dt_min", "impact_count"],
        "parameter": ["restitution", "amplitude", "phase"],
    }
    indices = xr.Dataset(parts, coords=coords)
    panels = drawn(figures.sobol_bars, indices)
    colours = legend(panels[-1])
    for plot, output in zip(panels, coords["output"], strict=True):
        names, one = plot.get_legend_handles_labels()[1], indices.sel(output=output)
        assert names == ["alone", "with interactions"]
        found = [(right, colour) for _, right, _, _, colour in bars(plot)]
        expected = [
            (value, colours[text])
            for name, text in (("first_order", "alone"), ("total_order", "with interactions"))
            for value in one[name].values
        ]
        near(found, expected)
        ends = np.concatenate(
            [
                np.stack([one[f"{n}_low"], one[f"{n}_high"]], axis=1)
                for n in ("first_order", "total_order")
            ]
        )
        np.testing.assert_array_equal(np.array(segments(plot))[:, :, 0], ends)
        # each interval lies on its bar
        for (_, _, bottom, top, _), segment in zip(bars(plot), segments(plot), strict=True):
            assert min(bottom, top) < segment[0, 1] == segment[1, 1] < max(bottom, top)


def test_motions_and_return_maps(random_drawn_orbits, make_record):
    from matplotlib.collections import PathCollection

    count = 3
    record = make_record(
        (0.0, 0.3, 0.55),
        6.0,
        "reflect",
        restitution=random_drawn_orbits.uniform(0.7, 0.95, count),
        amplitude=1.7,
    )
    record = record.isel(realization=random_drawn_orbits.permutation(count))
    i = int(random_drawn_orbits.integers(count))
    one = record.isel(realization=i)
    (plot,) = drawn(figures.height_time, record, realization=i)
    (paths,) = [c for c in plot.collections if isinstance(c, PathCollection)]
    names = legend(plot)
    for path, colour, k in zip(paths.get_paths(), paths.get_edgecolor(), range(3), strict=True):
        assert tuple(colour) == names[f"particle {k}"]
        t = one.landing_time.values[k]
        t = t[np.isfinite(t)]
        v = np.concatenate([[5.0], one.rebound_velocity.values[k, : t.size]])
        flights = path.vertices.reshape(-1, 3, 2)
        start = np.concatenate([[float(one.launch_time[k])], t])
        np.testing.assert_array_equal(flights[:, 0, 0], start)
        np.testing.assert_allclose(flights[:-1, -1, 0], t, rtol=1e-13)
        meet = flights[:-1, 1]  # twice as high as the apex, above it
        np.testing.assert_allclose(meet[:, 1], v[:-1] ** 2 / 9.81, rtol=1e-12)
        np.testing.assert_allclose(meet[:, 0], start[:-1] + v[:-1] / 9.81, rtol=1e-13)
    (plot,) = drawn(figures.return_map, record, realization=i)
    names, expected = legend(plot), []
    for k in range(3):
        t = one.landing_time.values[k]
        v = np.concatenate([[5.0], one.rebound_velocity.values[k]])
        for n in np.flatnonzero(np.isfinite(t)):
            colour = names["after 3 s" if t[n] > 3.0 else "to 3 s"]
            expected.append((v[n], v[n + 1], colour, True))  # a flight lands as fast as it began
    locked = (BLACK, to_rgba("none"))
    near([row for row in marked(plot) if row[2] not in locked], expected)


def test_every_public_figure_is_compared_with_its_dataset():
    files = sorted(Path(__file__).parent.glob("test_drawn*.py"))
    here = "".join(path.read_text("utf-8") for path in files)
    assert {name for name in figures.__all__ if f"figures.{name}" not in here} == NOT_DRAWN


def test_every_event_has_a_marker_dashes_and_a_name():
    for code, name in EVENTS:
        drawn = KINDS[code][2].replace("-", "_").replace(" a ", " ").replace(" ", "_")
        assert drawn == ("period_doubling" if name == "born_at_doubling" else name)
    assert {name for code, name in EVENTS if code in TIES} == {
        "grazing",
        "rest",
        "grazing_at_landing",
    }
