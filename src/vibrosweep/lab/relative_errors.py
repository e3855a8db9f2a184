"""Errors of predicted heights and periods.

The error of a quantity is |measured - predicted| / measured.  It can mean the error of the mean
over all particles, of the mean of each particle, or of each flight: all these readings are
computed.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.lab.impacts import BOUNCED

# Quantities of a flight, and the variables of `find_impacts` that hold them
MEASURED_AS: Final = {"height": "rebound_height", "period": "flight_time"}
QUANTITIES: Final = tuple(MEASURED_AS)
READINGS: Final = ("ensemble", "particle", "worst", "flight")
# Particles are compared if at least this share of their time and of their landings was measured.
MEASURED: Final = 0.9


def comparable(impacts: xr.Dataset) -> NDArray[np.bool_]:
    """Mark the particles whose flights were nearly all measured.

    Particles that rest or bounce too low for the camera are left out, because a mean over the
    flights that are seen would be biased.

    Parameters
    ----------
    impacts
        Result of `find_impacts` with the method ``"fit"``.

    Returns
    -------
    numpy.ndarray
        Booleans, shape (particle,).

    Examples
    --------
    >>> import vibrosweep as vs
    >>> experiment = vs.lab.Experiment(particles=2, repeats=1, transient=5.0, duration=10.0)
    >>> film = vs.lab.perform_trials(experiment)
    >>> vs.lab.comparable(vs.lab.find_impacts(film[0].tracks)).shape
    (2,)
    """
    quality = impacts["quality"].values
    bounced = (quality == BOUNCED).sum(axis=1)
    flying = np.nansum(impacts["flight_time"].values, axis=1)
    length = impacts.attrs["end"] - impacts.attrs["begin"]
    return np.asarray(
        (bounced > MEASURED * np.maximum((quality >= BOUNCED).sum(axis=1), 1))
        & (flying > MEASURED * length)
    )


def measured_means(impacts: xr.Dataset, among: NDArray[np.bool_]) -> dict[str, Array]:
    """Mean height (m) and period (s) of the flights of each particle; NaN where not `among`."""
    return {
        quantity: np.where(among, impacts[name].mean("impact").values, np.nan)
        for quantity, name in MEASURED_AS.items()
    }


def prediction_errors(
    impacts: xr.Dataset, predicted: dict[str, Array], among: NDArray[np.bool_]
) -> dict[str, dict[str, float]]:
    """Return the errors ``|measured - predicted| / measured`` by quantity and reading.

    Parameters
    ----------
    impacts
        Result of `find_impacts`.
    predicted
        Mean ``height`` (m) and ``period`` (s) of each particle, shape (particle,).
    among
        True for each particle that is compared, as `comparable` returns it; shape (particle,).

    Returns
    -------
    dict
        Errors in per cent, by quantity (``height``, ``period``) and reading: ``ensemble``, the
        error of the mean over all particles; ``particle``, the mean of the errors of each
        particle's mean; ``worst``, the largest of these; ``flight``, the mean error of single
        flights against the mean predicted for their particle.  NaN where no particle can be
        compared.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> experiment = vs.lab.Experiment(particles=2, repeats=1, transient=5.0, duration=10.0)
    >>> seen = vs.lab.find_impacts(vs.lab.perform_trials(experiment)[0].tracks)
    >>> predicted = vs.lab.predicted_means(experiment)
    >>> list(vs.lab.prediction_errors(seen, predicted, vs.lab.comparable(seen)))
    ['height', 'period']
    """
    errors = errors_of(impacts, predicted, among).tolist()
    return {
        q: dict(zip(READINGS, row, strict=True)) for q, row in zip(QUANTITIES, errors, strict=True)
    }


def errors_of(impacts: xr.Dataset, predicted: dict[str, Array], among: NDArray[np.bool_]) -> Array:
    """Errors of `prediction_errors` as an array of shape (quantity, reading)."""
    means = measured_means(impacts, among)
    found = np.full((len(QUANTITIES), len(READINGS)), np.nan)
    for row, name in zip(found, QUANTITIES, strict=True):
        measured, foretold = means[name], predicted[name]
        both = np.isfinite(measured) & np.isfinite(foretold)
        if both.any():
            measured, foretold = measured[both], foretold[both]
            flights = impacts[MEASURED_AS[name]].values[both]
            single = 100.0 * np.abs(measured - foretold) / measured
            ensemble = 100.0 * abs(measured.mean() - foretold.mean()) / measured.mean()
            of_flights = 100.0 * np.abs(flights - foretold[:, np.newaxis]) / flights
            row[:] = ensemble, single.mean(), single.max(), np.nanmean(of_flights)
    return found
