"""The server of the page, for browsers of this machine alone."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Callable
from typing import Final

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import Server

from vibrosweep.errors import RunError
from vibrosweep.explore.background import Background
from vibrosweep.explore.live import Page
from vibrosweep.explore.points import Points

HOST: Final = "localhost"
ENDINGS: Final = ("SIGINT", "SIGTERM", "SIGHUP")


def serve(points: Points, port: int, started: Callable[[str], None]) -> None:
    """Serve the page until a signal ends it; port 0 is any free one.

    `started` is called with the address once the page can be opened.  Raises a RunError where the
    port cannot be had.
    """
    background = Background()
    background.prepare(
        points.choice(points.count // 2).shortened()
    )  # while the browser loads the page

    def show(document: Document) -> None:
        Page(points, document, background).attach()

    try:
        with socket.create_server((HOST, port)):
            pass  # tornado would leave a socket open where it cannot have the port
    except OSError as error:
        raise RunError(
            f"port {port} cannot be had ({error.strerror}): give another one with --port, or 0 for "
            f"any that is free"
        ) from error
    # a page of any other origin is refused its connection: bokeh allows this address alone
    server = Server({"/": Application(FunctionHandler(show))}, port=port, address=HOST)
    loop = server.io_loop
    for name in ENDINGS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            # an exception that a signal raises in a callback would be logged with a traceback
            signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
    server.start()
    started(f"http://{HOST}:{server.port}/")
    loop.start()
    server.stop()
    if background.busy:  # Python would wait for a compilation, and it ends with a traceback
        sys.stdout.flush()
        os._exit(0)
