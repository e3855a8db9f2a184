"""``vibrosweep examples``: list the sweep files that come with the package, and copy them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from vibrosweep.commands.arguments import directory

# In an installed package, and in its source tree
PLACES: Final = (Path(__file__).parents[1] / "sweeps", Path(__file__).parents[3] / "sweeps")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("names", metavar="NAME", nargs="*", help="example to copy, as listed")
    parser.add_argument("--all", action="store_true", help="copy all")
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=directory,
        default=Path(),
        help="copy there; default: here",
    )
    parser.add_argument("--force", action="store_true", help="replace existing files")


def perform(options: argparse.Namespace) -> None:
    files = examples_in(PLACES)
    if options.all:
        _copy(files, options.output, force=options.force)
    elif options.names:
        _copy(_chosen(files, options.names), options.output, force=options.force)
    else:
        _list(files)


def examples_in(places: Sequence[Path]) -> dict[str, Path]:
    """Return the files of the first place that has any, by name.

    A name is the path without suffix, with slashes on every system.
    """
    from vibrosweep.errors import DataError

    for place in places:
        names = sorted(
            p.relative_to(place).with_suffix("").as_posix() for p in place.rglob("*.toml")
        )
        if names:
            return {name: place / f"{name}.toml" for name in names}
    raise DataError(f"{places[0]}: the example sweeps are missing; install vibrosweep again")


def _list(files: dict[str, Path]) -> None:
    import tomllib

    width = max(map(len, files))
    for name, path in files.items():
        title = tomllib.loads(path.read_text(encoding="utf-8"))["title"]
        print(f"{name:{width}}  {title}")
    print("\nvibrosweep examples NAME... copies some to this directory, --all copies all")


def _chosen(files: dict[str, Path], names: list[str]) -> dict[str, Path]:
    """Return the named files; ``paper`` and ``paper.toml`` name the same file."""
    from vibrosweep.errors import ParameterError

    wanted = [name.removesuffix(".toml") for name in names]
    unknown = [name for name in wanted if name not in files]
    if unknown:
        raise ParameterError(
            f"no example is called {', '.join(unknown)}; there are {', '.join(files)}"
        )
    return {name: files[name] for name in wanted}


def _copy(files: dict[str, Path], directory: Path, *, force: bool) -> None:
    """Copy files below a directory, with the traces that they read; all of them or none."""
    import re

    from vibrosweep.store.disk import check_output, make_directory, replacing

    copies = {directory / f"{name}.toml": path for name, path in files.items()}
    copies |= {
        copy.with_name(trace): path.with_name(trace)
        for copy, path in copies.items()
        for trace in re.findall(r'trace = "([^"/]+)"', path.read_text(encoding="utf-8"))
    }
    for copy in copies:
        make_directory(copy.parent)
        check_output(copy, force=force)
    for copy, path in copies.items():
        with replacing(copy, force=force) as file:
            file.write(path.read_bytes())
        print(copy)
