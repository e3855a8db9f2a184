"""The server of the page, for browsers of this machine alone."""

from __future__ import annotations

import os
import re
import signal
import socket
import sys
from collections.abc import Callable
from typing import Any, Final
from weakref import WeakSet

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPMessageDelegate, HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.routing import Router
from tornado.web import RequestHandler

from vibrosweep.errors import RunError
from vibrosweep.explore.background import Background
from vibrosweep.explore.live import Page
from vibrosweep.explore.points import Points

HOST: Final = "localhost"
NAMES: Final = (HOST, "127.0.0.1", "[::1]")  # of this machine for itself
ENDINGS: Final = ("SIGINT", "SIGTERM", "SIGHUP")
# What a page asks for.  Bokeh has more, for pages of other servers that show what is here
SERVED: Final = re.compile(r"/|/ws|/favicon\.ico|/static/.*")
HTTP_PORT: Final = 80  # which browsers leave out of an address


def serve(points: Points, port: int, started: Callable[[str], None]) -> None:
    """Serve the page until a signal ends it; port 0 is any free one.

    `started` is called with the address once the page can be opened.  Raises a RunError where the
    port cannot be had.
    """
    backgrounds = WeakSet[Background]()
    first = Background()
    backgrounds.add(first)
    # kernels are loaded or compiled while the browser loads the page
    first.call(points.choice(points.count // 2).shortened().simulate)
    server, address = opened(points, port, backgrounds.add)
    loop = server.io_loop
    for name in ENDINGS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            # an exception that a signal raises in a callback would be logged with a traceback
            signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
    server.start()
    started(address)
    loop.start()
    server.stop()
    if any(one.busy for one in backgrounds):
        # Python would wait for a compilation, and it ends with a traceback
        sys.stdout.flush()
        os._exit(0)


def opened(
    points: Points, port: int, watch: Callable[[Background], object]
) -> tuple[BaseServer, str]:
    """Return a server of the page in the present loop, and its address.

    `watch` is called with what computes for each visitor.  Raises a RunError where the port cannot
    be had.
    """

    def show(document: Document) -> None:
        background = Background()
        watch(background)
        document.on_session_destroyed(lambda session: background.close())
        Page(points, document, background).attach()

    try:
        with socket.create_server((HOST, port)):
            pass  # tornado would leave a socket open where it cannot have the port
        sockets, port = bind_sockets(HOST, port)
    except OSError as error:
        raise RunError(
            f"port {port} cannot be had ({error.strerror}): give another one with --port, or 0 for "
            f"any that is free"
        ) from error
    hosts = [f"{name}:{port}" for name in NAMES] + (list(NAMES) if port == HTTP_PORT else [])
    application = BokehTornado(
        {"/": Application(FunctionHandler(show))}, extra_websocket_origins=hosts
    )
    address = f"http://{HOST}:{port}/"
    http = HTTPServer(_Door(application, hosts, address))
    http.add_sockets(sockets)
    return BaseServer(IOLoop.current(), application, http), address


class _Door(Router):
    """Lets in what browsers of this machine ask of this page.

    The name server of another site may say that its name is this machine, and a browser then takes
    this page for one of that site, which may read all of it: but it tells the name that it asked.
    """

    def __init__(self, application: BokehTornado, hosts: list[str], address: str) -> None:
        self.application = application
        self.hosts = hosts
        self.origins = (None, *(f"http://{host}" for host in hosts))
        self.address = address

    def find_handler(self, request: HTTPServerRequest, **kwargs: Any) -> HTTPMessageDelegate | None:
        """Return what answers a request; what there is not has no answer but that."""
        known = request.host.lower() in self.hosts
        if not known or request.headers.get("Origin") not in self.origins:
            answer = self.application.get_handler_delegate(
                request, _Refusal, {"address": self.address}
            )
        elif SERVED.fullmatch(request.path):
            answer = self.application.find_handler(request, **kwargs)
        else:
            answer = None
        return answer  # type: ignore[no-any-return]


class _Refusal(RequestHandler):
    """Says at which address the page is."""

    def initialize(self, address: str) -> None:
        """Take what tornado was given for it."""
        self.address = address

    def prepare(self) -> None:
        """Answer a request of any method."""
        self.set_status(403)
        self.finish(f"This page is for browsers of its own machine, at {self.address}\n")
