"""Shared by the tests of the page: small results of every base and kind, and their points."""

import re
import shutil
from pathlib import Path

import pytest

import vibrosweep as vs
from tests.explorer.browsing import FLAGS, NAMES, READY
from vibrosweep.explorer.points import of_result

SWEEPS = {
    "high-bounce": {
        "restitution": (0.80, 0.98),
        "amplitude": (0.2, 3.5),
        "realizations": 30,
        "seed": 1,
        "particles": 5,
        "separation": True,
    },
    "moving": {
        "restitution": [0.8, 0.9],
        "base_acceleration": [0.5, 0.9, 1.5],
        "frequency": [1.0, 1.7],
        "particles": 3,
        "base": "moving",
        "duration_periods": 12.5,
        "regimes": True,
    },
    "sprung": {
        "base_mass": [0.5, 1.0],
        "particle_mass": 0.001,
        "mount_frequency": [0.37, 0.8],
        "particles": 3,
        "launch": [0.0, 0.2, 0.45],
        "base": "sprung",
        "duration": 9.0,
    },
}


@pytest.fixture(params=SWEEPS)
def base(request):
    return request.param


class Results(dict):
    """Sweeps by their bases, each computed when it is first asked for."""

    def __missing__(self, base):
        self[base] = vs.sweep(SWEEPS[base], progress=False)
        return self[base]


@pytest.fixture(scope="session")
def results():
    return Results()


@pytest.fixture(scope="session")
def points(results):
    """Points of the sweep over the high-bounce base."""
    return of_result(results["high-bounce"], Path("out.h5"), "sweep")


@pytest.fixture(scope="module")  # its loop of events would be in the way of other files
def browser():
    driver = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip(f"no browser is found: none of {', '.join(NAMES)}")
    with driver.sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=found, args=[*FLAGS])


# Bokeh 3.10 removes the view of a model that is replaced twice, and says so of each
HARMLESS = re.compile(r"\[bokeh [0-9.]+\] \w+View\(\w+\)\.remove\(\): view was already destroyed")


@pytest.fixture
def opened(browser):
    """Open an address in a window; fail on a console message or a request to another host."""
    said, asked, pages = [], [], []

    def note(message):
        if message.type in ("error", "warning") and not HARMLESS.fullmatch(message.text):
            said.append(message.text)

    def show(address, width=1280, **options):
        context = browser.new_context(viewport={"width": width, "height": 900}, **options)
        page = context.new_page()
        page.on("console", note)
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        pages.append(context)
        page.goto(address)
        page.wait_for_function(READY, timeout=120_000)
        return page

    yield show
    for context in pages:
        context.close()
    assert not said
    assert all(re.match(r"(data|blob|file):|(http|ws)://localhost:", url) for url in asked)
