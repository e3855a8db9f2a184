"""Figures of records."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import FillBetweenPolyCollection, LineCollection, PathCollection

from tests.cases import each_of
from vibrosweep import theory
from vibrosweep.analysis.records import (
    BaseMotion,
    ParticleFlights,
    base_motion,
    course,
    return_points,
)
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.figures import height_time, return_map
from vibrosweep.figures.laboratory import errors_by_case, fitted_track
from vibrosweep.figures.records import highest, parabolas, readable_until

STILL = BaseMotion(0.0, 1.0, 0.0)


def curves_of(figure):
    """Control points of every drawn flight, shape (flight, 3, 2)."""
    (flights,) = [c for c in figure.axes[0].collections if isinstance(c, PathCollection)]
    return np.concatenate([path.vertices for path in flights.get_paths()]).reshape(-1, 3, 2)


def rests_of(figure):
    (bars,) = [c for c in figure.axes[0].collections if isinstance(c, LineCollection)]
    return bars.get_segments()


def bezier(points, s):
    return (1 - s) ** 2 * points[0] + 2 * s * (1 - s) * points[1] + s**2 * points[2]


def test_every_point_of_a_drawn_curve_obeys_the_law_of_free_fall(make_record):
    one = make_record(np.arange(5) / 5, amplitude=3.0).isel(realization=0)
    flown = course(one, STILL, 7.3)
    start, v = flown.start[flown.flies], flown.velocity[flown.flies]
    assert flown.end[flown.flies].max() == 7.3
    curves = parabolas(flown, 9.81)
    assert len(curves) == np.count_nonzero(flown.flies) > 20
    for s in np.linspace(0, 1, 7):
        t, y = bezier(curves.swapaxes(0, 1), s).T
        since = t - start
        np.testing.assert_allclose(y, v * since - 9.81 * since**2 / 2, atol=1e-12)


def test_a_flight_cut_before_its_apex_ends_there(make_record):
    figure = height_time(make_record(), until=0.25).figure
    (flight,) = curves_of(figure)
    top = 5.0 * 0.25 - 9.81 * 0.25**2 / 2
    assert flight[2] == pytest.approx([0.25, top], rel=1e-14)
    assert figure.axes[0].get_xlim() == (0.0, 0.25)
    assert figure.axes[0].get_ylim()[1] == pytest.approx(1.05 * top)


def test_rests_are_drawn_on_the_base_from_landing_to_liftoff(make_record):
    record = make_record()
    rested = record.rested.values[0, 0] == 1
    assert rested.any()
    drawn = np.array(rests_of(height_time(record).figure))
    np.testing.assert_array_equal(drawn[:, 0, 0], record.landing_time.values[0, 0, rested])
    liftoff = np.minimum(record.liftoff_time.values[0, 0, rested], 12.0)
    np.testing.assert_array_equal(drawn[:, 1, 0], liftoff)
    np.testing.assert_array_equal(drawn[:, :, 1], 0.0)


def test_a_particle_at_rest_for_good_stays_to_the_end(make_record):
    (bar,) = rests_of(height_time(make_record(amplitude=0.0)).figure)
    assert bar[1, 0] == 12.0


def test_landings_are_marked_where_one_particle_is_drawn(twenty):
    def marks(figure):
        return [line for line in figure.axes[0].lines if line.get_marker() == "o"]

    (line,) = marks(height_time(twenty, [0]).figure)
    landing = twenty.landing_time.values[0, 0]
    np.testing.assert_array_equal(line.get_xdata(), landing[np.isfinite(landing)])
    assert not marks(height_time(twenty).figure)
    assert len(marks(height_time(twenty, [3, 4], mark_landings=True).figure)) == 2


def test_launch_times_may_differ_between_realizations(make_record):
    record = make_record([0.0, 0.25], restitution=np.array([0.9, 0.5]))
    shifted = record.assign_coords(
        launch_time=(("realization", "particle"), np.array([[0.0, 0.25], [-1.0, 0.0]]))
    )
    moved = xr.DataArray([[0.0, 0.0], [-1.0, -0.25]], dims=("realization", "particle"))
    for name in ("landing_time", "liftoff_time"):
        shifted[name] = shifted[name] + moved
    figure = height_time(shifted, realization=1).figure
    assert figure.axes[0].get_xlim() == (-1.0, 12.0)


@each_of(
    ("arguments", "message"),
    [
        ({"particles": [20]}, "particles = .20.:"),
        ({"particles": []}, "give at least one"),
        ({"realization": 1}, "realization = 1"),
        ({"until": 13.0}, "at most 12 s"),
        ({"until": 0.0}, "after 0 s"),
    ],
)
def test_a_wrong_choice_is_named(twenty, arguments, message):
    with pytest.raises(ParameterError, match=message):
        height_time(twenty, **arguments)


def test_a_missing_variable_is_named(twenty):
    with pytest.raises(DataError, match=r"height_time .*liftoff_time"):
        height_time(twenty.drop_vars("liftoff_time"))


def test_the_page_of_a_long_record_ends_after_forty_periods(twenty, make_record):
    assert readable_until(twenty) == 12.0
    assert readable_until(make_record(duration=100.0)) == 40.0
    assert readable_until(make_record(duration=100.0, frequency=2.0)) == 20.0


def test_a_particle_that_never_lands_and_one_that_is_never_launched(make_record):
    record = make_record([0.0, 3.0], duration=0.5)
    figure = height_time(record).figure
    assert len(curves_of(figure)) == 1
    figure.canvas.draw()


def test_a_moving_base_is_drawn_under_the_flights(moving_record):
    record = moving_record([0.0, 0.3], amplitude=3.0, restitution=0.3, phase=0.4)
    one = record.isel(realization=0)
    base = base_motion(one, "test")
    assert base.displacement > 0.1
    figure = height_time(record, mark_landings=True).figure
    axes = figure.axes[0]
    flights, landed = curves_of(figure), record.landing_time.values[0]
    whole = flights[:, 2, 0] < 12.0
    np.testing.assert_allclose(flights[:, 0, 1], base.height(flights[:, 0, 0]), atol=1e-12)
    np.testing.assert_allclose(flights[whole, 2, 1], base.height(flights[whole, 2, 0]), atol=1e-12)
    rests = rests_of(figure)
    assert len(rests) == np.count_nonzero(record.rested.values) > 3
    for ride in rests:
        np.testing.assert_allclose(ride[:, 1], base.height(ride[:, 0]), atol=1e-12)
    marks = [line for line in axes.lines if line.get_marker() == "o"]
    for line, landing in zip(marks, landed, strict=True):
        np.testing.assert_allclose(
            line.get_ydata(), base.height(landing[np.isfinite(landing)]), atol=1e-12
        )
    (floor,) = [c for c in axes.collections if isinstance(c, FillBetweenPolyCollection)]
    (outline,) = floor.get_paths()
    assert outline.vertices[:, 1].max() == pytest.approx(base.displacement, rel=3e-3)
    assert axes.get_ylim()[0] < -base.displacement
    assert "moving base" in axes.get_legend().get_title().get_text()


def test_a_flight_that_begins_downwards_has_its_highest_point_there():
    numbers = (np.array([[one]]) for one in (1.0, 1.5, -0.5, 0.3))
    flown = ParticleFlights(*numbers, np.array([[True]]))
    (flight,) = parabolas(flown, 9.81)
    for s in np.linspace(0, 1, 7):
        t, y = bezier(flight, s)
        since = t - 1.0
        assert y == pytest.approx(0.3 - 0.5 * since - 9.81 * since**2 / 2, abs=1e-12)
    assert highest(flown, 9.81) == 0.3


def drawn_points(figure):
    """Coordinates of all points but those of the legend and of locked orbits."""
    lines = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    return np.concatenate([np.asarray(line.get_xydata()) for line in lines])


def locked_points(figure, marker):
    lines = [line for line in figure.axes[0].lines if line.get_marker() == marker]
    return np.concatenate([line.get_xydata() for line in lines]) if lines else np.empty((0, 2))


@each_of("rebound", ["rest", "reflect"])
@each_of("amplitude", [0.0, 0.4, 1.2, 3.4])
def test_points_lie_in_the_strip(rebound, amplitude, make_record):
    record = make_record(np.arange(10) / 10, 30.0, rebound, amplitude=amplitude)
    v, after = drawn_points(return_map(record).figure).T
    assert np.all(np.abs(after - 0.9 * v) <= amplitude + 1e-12)


def test_locked_orbits_are_the_closed_form(make_record):
    stable = return_map(make_record(duration=60.0)).figure
    np.testing.assert_allclose(locked_points(stable, "D"), [[4.905, 4.905]])
    assert len(locked_points(stable, "X")) == 0
    unstable = return_map(make_record(duration=60.0, amplitude=3.4)).figure
    assert len(locked_points(unstable, "D")) == 0
    speeds = theory.locked_velocity(np.arange(1, 1 + len(locked_points(unstable, "X"))))
    np.testing.assert_allclose(locked_points(unstable, "X")[:, 0], speeds)


def test_a_record_without_a_rebound_is_drawn_empty(make_record):
    figure = return_map(make_record(duration=0.1)).figure
    assert len(drawn_points(figure)) == 0
    figure.canvas.draw()


def test_a_missing_variable_is_named_returns(twenty):
    with pytest.raises(DataError, match=r"return_map .*rebound_velocity"):
        return_map(twenty.drop_vars("rebound_velocity"))


def test_over_a_moving_base_the_strip_is_wider_and_windows_are_its_own(moving_record):
    # between the upper ends of both bases: A_max = 3.0068 and 3.0149 m/s at e = 0.9
    record = moving_record([0.43], amplitude=3.01, launch_velocity=4.905)
    names = [text.get_text() for text in return_map(record).get_legend().get_texts()]
    assert "locked, stable" in names
    assert any("A + 2 V_0" in name for name in names)
    still = record.assign_attrs(base="high-bounce")
    with pytest.raises(DataError, match="do not end on the base"):
        return_map(still)


def test_a_particle_that_lands_while_it_rises_is_in_view(moving_record):
    record = moving_record(np.arange(5) / 5, 20.0, amplitude=7.0, restitution=0.6, phase=0.4)
    before = return_points(record.isel(realization=0))[0]
    assert np.nanmin(before) < -1.0
    axes = return_map(record)
    assert axes.get_xlim()[0] < np.nanmin(before)


# Figures of the laboratory: what is drawn is what the datasets hold.


@pytest.fixture
def flights():
    """Two flights of one particle, and one of another, with samples on the first."""
    time = np.linspace(0.0, 0.1, 11)
    height = 9.81 / 2.0 * time * (0.1 - time)
    return xr.Dataset(
        {
            "time": ("sample", time),
            "height": ("sample", height),
            "particle": ("sample", np.zeros(11, int)),
            "residual": ("sample", np.where(time == 0.0, np.nan, 1.0)),
            "within": ("sample", time / 0.1),
            "start": ("flight", [0.0, 0.1, 0.0]),
            "end": ("flight", [0.1, 0.18, 0.1]),
            "speed": ("flight", [0.4905, 0.3924, 0.4905]),
            "rise": ("flight", [0.0, 0.002, 0.0]),
            "owner": ("flight", [0, 0, 1]),
            "landing_time": ("landing", [0.1]),
            "landing_error": ("landing", [1e-3]),
            "landing_height": ("landing", [0.002]),
            "landing_owner": ("landing", [0]),
        },
        attrs={"noise": 1e-4, "base": 0.0, "curvature": 9.81, "frame_rate": 100.0},
    )


def test_the_track_shows_samples_flights_and_landings(flights):
    figure = fitted_track(flights)[0].figure
    top, residuals, _ = figure.axes
    curves = [
        line for line in top.lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 9
    ]
    assert len(curves) == 2  # both of the particle that flies longest
    assert max(curves[0].get_ydata()) == pytest.approx(1e3 * 9.81 * 0.1**2 / 8.0, rel=1e-3)
    assert curves[1].get_ydata()[0] == pytest.approx(2.0)  # the height of the base at that time
    assert "height $y$ (mm)" in top.get_ylabel()
    dots = residuals.lines[0].get_ydata()
    assert len(dots) == 10
    assert set(dots) == {1.0}


def comparison():
    error = np.arange(2 * 2 * 4, dtype=float).reshape(2, 2, 4)
    return xr.Dataset(
        {"error": (("case", "quantity", "reading"), error)},
        coords={
            "case": ["N=1", "N=5"],
            "particles": ("case", [1, 5]),
            "quantity": ["height", "period"],
            "reading": ["ensemble", "particle", "worst", "flight"],
        },
        attrs={"study_height": np.array([3.8, 7.1]), "study_period": np.array([2.9, 6.0])},
    )


def test_errors_stand_beside_the_range_of_the_study():
    figure = errors_by_case(comparison())[0].figure
    heights, periods = figure.axes
    assert [text.get_text() for text in heights.get_xticklabels()] == ["N=1", "N=5"]
    assert [line.get_ydata().tolist() for line in periods.lines] == [
        [4.0, 12.0],
        [5.0, 13.0],
        [6.0, 14.0],
        [7.0, 15.0],
    ]
    box = heights.patches[0].get_extents().transformed(heights.transData.inverted())
    assert (box.y0, box.y1) == pytest.approx((3.8, 7.1))
    own = errors_by_case(comparison().drop_attrs())  # not an experiment of the study
    assert not own[0].patches
    unknown = comparison().drop_attrs()
    unknown["error"][:, 0] = np.nan
    assert errors_by_case(unknown)[0].get_ylim() == (0.0, 1.15)
