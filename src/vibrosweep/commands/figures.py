"""``vibrosweep figures``: draw the figures of a result file."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.commands.arguments import directory
from vibrosweep.errors import DataError

if TYPE_CHECKING:
    import xarray as xr


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("result", metavar="OUT.h5", type=Path)
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=directory,
        default=Path("figures"),
        help="default: figures",
    )


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.store.reading import using

    with using(options.result):
        _draw(options.result, options.output)


def _draw(path: Path, directory: Path) -> None:
    from vibrosweep.analysis.ragged import as_rectangle
    from vibrosweep.api.results import has_record, open_record, open_sweep
    from vibrosweep.figures.registry import FIGURES, left_out, save_all, save_formats
    from vibrosweep.figures.style import for_file
    from vibrosweep.store.kinds import SWEEP, load_dataset, read_kind

    kind = read_kind(path)
    if kind is not SWEEP:
        figure = for_file(kind.axes, load_dataset(path))
        print("\n".join(map(str, save_formats(figure, directory, kind.stem or kind.name))))
        return
    needed = {name for entry in FIGURES.values() for name in entry.needs.variables}

    def without_particles(sweep: xr.Dataset) -> xr.Dataset:
        """Leave out variables of single particles that no figure needs, since they may be large."""
        single = {name for name, one in sweep.variables.items() if "particle" in one.dims}
        return sweep.drop_vars(single - needed)

    sweep = _loaded(path, open_sweep, without_particles)
    record = _loaded(path, open_record, as_rectangle) if has_record(path) else None
    for written in save_all(sweep, record, directory):
        print(written)
    if line := left_out(sweep, record):
        print(line)


def _loaded(
    path: Path, opener: Callable[[Path], xr.Dataset], part: Callable[[xr.Dataset], xr.Dataset]
) -> xr.Dataset:
    """Load the part of a dataset that figures need."""
    with opener(path) as dataset:
        try:
            return part(dataset).load()
        except (OSError, RuntimeError) as error:
            raise DataError(f"{path}: is damaged; compute it again") from error
