"""Fit the flights of tracks over a moving base, or over one at a constant level."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.errors import ParameterError, TrackError, require_one_of
from vibrosweep.lab.contacts import Cut, find_contacts
from vibrosweep.lab.flight_search import SCALES, Flights, check_gravity, find_flights
from vibrosweep.lab.flights import contradicts, near_gravity
from vibrosweep.lab.levels import flights_on_levels
from vibrosweep.lab.moving_flights import flights_over
from vibrosweep.lab.oscillation import UNDETERMINED, Trace, fit_base
from vibrosweep.lab.quality import find_swaps
from vibrosweep.lab.segments import Samples, samples_of
from vibrosweep.lab.traces import trace_of_mark
from vibrosweep.lab.which_base import moves, which_base
from vibrosweep.model.parameters import PARAMETERS

MOTIONS: Final = ("detect", "level", "moving")
# Largest share of neighbouring flights that may meet above a moving base; otherwise its fit is
# rejected.  In irregular films a correct fit has at most 2 % of them, a wrong one 9 % and more.
TURNED_ABOVE: Final = 0.05
FREQUENCIES_APART: Final = 0.01  # largest relative difference of a given and a traced frequency


class Setup(NamedTuple):
    """Facts about a recording that its tracks do not contain."""

    base: float | None = None  # height in m at which particles land; None if unknown
    exposure: float = 0.0  # time for which the shutter is open, s
    # One of `MOTIONS`: the base moves, has a constant level, or the contacts decide
    motion: str = "detect"
    frequency: float | None = None  # frequency of the forcing in Hz; None if unknown
    trace: Trace | None = None  # measured motion of a moving base


class FittedTracks(NamedTuple):
    """Tracks with the flights found in them."""

    # samples, flights: measured positions, and parabolas through them
    samples: Samples
    flights: Flights
    swaps: list[tuple[int, int, int]]  # exchanged names, as `find_swaps` returns them
    # Base that the contacts favour, ``"moving"``, ``"level"`` or ``"undetermined"``; or that of the
    # setup
    favoured_base: str


def fit_tracks(tracks: xr.Dataset, gravity: float, setup: Setup = Setup()) -> FittedTracks:  # noqa: B008
    """Find and fit the flights of tracks; raise the errors of `find_impacts`."""
    if "base_height" in tracks:
        if setup.trace is not None:
            raise TrackError("a trace and a mark on the base are given: leave one of them out")
        setup = setup._replace(trace=trace_of_mark(tracks, setup.exposure))
    if setup.trace is not None:
        setup = setup._replace(trace=setup.trace.since(tracks.attrs.get("origin", 0.0)))
    _check_setup(gravity, setup)
    _check_base(tracks, setup.base)
    time, height = tracks["time"].values, tracks["height"].values
    cuts = np.zeros(height.shape, bool)
    try:
        samples = samples_of(time, height, cuts)
        check_gravity(samples, gravity, setup.base)
        flights, favoured = _flights(samples, gravity, setup)
        highest = float(flights.levels.max())
        if flights.base_fit is not None:
            highest += flights.base_fit.oscillation.reach
        swaps = find_swaps(time, height, flights.noise, highest, gravity)
        if swaps:
            for frame, *pair in swaps:
                cuts[frame, pair] = True
            samples = samples_of(time, height, cuts)
            flights, favoured = _flights(samples, gravity, setup)
    except TrackError as error:
        raise TrackError(f"{tracks.attrs['source']}: {error}") from error
    return FittedTracks(samples, flights, swaps, favoured)


def _flights(samples: Samples, gravity: float, setup: Setup) -> tuple[Flights, str]:
    """Find the flights over the base that is given or that contacts favour; return its name too."""
    level = setup.motion == "level" or (setup.motion == "detect" and setup.base is not None)
    level = level and setup.trace is None
    if level and setup.base is not None:
        return find_flights(samples, gravity, setup.base, setup.exposure), "level"
    fall, favoured, problem = gravity, "level", TrackError(UNDETERMINED)
    for _ in range(SCALES):
        cut = find_contacts(samples, fall)
        found, error, over = cut.fall, cut.error, None
        if not level:
            try:
                favoured, over = _over_moving(samples, cut, setup)
            except TrackError as reason:
                favoured, problem = "undetermined", reason
        if over is not None:
            found, error = over.gravity, over.gravity_error
        if not contradicts(found, error, fall):
            if over is not None:
                return over, favoured
            break
        # compared with gravity, so that the corrections of all rounds together stay small
        if not near_gravity(found, gravity):
            break
        fall = found
    if over is not None:  # the flights over this base contradict the acceleration taken for them
        favoured = "undetermined"
        problem = TrackError(
            f"over a base that moves, flights fall with {found:.4g} ± {error:.2g} m s-2, but were "
            f"fitted with {fall:.4g} m s-2: check the scale, the frame rate and the frequency"
        )
    if not level and (setup.motion == "moving" or setup.trace is not None):
        raise problem
    return flights_on_levels(samples, cut.contacts, gravity, setup.exposure), favoured


def _over_moving(samples: Samples, cut: Cut, setup: Setup) -> tuple[str, Flights | None]:
    """Return the base that contacts favour, and the flights over it if it moves, else None."""
    if setup.trace is None:
        favoured, base_fit = which_base(cut.contacts, setup.frequency)
    else:
        favoured, rate = "moving", float(setup.trace.values[2])
        base_fit = fit_base(cut.contacts, rate, free=True, moves=True, trace=setup.trace)
    detected = setup.motion == "detect" and setup.trace is None
    if base_fit is None or (detected and favoured != "moving"):
        return favoured, None
    over = flights_over(samples, cut, base_fit, setup.exposure)
    above = float(over.junctions.overlapping.mean()) if over.junctions.before.size else 0.0
    if above > TURNED_ABOVE:
        raise TrackError(
            f"{100.0 * above:.0f} % of the flights over the base that was found meet above it, "
            f"where nothing can turn them: the landings do not determine how the base moves; film "
            f"faster or closer, or give the frequency or a trace of the base"
        )
    # the contacts of the fitted flights are more accurate, and must favour a moving base too
    if detected and over.base_fit is not None and not moves(over.base_fit):
        return "undetermined", None
    return favoured, over


def _check_setup(gravity: float, setup: Setup) -> None:
    for name, value in (("gravity", gravity), ("frequency", setup.frequency)):
        if value is not None and not PARAMETERS[name].accepts(value):
            raise ParameterError(f"{name} = {value!r}: must be {PARAMETERS[name].allowed}")
    if not 0.0 <= setup.exposure <= 1.0:
        raise TrackError(f"exposure = {setup.exposure!r}: must be at least 0 and at most 1 s")
    require_one_of("motion", setup.motion, MOTIONS, TrackError)
    if setup.base is not None and (setup.motion == "moving" or setup.trace is not None):
        raise TrackError(
            "a height of the base belongs to one at a constant level, but a trace or the motion "
            "'moving' says that it moves: leave the height out"
        )
    if setup.trace is None:
        return
    if setup.motion == "level":
        raise TrackError(
            "a trace belongs to a base that moves, but the motion 'level' says that it does not: "
            "leave one of them out"
        )
    traced = float(setup.trace.values[2])
    apart = 0.0 if setup.frequency is None else abs(setup.frequency - traced)
    if apart > FREQUENCIES_APART * traced:
        raise TrackError(
            f"the frequency is given as {setup.frequency:g} Hz, but the trace of the base repeats "
            f"at {traced:.6g} Hz: leave the frequency out, or give the trace of this recording"
        )


def _check_base(tracks: xr.Dataset, base: float | None) -> None:
    if base is None:
        return
    middle, top = (float(tracks["height"].quantile(q)) for q in (0.5, 1.0))
    if not base < middle:
        where = "above the whole track" if base > top else "above half of the positions"
        raise TrackError(
            f"{tracks.attrs['source']}: the base at {base:g} m lies {where} (the highest position "
            f"is {top:.4g} m): give the height at which particles land, or leave it out"
        )
