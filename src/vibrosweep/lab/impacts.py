"""Landings from tracks: by parabolas through the flights, or by the sign of the velocity."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.errors import TrackError
from vibrosweep.lab.flight_search import Flights, find_flights
from vibrosweep.lab.flights import line_variance
from vibrosweep.lab.quality import find_swaps, seen
from vibrosweep.lab.segments import Samples, low_points, samples_of

__all__ = [
    "BOUNCED",
    "DOUBTFUL",
    "METHODS",
    "STAYED",
    "Fitted",
    "find_impacts",
    "fit_tracks",
    "impacts_of",
]

Array = NDArray[np.float64]

METHODS: Final = ("fit", "sign_change")
BOUNCED, STAYED, DOUBTFUL = 0, 1, 2
_VARIABLES: Final = {
    "landing_time": ("s", "time of landing"),
    "landing_time_error": ("s", "standard error of the time of landing"),
    "liftoff_time": ("s", "time of lift-off"),
    "liftoff_time_error": ("s", "standard error of the time of lift-off"),
    "next_covariance": ("s2", "covariance of the lift-off with the next landing"),
    "flight_time": ("s", "time from the lift-off to the next landing"),
    "impact_speed": ("m s-1", "speed at lift-off and at the next landing, from the flight time"),
    "rebound_height": ("m", "height of the flight that follows, above the base"),
    "rebound_height_error": ("m", "standard error of that height"),
}


class Fitted(NamedTuple):
    """Tracks with the flights found in them.

    Attributes
    ----------
    samples, flights
        What was seen, and the parabolas through it.
    swaps
        Swapped identities: the first frame with them, and the two particles.
    """

    samples: Samples
    flights: Flights
    swaps: list[tuple[int, int, int]]


def find_impacts(
    tracks: xr.Dataset,
    *,
    gravity: float = 9.81,
    base: float | None = None,
    exposure: float = 0.0,
    method: str = "fit",
) -> xr.Dataset:
    """Landings of every particle, with standard errors.

    Parameters
    ----------
    tracks
        Result of `read_tracks` or `make_tracks`.
    gravity
        m s-2; the flights are parabolas of this curvature.
    base
        Height in m at which particles land; by default it is found from the flights.
    exposure
        Time for which the shutter is open, s.
    method
        ``"fit"``: neighbouring parabolas are intersected.  ``"sign_change"``: the frame at which
        the velocity turns from falling to rising, and the highest frame in between.

    Returns
    -------
    xarray.Dataset
        Dims (particle, impact), NaN past the last landing: ``landing_time``, ``liftoff_time`` and
        their errors (s); ``next_covariance`` (s2) of a lift-off with the next landing;
        ``flight_time``, ``impact_speed``, ``rebound_height`` of the flight that follows, NaN where
        its landing is not seen or one of its ends is doubtful; ``quality``.  By particle what was
        seen of it.  Attributes: the noise of a position (m), the base (m), the acceleration that
        the tracks show.

    Raises
    ------
    TrackError
        Nothing bounces, nothing falls with gravity, or the base is not below the tracks.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab.experiment import Experiment, perform_trials
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=5.0))
    >>> vs.lab.find_impacts(film[0].tracks).landing_time.dims
    ('particle', 'impact')
    """
    if method not in METHODS:
        raise TrackError(f"method = {method!r}: must be one of {', '.join(METHODS)}")
    return impacts_of(tracks, fit_tracks(tracks, gravity, base, exposure), gravity, method)


def impacts_of(tracks: xr.Dataset, fitted: Fitted, gravity: float, method: str) -> xr.Dataset:
    """Landings from fitted tracks, by one of the `METHODS`, as `find_impacts` returns them."""
    samples, flights, swaps = fitted
    particles = tracks.sizes["particle"]
    if method == "fit":
        owner, columns = _fitted(flights, gravity)
    else:
        owner, columns = _turned(samples, flights, 1.0 / tracks.attrs["frame_rate"], gravity)
    found = _table(owner, columns, particles).merge(seen(tracks))
    poor = np.bincount(flights.particle[flights.poor], minlength=particles)
    exchanged = np.bincount(np.array([p for _, *pair in swaps for p in pair], int), None, particles)
    found["poor_flights"] = (
        "particle",
        poor,
        {"units": "1", "long_name": "flights that fit badly"},
    )
    found["swaps"] = (
        "particle",
        exchanged,
        {"units": "1", "long_name": "exchanges of names with another particle"},
    )
    found = found.assign_coords(particle=tracks["particle"])
    found.attrs = {
        "method": method,
        "source": tracks.attrs["source"],
        "frame_rate": tracks.attrs["frame_rate"],
        "begin": float(tracks["time"][0]),
        "end": float(tracks["time"][-1]),
        "gravity": gravity,
        "noise": flights.noise,
        "base": flights.base,
        "base_error": flights.base_error,
        "apparent_gravity": flights.gravity,
        "apparent_gravity_error": flights.gravity_error,
        "scale_off": int(flights.curvature != gravity),
    }
    return found


def fit_tracks(
    tracks: xr.Dataset, gravity: float, base: float | None = None, exposure: float = 0.0
) -> Fitted:
    """Find and fit the flights of tracks.

    Raises
    ------
    TrackError
        As in `find_impacts`.
    """
    _check_base(tracks, base)
    time, height = tracks["time"].values, tracks["height"].values
    cuts = np.zeros(height.shape, bool)
    try:
        samples = samples_of(time, height, cuts)
        flights = find_flights(samples, gravity, base, exposure)
        swaps = find_swaps(time, height, flights.noise, flights.base, gravity)
        if swaps:
            for frame, one, other in swaps:
                cuts[frame, [one, other]] = True
            samples = samples_of(time, height, cuts)
            flights = find_flights(samples, gravity, base, exposure)
    except TrackError as error:
        raise TrackError(f"{tracks.attrs['source']}: {error}") from error
    return Fitted(samples, flights, swaps)


def _check_base(tracks: xr.Dataset, base: float | None) -> None:
    if base is None:
        return
    middle, top = (float(tracks["height"].quantile(q)) for q in (0.5, 1.0))
    if not base < middle:
        where = "above the whole track" if base > top else "above half of the positions"
        raise TrackError(
            f"{tracks.attrs['source']}: the base at {base:g} m lies {where} (the highest position "
            f"is {top:.4g} m): give the height at which particles land, or leave it to be found"
        )


def _fitted(flights: Flights, gravity: float) -> tuple[NDArray[np.intp], dict[str, NDArray[Any]]]:
    """Columns of `_VARIABLES` and the quality, a row for each junction, and its particle."""
    joint, fits = flights.junctions, flights.fits
    after = joint.before + 1
    odd = flights.poor[joint.before] | flights.poor[after] | joint.overlapping
    linked = np.flatnonzero((after[:-1] == joint.before[1:]) & ~odd[:-1] & ~odd[1:])
    duration = np.full(joint.before.size, np.nan)
    duration[linked] = joint.landing[linked + 1] - joint.liftoff[linked]
    whole = np.isfinite(duration)
    # the apex lies where the slope vanishes
    apex = fits.centre + fits.slope / flights.curvature
    height = fits.top(flights.curvature) - flights.base
    base_error = np.nan_to_num(flights.base_error)
    error = np.hypot(flights.noise * np.sqrt(line_variance(fits, apex)), base_error)
    columns = {
        "landing_time": joint.landing,
        "landing_time_error": joint.landing_error,
        "liftoff_time": joint.liftoff,
        "liftoff_time_error": joint.liftoff_error,
        "next_covariance": joint.covariance,
        "flight_time": duration,
        "impact_speed": 0.5 * gravity * duration,
        "rebound_height": np.where(whole, height[after], np.nan),
        "rebound_height_error": np.where(whole, error[after], np.nan),
        "quality": np.where(odd, DOUBTFUL, np.where(joint.stayed, STAYED, BOUNCED)),
    }
    return flights.particle[joint.before], columns


def _turned(
    samples: Samples, flights: Flights, interval: float, gravity: float
) -> tuple[NDArray[np.intp], dict[str, NDArray[Any]]]:
    """The same by frames: the lowest is taken for the landing, the highest for the apex."""
    low, _ = low_points(samples, flights.noise, flights.base)
    time, owner = samples.time[low], samples.particle[low]
    linked = np.flatnonzero(np.diff(samples.piece[low]) == 0)
    duration, height = np.full((2, low.size), np.nan)
    duration[linked] = time[linked + 1] - time[linked]
    if low.size:
        tops = np.maximum.reduceat(samples.height, low)
        height[linked] = tops[linked] - flights.base
    error = np.full(low.size, interval / np.sqrt(12.0))
    columns = {
        "landing_time": time,
        "landing_time_error": error,
        "liftoff_time": time,
        "liftoff_time_error": error,
        "next_covariance": np.where(np.isfinite(duration), 0.0, np.nan),
        "flight_time": duration,
        "impact_speed": 0.5 * gravity * duration,
        "rebound_height": height,
        "rebound_height_error": np.where(np.isfinite(height), flights.noise, np.nan),
        "quality": np.full(low.size, BOUNCED),
    }
    return owner, columns


def _table(owner: NDArray[np.intp], columns: dict[str, NDArray[Any]], particles: int) -> xr.Dataset:
    """Rows in the order of particles and times -> arrays of shape (particle, impact)."""
    count = np.bincount(owner, minlength=particles)
    place = np.arange(owner.size) - (np.cumsum(count) - count)[owner]
    shape = (particles, int(count.max(initial=0)))
    variables: dict[str, Any] = {}
    for name, (units, words) in _VARIABLES.items():
        values = np.full(shape, np.nan)
        values[owner, place] = columns[name]
        variables[name] = (("particle", "impact"), values, {"units": units, "long_name": words})
    quality = np.full(shape, -1, np.int8)
    quality[owner, place] = columns["quality"]
    flags = {
        "long_name": "what is known of the landing",
        "flag_values": np.array([-1, BOUNCED, STAYED, DOUBTFUL], np.int8),
        "flag_meanings": "none bounced stayed_or_bounced_unseen doubtful",
    }
    variables["quality"] = (("particle", "impact"), quality, flags)
    variables["impact_count"] = (
        "particle",
        count,
        {"units": "1", "long_name": "landings that were seen"},
    )
    return xr.Dataset(variables)
