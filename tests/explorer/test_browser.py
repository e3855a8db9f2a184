"""The page of a running server, in a browser where there is one.

The package playwright drives the system's Chromium; without them these tests are skipped.
"""

import http.client
import os
import re
import shutil
import signal
import urllib.request

import pytest

import vibrosweep as vs
from tests.explorer.browsing import VIEW, address_of, served
from vibrosweep.explorer.pictures import heights

SPEC = {
    "restitution": (0.80, 0.98),
    "amplitude": (0.2, 3.5),
    "realizations": 40,
    "seed": 1,
    "particles": 4,
}
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


@pytest.mark.parametrize("width", [1280, 390])
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
    from vibrosweep.explorer.points import open_points
    from vibrosweep.explorer.static import write_page

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


@pytest.mark.skipif(os.name == "nt", reason="signals are those of POSIX")
def test_an_interruption_ends_the_server_without_a_traceback(process, address):
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "Traceback" not in errors
