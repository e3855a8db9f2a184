"""`vibrosweep.explorer`: what it shows, and where."""

import http.server
import threading
import urllib.request
from functools import partial

import pytest

import vibrosweep as vs
from vibrosweep import explorer
from vibrosweep.errors import DataError
from vibrosweep.explorer.points import points_of


@pytest.fixture
def notebook(monkeypatch):
    monkeypatch.setattr(explorer, "_shell", lambda: "ZMQInteractiveShell")


def test_a_dataset_in_memory_has_the_points_of_its_file(results, points):
    found = points_of(results["high-bounce"])
    assert found.count == points.count
    assert (found.axes, found.colour, found.varied) == (points.axes, points.colour, points.varied)


def test_a_result_without_points_is_refused(results):
    with pytest.raises(DataError, match="no plane"):
        points_of(results["high-bounce"].expand_dims("curve"))


def test_a_notebook_shows_the_page_in_a_frame(results, notebook):
    page = vs.explore(results["high-bounce"])
    assert f'<iframe src="{page.address}"' in page._repr_html_()
    with urllib.request.urlopen(page.address) as answer:
        policy = answer.headers["Content-Security-Policy"]
    assert {"http://localhost:*", "http://127.0.0.1:*"} <= set(policy.split())


def test_behind_a_hub_a_notebook_shows_the_page_in_a_file(results, notebook, monkeypatch):
    monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", "/user/someone/")
    page = vs.explore(results["high-bounce"])
    assert page.address == ""
    assert "srcdoc" in page._repr_html_()
    assert "Behind JupyterHub" in page._repr_html_()


@pytest.mark.parametrize("hub", [False, pytest.param(True, marks=pytest.mark.weekly)])
def test_the_page_works_in_a_frame(results, notebook, monkeypatch, browser, tmp_path, hub):
    if hub:
        monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", "/user/someone/")
    shown = vs.explore(results["high-bounce"])._repr_html_()
    (tmp_path / "cell.html").write_text(f"<meta charset='utf-8'>{shown}", "utf-8")
    handler = partial(http.server.SimpleHTTPRequestHandler, directory=tmp_path)
    with http.server.ThreadingHTTPServer(("localhost", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        page = browser.new_page()
        page.goto(f"http://localhost:{server.server_port}/cell.html")
        frame = page.frame_locator("iframe")
        frame.get_by_text("Click a point").wait_for(timeout=120_000)
        frame.locator("#motion-1").get_by_text("high-bounce base").wait_for(timeout=120_000)
        page.close()
        server.shutdown()
