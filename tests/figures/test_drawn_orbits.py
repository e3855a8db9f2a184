"""Figures of orbits, basins, windows and indices show the numbers of their datasets, at random."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

import vibrosweep as vs
from tests.cases import each_of
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
from vibrosweep.analysis.orbits import EVENTS, cycle_name
from vibrosweep.errors import DataError
from vibrosweep.figures.orbits import KINDS, TIES
from vibrosweep.model.measures import Regime

PLAIN = {"phase": 0.0, "gravity": 9.81, "contact_time": 1e-4, "frequency": 1.0}
BLACK, WHITE = to_rgba("black"), to_rgba("white")
NOT_DRAWN = {"available", "save_all"}


@pytest.fixture(params=range(4))
def random(request):
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


@each_of("sizes", [(6, 5), (1, 4), (3, 1), (1, 1)])
def test_numbers_of_stable_orbits(sizes, random):
    e, a = (axis(random, size) for size in sizes)
    found = random_orbits(random, restitution=e, amplitude=a)
    plot, bar = drawn(figures.periodic_orbits, found)
    stable = ((found.stable == 1) & (found.admissible == 1)).sum("orbit")
    for at_e in e:
        for at_a in a:
            expected = scale(bar)(int(stable.sel(restitution=at_e, amplitude=at_a)))
            assert colour_at(plot, at_e, at_a) == expected
    low, high = plot.get_xlim()
    assert np.all((low < e) & (e < high))


def test_orbits_along_an_axis_and_at_one_point(random):
    line = random_orbits(random, amplitude=axis(random, 7))
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


@each_of(("times", "attractors"), [(9, 12), (9, 3), (1, 2)])
def test_basins(times, attractors, random):
    basins = random_basins(random, times, attractors)
    (plot,) = drawn(figures.basins_of_attraction, basins)
    names = {text.rsplit(",", 1)[0]: colour for text, colour in legend(plot).items()}
    for t in basins.launch_time.values:
        for v in basins.launch_velocity.values:
            code = int(basins.basin.sel(launch_time=t, launch_velocity=v))
            name = "unsettled" if code < 0 else name_of(basins.isel(attractor=code))
            expected = names.get(name) or names["5 others"]
            assert colour_at(plot, t, v) == expected


def test_orbits_over_basins_lie_at_the_times_of_their_phases(random):
    shift = {"phase": 2.0, "frequency": 2.5}
    basins = random_basins(random).assign_coords(shift)
    basins["launch_time"] = basins.launch_time / 2.5
    orbits = random_orbits(random).assign_coords(frequency=2.5)  # of another phase
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


@each_of(("name", "value"), [*CONTRADICTIONS, ("amplitude", 1.3), ("restitution", 0.9)])
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


@each_of("count", [6, 1])
def test_shares_are_as_thick_as_they_are_large(count, random):
    basins = random_shares(random, count)
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


def test_both_panels_of_a_bifurcation_diagram_show_the_same_forcings_on_any_axes(random):
    at, dims = axis(random, 5), ("direction", "amplitude", "particle")
    numbers = {
        "lyapunov_largest": (dims, random.normal(size=(2, at.size, 1))),
        "rebound_velocity": ((*dims, "sample"), random.uniform(1.0, 5.0, (2, at.size, 1, 4))),
        "regime": (dims, np.full((2, at.size, 1), Regime.APERIODIC, np.int8)),
    }
    coords = {"amplitude": at, "direction": ["up", "down"], **scene(restitution=0.8)}
    attrs = {"observable": "rebound_velocity", "forcing": "amplitude"}
    own = Figure().subplots(2, 1)
    upper, lower = figures.bifurcation_diagram(xr.Dataset(numbers, coords, attrs), ax=own)
    assert lower.get_xlim() == upper.get_xlim()


@each_of("launched", [True, False])
def test_a_bifurcation_diagram(launched, random):
    at = axis(random, 5)
    dims, shape = ("direction", "amplitude", "particle"), (2, at.size, 3)
    exponent = random.normal(size=shape)
    exponent.flat[random.choice(exponent.size, 5)] = np.nan
    exponent.flat[random.choice(exponent.size, 4)] = -np.inf
    speed = random.uniform(1.0, 5.0, (*shape, 4))
    speed.flat[random.choice(speed.size, 9)] = np.nan
    numbers = {
        "lyapunov_largest": (dims, exponent),
        "rebound_velocity": ((*dims, "sample"), speed),
        "regime": (dims, np.full(shape, 2, np.int8)),
    }
    anew = random.uniform(1.0, 5.0, (at.size, 2, 4))
    several = random.integers(1, 3, at.size)
    if launched:
        numbers |= {
            "launched_rebound_velocity": (("amplitude", "launch", "sample"), anew),
            "launched_lyapunov_largest": (("amplitude", "launch"), anew[:, :, 0]),
            "launched_regime": (("amplitude", "launch"), np.full((at.size, 2), 2, np.int8)),
            "attractors": ("amplitude", several),
            "chaos_high": ((), at[1]),
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
    if launched:
        colour = names["new launches"]
        expected += [(at[i], y, colour) for i in range(at.size) for y in anew[i].ravel()]
        exponents += [(at[i], y, colour, True) for i in range(at.size) for y in anew[i, :, 0]]
        marks = {one.get_label(): one.get_xdata() for one in upper.lines}
        assert list(marks["first exponent above 0"]) == [at[1]] * 2
        coexist = marks.get("attractors coexist", [])
        np.testing.assert_array_equal(coexist, at[several > 1])
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


def test_impacts_of_aperiodic_orbits_are_counted_in_pixels(random):
    at = axis(random, 6)
    dims, shape = ("direction", "amplitude", "particle"), (2, at.size, 3)
    speed = random.uniform(1.0, 5.0, (*shape, 8))
    regime = random.choice([2, 3, 4], shape)
    diagram = xr.Dataset(
        {
            "lyapunov_largest": (dims, random.normal(size=shape)),
            "rebound_velocity": ((*dims, "sample"), speed),
            "regime": (dims, regime.astype(np.int8)),
        },
        {"amplitude": at, "direction": ["up", "down"], **scene(restitution=0.8)},
        {"observable": "rebound_velocity", "forcing": "amplitude"},
    )
    upper, _ = drawn(figures.bifurcation_diagram, diagram)
    dots = sorted(y for _, y, *_ in scattered(upper) if np.isfinite(y))
    assert dots == sorted(speed[regime == 2].ravel())
    (mesh,) = (one for one in upper.collections if isinstance(one, QuadMesh))
    edges, shades = mesh.get_coordinates(), np.ma.getmaskarray(mesh.get_array())
    for i, x in enumerate(np.sort(at)):
        assert edges[0, i, 0] < x < edges[0, i + 1, 0]
        there = speed[:, at == x][regime[:, at == x] > 2]
        counts, _ = np.histogram(there, edges[:, 0, 1])
        np.testing.assert_array_equal(~shades[:, i], counts > 0)


STABLE = {"restitution": 0.5, "doublings": 1, "points": 300}
AMPLITUDES = [1.0, 2.0, 3.0, 5.0]


@pytest.fixture(scope="module")
def diagram():
    return vs.bifurcation(restitution=0.5, amplitude=AMPLITUDES, samples=2, launches=1)


def test_stable_orbits_are_drawn_over_a_bifurcation_diagram(diagram):
    lines = vs.branches(**STABLE, amplitude=[1.0, 5.0])
    orbits = vs.orbits(restitution=0.5, amplitude=AMPLITUDES, impacts=1, periods=1)
    real = (lines.stable == 1) & (lines.admissible == 1)
    for over, expected in (
        (lines, lines.rebound_velocity.where(real)),
        (orbits, orbits.rebound_velocity.where((orbits.stable == 1) & (orbits.admissible == 1))),
    ):
        upper, _ = figures.bifurcation_diagram(diagram, orbits=over)
        black = [line for line in upper.lines if line.get_zorder() == 3.0]
        shown = np.concatenate([np.ravel(line.get_ydata()) for line in black])
        expected = expected.values[np.isfinite(expected.values)]
        np.testing.assert_array_equal(np.sort(shown[np.isfinite(shown)]), np.sort(expected))
        assert expected.size
        assert "stable orbits" in legend(upper)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"restitution": 0.6}, "restitution"),
        ({"along": "restitution"}, "along amplitude, but these are along restitution"),
        ({"observable": "flight_time"}, "rebound_velocity or impact_phase"),
    ],
)
def test_orbits_that_do_not_belong_to_a_bifurcation_diagram_are_refused(diagram, changed, words):
    lines = vs.branches(restitution=0.5, amplitude=[1.0, 5.0], points=100)
    if "restitution" in changed:
        lines = lines.assign(restitution=changed["restitution"])
    elif "along" in changed:
        lines = lines.assign_attrs(along="restitution")
    else:
        diagram = diagram.rename(
            {"rebound_velocity": "flight_time", "launched_rebound_velocity": "launched_flight_time"}
        ).assign_attrs(changed)
    with pytest.raises(DataError, match=words):
        figures.bifurcation_diagram(diagram, orbits=lines)


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


def test_branches(random):
    branches = random_lines(random, "branch")
    # each branch bifurcates at its second point
    codes = np.stack([random.integers(0, 7, 3), np.full(3, -1)], axis=1)
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


def test_boundaries(random):
    lines = random_lines(random, "curve")
    lines = lines.assign(bifurcation=("curve", random.integers(0, 7, 3)))
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
        # thin where no particle follows the orbit, and one point further, which joins both parts
        near_by = np.pad(~real, 1)
        thin = near_by[:-2] | near_by[1:-1] | near_by[2:]
        expected.append((x, np.where(thin, y, np.nan), legend(plot)[names[0]], 0.5))
        expected.append((x, np.where(real, y, np.nan), legend(plot)[names[0]], 1.3))
    same_lines(curves(plot), expected)


def plane_under(random, **given):
    e, a = random.uniform(0.1, 0.9, 20), random.uniform(0.1, 2.0, 20)
    plane = {"restitution": ("realization", e), "amplitude": ("realization", a)}
    numbers = {"rebound_height_max": ("realization", random.uniform(0.0, 1.0, 20))}
    return xr.Dataset(numbers, coords=plane | scene(**given))


def test_boundaries_over_a_sweep_are_in_the_units_of_its_axis(random):
    lines = random_lines(random, "curve").assign(bifurcation=("curve", [0, 1, 5]))
    gamma = 2.0 * np.pi * lines.amplitude / (9.81 * (1.0 + lines.restitution))
    lines["base_acceleration"] = gamma
    sweep = plane_under(random)
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
            of_line = [b for a, b, *_ in curves(plot) if np.array_equal(a, x, equal_nan=True)]
            np.testing.assert_array_equal(np.fmax(*of_line), y)


@each_of(("name", "value"), CONTRADICTIONS)
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


@each_of("count", [5, 1])
def test_windows(count, random):
    e, scan = axis(random, count), np.sort(random.uniform(0.1, 3.0, 7))
    dims = ("condition", "direction", "restitution")
    names = ["locked(1)", "locked(2)", "periodic"]
    shape = (3, 1, e.size, 2)
    ends = np.sort(random.uniform(scan[0], scan[-1], (*shape, 2)), axis=-1)
    codes = random.integers(-1, 4, shape)
    low = np.where((codes < 0) | (codes == 1), np.nan, ends[..., 0])
    high = np.where((codes < 0) | (codes == 2), np.nan, ends[..., 1])
    windows = xr.Dataset(
        {
            "A_min": ((*dims, "window"), low),
            "A_max": ((*dims, "window"), high),
            "window_ends": ((*dims, "window"), codes),
            "holds": ((*dims, "scan"), random.integers(-1, 2, (3, 1, e.size, 7))),
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
        expected, dots = [], []
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
                        dots += [(at, end, colour, True) for end in (bottom, top)]
        if len(shown) == 2:  # of locked orbits
            near(marked(plot), dots)
        else:
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


def test_windows_in_two_directions_are_told_from_those_in_one(random):
    e, scan, dims = axis(random, 5), np.linspace(0.1, 3.0, 7), ("direction", "restitution")
    ends = np.sort(random.uniform(0.1, 3.0, (1, 2, e.size, 4)), axis=-1).reshape(1, 2, e.size, 2, 2)
    numbers = {f"A_{end}": ends[..., k] for k, end in enumerate(("min", "max"))}
    numbers["window_ends"] = np.where(random.random((1, 2, e.size, 2)) < 0.7, 0, -1)
    windows = xr.Dataset(
        {name: (("condition", *dims, "window"), one) for name, one in numbers.items()},
        coords={
            "condition": ["periodic"],
            "direction": ["up", "down"],
            "restitution": e,
            "scan": scan,
            **scene(),
        },
    )
    (plot,) = drawn(figures.stability_windows, windows)
    said = {c: text.removeprefix("periodic, ") for text, c in legend(plot).items()}
    for i, at in enumerate(e):
        for forcing in random.uniform(0.1, 3.0, 20):
            up, down = (
                bool(np.any((low < forcing) & (forcing < high) & (there == 0)))
                for low, high, there in zip(
                    *(windows[n].values[0, :, i] for n in ("A_min", "A_max", "window_ends")),
                    strict=True,
                )
            )
            wanted = {(1, 1): "both ways", (1, 0): "up only", (0, 1): "down only"}.get((up, down))
            seen = {
                said[colour]
                for left, right, low, high, colour in bars(plot)
                if left < at < right and low < forcing < high
            }
            assert seen == ({wanted} if wanted else set())


def test_sobol_indices(random):
    dims, shape = ("output", "parameter"), (2, 3)
    parts = {}
    for name in ("first_order", "total_order"):
        parts[name] = (dims, random.uniform(0.0, 1.0, shape))
        ends = np.sort(random.uniform(-0.2, 1.2, (*shape, 2)), axis=-1)  # perhaps without the index
        parts |= {f"{name}_low": (dims, ends[..., 0]), f"{name}_high": (dims, ends[..., 1])}
    coords = {
        "output": ["dt_min", "impact_count"],
        "parameter": ["restitution", "amplitude", "phase"],
    }
    indices = xr.Dataset(parts, coords=coords)
    panels = drawn(figures.sobol_bars, indices)
    colours = legend(panels[0])
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


def test_motions_and_return_maps(random, make_record):
    from matplotlib.collections import PathCollection

    count = 3
    record = make_record(
        (0.0, 0.3, 0.55),
        6.0,
        "reflect",
        restitution=random.uniform(0.7, 0.95, count),
        amplitude=1.7,
    )
    record = record.isel(realization=random.permutation(count))
    i = int(random.integers(count))
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
            colour = names["$t > 3$ s" if t[n] > 3.0 else r"$t \leq 3$ s"]
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
