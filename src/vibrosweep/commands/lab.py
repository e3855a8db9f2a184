"""``vibrosweep lab``: measure bouncing balls in films and recordings of impacts."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from vibrosweep.commands import (
    JSON,
    QUIET,
    directory,
    output_file,
    positive,
    say,
    some,
    tell,
    whole,
)
from vibrosweep.commands.pictures import drawing
from vibrosweep.errors import ParameterError, TrackError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from vibrosweep.figures.style import Panels
    from vibrosweep.lab.fitting import Setup
    from vibrosweep.lab.recordings import Recording
    from vibrosweep.store.reading import ResultKind


# Options for physical parameters of a scene
PHYSICAL: Final = (
    *("gravity", "frequency", "restitution", "amplitude", "phase", "contact_time"),
    "restitution_speed",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command and its subcommands."""
    parts = parser.add_subparsers(title="parts", metavar="PART", required=True)

    def part(name: str, words: str, example: str) -> argparse.ArgumentParser:
        text = f"example: vibrosweep lab {name} {example}"
        added = parts.add_parser(name, help=words, description=words, epilog=text)
        JSON.add_to(added)
        QUIET.add_to(added)
        return added

    synthesize = part("synthesize", "film a virtual experiment", "experiment.toml -o tracks")
    synthesize.add_argument("spec", metavar="SPEC.toml", type=Path)
    synthesize.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=directory,
        default=Path("tracks"),
        help="folder for the recordings; default: tracks",
    )
    synthesize.add_argument("--force", action="store_true", help="replace existing files")
    synthesize.set_defaults(part=_synthesize)

    impacts = part(
        "impacts",
        "find the landings in tracks, or measure a shaken base from times of impacts",
        "track.csv --frequency 20 -o impacts.h5",
    )
    _add_tracks(impacts)
    impacts.add_argument("--frequency", metavar="HZ", type=float, help="forcing frequency")
    impacts.add_argument(
        "--gravity",
        metavar="G",
        type=_range,
        default=9.81,
        help="m/s^2, or a range LOW:HIGH if the scale is uncertain; default: 9.81",
    )
    impacts.add_argument(
        "--phase", metavar="RAD", type=float, default=0.0, help="phase of the forcing at t = 0"
    )
    for name, unit, words in (("mass", "KG", "mass of a ball"), ("diameter", "M", "its diameter")):
        text = f"{words}, for drag in air over a moving base"
        impacts.add_argument(f"--{name}", metavar=unit, type=float, help=text)
    impacts.set_defaults(part=_impacts)

    words = "measure the restitution of a ball on a floor at rest"
    _add_restitution(part("restitution", words, "drop1.csv drop2.csv --scale gravity"))

    compare = part("compare", "compare tracks with prediction", "trial*.csv --frequency 20")
    _add_tracks(compare)
    for name, unit in (("frequency", "HZ"), ("restitution", "E"), ("amplitude", "M/S")):
        compare.add_argument(f"--{name}", metavar=unit, type=float, help="default: estimated")
    compare.add_argument("--phase", metavar="RAD", type=float, help="at t = 0; default: estimated")
    compare.add_argument(
        "--restitution-law", metavar="LAW", default="constant", help="law of restitution"
    )
    compare.add_argument("--restitution-speed", metavar="M/S", type=float, help="its speed")
    compare.add_argument(
        "--gravity", metavar="G", type=float, default=9.81, help="m/s^2; default: 9.81"
    )
    compare.add_argument("--contact-time", metavar="S", type=float, help="default: 1e-4")
    compare.add_argument(
        "--draws",
        metavar="N",
        type=positive,
        default=64,
        help="number of random parameter sets; default: 64",
    )
    compare.add_argument(
        "--seed", metavar="S", type=whole, default=0, help="random seed; default: 0"
    )
    compare.set_defaults(part=_compare)


def _range(text: str) -> float | tuple[float, float]:
    """Read a number, or two separated by a colon."""
    try:
        low, *high = map(float, text.split(":"))
    except ValueError:
        high = [0.0, 0.0]
    if len(high) > 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number, or a range such as 0.1:0.2")
    return (low, high[0]) if high else low


def _scale(text: str) -> float | str:
    """Read m per unit, or the word gravity."""
    if text == "gravity":
        return text
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number, or "gravity"') from None


def _add_restitution(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "tracks", metavar="FILES", type=Path, nargs="+", help="films, or times of impacts"
    )
    for name, unit, words in (
        ("drop-height", "M", "drop height, to use the first fall too"),
        ("contact", "S", "contact time; default: 0.0002:0.005"),
        ("gravity", "G", "m/s^2; default: 9.81"),
    ):
        default = 9.81 if name == "gravity" else None
        text = f"{words}; a number, or a range LOW:HIGH"
        parser.add_argument(f"--{name}", metavar=unit, type=_range, default=default, help=text)
    for name, unit, words in (
        ("mass", "KG", "mass of the ball, for drag in air"),
        ("diameter", "M", "its diameter"),
        ("frame-rate", "HZ", "frames per second of the camera"),
        ("from", "S", "start of the part to use"),
        ("to", "S", "its end"),
    ):
        parser.add_argument(f"--{name}", metavar=unit, type=float, help=words)
    parser.add_argument(
        "--scale", metavar="M", type=_scale, help='metres per unit of the file, or "gravity"'
    )
    parser.add_argument("--axis", choices=("up", "down"), help="direction in which heights grow")
    for name in ("column", "particle", "sheet"):
        parser.add_argument(f"--{name}", metavar="NAME", help=f"{name} to read")
    parser.add_argument(
        "-o", "--output", metavar="OUT.h5", type=output_file, help="result file to write"
    )
    parser.add_argument("--figures", metavar="DIR", type=directory, help="folder for figures")
    parser.add_argument("--force", action="store_true", help="replace an existing output")
    parser.set_defaults(part=_restitution)


def _add_tracks(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "tracks", metavar="TRACKS", type=Path, nargs="+", help="files, one recording each"
    )
    parser.add_argument(
        "--together", action="store_true", help="all files are particles of one recording"
    )
    parser.add_argument("--frame-rate", metavar="HZ", type=float, help="frames per second")
    parser.add_argument("--scale", metavar="M", type=float, help="metres per unit of the file")
    parser.add_argument("--axis", choices=("up", "down"), help="direction in which heights grow")
    parser.add_argument("--base", metavar="Y", type=float, help="height of the base in the file")
    parser.add_argument(
        "--contact",
        metavar="S",
        type=_range,
        help="contact time over a moving base, or a range LOW:HIGH; default: 0",
    )
    parser.add_argument(
        "--base-motion",
        choices=("detect", "level", "moving"),
        default="detect",
        help="motion of the base; by default the landings decide",
    )
    parser.add_argument(
        "--base-trace",
        metavar="TABLE",
        type=Path,
        help="measured height or acceleration of the base",
    )
    parser.add_argument(
        "--column", metavar="NAME", help="column of values in the trace, or else in the tracks"
    )
    for name in ("particle", "sheet"):
        parser.add_argument(f"--{name}", metavar="NAME", help=f"{name} to read")
    parser.add_argument("--base-track", metavar="NAME", help="particle that is a mark on the base")
    parser.add_argument(
        "--exposure", metavar="S", type=float, default=0.0, help="exposure time; default: 0"
    )
    parser.add_argument(
        "--method",
        choices=("fit", "sign_change"),
        default="fit",
        help="intersect parabolas, or find the sign change of the velocity; default: fit",
    )
    parser.add_argument(
        "-o", "--output", metavar="OUT.h5", type=output_file, help="result file to write"
    )
    parser.add_argument("--figures", metavar="DIR", type=directory, help="folder for figures")
    parser.add_argument("--force", action="store_true", help="replace an existing output")


def perform(options: argparse.Namespace) -> None:
    options.part(options)


def _synthesize(options: argparse.Namespace) -> None:
    from vibrosweep.lab.experiment import read_experiments
    from vibrosweep.lab.trials import write_experiments

    spec = read_experiments(options.spec)
    written = write_experiments(
        spec.experiments, options.output, options.spec.stem, force=options.force
    )
    title, recordings = spec.title or options.spec.stem, len(written) // 2
    count = f"{some(recordings, 'recording')} and their true landings in {options.output}"
    say(options, title, count)
    tell(options, {"title": title, "recordings": recordings, "output": options.output})


def _recordings(options: argparse.Namespace) -> list[xr.Dataset]:
    """Check the options, and read the tracks."""
    from vibrosweep.lab.recordings import read_tracks
    from vibrosweep.model.parameters import OF_RESTITUTION, PARAMETERS
    from vibrosweep.store.disk import check_output

    known = {**PARAMETERS, **OF_RESTITUTION}
    for name in PHYSICAL:
        value = getattr(options, name, None)
        if isinstance(value, float) and not known[name].accepts(value):
            key = name.replace("_", "-")
            raise ParameterError(f"--{key} {value:g}: must be {known[name].allowed}")
    if options.base is not None and not math.isfinite(options.base):
        raise TrackError(f"--base {options.base:g}: must be a finite number")
    if not 0.0 <= options.exposure <= 1.0:
        raise TrackError(f"--exposure {options.exposure:g}: must be at least 0 and at most 1 s")
    if options.output is not None:
        check_output(options.output, force=options.force, inputs=options.tracks)
    groups = [options.tracks] if options.together else [[path] for path in options.tracks]
    names = ("frame_rate", "scale", "axis", "base", "base_track", "particle", "sheet")
    how = {name: getattr(options, name) for name in names}
    how["column"] = None if options.base_trace else options.column
    recordings = [read_tracks(group, **how) for group in groups]
    for tracks in recordings:
        if "remarks" in tracks.attrs:
            say(options, tracks.attrs["remarks"])
    return recordings


def _setup(options: argparse.Namespace) -> Setup:
    """Return the information about the recordings in the options."""
    from vibrosweep.lab.fitting import Setup
    from vibrosweep.lab.impacts import gravity_of, inputs_of
    from vibrosweep.lab.traces import read_trace

    return Setup(
        None if options.base is None else 0.0,
        options.exposure,
        options.base_motion,
        options.frequency,
        None
        if options.base_trace is None
        else read_trace(options.base_trace, column=options.column),
        inputs_of(
            options.contact,
            getattr(options, "mass", None),
            getattr(options, "diameter", None),
            gravity_of(options.gravity),
        ),
    )


def _lists_of_times(options: argparse.Namespace) -> list[list[Recording]] | None:
    """Return the times of impacts of each recording; None if the files hold tracks."""
    from vibrosweep.lab.recordings import read_recordings

    groups = [options.tracks] if options.together else [[path] for path in options.tracks]
    how = {name: getattr(options, name) for name in ("particle", "sheet")}
    column = None if options.base_trace else options.column
    try:
        lists = [read_recordings(group, column=column, **how) for group in groups]
    except TrackError:
        return None  # the reader of tracks has reported the error
    timed = [recording.height is None for one in lists for recording in one]
    return lists if timed and all(timed) else None


def _impact_times(options: argparse.Namespace, lists: list[list[Recording]]) -> None:
    """Measure a shaken base from times alone."""
    from vibrosweep.api.result_kinds import RESTITUTION
    from vibrosweep.lab.lines import numbers_of, restitution_lines
    from vibrosweep.lab.shaken_times import times_on_shaker
    from vibrosweep.store.disk import check_output

    if options.output is not None:
        check_output(options.output, force=options.force, inputs=options.tracks)
        if len(lists) > 1:
            raise TrackError(
                f"{options.output}: holds one recording, but there are {len(lists)}; write them "
                f"one by one, or add --together"
            )
    how = {name: getattr(options, name) for name in ("frequency", "contact", "gravity")}
    numbers = []
    for recordings in lists:
        found = times_on_shaker(recordings, **how)
        say(options, *restitution_lines(found))
        numbers.append(numbers_of(found))
    tell(options, {"recordings": numbers})

    def draw() -> Axes:
        from vibrosweep.figures.laboratory import restitution_by_speed

        return restitution_by_speed(found)

    _write_result(options, found, RESTITUTION, draw, RESTITUTION.stem)


def _impacts(options: argparse.Namespace) -> None:
    from vibrosweep.api.result_kinds import IMPACTS
    from vibrosweep.lab.fitting import fit_tracks
    from vibrosweep.lab.impacts import agreement, gravity_of, impacts_of, quantities
    from vibrosweep.lab.lines import agreement_lines, flights_of, impact_lines, numbers_of

    try:
        recordings = _recordings(options)
    except TrackError:
        lists = _lists_of_times(options)
        if lists is None:
            raise
        _impact_times(options, lists)
        return
    if options.output is not None and len(recordings) > 1:
        raise TrackError(
            f"{options.output}: holds the landings of one recording, but there are "
            f"{len(recordings)}; write them one by one, or add --together"
        )
    setup, summaries = _setup(options), []
    gravity = gravity_of(options.gravity).value
    for tracks in recordings:
        fitted = fit_tracks(tracks, gravity, setup)
        found = impacts_of(tracks, fitted, gravity, options.method)
        say(options, *impact_lines(found))
        summaries.append(quantities(found, frequency=options.frequency, phase=options.phase))
    agreed = agreement(summaries)
    say(options, *agreement_lines(agreed))
    numbers = [numbers_of(summary) for summary in summaries]
    tell(options, {"recordings": numbers, "agreement": numbers_of(agreed)})

    def draw() -> Panels:
        from vibrosweep.figures.laboratory import fitted_track

        return fitted_track(flights_of(tracks, fitted))

    _write_result(options, found, IMPACTS, draw, "lab_track")


def _compare(options: argparse.Namespace) -> None:
    from vibrosweep.api.result_kinds import COMPARISON
    from vibrosweep.engine.workers import Workers
    from vibrosweep.lab.compare import ComparisonOptions, compare
    from vibrosweep.lab.lines import numbers_of, table_lines
    from vibrosweep.runs.driver import available_threads

    recordings = _recordings(options)
    known = {n: getattr(options, n) for n in PHYSICAL if getattr(options, n) is not None}
    how = ComparisonOptions(
        known=known,
        method=options.method,
        setup=_setup(options),
        draws=options.draws,
        seed=options.seed,
        restitution_law=options.restitution_law,
    )
    with Workers(available_threads()) as workers:
        table = compare(recordings, how, workers)
    say(options, *table_lines(table))
    tell(options, numbers_of(table))
    _write_result(options, table, COMPARISON, lambda: COMPARISON.axes(table), COMPARISON.stem)


def _restitution(options: argparse.Namespace) -> None:
    from vibrosweep.api.result_kinds import RESTITUTION
    from vibrosweep.lab.drops import restitution
    from vibrosweep.lab.lines import numbers_of, restitution_lines
    from vibrosweep.lab.recordings import read_recordings
    from vibrosweep.store.disk import check_output

    if options.output is not None:
        check_output(options.output, force=options.force, inputs=options.tracks)
    free = options.scale == "gravity"
    reading = ("frame_rate", "axis", "column", "particle", "sheet")
    recordings = read_recordings(
        options.tracks,
        scale=None if free else options.scale,
        **{name: getattr(options, name) for name in reading},
    )
    about = ("contact", "mass", "diameter", "gravity", "drop_height")
    found = restitution(
        recordings,
        **{name: getattr(options, name) for name in about},
        scale_from_gravity=free,
        begin=getattr(options, "from"),
        end=options.to,
    )
    say(options, *restitution_lines(found))
    tell(options, numbers_of(found))

    def draw() -> Axes:
        from vibrosweep.figures.laboratory import restitution_by_speed

        return restitution_by_speed(found)

    _write_result(options, found, RESTITUTION, draw, RESTITUTION.stem)
    if options.figures is not None and "sample_time" in found:
        from vibrosweep.figures.laboratory import film_of_drop
        from vibrosweep.figures.registry import save_formats
        from vibrosweep.figures.style import for_file

        with drawing(None):
            save_formats(for_file(lambda: film_of_drop(found)), options.figures, "lab_drop_film")


def _write_result(
    options: argparse.Namespace,
    result: xr.Dataset,
    kind: ResultKind,
    draw: Callable[[], Axes | Panels],
    stem: str,
) -> None:
    """Write a result and its figure, if requested."""
    if options.output is not None:
        from vibrosweep.store.writing import write_dataset

        write_dataset(result, options.output, kind, force=options.force)
        say(options, f"written to {options.output}")
    if options.figures is not None:
        from vibrosweep.figures.registry import save_formats
        from vibrosweep.figures.style import for_file

        with drawing(options.output):
            for path in save_formats(for_file(draw), options.figures, stem):
                say(options, str(path))
