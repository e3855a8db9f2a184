"""The page of a running server, in a browser where there is one.

The package playwright drives the system's Chromium; without them these tests are skipped.
"""

import http.client
import os
import re
import shutil
import signal
import urllib.request

import numpy as np
import pytest

import vibrosweep as vs
from tests.explorer.browsing import VIEW, address_of, served
from vibrosweep.explorer.pictures import heights
from vibrosweep.explorer.points import open_points
from vibrosweep.explorer.static import write_page

SPEC = {
    "restitution": (0.80, 0.98),
    "amplitude": (0.2, 3.5),
    "realizations": 40,
    "seed": 1,
    "particles": 4,
}
WIDTHS = (1280, pytest.param(390, marks=pytest.mark.weekly))
# the flights that are drawn, and the parameters that they are drawn for
DRAWN = """() => {
  const model = (name) => Bokeh.documents[0].get_model_by_name(name)
  const glyphs = model("height first").renderers.filter((r) => r.glyph.type === "Quadratic")
  const {x_range, inner_width} = model("height first")
  return {
    start: Array.from(glyphs[0].data_source.data.start),
    pixel: (x_range.end - x_range.start) / inner_width,
    code: model("code").text,
  }
}"""


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    path = tmp_path_factory.mktemp("explored") / "out.h5"
    vs.run(SPEC, path, progress=False).close()
    return path


@pytest.fixture(scope="module")
def process(result):
    with served(result) as started:
        yield started


@pytest.fixture(scope="module")
def address(process):
    return address_of(process)


def changed(page, before):
    """Wait until the picture has changed, and return it."""
    for _ in range(2400):  # kernels may have to be compiled
        drawn = page.evaluate(DRAWN)
        if all(drawn[name] != before[name] for name in ("start", "code")):
            return drawn
        page.wait_for_timeout(50)
    raise AssertionError("the pictures stay the same")


def realization(drawn):
    """Run the Python lines of the page; return their record."""
    names = {}
    exec(drawn["code"].partition("\nvs.figures.")[0], names)
    return names["record"]


def assert_drawn(drawn):
    """Check that the flights are those of `simulate`, except those that others hide."""
    starts = heights(realization(drawn)).flights["start"].tolist()
    assert set(drawn["start"]) <= set(starts)
    assert all(min(abs(s - d) for d in drawn["start"]) <= drawn["pixel"] for s in starts)


def click(page, across, up):
    left, top, width, height = page.evaluate(VIEW)
    page.mouse.click(left + across * width, top + up * height)


@pytest.mark.parametrize("width", WIDTHS)
def test_a_click_and_a_slider_change_the_pictures(address, opened, width):
    page = opened(address, width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    first = page.evaluate(DRAWN)
    click(page, 0.3, 0.4)
    second = changed(page, first)
    assert_drawn(second)
    handle = page.locator(".noUi-handle").nth(1)
    handle.scroll_into_view_if_needed()
    handle.focus()
    page.keyboard.press("ArrowRight")
    third = changed(page, second)
    assert_drawn(third)


def lasso(page):
    """Draw a line around the left half of the plane; return the number of points inside."""
    page.locator(".bk-tool-icon-lasso-select, [title='Lasso Select']").first.click()
    left, top, width, height = page.evaluate(VIEW)
    corners = [(0.01, 0.01), (0.5, 0.01), (0.5, 0.99), (0.01, 0.99), (0.01, 0.02)]
    page.mouse.move(left + corners[0][0] * width, top + corners[0][1] * height)
    page.mouse.down()
    for x, y in corners[1:]:
        page.mouse.move(left + x * width, top + y * height, steps=4)
    page.mouse.up()
    return int(page.get_by_text("points are chosen").inner_text().split()[0])


def saved(page):
    with page.expect_download() as download:
        page.get_by_role("button", name="Save the table").click()
    return download.value.path()


def test_a_lasso_saves_a_table_that_a_sweep_takes(address, opened, result, tmp_path):
    page = opened(address)
    count = lasso(page)
    path = tmp_path / "selection.csv"
    shutil.copy(saved(page), path)
    again = vs.sweep(design=str(path), particles=4, progress=False)
    assert 0 < again.sizes["realization"] == count < 40
    with vs.open_sweep(result) as swept:
        same = swept.restitution.isin(again.restitution)
        assert (swept.impact_count.values[same] == again.impact_count.values).all()


def test_a_page_in_a_file_works_without_a_network(result, opened, tmp_path):
    path = tmp_path / "page.html"
    write_page(open_points(result), path, force=False)
    page = opened(path.as_uri(), offline=True)
    first = page.evaluate(DRAWN)
    click(page, 0.2, 0.3)
    second = changed(page, first)
    assert second["start"] == heights(realization(second)).flights["start"].tolist()
    page.locator("select[name=colour]").select_option(label="landings")
    assert lasso(page) == saved(page).read_text().count("\n") - 1


def test_pages_of_other_origins_may_not_connect(address):
    port = int(address.strip("/").rpartition(":")[2])
    connection = http.client.HTTPConnection("localhost", port)
    headers = {
        "Origin": f"http://example.org:{port}",
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
        "Sec-WebSocket-Version": "13",
    }
    connection.request("GET", "/ws", headers=headers)
    assert connection.getresponse().status == 403
    connection.close()


def test_the_page_loads_nothing_from_elsewhere(address):
    with urllib.request.urlopen(address) as answer:
        text = answer.read().decode()
    assert not re.search(r"https?://(?!localhost)", text)
    assert "static/js/bokeh.min.js" in text


# What the page can do, served and in a file.

MODEL = "([name, key]) => Bokeh.documents[0].get_model_by_name(name)[key]"
SET = "([name, key, value]) => { Bokeh.documents[0].get_model_by_name(name)[key] = value }"
# places of the cursor in the pictures of time, and the dots of the particles
CURSOR = """() => {
  const model = (name) => Bokeh.documents[0].get_model_by_name(name)
  const spans = ["height", "phases", "separations"].map(
    (name) => model(`${name} first`).center.find((one) => one.type === "Span"))
  const dots = ["height", "return map"].map((name) => {
    const {data} = model(`${name} first`).renderers.findLast(
      (one) => one.glyph.type === "Scatter").data_source
    return {x: Array.from(data.x), y: Array.from(data.y), particle: Array.from(data.particle)}
  })
  return [spans.map((one) => [one.location, one.visible]), ...dots]
}"""
# ends of the colours, words beside the bar, and places of the rings of two motions
COLOURS = """() => {
  const plane = Bokeh.documents[0].get_model_by_name("plane")
  const bar = plane.right[0], labels = bar.major_label_overrides
  const rings = plane.renderers.filter((one) => one.glyph.size?.value === 15)
  const {transform} = plane.renderers.find((one) => one.glyph.type === "Scatter").glyph.fill_color
  return {
    ends: [transform.low, transform.high],
    words: labels instanceof Map ? [...labels.values()] : Object.values(labels),
    rings: rings.map((one) => [one.data_source.data.x[0], one.data_source.data.y[0]]),
  }
}"""


@pytest.fixture(
    scope="module", params=["served", pytest.param("in a file", marks=pytest.mark.weekly)]
)
def place(request, result):
    """The address of a page that is served, or of one in a file."""
    if request.param == "served":
        return request.getfixturevalue("address")
    path = result.with_suffix(".html")
    write_page(open_points(result), path, force=False)
    return path.as_uri()


def model(page, name, key):
    return page.evaluate(MODEL, [name, key])


def click_and_wait(page, across, up):
    """Click on the plane, and wait for another motion."""
    before = model(page, "heading first", "text")
    click(page, across, up)
    page.wait_for_function(
        "(before) => Bokeh.documents[0].get_model_by_name('heading first').text !== before",
        arg=before,
        timeout=120_000,
    )


def record_of(page):
    names = {}
    exec(model(page, "code", "text").partition("\nvs.figures.")[0], names)
    return names["record"]


@pytest.mark.parametrize("width", WIDTHS)
def test_it_says_what_to_do_and_begins_with_a_motion(place, opened, width):
    page = opened(place, width)
    assert page.get_by_text("Click a point").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    record = record_of(page)
    lies = (record.rested == 1) & record.liftoff_time.isnull()
    assert not bool(lies.any())


@pytest.mark.weekly
def test_one_time_in_all_pictures(place, opened):
    page = opened(place)
    record = record_of(page)
    time = 3.3
    page.evaluate(SET, ["time first", "value", time])
    spans, balls, returned = page.evaluate(CURSOR)
    assert spans == [[time, True]] * 3
    assert sorted(balls["particle"]) == [0, 1, 2, 3]
    heights = vs.positions(record, [time]).height.values.ravel()
    for particle, y in zip(balls["particle"], balls["y"], strict=True):
        assert y == pytest.approx(heights[particle], abs=1e-9)
    found = vs.analysis.return_map(record)
    for x, y, particle in zip(*(returned[name] for name in ("x", "y", "particle")), strict=True):
        until = (found.particle == particle) & (found.landing_time <= time)
        last = found.isel(point=np.flatnonzero(until)[-1])
        assert (x, y) == (float(last.arrival_speed), float(last.next_arrival_speed))
    page.get_by_role("button", name="play").first.click()
    page.wait_for_function(
        "(t) => Bokeh.documents[0].get_model_by_name('time first').value > t", arg=time
    )
    page.get_by_role("button", name="stop").first.click()


def test_two_points_side_by_side(place, opened):
    page = opened(place)
    first = model(page, "heading first", "text")
    page.get_by_role("button", name="Pin this motion").click()
    click_and_wait(page, 0.25, 0.3)
    assert page.locator("#motion-2").is_visible()
    pinned = model(page, "heading second", "text").replace("pinned: ", "")
    assert pinned == first != model(page, "heading first", "text")
    (kept, shown) = page.evaluate(COLOURS)["rings"]
    assert kept != shown
    page.get_by_role("button", name="Pin this motion").click()
    page.wait_for_selector("#motion-2", state="hidden")


@pytest.mark.weekly
def test_a_view_is_kept_in_its_address(place, opened):
    page = opened(place)
    page.get_by_role("button", name="Pin this motion").click()
    click_and_wait(page, 0.25, 0.3)
    page.evaluate(SET, ["scale", "value", "logarithmic"])
    page.evaluate(SET, ["to", "value", 2.0])
    page.wait_for_function("() => location.hash.includes('to=2')")
    again = opened(page.url)
    again.wait_for_selector("#motion-2")
    for name, key in (("heading first", "text"), ("heading second", "text"), ("scale", "value")):
        again.wait_for_function(
            "([name, key, value]) => Bokeh.documents[0].get_model_by_name(name)[key] === value",
            arg=[name, key, model(page, name, key)],
        )
    assert again.evaluate(COLOURS) == page.evaluate(COLOURS)


@pytest.mark.weekly
def test_ends_of_the_colours(place, opened, result):
    page = opened(place)
    with vs.open_sweep(result) as swept:
        heights = swept.rebound_height_max.values
    low, high = np.quantile(heights, [0.2, 0.8])
    page.evaluate(SET, ["from", "value", low])
    page.evaluate(SET, ["to", "value", high])
    page.wait_for_function(
        "(high) => Bokeh.documents[0].get_model_by_name('plane').right[0].color_mapper.high"
        " === high",
        arg=high,
    )
    found = page.evaluate(COLOURS)
    assert found["ends"] == pytest.approx([low, high])
    assert {f"▼ {low:.3g}", f"▲ {high:.3g}"} <= set(found["words"])
    page.evaluate(SET, ["scale", "value", "logarithmic"])
    page.wait_for_function(
        "(low) => Math.abs(Bokeh.documents[0].get_model_by_name('plane').renderers.find("
        "(one) => one.glyph.type === 'Scatter').glyph.fill_color.transform.low - low) < 1e-9",
        arg=float(np.log(low)),
    )


@pytest.mark.weekly
def test_pictures_are_saved_as_svg_and_png(place, opened):
    page = opened(place)
    for name, begins in (("Save as SVG", b"<svg"), ("Save", b"\x89PNG")):
        with page.expect_download() as download:
            page.locator(f"[title='{name}']").first.click()
        data = download.value.path().read_bytes()
        assert data.startswith(begins)


@pytest.mark.skipif(os.name == "nt", reason="signals are those of POSIX")
def test_an_interruption_ends_the_server_without_a_traceback(process, address):
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "Traceback" not in errors
