"""How fast the page of ``vibrosweep explore`` answers, measured in a browser.

Prints the median and the worst time from a click on the plane to the drawn pictures, and from a
movement of a slider with twenty particles over a hundred forcing periods.  Needs the extra
``browser`` and a Chromium.
"""

from __future__ import annotations

import argparse
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

FLAGS = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
READY = "() => window.Bokeh && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle"
DATA = """Bokeh.documents[0].get_model_by_name("height first").renderers
  .find((r) => r.glyph.type === "Quadratic").data_source.data"""
# once other flights than before are there and have been painted
PAINTED = "() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))"
SET = "([name, value]) => { Bokeh.documents[0].get_model_by_name(name).value = value }"
VIEW = """() => {
  const view = Bokeh.index.find_one_by_id(Bokeh.documents[0].get_model_by_name("plane").id)
  const {left, top} = view.canvas_view.el.getBoundingClientRect()
  const box = view.frame.bbox
  return [left + box.left, top + box.top, box.width, box.height]
}"""


def answered(page: Page, act: Callable[[], object]) -> float:
    """Milliseconds from an act to the picture, with those of driving the browser."""
    page.evaluate(f"() => {{ window.before = {DATA} }}")
    began = time.perf_counter()
    act()
    page.wait_for_function(f"() => {DATA} !== window.before", timeout=15_000)
    page.evaluate(PAINTED)
    return 1e3 * (time.perf_counter() - began)


def clicked(page: Page, across: float, up: float) -> float:
    """Milliseconds from a click on the plane to the picture."""
    left, top, width, height = page.evaluate(VIEW)
    page.wait_for_timeout(500)  # a second click at once would be a double click
    return answered(page, lambda: page.mouse.click(left + across * width, top + up * height))


def moved(page: Page, name: str, value: float) -> float:
    """Milliseconds from a movement of a slider to the picture."""
    return answered(page, lambda: page.evaluate(SET, [name, value]))


def told(name: str, times: list[float]) -> str:
    """Return a line about times in ms."""
    middle, worst = statistics.median(times), max(times)
    return f"{name:52} median {middle:5.0f} ms, worst of {len(times)} {worst:5.0f} ms"


def measured(page: Page, count: int) -> Iterator[str]:
    """Tell in lines about clicks and movements of sliders."""
    places = [(0.08 + 0.84 * i / count, 0.1 + 0.8 * (i * 7 % count) / count) for i in range(count)]
    clicks = [clicked(page, *place) for place in places]
    yield told("click to picture, 20 particles over 12 periods", clicks)
    moved(page, "periods", 100.0)
    for base in ("high-bounce", "moving"):
        if base == "moving":
            page.get_by_role("button", name="moving").first.click()
            page.wait_for_timeout(5000)
        times = [moved(page, "amplitude", 1.0 + 1.5 * (i + 0.5) / count) for i in range(count)]
        yield told(f"slider to picture, 20 over 100 periods, {base}", times)


def timed(server: subprocess.Popen[str], began: float, found: str, count: int) -> Iterator[str]:
    """Tell in lines about a server that was started."""
    assert server.stdout is not None
    address = re.search(r"http://localhost:\d+/", server.stdout.readline())[0]
    yield f"from the command to the address {time.perf_counter() - began:.1f} s"
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=[*FLAGS])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        began = time.perf_counter()
        page.goto(address)
        page.wait_for_function(READY)
        yield f"from the address to the page {time.perf_counter() - began:.1f} s"
        page.wait_for_timeout(2000)
        yield from measured(page, count)
        browser.close()


def main() -> None:
    """Start the page of a sweep and print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="of each; default: 50")
    parser.add_argument("--realizations", type=int, default=200, help="default: 200")
    options = parser.parse_args()
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    spec = {"restitution": (0.80, 0.98), "amplitude": (0.2, 3.5), "particles": 20, "seed": 1}
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
