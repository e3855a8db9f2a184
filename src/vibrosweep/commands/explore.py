"""``vibrosweep explore``: look at a result in a browser, and at the motion behind every point."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Final

from vibrosweep.commands.arguments import output_file, whole

LAST_PORT: Final = 65535
ORIGIN: Final = re.compile(r"https?://[\w.-]+(:\d+)?|https?://\[[\da-fA-F:]+\](:\d+)?")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("result", metavar="OUT.h5", type=Path, help="the result")
    parser.add_argument(
        "-o",
        "--output",
        metavar="PAGE.html",
        type=output_file,
        help="write one file that works without this program, instead of serving the page",
    )
    parser.add_argument(
        "--boundaries",
        metavar="BORDERS.h5",
        type=Path,
        help="result of vibrosweep boundaries, whose curves are drawn over the plane",
    )
    parser.add_argument("--force", action="store_true", help="replace an existing PAGE.html")
    parser.add_argument(
        "--port", metavar="N", type=_port, default=0, help="port; default: a free one"
    )
    parser.add_argument(
        "--frame-in",
        metavar="ORIGIN",
        type=_origin,
        action="append",
        default=[],
        help="site that may show the page in a frame, such as https://hub.example.org; repeatable",
    )


def _port(text: str) -> int:
    return whole(text, 0, LAST_PORT)


def _origin(text: str) -> str:
    if not ORIGIN.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no origin: give a scheme and a host, such as https://hub.example.org, "
            f"without a path"
        )
    return text


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.explorer import require_bokeh
    from vibrosweep.store.reading import using

    require_bokeh()
    with using(options.result):
        _explore(options)


def _explore(options: argparse.Namespace) -> None:
    from vibrosweep.explorer.points import open_points

    points = open_points(options.result)
    if options.boundaries is not None:
        from vibrosweep.explorer.points import with_borders

        points = with_borders(points, options.boundaries)
    if options.output is not None:
        from vibrosweep.explorer.static import write_page

        print(write_page(points, options.output, force=options.force))
        return
    from vibrosweep.explorer.server import serve

    def started(address: str) -> None:
        print(f"{points.title}: {address} (Ctrl-C ends it)", flush=True)

    serve(points, options.port, started, options.frame_in)


COMMANDS: Final = {"explore": (add_arguments, perform)}
