"""The server and the page in a file."""

import asyncio
import http.client
import re
import threading
from contextlib import contextmanager
from itertools import product

import pytest
from bokeh.client import pull_session
from tornado.ioloop import IOLoop

from vibrosweep.errors import ExistingOutputError, OutputError
from vibrosweep.explorer import static
from vibrosweep.explorer.server import opened
from vibrosweep.explorer.static import Limits, page_text, write_page

# The server gives browsers of this machine all of the page, and anybody else nothing.

PATHS = (
    "/",
    "/ws",
    "/static/js/bokeh.min.js",
    "/favicon.ico",
    "/metadata",
    "/autoload.js?bokeh-autoload-element=x",
    "/nothing",
)
OWN = ("localhost:{}", "127.0.0.1:{}", "[::1]:{}", "LOCALHOST:{}")
FOREIGN = (
    "example.org:{}",
    "example.org",
    "localhost",
    "localhost:1",
    "localhost:{}0",
    "localhost.example.org:{}",
    "127.0.0.1.example.org:{}",
    "0.0.0.0:{}",
)
# every path once, and every header on the two paths that hand out a session
SESSIONS = PATHS[:2]
HUB = "https://hub.example.org"
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    "Sec-WebSocket-Version": "13",
}


@contextmanager
def serving(points, framing=()):
    """Yield the port of a server that runs in a thread."""
    made, found = threading.Event(), []

    def serve():
        asyncio.set_event_loop(asyncio.new_event_loop())
        loop = IOLoop.current()
        server, address = opened(points, 0, lambda background: None, framing)
        server.start()
        found.extend([loop, int(address.strip("/").rpartition(":")[2])])
        made.set()
        loop.start()
        server.stop()
        loop.run_sync(server._http.close_all_connections)
        loop.close()

    thread = threading.Thread(target=serve)
    thread.start()
    assert made.wait(60.0)
    yield found[1]
    found[0].add_callback(found[0].stop)
    thread.join(60.0)


@pytest.fixture(scope="module")
def port(points):
    with serving(points) as found:
        yield found


@pytest.fixture
def ask(port):
    """Send a request as a browser does that knows the server by a host name."""
    return asking(port)


def asking(port):
    def answer(path, method="GET", host="localhost:{}", **headers):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        headers = {name: value.format(port) for name, value in headers.items()}
        connection.request(method, path, headers={"Host": host.format(port), **headers})
        found = connection.getresponse()
        found.text = "" if found.status == 101 else found.read().decode(errors="replace")
        connection.close()
        return found

    return answer


def assert_refused(found):
    assert found.status == 403
    assert "for browsers on its own machine" in found.text or not found.text
    assert "docs_json" not in found.text


@pytest.mark.parametrize(
    ("host", "path"),
    [
        *((host, path) for host in FOREIGN for path in SESSIONS),
        *((FOREIGN[0], p) for p in PATHS[2:]),
    ],
)
def test_requests_under_foreign_host_names_are_refused(ask, path, host):
    """The name server of another site may resolve the site's name to this machine."""
    upgrade = UPGRADE if path == "/ws" else {}
    assert_refused(ask(path, host=host, **upgrade))
    assert_refused(ask(path, host=host, Origin=f"http://{host}", **upgrade))


@pytest.mark.parametrize("path", PATHS)
def test_requests_of_pages_of_other_origins_are_refused(ask, path):
    upgrade = UPGRADE if path == "/ws" else {}
    origins = ("http://example.org:{}", "https://localhost:{}", "null")
    for method in ("GET", "HEAD", "POST", "OPTIONS"):
        for origin in origins if path in SESSIONS else origins[:1]:
            assert_refused(ask(path, method, Origin=origin, **upgrade))


def test_the_page_is_served_under_every_name_of_this_machine(ask):
    page = ask("/", host=OWN[-1])
    assert page.status == 200
    token = re.search(r'"token":"([^"]+)"', page.text)[1]
    headers = {**UPGRADE, "Sec-WebSocket-Protocol": f"bokeh, {token}"}
    for host in OWN:
        for script in re.findall(r'src="(/?static/[^"]+)"', page.text):
            assert ask(f"/{script.lstrip('/')}", host=host).status == 200
        assert ask("/ws", host=host, Origin=f"http://{host.lower()}", **headers).status == 101


@pytest.mark.parametrize("path", PATHS)
def test_no_answer_lets_pages_of_other_origins_read_it(ask, path):
    for method in ("GET", "OPTIONS"):
        found = ask(path, method, Origin="http://localhost:{}", Cookie="a=b")
        assert not [name for name, _ in found.getheaders() if "access-control" in name.lower()]


def fetched(site, mode, dest):
    return {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": mode, "Sec-Fetch-Dest": dest}


LOADS = [
    ("no-cors", "image"),
    ("no-cors", "script"),
    ("cors", "empty"),
    ("websocket", "websocket"),
    ("navigate", "embed"),
    ("navigate", "object"),
]


@pytest.mark.parametrize("path", PATHS)
def test_what_pages_of_other_sites_load_makes_no_session(ask, path):
    """Such requests need not carry the header ``Origin``."""
    upgrade, sites = UPGRADE if path == "/ws" else {}, ("cross-site", "same-site", "anything")
    for site, load in product(sites, LOADS if path in SESSIONS else LOADS[:1]):
        assert_refused(ask(path, **fetched(site, *load), **upgrade))


@pytest.mark.parametrize("site", ["cross-site", "none"])
def test_a_link_that_is_followed_opens_the_page(ask, site):
    found = ask("/", **fetched(site, "navigate", "document"))
    assert found.status == 200
    assert "docs_json" in found.text


def test_only_named_origins_may_show_the_page_in_a_frame(points, ask):
    named = (HUB, "http://localhost:8888")
    with serving(points, named) as other:
        for asked, framing in ((ask, ()), (asking(other), named)):
            found = asked("/", **fetched("cross-site", "navigate", "iframe"))
            assert found.status == (200 if framing else 403)
            policy = " ".join(["frame-ancestors 'self'", *framing])
            for answer in (found, asked("/static/js/bokeh.min.js")):
                assert answer.getheader("Content-Security-Policy") == policy


def test_only_what_the_page_asks_for_is_served(ask):
    """The script that embeds the page in another one is not served."""
    assert [ask(path).status for path in PATHS[4:]] == [404] * 3


# the values themselves are those of test_live.py; the client takes long
# the client of Bokeh makes a loop as Python 3.12 before 3.12.4 no longer likes
@pytest.mark.weekly
@pytest.mark.filterwarnings("ignore:There is no current event loop:DeprecationWarning")
def test_a_value_that_comes_by_the_socket_is_clipped_to_the_range_of_its_widget(port):
    session = pull_session(url=f"http://localhost:{port}/")
    slider = session.document.get_model_by_name("particles")
    slider.end = 1e7
    slider.value = 1e6
    session.pull()  # what the server has now
    slider, status = (session.document.get_model_by_name(n) for n in ("particles", "status"))
    assert slider.value == slider.end == 100
    assert "not computed" not in status.text
    session.close()


# The page in a file.


def test_a_page_is_one_file_that_says_what_it_holds(points, tmp_path):
    limits, path = Limits(points=20, motions=3), tmp_path / "page.html"
    said = write_page(points, path, force=False, limits=limits)
    text = path.read_text("utf-8")
    assert "20 of 30 points; a click shows the nearest of 3 realizations" in said
    assert "20 of 30 points" in text
    # nothing is fetched: scripts and styles are in the file
    assert not re.search(r"<(script|link|img)[^>]*\b(src|href)\s*=\s*.?(?!data:)\w+:", text)
    with pytest.raises(ExistingOutputError):
        write_page(points, path, force=False)


def test_a_page_that_would_be_too_large_gets_fewer_motions_or_is_refused(monkeypatch):
    class Page:
        """A page of a byte for each motion."""

        def __init__(self, points, limits):
            self.kept, self.contents = range(limits.motions), f"{limits.motions} motions"

        def html(self):
            return "x" * len(self.kept)

    monkeypatch.setattr(static, "_Page", Page)
    assert page_text(None, "p.html", Limits(size=40, motions=150))[1] == "37 motions"
    with pytest.raises(OutputError, match=r"p\.html: would have 1 bytes, more than 0"):
        page_text(None, "p.html", Limits(size=0, motions=5))
