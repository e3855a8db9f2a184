"""The page without a browser: what it shows is what `simulate` gives, value for value."""

from concurrent.futures import Future
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bokeh.document import Document

import vibrosweep as vs
from vibrosweep.errors import VibrosweepError
from vibrosweep.explore import motion_view, pictures, plane_view
from vibrosweep.explore.background import Background
from vibrosweep.explore.live import Page
from vibrosweep.explore.points import Column
from vibrosweep.explore.table import TABLE, table


class Foreground(Background):
    """Computes at once."""

    def call(self, work):
        future = Future()
        future.set_result(work())
        return future

    def prepare(self, choice):
        return self.call(lambda: None)


@pytest.fixture
def page(points):
    made = Page(points, Document(), Foreground())
    made.attach()
    return made


def drawings(record):
    found = pictures.heights(record)
    return {
        "flights": found.flights,
        "stays": found.stays,
        "return map": pictures.return_map(record),
        "phases": pictures.landing_phases(record),
        "separations": pictures.separations(record),
    }


def rows(columns, names):
    return set(zip(*(columns[name].tolist() for name in names), strict=True))


def farthest(values, shown):
    """Largest distance from a value to the next one that is shown."""
    if not len(values):
        return 0.0
    return np.abs(np.subtract.outer(np.asarray(values), np.asarray(shown))).min(axis=1).max()


def assert_shows(view, record):
    """What is drawn is of this record, value for value; what is not is within a pixel of that."""
    content = view.content
    base = pictures.heights(record).base
    assert all(np.array_equal(content["base"][name], base[name]) for name in base)
    for source, columns in drawings(record).items():
        shown = content[source]
        assert rows(shown, shown) <= rows(columns, shown)
        across = next(name for name in ("start", "time", "speed") if name in columns)
        left, right, _, _ = content["views"].get(source, content["views"]["height"])
        pixel = (right - left) / motion_view.GUESS[0]
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
    page.click(0.5, 10.0)
    record = vs.simulate(restitution=0.5, amplitude=10.0, launch_time=np.arange(5) / 5.0)
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
    assert choice.particles == 3


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
    """What is drawn of a picture in another window."""
    ranges = dict(zip(("x0", "x1", "y0", "y1"), ends, strict=True))
    page.motions[0]._moved(name, SimpleNamespace(**ranges))
    return page.motions[0].content


def test_a_window_that_is_moved_gets_all_that_is_seen_in_it(page):
    page.controls.set(page.controls.choice.lasting(100.0))
    page._follow()
    record = page.controls.choice.simulate()
    columns = drawings(record)
    sent = window(page, "phases", 3.0, 3.2, 0.0, 1.0)
    assert set(sent) == {"phases"}
    time = columns["phases"]["time"]
    assert set(time[(time > 3.0) & (time < 3.2)]) <= set(sent["phases"]["time"])
    flights = window(page, "height", 3.0, 3.2, 0.0, 1.0)["flights"]
    over = (columns["flights"]["start"] < 3.2) & (columns["flights"]["end"] > 3.0)
    assert set(columns["flights"]["start"][over]) <= set(flights["start"])
    assert len(flights["start"]) < over.size


def test_what_cannot_be_computed_is_told(page):
    page.controls.choice = page.controls.choice.with_inputs(amplitude=np.nan)
    page._follow()
    assert "not computed" in page.status.text
    assert "amplitude" in page.status.text


def test_kernels_that_are_not_ready_are_waited_for_with_a_message(page, monkeypatch):
    waits = Future()
    monkeypatch.setattr(page.background, "prepare", lambda choice: waits)
    before = page.motions[0].content
    page.controls.base.active = 1
    page._follow()
    assert "kernels of the moving base are being loaded" in page.status.text
    assert page.motions[0].content["heading"] == before["heading"]
    waits.set_result(None)
    (callback,) = (c for c in page.document.session_callbacks if "_prepares" in repr(c.callback))
    callback.callback()
    assert_shows(page.motions[0], page.controls.choice.simulate())


def test_what_cannot_be_prepared_is_told_and_not_tried_for_ever(page, monkeypatch):
    tried = []

    def prepare(choice):
        tried.append(Future())
        return tried[-1]

    monkeypatch.setattr(page.background, "prepare", prepare)
    page._follow()
    tried[0].set_exception(VibrosweepError("no such thing"))
    (callback,) = (c for c in page.document.session_callbacks if "_prepares" in repr(c.callback))
    callback.callback()
    assert "not computed" in page.status.text
    assert "no such thing" in page.status.text
    assert len(tried) == 1


def geometry(**given):
    return SimpleNamespace(final=True, geometry=given)


def test_a_lasso_makes_a_table(page, points):
    x, y = points.columns["restitution"].values, points.columns["amplitude"].values
    page._selected(geometry(type="poly", x=[0.0, 0.9, 0.9, 0.0], y=[0.0, 0.0, 9.0, 9.0]))
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


def test_very_many_points_are_gathered_in_pixels(points, monkeypatch):
    monkeypatch.setattr(plane_view, "MANY", 10)
    rng = np.random.default_rng(0)
    column = replace(points.columns["dt_min"], values=rng.random(30))
    many = replace(points, columns={**points.columns, "dt_min": column})
    page = Page(many, Document(), Foreground())
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
