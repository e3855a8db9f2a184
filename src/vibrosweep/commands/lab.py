"""``vibrosweep lab``: measure bouncing balls in films and recordings of impacts."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibrosweep.commands import (
    FORCE,
    JSON,
    QUIET,
    Argument,
    argument,
    directory,
    folder,
    number,
    output_file,
    say,
    some,
    tell,
)
from vibrosweep.commands.pictures import drawing
from vibrosweep.errors import TrackError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from vibrosweep.figures.style import Panels
    from vibrosweep.lab.recordings import Recording
    from vibrosweep.store.reading import ResultKind


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


def _value(name: str, unit: str, words: str, **settings: Any) -> Argument:
    """Describe an option that is a number unless the settings say otherwise."""
    return argument(f"--{name}", metavar=unit, **{"type": float, "help": words, **settings})


def _files(words: str) -> Argument:
    return argument("tracks", metavar="FILES", type=Path, nargs="+", help=words)


AXIS: Final = argument("--axis", choices=("up", "down"), help="direction in which heights grow")
# Of the parts that read recordings
SHARED: Final = (
    _value("frame-rate", "HZ", "frames per second of the camera"),
    AXIS,
    argument("--particle", metavar="NAME", help="particle to read"),
    argument("--sheet", metavar="NAME", help="sheet to read"),
    argument("-o", "--output", metavar="OUT.h5", type=output_file, help="result file to write"),
    argument("--figures", metavar="DIR", type=directory, help="folder for figures"),
    FORCE,
)
FREQUENCY: Final = _value("frequency", "HZ", "forcing frequency; default: estimated")
TRACKS: Final = (
    _files("files, one recording each"),
    argument("--together", action="store_true", help="all files are particles of one recording"),
    *SHARED,
    FREQUENCY,
    _value("scale", "M", "metres per unit of the file"),
    _value("base", "Y", "height of the base in the file"),
    _value(
        "contact",
        "S",
        "contact time over a moving base, or a range LOW:HIGH; by default 0, or 0.0002:0.005 if "
        "this fits better",
        type=_range,
    ),
    argument(
        "--base-motion",
        choices=("detect", "level", "moving"),
        default="detect",
        help="motion of the base; by default the landings decide",
    ),
    argument(
        "--base-trace",
        metavar="TABLE",
        type=Path,
        help="measured height or acceleration of the base",
    ),
    argument(
        "--column", metavar="NAME", help="column of values in the trace, or else in the tracks"
    ),
    argument("--base-track", metavar="NAME", help="particle that is a mark on the base"),
    _value("exposure", "S", "exposure time; default: 0", default=0.0),
    argument(
        "--method",
        choices=("fit", "sign_change"),
        default="fit",
        help="intersect parabolas, or find the sign change of the velocity; default: fit",
    ),
)
OR_RANGE: Final = "; a number, or a range LOW:HIGH"
IMPACTS: Final = (
    *TRACKS,
    _value(
        "gravity",
        "G",
        "m/s^2, or a range LOW:HIGH if the scale is uncertain; default: 9.81",
        type=_range,
        default=9.81,
    ),
    _value("phase", "RAD", "phase of the forcing at t = 0", default=0.0),
    _value("mass", "KG", "mass of a ball, for drag in air over a moving base"),
    _value("diameter", "M", "its diameter"),
)
COMPARE: Final = (
    *TRACKS,
    _value("gravity", "G", "m/s^2; default: 9.81", default=9.81),
    _value("restitution", "E", "default: estimated"),
    _value("amplitude", "M/S", "default: estimated"),
    _value("phase", "RAD", "at t = 0; default: estimated"),
    _value("restitution-law", "LAW", "law of restitution", type=str, default="constant"),
    _value("restitution-speed", "M/S", "its speed"),
    _value("contact-time", "S", "default: 1e-4"),
    number("draws", "number of random parameter sets", 64),
    number("seed", "random seed", 0, "S"),
)
# Parameters of a prediction that may be given
KNOWN: Final = (
    *("gravity", "frequency", "restitution", "amplitude", "phase", "contact_time"),
    "restitution_speed",
)
RESTITUTION: Final = (
    _files("films, or times of impacts"),
    *SHARED,
    _value("drop-height", "M", f"drop height, to use the first fall too{OR_RANGE}", type=_range),
    _value("contact", "S", f"contact time; default: 0.0002:0.005{OR_RANGE}", type=_range),
    _value("gravity", "G", f"m/s^2; default: 9.81{OR_RANGE}", type=_range, default=9.81),
    _value("mass", "KG", "mass of the ball, for drag in air"),
    _value("diameter", "M", "its diameter"),
    _value("from", "S", "start of the part to use"),
    _value("to", "S", "its end"),
    _value("scale", "M", 'metres per unit of the file, or "gravity"', type=_scale),
    argument("--column", metavar="NAME", help="column to read"),
)
BASE: Final = (
    argument("traces", metavar="TRACE", type=Path, nargs="+", help="height or acceleration"),
    argument("--column", metavar="NAME", help="column to read"),
    _value("gravity", "G", "m/s^2; default: 9.81", default=9.81),
)
SYNTHESIZE: Final = (
    argument("spec", metavar="SPEC.toml", type=Path),
    folder(Path("tracks"), "folder for the recordings; default: tracks"),
    FORCE,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands and their arguments."""
    parts = parser.add_subparsers(title="parts", metavar="PART", required=True)
    for perform_part, words, example, arguments in (
        (_synthesize, "film a virtual experiment", "experiment.toml -o tracks", SYNTHESIZE),
        (
            _impacts,
            "find the landings in tracks, or measure a shaken base from times of impacts",
            "track.csv --frequency 20 -o impacts.h5",
            IMPACTS,
        ),
        (
            _restitution,
            "measure the restitution of a ball on a floor at rest",
            "drop1.csv drop2.csv --scale gravity",
            RESTITUTION,
        ),
        (_base, "measure the motion of a base from its trace", "base.csv", BASE),
        (_compare, "compare tracks with prediction", "trial*.csv --frequency 20", COMPARE),
    ):
        name = perform_part.__name__.strip("_")
        text = f"example: vibrosweep lab {name} {example}"
        added = parts.add_parser(name, help=words, description=words, epilog=text)
        for one in (*arguments, JSON, QUIET):
            one.add_to(added)
        added.set_defaults(part=perform_part)


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


def _check_output(options: argparse.Namespace, recordings: int = 1) -> None:
    """Raise an error if the result file cannot be written."""
    from vibrosweep.store.disk import check_output

    if options.output is None:
        return
    check_output(options.output, force=options.force, inputs=options.tracks)
    if recordings > 1:
        raise TrackError(
            f"{options.output}: holds one recording, but there are {recordings}; write them one by "
            f"one, or add --together"
        )


def _selected(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    return {name: getattr(options, name) for name in names}


def _groups(options: argparse.Namespace) -> list[list[Path]]:
    """Return the files of each recording."""
    return [options.tracks] if options.together else [[path] for path in options.tracks]


def _recordings(options: argparse.Namespace) -> list[xr.Dataset]:
    """Read the tracks."""
    from vibrosweep.lab.recordings import read_tracks

    names = ("frame_rate", "scale", "axis", "base", "base_track", "particle", "sheet")
    how = _selected(options, *names)
    how["column"] = None if options.base_trace else options.column
    recordings = [read_tracks(group, **how) for group in _groups(options)]
    for tracks in recordings:
        if "remarks" in tracks.attrs:
            say(options, tracks.attrs["remarks"])
    return recordings


def _facts(options: argparse.Namespace) -> dict[str, Any]:
    """Return the facts about the recordings, as arguments of `find_impacts`."""
    from vibrosweep.lab.traces import read_trace

    trace = options.base_trace
    return {
        # heights were read relative to the base
        "base": None if options.base is None else 0.0,
        "exposure": options.exposure,
        "motion": options.base_motion,
        "trace": None if trace is None else read_trace(trace, column=options.column),
        "contact": options.contact,
    }


def _lists_of_times(options: argparse.Namespace) -> list[list[Recording]] | None:
    """Return the times of impacts of each recording; None if the files hold tracks."""
    from vibrosweep.lab.recordings import read_recordings

    how = _selected(options, "particle", "sheet")
    how["column"] = None if options.base_trace else options.column
    try:
        lists = [read_recordings(group, **how) for group in _groups(options)]
    except TrackError:
        return None  # the reader of tracks has reported the error
    timed = [recording.height is None for one in lists for recording in one]
    return lists if timed and all(timed) else None


def _impact_times(options: argparse.Namespace, lists: list[list[Recording]]) -> None:
    """Measure a shaken base from times alone."""
    from vibrosweep.api.result_kinds import RESTITUTION as KIND
    from vibrosweep.lab.lines import numbers_of, restitution_lines
    from vibrosweep.lab.shaken_times import times_on_shaker

    _check_output(options, len(lists))
    if (options.mass, options.diameter) != (None, None):
        raise TrackError("--mass, --diameter: drag is taken into account in films, not in times")
    how = _selected(options, "frequency", "contact", "gravity")
    results = [times_on_shaker(recordings, **how) for recordings in lists]
    for found in results:
        say(options, *restitution_lines(found))
    tell(options, {"recordings": [numbers_of(found) for found in results]})
    _write_result(options, found, KIND, (lambda: KIND.axes(found), KIND.stem))


def _impacts(options: argparse.Namespace) -> None:
    from vibrosweep.api.result_kinds import IMPACTS as KIND
    from vibrosweep.lab.fitting import Setup, fit_tracks
    from vibrosweep.lab.impacts import agreement, gravity_of, impacts_of, inputs_of, quantities
    from vibrosweep.lab.lines import (
        agreement_lines,
        flights_of,
        impact_lines,
        impact_numbers,
        numbers_of,
    )
    from vibrosweep.lab.variables import require_parameter

    require_parameter("phase", options.phase)
    try:
        recordings = _recordings(options)
    except TrackError:
        lists = _lists_of_times(options)
        if lists is None:
            raise
        _impact_times(options, lists)
        return
    _check_output(options, len(recordings))
    facts, fall = _facts(options), gravity_of(options.gravity)
    inputs = inputs_of(facts.pop("contact"), options.mass, options.diameter, fall)
    setup, gravity = Setup(**facts, frequency=options.frequency, inputs=inputs), fall.value
    summaries, numbers = [], []
    for tracks in recordings:
        fitted = fit_tracks(tracks, gravity, setup)
        found = impacts_of(tracks, fitted, gravity, options.method)
        say(options, *impact_lines(found))
        summaries.append(quantities(found, frequency=options.frequency, phase=options.phase))
        numbers.append(impact_numbers(found) | numbers_of(summaries[-1]))
    agreed = agreement(summaries)
    say(options, *agreement_lines(agreed))
    tell(options, {"recordings": numbers, "agreement": numbers_of(agreed)})

    def draw() -> Panels:
        from vibrosweep.figures.laboratory import fitted_track

        return fitted_track(flights_of(tracks, fitted))

    _write_result(options, found, KIND, (draw, "lab_track"))


def _compare(options: argparse.Namespace) -> None:
    from vibrosweep.api.result_kinds import COMPARISON as KIND
    from vibrosweep.lab.compare import compare_tracks
    from vibrosweep.lab.lines import numbers_of, table_lines

    _check_output(options)
    recordings = _recordings(options)
    known = {name: one for name, one in _selected(options, *KNOWN).items() if one is not None}
    how = _selected(options, "method", "draws", "seed", "restitution_law")
    table = compare_tracks(recordings, **_facts(options), **how, **known)
    say(options, *table_lines(table))
    tell(options, numbers_of(table))
    _write_result(options, table, KIND, (lambda: KIND.axes(table), KIND.stem))


def _restitution(options: argparse.Namespace) -> None:
    from vibrosweep.api.result_kinds import RESTITUTION as KIND
    from vibrosweep.lab.drops import restitution
    from vibrosweep.lab.lines import numbers_of, restitution_lines
    from vibrosweep.lab.recordings import read_recordings

    _check_output(options)
    free = options.scale == "gravity"
    recordings = read_recordings(
        options.tracks,
        scale=None if free else options.scale,
        **_selected(options, "frame_rate", "axis", "column", "particle", "sheet"),
    )
    found = restitution(
        recordings,
        **_selected(options, "contact", "mass", "diameter", "gravity", "drop_height"),
        scale_from_gravity=free,
        begin=getattr(options, "from"),
        end=options.to,
    )
    say(options, *restitution_lines(found))
    tell(options, numbers_of(found))

    def film() -> Panels:
        from vibrosweep.figures.laboratory import film_of_drop

        return film_of_drop(found)

    films = [(film, "lab_drop_film")] if "sample_time" in found else []
    _write_result(options, found, KIND, (lambda: KIND.axes(found), KIND.stem), *films)


def _base(options: argparse.Namespace) -> None:
    from vibrosweep.lab.lines import motion_lines, numbers_of
    from vibrosweep.lab.traces import base_motion, read_trace

    numbers = []
    for path in options.traces:
        trace = read_trace(path, column=options.column)
        found = base_motion(trace, gravity=options.gravity)
        say(options, *motion_lines(found, str(path), trace.origin))
        numbers.append(numbers_of(found) | {"source": str(path), "origin": trace.origin})
    tell(options, {"traces": numbers})


def _write_result(
    options: argparse.Namespace,
    result: xr.Dataset,
    kind: ResultKind,
    *figures: tuple[Callable[[], Axes | Panels], str],
) -> None:
    """Write a result and its figures, each a function and the name of its file, if requested."""
    if options.output is not None:
        from vibrosweep.store.writing import write_dataset

        write_dataset(result, options.output, kind, force=options.force)
        say(options, f"written to {options.output}")
    if options.figures is None:
        return
    from vibrosweep.figures.registry import save_formats
    from vibrosweep.figures.style import for_file

    with drawing(options.output):
        for draw, stem in figures:
            for path in save_formats(for_file(draw), options.figures, stem):
                say(options, str(path))
