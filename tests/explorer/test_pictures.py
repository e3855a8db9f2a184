"""Pictures of the page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vibrosweep as vs
from vibrosweep.api.result_kinds import BOUNDARIES, WINDOWS
from vibrosweep.errors import DataError
from vibrosweep.explorer import pictures
from vibrosweep.explorer.pictures import (
    Axis,
    View,
    curves_over,
    evenly,
    nearest,
    raster,
    spread_out,
    visible_rows,
)
from vibrosweep.explorer.points import Column, of_result, with_borders
from vibrosweep.explorer.views import PlaneView
from vibrosweep.store.writing import save_result

# Pictures of a record agree with `simulate`: true parabolas that end on the base.

LOCKED = {"restitution": 0.9, "amplitude": 1.2, "launch_time": [0.125]}


@pytest.fixture
def record(results, base):
    return of_result(results[base], Path("out.h5"), "sweep").choice(1).simulate()


def known(values):
    return np.sort(values[np.isfinite(values)])


def test_flights_begin_and_end_where_simulate_says(record):
    flights = pictures.heights(record).flights
    end = float(record.duration)
    begun = np.concatenate([record.launch_time.values, known(record.liftoff_time.values)])
    assert np.isin(flights["start"], begun).all()
    landed = known(record.landing_time.values)
    assert np.isin(flights["end"], np.append(landed, end)).all()
    assert np.isin(landed, flights["end"]).mean() > 0.9  # a flight without duration is not drawn
    speeds = np.append(known(record.rebound_velocity.values), float(record.launch_velocity))
    assert np.isin(flights["velocity"], speeds).all()


def test_flights_are_parabolas_that_end_on_the_base(record):
    found = pictures.heights(record)
    f, gravity = found.flights, float(record.gravity)
    middle = (f["y_start"] + 2.0 * f["cy"] + f["y_end"]) / 4.0  # of a quadratic Bezier curve
    half = (f["end"] - f["start"]) / 2.0
    height = f["y_start"] + f["velocity"] * half - gravity * half**2 / 2.0
    assert np.allclose(middle, height, rtol=0.0, atol=1e-12)
    assert np.allclose(f["cx"], f["start"] + half, rtol=0.0, atol=0.0)
    landed = f["end"] < float(record.duration)
    there = np.interp(f["end"][landed], found.base["time"], found.base["height"])
    # the base is drawn straight between its points
    step = np.diff(found.base["time"]).max() if record.attrs["base"] != "high-bounce" else 0.0
    bend = 9.81 * float(record.base_acceleration) * step**2
    assert np.all(np.abs(f["y_end"][landed] - there) < bend + 1e-9)


def test_stays_are_on_the_base():
    record = vs.simulate(
        restitution=0.5, base_acceleration=1.3, base="moving", launch_time=[0.0, 0.3]
    )
    stays = pictures.heights(record).stays
    rests = int(record.rested.sum())
    assert rests > 0
    # followed as finely as the base is drawn
    assert rests * pictures.OF_STAY <= stays["start"].size
    longest = 1.0 / pictures.SAMPLES + 1e-12
    assert np.max(stays["end"] - stays["start"]) <= longest
    landed = known(record.landing_time.values[record.rested.values == 1])
    assert np.isin(landed, stays["start"]).all()
    displacement = float(record.amplitude) / 1.5 / (2.0 * np.pi)
    for time, height in (("start", "y_start"), ("end", "y_end")):
        there = -displacement * np.cos(2.0 * np.pi * stays[time])
        assert np.allclose(stays[height], there, atol=1e-12)


def test_the_view_holds_all_flights(record):
    (begin, end), (bottom, top) = pictures.heights(record).span
    assert begin <= record.launch_time.values.min()
    assert end == float(record.duration)
    f = pictures.heights(record).flights
    highest = f["y_start"] + np.maximum(f["velocity"], 0.0) ** 2 / (2.0 * float(record.gravity))
    assert bottom <= f["y_start"].min()
    assert top <= highest.max(initial=0.0) + 1e-12


def test_landing_phases_converge_to_that_of_the_locked_orbit():
    record = vs.simulate(**LOCKED, duration=800.0)
    found = vs.analysis.landing_phases(record)
    assert np.array_equal(found["landing_time"], known(record.landing_time.values))
    assert found["phase"][-1] == pytest.approx(0.4329824002, abs=1e-9)


def test_a_locked_orbit_is_a_point_of_the_return_map():
    found = vs.analysis.return_map(vs.simulate(**LOCKED, duration=800.0))
    assert found["arrival_speed"][-1] == pytest.approx(4.905, abs=1e-9)
    assert found["next_arrival_speed"][-1] == pytest.approx(4.905, abs=1e-9)


def test_the_smallest_separation_is_that_of_the_sweep(results):
    swept = results["high-bounce"]
    points = of_result(swept, Path("out.h5"), "sweep")
    apart = np.flatnonzero(swept.dt_min.values > 0.0)
    for i in apart[:5]:
        record = points.choice(int(i)).simulate()
        gaps = vs.analysis.landing_separations(record)["separation"].values
        # times of some seconds are rounded to 1e-15 s
        assert gaps.min() == pytest.approx(float(swept.dt_min[i]), rel=1e-6, abs=1e-14)
    assert apart.size


def test_one_particle_has_no_separations():
    assert vs.analysis.landing_separations(vs.simulate(**LOCKED)).sizes["landing"] == 0


# Points gathered in pixels, compared with plain loops.

VIEW = View((0.2, 0.9), (0.1, 0.7), 5, 4)


def pixels(x, y):
    """Point numbers in each pixel of the view."""
    found = {}
    for i, (a, b) in enumerate(zip(x, y, strict=True)):
        column = int(np.floor((a - 0.2) / 0.7 * 5))
        row = int(np.floor((b - 0.1) / 0.6 * 4))
        if 0 <= column < 5 and 0 <= row < 4:
            found.setdefault((row, column), []).append(i)
    return found


@pytest.fixture
def scattered():
    rng = np.random.default_rng(3)
    return rng.random(60), rng.random(60), rng.random(60)


def test_a_pixel_holds_the_mean_of_its_finite_numbers(scattered):
    x, y, values = scattered
    values[::7] = np.nan
    values[3] = -np.inf
    found = raster(x, y, values, VIEW)
    assert (found.x, found.y) == (VIEW.x, VIEW.y)
    there = pixels(x, y)
    for place, value in np.ndenumerate(found.values):
        inside = values[there.get(place, [])]
        known = inside[np.isfinite(inside)]
        if known.size:
            assert value == pytest.approx(known.mean(), rel=1e-14)
        elif inside.size:
            assert np.isneginf(value) if np.isneginf(inside).any() else np.isnan(value)


def test_a_pixel_holds_its_commonest_code(scattered):
    x, y, values = scattered
    codes = np.round(2.0 * values)
    found = raster(x, y, codes, VIEW, np.arange(3.0))
    there = pixels(x, y)
    for place, value in np.ndenumerate(found.values):
        inside = codes[there.get(place, [])].tolist()
        if inside:
            assert inside.count(value) == max(map(inside.count, inside))


def test_each_point_of_a_grid_has_a_cell():
    x, y = (axis.ravel() for axis in np.meshgrid([0.0, 1.0, 2.0], [5.0, 7.0], indexing="ij"))
    found = raster(x, y, np.arange(6.0), VIEW)
    assert (found.x, found.y) == ((-0.5, 2.5), (4.0, 8.0))
    assert found.values.tolist() == [[0.0, 2.0, 4.0], [1.0, 3.0, 5.0]]


@pytest.mark.parametrize("columns", [40, 200, 500])
def test_a_grid_over_another_axis_has_no_stripes(columns):
    """Each pixel between points takes the value of a near one; those outside stay empty."""
    e, a = (
        axis.ravel() for axis in np.meshgrid(np.linspace(0.5, 0.9, columns), np.linspace(1, 3, 90))
    )
    y = a / (1.0 + e)
    found = raster(e, y, e, View((0.4, 1.0), (0.2, 2.2), 300, 250)).values
    across, up = np.meshgrid((np.arange(300) + 0.5) / 500 + 0.4, (np.arange(250) + 0.5) / 125 + 0.2)
    inside = (
        (across > 0.51) & (across < 0.89) & (up > 1.02 / (1 + across)) & (up < 2.98 / (1 + across))
    )
    assert np.abs(found - across)[inside].max() < 0.5 * 0.4 / columns + 0.02
    outside = (
        (across < 0.47) | (across > 0.93) | (up < 0.8 / (1 + across)) | (up > 3.2 / (1 + across))
    )
    assert np.isnan(found[outside]).all()


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1), st.floats(-1, 1))
@settings(max_examples=50)
def test_none_is_nearer_than_the_nearest(places, at):
    x, y = np.array(places).T
    found = nearest(x, y, (at, 0.5), (0.1, 2.0))
    far = np.hypot((x - at) / 0.1, (y - 0.5) / 2.0)
    assert far[found] <= far.min() * (1.0 + 1e-12)


def test_a_sample_spreads_from_coarse_to_fine(scattered):
    x, y, _ = scattered
    order = list(spread_out(x, y))
    assert sorted(order) == sorted(set(order))
    middle = np.argmin(np.hypot((x - x.min()) / np.ptp(x) - 0.5, (y - y.min()) / np.ptp(y) - 0.5))
    assert order[0] == middle
    # the first five points are one for the plane and one for each quarter of it
    quarters = {(x[i] > np.median(x), y[i] > np.median(y)) for i in order[1:5]}
    assert len(quarters) == 4


def test_a_sample_of_many_points_is_even():
    assert evenly(7, 100).tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert evenly(1000, 4).tolist() == [0, 333, 666, 999]


# Closed forms of window ends, drawn over planes of any axes.


def drawn(points, axes, **columns):
    more = {name: Column(name, np.asarray(values, float)) for name, values in columns.items()}
    return curves_over(replace(points, columns={**points.columns, **more}), axes)


def test_ends_of_windows_over_restitution_and_amplitude(points):
    ends, reason = drawn(points, ("restitution", "amplitude"))
    assert reason == ""
    assert {(end.mode, end.is_upper) for end in ends} >= {(1, False), (1, True)}
    for end in ends:
        closed = vs.theory.amplitude_max if end.is_upper else vs.theory.amplitude_min
        assert np.array_equal(end.y, closed(end.mode, end.x))


def test_axes_may_be_exchanged(points):
    along, _ = drawn(points, ("restitution", "amplitude"))
    across, _ = drawn(points, ("amplitude", "restitution"))
    for one, other in zip(along, across, strict=True):
        assert np.array_equal(one.x, other.y)
        assert np.array_equal(one.y, other.x)


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_ends_against_base_acceleration_are_those_of_the_base(points, base):
    moved = replace(points, base_choice=points.base_choice.over(base))
    gamma = np.linspace(0.01, 2.0, points.count)
    ends, _ = drawn(moved, ("restitution", "base_acceleration"), base_acceleration=gamma)
    assert any(end.is_upper for end in ends)
    for end in ends:
        least = np.pi * end.mode * (1.0 - end.x) / (1.0 + end.x)
        steepest = 2.0 * (1.0 + end.x**2) / (1.0 + end.x) ** 2 if base == "moving" else 1.0
        expected = np.hypot(least, steepest) if end.is_upper else least
        assert np.allclose(end.y, expected, rtol=1e-12, atol=0.0)


def test_the_reason_is_given_where_no_ends_are_drawn(points):
    assert "an axis is the forcing" in drawn(points, ("restitution", "dt_min"))[1]
    frequency = np.linspace(1.0, 2.0, points.count)
    ends, reason = drawn(points, ("restitution", "amplitude"), frequency=frequency)
    assert not ends
    assert "depend on frequency, which differs" in reason
    coupled = replace(points, base_choice=points.base_choice.over("sprung"))
    assert "a base without recoil" in drawn(coupled, ("restitution", "amplitude"))[1]


# Curves of bifurcations over the plane of the page.


@pytest.fixture(scope="module")
def curves():
    return vs.boundaries(restitution=[0.8, 0.9], amplitude=[0.5, 3.5])


@pytest.fixture
def plane(tmp_path):
    found = vs.sweep(restitution=[0.8, 0.9], amplitude=[0.5, 2.0, 3.5], particles=5)
    return of_result(found, tmp_path / "plane.h5", "sweep")


def test_curves_are_drawn_over_restitution_and_forcing_and_nothing_else(curves, plane, tmp_path):
    path = save_result(curves, tmp_path / "borders.h5", BOUNDARIES)
    view = PlaneView(with_borders(plane, path))
    view.x, view.y = "restitution", "amplitude"
    view.show()
    shown = view.borders.data
    assert sorted(shown["name"]) == ["1 in 1 period: period doubling", "1 in 1 period: saddle node"]
    assert sorted(shown["dash"]) == ["dashed", "solid"]
    born = shown["name"].index("1 in 1 period: saddle node")
    e, a = shown["xs"][born], shown["ys"][born]
    known = np.isfinite(e)
    assert a[known] == pytest.approx(vs.theory.amplitude_min(1, e[known]), rel=1e-12)
    view.y = "rebound_height_max"
    view.show()
    assert not view.borders.data["xs"]


def test_curves_of_another_scene_are_refused(curves, plane, tmp_path):
    for name, wrong in (
        ("base", curves.assign_attrs(base="moving")),
        ("frequency", curves.assign(frequency=2.0)),
    ):
        path = save_result(wrong, tmp_path / f"{name}.h5", BOUNDARIES)
        with pytest.raises(DataError, match=f"its {name} is "):
            with_borders(plane, path)
    path = save_result(curves, tmp_path / "windows.h5", WINDOWS)
    with pytest.raises(DataError, match="vibrosweep boundaries"):
        with_borders(replace(plane), path)


# Points left out of a picture cover the same pixels as others that are drawn.

COUNTS = st.integers(0, 60)
SEEDS = st.integers(0, 2**32 - 1)
X, Y = Axis(1.0, 3.0, 20), Axis(1e-3, 1.0, 10, log=True)


@settings(max_examples=60, deadline=None)
@given(COUNTS, SEEDS)
def test_the_last_of_the_dots_in_a_pixel_is_kept(count, seed):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(1.0, 3.0, count), 10.0 ** rng.uniform(-3.0, 0.0, count)
    last = {}
    for i in range(count):  # by the definition of a pixel
        last[int((x[i] - 1.0) * 10.0), int((np.log10(y[i]) + 3.0) / 0.3)] = i
    assert visible_rows([x], y, X, Y).tolist() == sorted(last.values())


@settings(max_examples=60, deadline=None)
@given(COUNTS, SEEDS)
def test_the_last_of_the_lines_in_the_same_pixels_is_kept(count, seed):
    rng = np.random.default_rng(seed)
    start, length, up = rng.uniform(-1.0, 5.0, count), rng.uniform(0.0, 3.0, count), np.ones(count)
    shown = visible_rows([start, start + length], up, X, Axis(0.0, 2.0, 10))
    reaches = (start + length > 1.0) & (start < 3.0)
    for i in np.flatnonzero(reaches):
        like = shown[shown >= i]
        near = np.abs(start[like] - start[i]) + np.abs(length[like] - length[i])
        assert near.min() <= 0.3  # three pixels of 0.1: one for each end, one for their difference
    assert set(shown) <= set(np.flatnonzero((start + length > 0.0) & (start < 4.0)))


def test_values_without_a_logarithm_are_left_out():
    gaps = np.array([0.0, 0.1, np.nan, -1.0])
    assert visible_rows([np.full(4, 2.0)], gaps, X, Y).tolist() == [1]
