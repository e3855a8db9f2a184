"""The command ``vibrosweep explore`` as a user starts it, and a browser that opens its page."""

import os
import re
import subprocess
import sys
from contextlib import contextmanager

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
# true once the first pictures are drawn, which may have to wait for a compilation
READY = """() => window.Bokeh && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle
  && Bokeh.documents[0].get_model_by_name("heading first").text !== "" """
# left, top, width, height of the view of the plane in the window
VIEW = """() => {
  const plot = Bokeh.documents[0].get_model_by_name("plane")
  const view = Bokeh.index.find_one_by_id(plot.id)
  const {left, top} = view.canvas_view.el.getBoundingClientRect()
  const box = view.frame.bbox
  return [left + box.left, top + box.top, box.width, box.height]
}"""


@contextmanager
def served(result):
    """Start the command; yield its process."""
    command = [sys.executable, "-m", "vibrosweep", "explore", str(result)]
    group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP} if os.name == "nt" else {}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **group
    ) as started:
        try:
            yield started
        finally:
            started.kill()


def address_of(process):
    return re.search(r"http://localhost:\d+/", process.stdout.readline())[0]
