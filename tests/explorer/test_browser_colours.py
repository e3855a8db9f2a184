"""Colours that a browser shows, pixel by pixel, are those that the scale gives to the values."""

import io

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import vibrosweep as vs
from tests.explorer.browsing import VIEW, address_of, served
from vibrosweep.explorer.points import open_points
from vibrosweep.explorer.static import write_page
from vibrosweep.explorer.views import colouring, limits

SCENE = {"particles": 3, "separation": True}
SAMPLES = {
    "dots": {
        "restitution": (0.8, 0.98),
        "amplitude": (0.2, 3.5),
        "realizations": 30,
        "seed": 1,
    },
    "cells": {
        "restitution": np.linspace(0.8, 0.98, 6).tolist(),
        "amplitude": np.linspace(0.2, 3.5, 7).tolist(),
    },
}
# leave only the points or cells, which curves, crosses and the ring would hide in places
BARE = """() => {
  for (const one of Bokeh.documents[0].get_model_by_name("plane").renderers)
    one.visible = one.glyph.type === "Image" || one.glyph.fill_color?.transform != null
}"""


@pytest.fixture(scope="module", params=["dots", pytest.param("cells", marks=pytest.mark.weekly)])
def result(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("coloured") / "out.h5"
    vs.run({**SCENE, **SAMPLES[request.param]}, path, progress=False).close()
    return path


@pytest.fixture(scope="module")
def address(result):
    with served(result) as process:
        yield address_of(process)


@pytest.fixture(params=[pytest.param("server", marks=pytest.mark.weekly), "file"])
def page(request, result, opened):
    if request.param == "file":
        path = result.with_suffix(".html")
        if not path.exists():
            write_page(open_points(result), path, force=False)
        address = path.as_uri()
    else:
        address = request.getfixturevalue("address")
    shown = opened(address)
    shown.evaluate(BARE)
    return shown


def expected(column):
    """Colours of a column, 0 to 255; NaN where nothing is drawn."""
    scale = colouring(column)
    palette = np.array([to_rgb(colour) for colour in scale.palette])
    low, high, values = scale.low, scale.high, scale.values
    if scale.log:
        with np.errstate(divide="ignore"):
            low, high, values = np.log(low), np.log(high), np.log(values)
    with np.errstate(invalid="ignore"):
        place = np.clip((values - low) / (high - low) * len(palette), 0, len(palette) - 1)
    colours = palette[np.nan_to_num(place).astype(int)]
    colours[values < low] = to_rgb(scale.below)
    colours[np.isnan(values)] = 1.0  # the background
    return 255.0 * colours


def apart(x, y):
    """Which places are more than a dot away from all others."""
    far = np.hypot(np.subtract.outer(x, x), np.subtract.outer(y, y))
    return (far + 99.0 * np.eye(x.size)).min(axis=1) > 12.0


def places(page, points, x, y):
    """Pixels of the points in the picture of the plane."""
    left, top, width, height = page.evaluate(VIEW)
    ends = limits(points.columns[x].values), limits(points.columns[y].values)
    across, up = (
        (points.columns[name].values - low) / (high - low)
        for name, (low, high) in zip((x, y), ends, strict=True)
    )
    return left + across * width, top + (1.0 - up) * height


def false_colours(page, points, x, y, colour):
    """Names of the points whose pixels differ from the colours of their values."""
    across, up = places(page, points, x, y)
    seen = apart(across, up)
    screen = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), float)
    found = screen[np.round(up[seen]).astype(int), np.round(across[seen]).astype(int)]
    # a value at the limit of two colours of the scale may have either, through rounding
    differ = np.abs(found - expected(points.columns[colour])[seen]).max(axis=1) > 4.0
    assert seen.sum() > seen.size // 2
    return np.flatnonzero(seen)[differ].tolist()


def assert_coloured(page, points, x, y, colour):
    for _ in range(50):
        wrong = false_colours(page, points, x, y, colour)
        if not wrong:
            return
        page.wait_for_timeout(100)
    raise AssertionError(f"{colour}: false colours of the points {wrong}")


def pick(page, points, menu, name):
    page.locator(f"select[name={menu}]").select_option(label=points.columns[name].label)


def test_every_pixel_has_the_colour_of_its_value(page, result):
    """Whatever quantity is chosen, one after the other, and when the axes are exchanged."""
    points = open_points(result)
    x, y = points.axes
    assert_coloured(page, points, x, y, points.colour)
    for colour in points.columns:
        pick(page, points, "colour", colour)
        assert_coloured(page, points, x, y, colour)
    pick(page, points, "x", y)
    pick(page, points, "y", x)
    for colour in (x, points.colour):
        pick(page, points, "colour", colour)
        assert_coloured(page, points, y, x, colour)


@pytest.mark.weekly
@pytest.mark.parametrize("page", ["file"], indirect=True)
def test_the_words_beside_the_pointer_are_those_of_the_value(page, result):
    """Of a point, or of the cell around it, wherever in the cell the pointer is."""
    points = open_points(result)
    x, y = points.axes
    for colour in (points.colour, "collision_free"):
        column = points.columns[colour]
        pick(page, points, "colour", colour)
        assert_coloured(page, points, x, y, colour)
        across, up = places(page, points, x, y)
        index = int(np.flatnonzero(apart(across, up) & np.isfinite(column.values))[-1])
        value = column.values[index]
        words = column.codes.get(int(value), f"{value:.6g}")
        numbers = [f"{points.columns[name].values[index]:.6g}" for name in (x, y)]
        page.mouse.move(across[index] + 2, up[index] + 2)
        for text in (*numbers, words):
            page.locator(".bk-tooltip-row-value").get_by_text(text, exact=True).first.wait_for()
