"""What the served page and the page in a file can do, in a browser where there is one."""

import numpy as np
import pytest

import vibrosweep as vs
from tests.explorer.browsing import VIEW, address_of, served
from vibrosweep.explorer.points import open_points
from vibrosweep.explorer.static import write_page

SPEC = {
    "restitution": (0.80, 0.98),
    "amplitude": (0.2, 3.5),
    "realizations": 40,
    "seed": 1,
    "particles": 4,
}
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


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    path = tmp_path_factory.mktemp("explored") / "out.h5"
    vs.run(SPEC, path, progress=False).close()
    return path


@pytest.fixture(
    scope="module", params=["served", pytest.param("in a file", marks=pytest.mark.weekly)]
)
def address(request, result):
    if request.param == "served":
        with served(result) as process:
            yield address_of(process)
    else:
        path = result.with_suffix(".html")
        write_page(open_points(result), path, force=False)
        yield path.as_uri()


def model(page, name, key):
    return page.evaluate(MODEL, [name, key])


def click(page, across, up):
    """Click on the plane, and wait for another motion."""
    before = model(page, "heading first", "text")
    left, top, width, height = page.evaluate(VIEW)
    page.mouse.click(left + across * width, top + up * height)
    page.wait_for_function(
        "(before) => Bokeh.documents[0].get_model_by_name('heading first').text !== before",
        arg=before,
        timeout=120_000,
    )


def record_of(page):
    names = {}
    exec(model(page, "code", "text").partition("\nvs.figures.")[0], names)
    return names["record"]


@pytest.mark.parametrize("width", [1280, 390])
def test_it_says_what_to_do_and_begins_with_a_motion(address, opened, width):
    page = opened(address, width)
    assert page.get_by_text("Click a point").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    record = record_of(page)
    lies = (record.rested == 1) & record.liftoff_time.isnull()
    assert not bool(lies.any())


def test_one_time_in_all_pictures(address, opened):
    page = opened(address)
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


def test_two_points_side_by_side(address, opened):
    page = opened(address)
    first = model(page, "heading first", "text")
    page.get_by_role("button", name="Pin this motion").click()
    click(page, 0.25, 0.3)
    assert page.locator("#motion-2").is_visible()
    pinned = model(page, "heading second", "text").replace("pinned: ", "")
    assert pinned == first != model(page, "heading first", "text")
    (kept, shown) = page.evaluate(COLOURS)["rings"]
    assert kept != shown
    page.get_by_role("button", name="Pin this motion").click()
    page.wait_for_selector("#motion-2", state="hidden")


def test_a_view_is_kept_in_its_address(address, opened):
    page = opened(address)
    page.get_by_role("button", name="Pin this motion").click()
    click(page, 0.25, 0.3)
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


def test_ends_of_the_colours(address, opened, result):
    page = opened(address)
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


def test_pictures_are_saved_as_svg_and_png(address, opened):
    page = opened(address)
    for name, begins in (("Save as SVG", b"<svg"), ("Save", b"\x89PNG")):
        with page.expect_download() as download:
            page.locator(f"[title='{name}']").first.click()
        data = download.value.path().read_bytes()
        assert data.startswith(begins)
