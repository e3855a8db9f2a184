"""The server of the page, which answers only browsers on this machine."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from threading import Thread
from typing import Any, Final
from weakref import WeakSet

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPHeaders, HTTPMessageDelegate, HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.routing import Router
from tornado.web import OutputTransform, RequestHandler

from vibrosweep.errors import RunError
from vibrosweep.explorer.live import Background, Page
from vibrosweep.explorer.pictures import moving_point
from vibrosweep.explorer.points import Points
from vibrosweep.system import ENDINGS

HOST: Final = "localhost"
NAMES: Final = (HOST, "127.0.0.1", "[::1]")  # names by which this machine calls itself
# Paths that a page requests; Bokeh serves more, for documents embedded in other sites
SERVED: Final = re.compile(r"/|/ws|/favicon\.ico|/static/.*")
HTTP_PORT: Final = 80  # the port that browsers leave out of an address
OWN: Final = (None, "same-origin", "none")  # who asks: this page, the visitor, or an old browser


def serve(
    points: Points, port: int, started: Callable[[str], None], framing: Sequence[str] = ()
) -> None:
    """Serve the page until a signal ends it; port 0 means any free one.

    `started` is called with the address once the page can be opened.  Pages of the origins
    `framing` may show it in a frame.  Raises a RunError if the port is not free.
    """
    backgrounds = WeakSet[Background]()
    server, address = opened(points, port, backgrounds.add, framing)
    loop = server.io_loop
    for number in ENDINGS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            # an exception that a signal raises in a callback would be logged with a traceback
            signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
    server.start()
    started(address)
    loop.start()
    server.stop()
    if any(background.busy for background in backgrounds):
        # Python would wait for the compilation, then print a traceback
        sys.stdout.flush()
        os._exit(0)


def serve_beside(points: Points, port: int, framing: Sequence[str]) -> str:
    """Serve the page in a separate thread until Python ends; return its address.

    Raises a RunError if the port is not free.
    """
    begun: Future[str] = Future()

    def run() -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            server, address = opened(points, port, lambda background: None, framing)
        except RunError as error:
            begun.set_exception(error)
            return
        server.start()
        begun.set_result(address)
        server.io_loop.start()

    Thread(target=run, name="vibrosweep explore", daemon=True).start()
    return begun.result()


def opened(
    points: Points,
    port: int,
    watch: Callable[[Background], object],
    framing: Sequence[str] = (),
) -> tuple[BaseServer, str]:
    """Return a server of the page in the present loop, and its address.

    `watch` is called with each `Background`: one for all, and one of each visitor.  Pages of the
    origins `framing` may show the page in a frame.  Raises a RunError if the port is not free.
    """

    def show(document: Document) -> None:
        background = Background()
        watch(background)
        document.on_session_destroyed(lambda session: background.close())
        Page(points, document, background, first).attach()

    try:
        with socket.create_server((HOST, port)):
            pass  # if the port were taken, tornado would leave a socket open
        sockets, port = bind_sockets(HOST, port)
    except OSError as error:
        raise RunError(
            f"port {port} is not available ({error.strerror}): give another one with --port, or 0 "
            f"for any that is free"
        ) from error
    early = Background()
    watch(early)
    # kernels are loaded or compiled while the browser loads the page
    first = early.call(partial(moving_point, points)).result
    hosts = [f"{name}:{port}" for name in NAMES] + (list(NAMES) if port == HTTP_PORT else [])
    application = BokehTornado(
        {"/": Application(FunctionHandler(show))}, extra_websocket_origins=hosts
    )
    application.add_transform(_framed(framing))
    address = f"http://{HOST}:{port}/"
    http = HTTPServer(_LocalRouter(application, hosts, address, framing))
    http.add_sockets(sockets)
    return BaseServer(IOLoop.current(), application, http), address


class _LocalRouter(Router):
    """Router that accepts requests of browsers on this machine for this page, and no others.

    The name server of another site may resolve its name to this machine (DNS rebinding).  A browser
    then takes this page for one of that site, whose scripts may read it; but the request still
    carries the other name in its header ``Host``.

    A page of another site may load this one as a picture, a script or a frame; it cannot read the
    answer, but each such load would make a session here.  Browsers say in ``Sec-Fetch-Site`` that
    the request comes from elsewhere; only that of a link that a visitor follows is answered.
    """

    def __init__(
        self, application: BokehTornado, hosts: list[str], address: str, framing: Sequence[str]
    ) -> None:
        self.application = application
        self.hosts = hosts
        # what a browser may do with a page that it was led to from another site
        self.destinations = ("document", "iframe") if framing else ("document",)
        self.origins = (None, *(f"http://{host}" for host in hosts))
        self.address = address

    def find_handler(self, request: HTTPServerRequest, **kwargs: Any) -> HTTPMessageDelegate | None:
        """Return the handler of a request; None, which is a 404, for an unknown path."""
        known = request.host.lower() in self.hosts
        if not (known and self._invited(request)):
            answer = self.application.get_handler_delegate(
                request, _Refusal, {"address": self.address}
            )
        elif SERVED.fullmatch(request.path):
            answer = self.application.find_handler(request, **kwargs)
        else:
            answer = None
        return answer  # type: ignore[no-any-return]

    def _invited(self, request: HTTPServerRequest) -> bool:
        """Return whether this page, its visitor, or a link that was followed makes the request."""
        headers = request.headers
        if headers.get("Origin") not in self.origins:
            return False
        if headers.get("Sec-Fetch-Site") in OWN:
            return True
        leads = request.path == "/" and headers.get("Sec-Fetch-Mode") == "navigate"
        return leads and headers.get("Sec-Fetch-Dest") in self.destinations


def _framed(framing: Sequence[str]) -> type[OutputTransform]:
    """Make every answer say which origins may show it in a frame."""
    policy = " ".join(["frame-ancestors 'self'", *framing])

    class Framed(OutputTransform):
        def transform_first_chunk(
            self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
        ) -> tuple[int, HTTPHeaders, bytes]:
            headers["Content-Security-Policy"] = policy
            return status_code, headers, chunk

    return Framed


class _Refusal(RequestHandler):
    """Handler that refuses a request, and names the address of the page."""

    def initialize(self, address: str) -> None:
        """Take the address from the arguments of the handler."""
        self.address = address

    def prepare(self) -> None:
        """Answer a request of any method."""
        self.set_status(403)
        self.finish(f"This page is for browsers on its own machine, at {self.address}\n")
