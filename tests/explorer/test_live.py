"""The page while it is open."""

import itertools
import math
import threading
from array import array
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from threading import Event
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest
from bokeh.document import Document

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep.errors import VibrosweepError
from vibrosweep.explorer import pictures, views
from vibrosweep.explorer.live import Background, Page
from vibrosweep.explorer.points import Choice, Column, points_of
from vibrosweep.explorer.views import MOST_PIXELS, inner_pixels
from vibrosweep.explorer.words import TABLE, table

# The page without a browser: what it shows is what `simulate` gives, value for value.

ENDS = ("x0", "x1", "y0", "y1")


class Foreground(Background):
    """Computes at once."""

    def call(self, work):
        future = Future()
        try:
            future.set_result(work())
        except VibrosweepError as error:
            future.set_exception(error)
        return future


@pytest.fixture
def page(points):
    made = Page(points, Document(), Foreground())
    made.attach()
    return made


def test_names_of_curves_do_not_lie_on_each_other():
    grid = vs.sweep(
        restitution=np.linspace(0.3, 0.98, 8), amplitude=np.linspace(0.2, 3.5, 8), duration=2.0
    )
    plane = Page(points_of(grid), Document(), Foreground()).plane
    unit = [np.ptp([view.start, view.end]) for view in plane.views]
    places = np.stack([plane.names.data["x"], plane.names.data["y"]], axis=1) / unit
    assert len(places) >= 5
    for one, other in itertools.combinations(places, 2):
        assert np.hypot(*(one - other)) > 0.12


def drawings(record):
    found = pictures.heights(record)
    return {
        "flights": found.flights,
        "stays": found.stays,
        **{name: dots.columns(record) for name, dots in pictures.DOTS.items()},
    }


def rows(columns, names):
    return set(zip(*(columns[name].tolist() for name in names), strict=True))


def farthest(values, shown):
    """Largest distance from a value to the nearest one that is shown."""
    if not len(values):
        return 0.0
    return np.abs(np.subtract.outer(np.asarray(values), np.asarray(shown))).min(axis=1).max()


def assert_shows(view, record):
    """Each point drawn is one of the record; each other point has one within a pixel."""
    content = view.content
    base = pictures.heights(record).base
    assert all(np.array_equal(content["base"][name], base[name]) for name in base)
    for source, columns in drawings(record).items():
        shown = content[source]
        assert rows(shown, shown) <= rows(columns, shown)
        across = next(
            name for name in ("start", "arrival_speed", "landing_time") if name in columns
        )
        left, right, _, _ = content["views"].get(source, content["views"]["height"])
        pixel = (right - left) / views.GUESS[0]
        assert farthest(columns[across], shown[across]) <= pixel


def test_a_click_on_a_point_shows_its_realization(page, points):
    for index in (4, 21):
        inputs = {name: points.columns[name].values[index] for name in points.varied}
        page.click(*inputs.values())
        record = vs.simulate(**inputs, launch_time=np.arange(5) / 5.0)
        assert_shows(page.motions[0], record)
        assert f"point {index} of 30" in page.status.text
        assert repr(float(inputs["amplitude"])) in page.code.text


def test_a_click_between_points_shows_that_place(page):
    page.click(0.5, 5.0)
    record = vs.simulate(restitution=0.5, amplitude=5.0, launch_time=np.arange(5) / 5.0)
    assert_shows(page.motions[0], record)
    assert "between the points" in page.status.text


def test_a_slider_changes_the_pictures_once_for_all_its_movements(page):
    for value in (0.7, 0.75, 0.8):
        page.controls.sliders["restitution"].value = value
    page.controls.launch["particles"].value = 3
    choice = page.controls.choice
    assert choice.inputs["restitution"] == 0.8
    page._follow()
    assert len([c for c in page.document.session_callbacks if c.callback == page._follow]) <= 1
    assert_shows(page.motions[0], choice.simulate())
    assert choice.scene.particles == 3


def ring(page):
    return [page.plane.chosen.data[name] for name in "xy"]


def test_the_ring_is_where_the_motion_is_or_nowhere(page, points):
    x, y = (points.columns[name].values for name in points.axes)
    page.select_point(4)
    assert ring(page) == [[x[4]], [y[4]]]
    page.controls.sliders["amplitude"].value = 2.5
    page._follow()
    assert ring(page) == [[x[4]], [2.5]]
    page.pickers["x"].value = "dt_min"  # not known for a motion that is no point of the result
    assert ring(page) == [[], []]
    page.controls.sliders["amplitude"].value = float(y[4])
    page._follow()
    assert ring(page) == [[points.columns["dt_min"].values[4]], [y[4]]]


def test_colours_keep_the_mapper_that_the_browser_has_copied(page):
    """Its browser would go on to paint with a mapper that is replaced."""
    mapper = page.plane.mapper
    for name in page.points.columns:
        page.pickers["colour"].value = name
        assert page.plane.dots.glyph.fill_color.transform is mapper
        assert page.plane.painted.glyph.color_mapper is mapper


def test_both_bases_are_shown_side_by_side(page):
    assert not page.motions[1].heading.visible
    page.controls.both.active = [0]
    page._follow()
    assert page.motions[1].heading.visible
    choice = page.controls.choice
    assert_shows(page.motions[0], choice.simulate())
    assert_shows(page.motions[1], choice.over("moving").simulate())


def test_sliders_of_the_mount_appear_with_the_sprung_base(page):
    sliders = page.controls.sliders
    assert not sliders["mass_ratio"].visible
    page.controls.base.active = 2
    assert sliders["mass_ratio"].visible
    page._follow()
    assert_shows(page.motions[0], page.controls.choice.simulate())


def window(page, name, *ends):
    """Move the window of a picture; return the content that is drawn in it."""
    ranges = dict(zip(ENDS, ends, strict=True))
    page.motions[0]._moved(name, SimpleNamespace(**ranges))
    return page.motions[0].content


def test_a_window_that_is_moved_gets_all_that_is_seen_in_it(page):
    page.controls.set(page.controls.choice.lasting(100.0))
    page._follow()
    record = page.controls.choice.simulate()
    columns = drawings(record)
    sent = window(page, "phases", 3.0, 3.2, 0.0, 1.0)
    assert set(sent) == {"phases"}
    time = columns["phases"]["landing_time"]
    assert set(time[(time > 3.0) & (time < 3.2)]) <= set(sent["phases"]["landing_time"])
    flights = window(page, "height", 3.0, 3.2, 0.0, 1.0)["flights"]
    over = (columns["flights"]["start"] < 3.2) & (columns["flights"]["end"] > 3.0)
    assert set(columns["flights"]["start"][over]) <= set(flights["start"])
    assert len(flights["start"]) < over.size


def test_a_failed_computation_is_reported(page):
    page.controls.choice = page.controls.choice.with_inputs(amplitude=np.nan)
    page._follow()
    assert "not computed" in page.status.text
    assert "amplitude" in page.status.text


def late_callback(page):
    (found,) = (c for c in page.document.session_callbacks if "_show.<locals>" in repr(c.callback))
    return found.callback


def test_a_long_computation_shows_a_message_until_it_ends(page, monkeypatch):
    waits = Future()
    monkeypatch.setattr(page.background, "call", lambda work: waits)
    before = page.motions[0].content
    page.controls.base.active = 1
    page._follow()
    assert "is being computed" in page.status.text
    assert page.motions[0].content["heading"] == before["heading"]
    waits.set_result([page.controls.choice.simulate()])
    late_callback(page)()
    assert_shows(page.motions[0], page.controls.choice.simulate())


def test_the_failure_of_a_long_computation_is_reported(page, monkeypatch):
    waits = Future()
    monkeypatch.setattr(page.background, "call", lambda work: waits)
    page._follow()
    waits.set_exception(VibrosweepError("no such thing"))
    late_callback(page)()
    assert "not computed" in page.status.text
    assert "no such thing" in page.status.text


def test_movements_between_the_running_and_the_newest_one_are_dropped(points):
    """Only one computation runs at a time, and only the newest one waits."""
    background, gate, begun, simulated = Background(), Event(), Event(), []
    page = Page(points, Document(), background)

    def simulate(choice):
        simulated.append(choice)
        begun.set()
        assert gate.wait(10.0)
        return vs.simulate(**choice.keywords())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Choice, "simulate", simulate)
        for i in range(5):
            page.controls.sliders["restitution"].value = 0.8 + 0.01 * i
            page._follow()
            assert begun.wait(10.0)
        last = page.controls.choice
        gate.set()
        background.call(lambda: None).cancel()
        background.close()
        while background.busy:
            sleep(0.01)
    assert [one.inputs["restitution"] for one in simulated] == [0.8]
    assert last.inputs["restitution"] > 0.83


WILD = (1e6, -1e6, 1e308, -1e308, 1e-320, math.nan, math.inf, -math.inf, 10**309, 0)


@each_of("wild", WILD)
def test_values_from_a_browser_are_clipped_to_the_ranges_of_the_widgets(page, wild):
    """Even if the browser changes the ranges of the widgets themselves."""
    sliders, ranges = {**page.controls.sliders, **page.controls.launch}, page.controls._ranges
    for name, slider in sliders.items():
        slider.update(start=-1e308, end=1e308)
        slider.value = wild
        assert ranges[name][0] <= slider.value <= ranges[name][1], name
    page._follow()
    assert "Shown" in page.status.text
    page._tapped(SimpleNamespace(x=wild, y=wild))
    choice = page.controls.choice
    assert 1 <= choice.scene.particles <= 100
    assert choice.periods <= 200.0
    for name in page.controls.sliders:
        assert ranges[name][0] <= choice.inputs[name] <= ranges[name][1], name


def lasting(choice, seconds):
    return replace(choice, scene=replace(choice.scene, duration=seconds))


def test_a_duration_in_seconds_is_no_more_periods_than_its_slider_has(page):
    page.controls.set(lasting(page.controls.choice, 90.0))
    page.controls.launch["particles"].value = 1
    sliders = page.controls.sliders
    sliders["frequency"].update(end=1e6)
    sliders["frequency"].value = 1e6
    assert page.controls.choice.periods == 180.0
    page.controls.set(lasting(page.controls.choice, 190.0).with_inputs(frequency=1.0))
    sliders["frequency"].value = 2.0
    assert page.controls.choice.periods == 200.0 == page.controls.launch["periods"].value


@each_of("wild", [None, -1, 7])
def test_an_unknown_base_is_ignored(page, wild):
    page.controls.base.active = wild
    assert page.controls.base.active == 0
    assert page.controls.choice.scene.base == "high-bounce"


def test_an_unknown_column_is_ignored(page):
    for name, one in page.pickers.items():
        before = one.value
        one.options = ["nothing"]
        one.value = "nothing"
        assert one.value == before == getattr(page.plane, name)


@each_of("wild", [None, "a", math.nan, math.inf, 10**309, [0.0]])
def test_invalid_places_and_windows_change_nothing(page, wild):
    before = page.motions[0].content, page.status.text
    page._tapped(SimpleNamespace(x=0.9, y=wild))
    page._tapped(SimpleNamespace(x=wild, y=1.0))
    for ends in ((wild, 1.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0), (-1.7e308, 1.7e308, 0.0, 1.0)):
        page.motions[0]._moved("phases", SimpleNamespace(**dict(zip(ENDS, ends, strict=True))))
    for shape in (
        {"type": "poly", "x": [0.0, 1.0, wild], "y": [0.0, 1.0, 2.0]},
        {"type": "poly", "x": [], "y": [0.0, 1.0, 2.0]},
        {"type": "poly", "x": wild, "y": wild},
        {"type": "poly"},
        {"type": "rect", "x0": wild, "x1": 1.0, "y0": 0.0, "y1": 1.0},
        {"type": "rect"},
        {},
    ):
        page._selected(geometry(**shape))
    assert (page.motions[0].content, page.status.text) == before
    assert not page.rows.size


def many_times(points):
    """Repeat the points until there are so many that they are gathered in pixels."""
    return points.taken(np.arange(views.MANY + 1) % points.count)


def test_a_view_without_a_size_shows_all_points(points):
    page = Page(many_times(points), Document(), Foreground())
    whole = page.plane.image.data["image"][0]
    plot = page.plane.figure
    for start, end in ((0.9, 0.9), (math.nan, 1.0), (-1.7e308, 1.7e308)):
        plot.x_range.update(start=start, end=end)
        page._paint()
        assert np.array_equal(page.plane.image.data["image"][0], whole, equal_nan=True)
    for name in ("inner_width", "inner_height"):
        plot.set_from_json(name, 10**9)
    assert inner_pixels(plot, (1, 1)) == (MOST_PIXELS, MOST_PIXELS)


def geometry(**given):
    return SimpleNamespace(final=True, geometry=given)


@each_of("kind", [list, np.array, partial(array, "d")])
def test_a_lasso_makes_a_table(page, points, kind):
    x, y = points.columns["restitution"].values, points.columns["amplitude"].values
    outline = {"x": kind([0.0, 0.9, 0.9, 0.0]), "y": kind([0.0, 0.0, 9.0, 9.0])}
    page._selected(geometry(type="poly", **outline))
    rows = np.flatnonzero(x < 0.9)
    assert np.array_equal(page.rows, rows)
    assert f"{rows.size} points" in page.selection.text
    page._save()
    assert page.holder.data["text"] == [table(points, rows)]
    page.picture.value = "table of the selection"
    assert TABLE in page.code.text
    page._selected(geometry(type="rect", x0=2.0, x1=3.0, y0=0.0, y1=1.0))
    assert page.save.disabled
    assert y.size == 30


def test_axes_colours_and_markers_can_be_chosen(page, points):
    page.pickers["x"].value = "amplitude"
    page.pickers["y"].value = "restitution"
    assert np.array_equal(page.plane.source.data["x"], points.columns["amplitude"].values)
    assert page.plane.figure.yaxis.axis_label == "restitution e"
    page.pickers["colour"].value = "collision_free"
    names = page.plane.scale.major_label_overrides
    said = page.plane.source.data["said"]
    position = page.plane.source.data["value"]
    assert [names[int(p)] for p in position] == said
    page.pickers["marker"].value = "collision_free"
    assert len(set(page.plane.source.data["marker"])) == len(set(said))


def test_very_many_points_are_gathered_in_pixels(points):
    rng = np.random.default_rng(0)
    column = replace(points.columns["dt_min"], values=rng.random(30))
    many = replace(points, columns={**points.columns, "dt_min": column})
    page = Page(many_times(many), Document(), Foreground())
    image = page.plane.image.data["image"][0]
    assert np.isfinite(image).sum() == 30
    plot = page.plane.figure
    plot.x_range.start = 0.9
    page._paint()
    inside = many.columns["restitution"].values >= 0.9
    assert np.isfinite(page.plane.image.data["image"][0]).sum() == inside.sum()


def test_numbers_that_are_missing_have_no_colour(points):
    values = np.where(np.arange(30) < 3, np.nan, 1.0)
    column = Column("something", values)
    found = Page(
        replace(points, columns={**points.columns, "dt_min": column}), Document(), Foreground()
    )
    assert found.plane.source.data["said"][:4] == ["not known"] * 3 + ["1"]
    assert np.isnan(found.plane.source.data["value"][:3]).all()


def test_the_first_point_moves(points, page):
    record = points.choice(page.index).simulate()
    assert not bool(((record.rested == 1) & record.liftoff_time.isnull()).any())
    assert "Click a point" in page.status.text


def test_a_pinned_motion_stays_beside_the_next(page, points):
    page.select_point(3)
    page.pin.active = True
    page.select_point(7)
    first, second = (motion.content["heading"] for motion in page.motions)
    assert "pinned: " in second
    assert page.motions[1].heading.visible
    assert page.plane.pinned.data["x"] == [points.columns[page.plane.x].values[3]]
    assert f"e = {points.columns['restitution'].values[3]:.5g}" in second
    assert f"e = {points.columns['restitution'].values[7]:.5g}" in first
    page.pin.active = False
    assert not page.motions[1].heading.visible


def test_an_address_restores_what_it_says(page, points):
    page.select_point(3)
    page.controls.sliders["frequency"].value = 1.3
    page._follow()
    page.pin.active = True
    page.select_point(5)
    page.pickers["colour"].value = "rebound_height_max"
    page.scale.value, page.high.value = "logarithmic", 1.5
    page.controls.base.active = 1
    page._follow()
    said = page.said.data["text"][0]
    again = Page(points, Document(), Foreground())
    again.asked.data = {"text": [f"#{said}"]}
    assert again.said.data["text"][0] == said
    assert again.controls.choice == page.controls.choice
    assert again._pinned == page._pinned
    assert again.plane.wish == page.plane.wish == views.Scale("logarithmic", None, 1.5)


@each_of(
    "data",
    [
        {},
        {"text": []},
        {"text": [["x"]]},
        *(
            {"text": [f"#{text}"]}
            for text in (
                "x=nothing&y=%00&colour=&point=-1&scale=odd",
                "point=1e400&from=nan&to=inf&window=1,1,1,1",
                "point=0.5&base=7&particles=1e300&pinned=pinned%3Dpoint&periods=-3",
                "window=a,b&amplitude=nan&restitution=inf&frequency=-1",
            )
        ),
    ],
)
def test_an_address_that_means_nothing_changes_nothing_else(page, points, data):
    """No exception, and a motion that can be computed."""
    page.asked.data = data
    assert page.plane.x in points.columns
    assert page.plane.wish == views.Scale()
    low, high = page.controls._ranges["particles"]
    assert low <= page.controls.choice.scene.particles <= high
    assert "not computed" not in page.status.text


# Computations that run while the page stays responsive.


@pytest.fixture
def background():
    made = Background()
    yield made
    made.close()


class Gate:
    """Work that says when it begins, and waits to be let through."""

    def __init__(self):
        self.begun, self.open = threading.Event(), threading.Event()

    def __call__(self):
        self.begun.set()
        assert self.open.wait(10.0)
        return threading.get_ident()


def test_one_task_runs_at_a_time_and_only_the_newest_task_waits(background):
    gate, done = Gate(), []
    first = background.call(gate)
    assert gate.begun.wait(10.0)
    others = [background.call(lambda i=i: done.append(i)) for i in range(5)]
    assert background.busy
    assert done == []
    gate.open.set()
    others[-1].result(10.0)
    assert first.result(10.0) != threading.get_ident()
    assert done == [4]
    assert all(one.cancelled() for one in others[:-1])
    assert not background.busy


def test_two_visitors_do_not_wait_for_each_other(background):
    gate, other = Gate(), Background()
    background.call(gate)
    assert other.call(lambda: 3).result(10.0) == 3
    gate.open.set()
    other.close()


def test_a_waiting_task_is_cancelled_when_its_visitor_leaves(background):
    gate = Gate()
    background.call(gate)
    assert gate.begun.wait(10.0)
    waits = background.call(lambda: 3)
    background.close()
    assert waits.cancelled()
    assert background.busy
    gate.open.set()


def test_an_exception_is_handed_on_and_later_tasks_still_run(background):
    with pytest.raises(ZeroDivisionError):
        background.call(lambda: 1 / 0).result(10.0)
    assert background.call(lambda: 3).result(10.0) == 3
