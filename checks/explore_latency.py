"""Latency of the page of ``vibrosweep explore``, measured in a browser.

A response is timed in the browser, from the event until all pictures that it changes are painted
and the frame is finished.  Needs the extra ``browser`` and a Chromium.
"""

from __future__ import annotations

import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

import vibrosweep as vs
from accuracy import options_of

FLAGS = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
IMPORTS = "import vibrosweep.commands.results, vibrosweep.explorer.server"
MANY = 20_000  # more points than this are gathered in pixels
MOTION = ("height first", "return map first", "phases first", "separations first")
# pictures are there, whether kernels had to be compiled or not
READY = """() => window.Bokeh && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle
  && Bokeh.documents[0].get_model_by_name("heading first").text !== "" """
TOOLS = """() => {
  window.model = (name) => Bokeh.documents[0].get_model_by_name(name)
  window.view = (name) => Bokeh.index.find_one_by_id(model(name).id)
  window.image = () => model("plane").renderers.find((r) => r.glyph.type === "Image").data_source
  // ms from an event, or from now, until pictures are painted with new data of a source
  window.answer = (event, source, names) => new Promise((done) => {
    let began = performance.now(), arrived = event === null
    if (event) {
      const begin = (e) => { began = e.timeStamp; arrived = true }
      window.addEventListener(event, begin, {capture: true, once: true})
    }
    let fresh = false
    const changed = () => { fresh = arrived }
    source.properties.data.change.connect(changed)
    const left = new Set(names)
    for (const name of names) {
      const {repainted} = view(name)
      const painted = () => {
        if (!fresh) return
        repainted.disconnect(painted)
        left.delete(name)
        if (left.size) return
        source.properties.data.change.disconnect(changed)
        setTimeout(() => done(performance.now() - began))
      }
      repainted.connect(painted)
    }
  })
}"""
SET = """([name, value, names]) => {
  const answered = answer(null, model("shown first"), names)
  model(name).value = value
  return answered
}"""
# number of pictures while a slider is moved with every frame, for a time in ms
DRAG = """([name, low, high, lasting]) => new Promise((done) => {
  let pictures = 0
  const began = performance.now(), {repainted} = view("height first")
  const count = () => { pictures += 1 }
  repainted.connect(count)
  const move = () => {
    const share = (performance.now() - began) / lasting
    if (share > 1) { repainted.disconnect(count); done(pictures); return }
    model(name).value = low + share * (high - low)
    requestAnimationFrame(move)
  }
  move()
})"""
PLACE = """() => {
  const {left, top} = view("plane").canvas_view.el.getBoundingClientRect()
  const box = view("plane").frame.bbox
  return [left + box.left, top + box.top, box.width, box.height]
}"""
MOVED, GATHERED = '(model("shown first"))', "(image())"


def answered(
    page: Page, act: Callable[[], object], event: str, source: str, names: tuple[str, ...]
) -> float:
    """Milliseconds from an event to the pictures that it changes."""
    page.evaluate(
        f"([event, names]) => {{ window.answers = answer(event, {source}, names) }}",
        [event, list(names)],
    )
    act()
    return float(page.evaluate("() => window.answers"))


def clicked(page: Page, across: float, up: float) -> float:
    """Milliseconds from a click on the plane to the pictures."""
    left, top, width, height = page.evaluate(PLACE)
    page.wait_for_timeout(500)  # a second click at once would be a double click
    return answered(
        page,
        lambda: page.mouse.click(left + across * width, top + up * height),
        "pointerup",
        MOVED,
        MOTION,
    )


def places(count: int) -> list[tuple[float, float]]:
    """Places all over the plane."""
    return [(0.08 + 0.84 * i / count, 0.1 + 0.8 * (i * 7 % count) / count) for i in range(count)]


def told(name: str, times: list[float]) -> str:
    """Return a line about times in ms."""
    middle, worst = statistics.median(times), max(times)
    return f"{name:52} median {middle:5.0f} ms, worst of {len(times)} {worst:5.0f} ms"


def of_motions(page: Page, count: int) -> Iterator[str]:
    """Yield lines about clicks and movements of sliders."""
    clicks = [clicked(page, *place) for place in places(count)]
    yield told("click to pictures, 20 particles over 12 periods", clicks)
    page.evaluate(SET, ["periods", 100.0, list(MOTION)])
    for base in ("high-bounce", "moving"):
        if base == "moving":
            page.get_by_role("button", name="moving").first.click()
            page.wait_for_function(
                "() => model('heading first').text.includes('moving')", timeout=300_000
            )
            page.evaluate(SET, ["amplitude", 3.0, list(MOTION)])  # more than 1 g
        page.wait_for_function("() => model('facts').text.includes('<table>')", timeout=300_000)
        times = []
        for i in range(count):
            value = 1.0 + 1.5 * (i + 0.5) / count
            times.append(page.evaluate(SET, ["amplitude", value, list(MOTION)]))
            page.wait_for_timeout(50)
        yield told(f"slider to pictures, 20 over 100 periods, {base}", times)
        pictures = page.evaluate(DRAG, ["amplitude", 1.0, 2.5, 3000])
        yield f"{'a slider dragged for 3 s: pictures a second':52} {pictures / 3:.0f}"


def of_plane(page: Page, count: int) -> Iterator[str]:
    """Yield lines about a plane of very many points."""
    clicks = [clicked(page, *place) for place in places(count)]
    yield told("click to pictures", clicks)
    left, top, width, height = page.evaluate(PLACE)
    page.mouse.move(left + width / 2, top + height / 2)
    zooms = []
    for i in range(count):
        step = -120 if i % 10 < 5 else 120
        zooms.append(
            answered(page, lambda s=step: page.mouse.wheel(0, s), "wheel", GATHERED, ("plane",))
        )
        page.wait_for_timeout(400)
    yield told("turn of the wheel to the plane regrouped", zooms)
    colours = []
    select = page.locator("select[name=colour]")
    options = [one.get_attribute("value") for one in select.locator("option").all()]
    for i in range(count):
        value = options[i % len(options)]
        if value != select.input_value():
            colours.append(
                answered(
                    page, lambda v=value: select.select_option(v), "input", GATHERED, ("plane",)
                )
            )
            page.wait_for_timeout(200)
    yield told("another colour to the plane", colours)


def timed(server: subprocess.Popen[str], began: float, found: str, count: int) -> Iterator[str]:
    """Yield lines about a server that was started."""
    assert server.stdout is not None
    address = re.search(r"http://localhost:\d+/", server.stdout.readline())[0]
    yield f"from the command to the address {time.perf_counter() - began:.1f} s"
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=[*FLAGS])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        began = time.perf_counter()
        page.goto(address)
        page.wait_for_function(READY, timeout=300_000)
        yield f"from the address to the page with its pictures {time.perf_counter() - began:.1f} s"
        page.evaluate(TOOLS)
        page.wait_for_timeout(2000)
        many = page.evaluate("() => image().get_length() > 0")
        yield from (of_plane if many else of_motions)(page, count)
        browser.close()


def main() -> None:
    """Start the page of a sweep and print what was measured."""
    timed_too = f"of the sweep that is opened; above {MANY} the plane is timed"
    options = options_of(__doc__, count=(50, "of each"), realizations=(200, timed_too), write=False)
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    spec = {"restitution": (0.80, 0.98), "amplitude": (0.2, 3.5), "particles": 20, "seed": 1}
    if options.realizations > MANY:
        spec["particles"] = 2
    print(f"load of the machine {os.getloadavg()[0]:.1f}, processors {os.cpu_count()}")
    for _ in range(2):  # the first time they are read from the disk
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", IMPORTS], check=True)
    print(f"imports {time.perf_counter() - began:.1f} s", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "out.h5"
        vs.run({**spec, "realizations": options.realizations}, path, progress=False).close()
        command = [sys.executable, "-m", "vibrosweep", "explore", str(path)]
        began = time.perf_counter()
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            try:
                for line in timed(server, began, found, options.count):
                    print(line, flush=True)
            finally:
                server.terminate()


if __name__ == "__main__":
    main()
