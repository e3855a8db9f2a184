"""Summary quantities of a recording, and their variation over repeats of an experiment.

The study repeats each case four times and accepts a quantity if its coefficient of variation over
the repeats is below 8 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import circmean

from vibrosweep.analysis import require
from vibrosweep.arrays import Array
from vibrosweep.lab.impacts import BOUNCED, DOUBTFUL
from vibrosweep.lab.variables import with_units

__all__ = ["CRITERION", "QUANTITY_UNITS", "agreement", "phases", "quantities"]


CRITERION: Final = 0.08
QUANTITY_UNITS: Final = {
    "flight_time": ("s", "mean flight time"),
    "rebound_height_max": ("m", "maximum rebound height"),
    "rebound_height_mean": ("m", "mean rebound height"),
    "impact_speed": ("m s-1", "mean velocity at lift-off; over a level base the impact speed"),
    "impact_phase": ("1", "mean phase of impact, in turns"),
    "phase_lock": ("1", "length of the mean phase vector; 1 where all impacts share one phase"),
    "phase_difference": ("1", "mean separation in phase of neighbouring particles, in turns"),
    "dt_min": ("s", "smallest separation of landings of different particles, if above its error"),
}
# Phases have an arbitrary zero, so that their coefficient of variation has no meaning.
_ANGLES: Final = ("impact_phase", "phase_difference")


def phases(impacts: xr.Dataset, frequency: float, phase: float = 0.0) -> Array:
    """Phase of the forcing at each landing, in turns from 0 to 1; shape (particle, impact)."""
    turns = frequency * impacts["landing_time"].values + phase / (2.0 * np.pi)
    return np.asarray(turns - np.floor(turns))


def quantities(
    impacts: xr.Dataset, *, frequency: float | None = None, phase: float = 0.0
) -> xr.Dataset:
    """Summarise one recording over all particles.

    Parameters
    ----------
    impacts
        Result of `find_impacts`.
    frequency
        Forcing frequency in Hz; without it the phases are NaN.
    phase
        Phase of the forcing at t = 0 of the recording, rad.

    Returns
    -------
    xarray.Dataset
        Scalars: ``flight_time`` (s), ``rebound_height_max`` and ``rebound_height_mean`` (m),
        ``impact_speed`` (m s-1), ``impact_phase`` and ``phase_difference`` (turns),
        ``phase_lock``, the length of the mean phase vector, and ``dt_min`` (s).

    Raises
    ------
    DataError
        The dataset is not a result of `find_impacts`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab import Experiment, perform_trials, quantities
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=10.0))
    >>> found = quantities(vs.lab.find_impacts(film[0].tracks), frequency=20.0)
    >>> found.rebound_height_mean.dims
    ()
    """
    needed = ("quality", "flight_time", "rebound_height", "impact_speed", "landing_time")
    require(impacts, "quantities", *needed, source="find_impacts")
    good = impacts["quality"].values == BOUNCED
    flight = impacts["flight_time"].values
    height = impacts["rebound_height"].values
    seen = np.isfinite(flight)
    found = dict.fromkeys(QUANTITY_UNITS, float("nan"))
    if seen.any():
        found["flight_time"] = float(flight[seen].mean())
        found["rebound_height_max"] = float(height[seen].max())
        found["rebound_height_mean"] = float(height[seen].mean())
        found["impact_speed"] = float(impacts["impact_speed"].values[seen].mean())
    if frequency is not None and good.any():
        vector = np.where(good, np.exp(2j * np.pi * phases(impacts, frequency, phase)), 0.0)
        mean = vector.sum() / good.sum()
        found["phase_lock"] = float(np.abs(mean))
        found["impact_phase"] = float(np.angle(mean) / (2.0 * np.pi) % 1.0)
        found["phase_difference"] = _neighbours(vector.sum(axis=1))
    found["dt_min"] = _closest(impacts)
    return xr.Dataset(
        with_units((), {n: (found[n], *about) for n, about in QUANTITY_UNITS.items()})
    )


def _neighbours(vectors: NDArray[np.complex128]) -> float:
    """Mean difference in phase of successive particles, in turns from 0 to 1/2."""
    vectors = vectors[np.abs(vectors) > 0.0]
    if vectors.size < 2:
        return float("nan")
    turned = np.angle(vectors[1:] * np.conj(vectors[:-1])) / (2.0 * np.pi)
    return float(np.abs(turned).mean())


def _closest(impacts: xr.Dataset) -> float:
    """Smallest separation in s of landings of different particles.

    NaN if it is below the standard error of the difference.
    """
    quality = impacts["quality"].values
    certain = (quality >= BOUNCED) & (quality != DOUBTFUL)
    time = np.where(certain, impacts["landing_time"].values, np.nan)
    owner = np.broadcast_to(np.arange(time.shape[0])[:, np.newaxis], time.shape)
    landed = np.isfinite(time)
    order = np.argsort(time[landed])
    times, owners = time[landed][order], owner[landed][order]
    errors = impacts["landing_time_error"].values[landed][order]
    # the closest landings of different particles are neighbours in time
    different = np.flatnonzero(np.diff(owners) != 0)
    if not different.size:
        return float("nan")
    gaps = np.diff(times)[different]
    pair = different[gaps.argmin()]
    error = float(np.hypot(errors[pair], errors[pair + 1]))
    return float(gaps.min()) if gaps.min() > error else float("nan")


def agreement(trials: Sequence[xr.Dataset]) -> xr.Dataset:
    """Compute the mean, standard deviation and coefficient of variation over repeats.

    Parameters
    ----------
    trials
        Results of `quantities`, one for each repeat.

    Returns
    -------
    xarray.Dataset
        Dim quantity: ``mean``, ``sd``, ``variation`` (sd / mean; NaN for phases, whose zero is
        arbitrary), and ``accepted``: 1 if the variation is below the criterion of the study, 8 %, 0
        if it is not, -1 if there is none.

    Raises
    ------
    DataError
        A dataset is not a result of `quantities`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab import Experiment, agreement, perform_trials, quantities
    >>> film = perform_trials(Experiment(particles=2, repeats=2, transient=5.0, duration=10.0))
    >>> landings = [vs.lab.find_impacts(trial.tracks) for trial in film]
    >>> trials = [quantities(impacts, frequency=20.0) for impacts in landings]
    >>> agreement(trials)["mean"].dims
    ('quantity',)
    """
    for trial in trials:
        require(trial, "agreement", *QUANTITY_UNITS, source="quantities")
    values = np.array([[float(trial[name]) for name in QUANTITY_UNITS] for trial in trials])
    names = list(QUANTITY_UNITS)
    mean = values.mean(axis=0)
    sd = values.std(axis=0, ddof=1) if len(trials) > 1 else np.full(len(names), np.nan)
    k = names.index("impact_phase")  # a circular quantity
    mean[k] = circmean(values[:, k], high=1.0)
    off = values[:, k] - mean[k]
    if len(trials) > 1:
        sd[k] = np.sqrt(np.sum((off - np.rint(off)) ** 2) / (len(trials) - 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        variation = np.where(np.isin(names, _ANGLES), np.nan, sd / mean)
    judged = np.isfinite(variation)
    accepted = np.where(judged, (variation < CRITERION).astype(int), -1).astype(np.int8)
    flags = {"flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "undetermined no yes"}
    return xr.Dataset(
        {
            "mean": ("quantity", mean, {"long_name": "mean over the repeats"}),
            "sd": ("quantity", sd, {"long_name": "standard deviation over the repeats"}),
            "variation": ("quantity", variation, {"units": "1", "long_name": "sd / mean"}),
            "accepted": ("quantity", accepted, {"long_name": "variation below 8 %", **flags}),
        },
        coords={
            "quantity": names,
            "units": ("quantity", [QUANTITY_UNITS[name][0] for name in names]),
        },
        attrs={"repeats": len(trials)},
    )
