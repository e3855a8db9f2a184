"""Laws of restitution over a moving base, fitted together with its motion."""

from __future__ import annotations

import numpy as np

from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.oscillation import BaseFit, Problem, Trace, covariance_of_fit, without_outliers
from vibrosweep.lab.speed_laws import FITTED, FittedLaw, failed_fit, fit_law, with_speed


def fit_laws(
    contacts: Contacts, base_fit: BaseFit, *, free: bool, trace: Trace | None = None
) -> list[FittedLaw]:
    """Fit the laws of `FITTED` to the contacts that are no outliers.

    `free` and `trace` are those with which `fit_base` made `base_fit`.
    """
    owner = np.searchsorted(base_fit.particles, contacts.particle)
    known = None if free or trace is not None else base_fit.oscillation.frequency
    speeds = base_fit.oscillation.velocity(contacts.time) - contacts.arrival
    speeds = np.maximum(speeds[base_fit.kept], 1e-6)
    plain = Problem(contacts, owner, known, 1.0, trace)
    return [
        fit_law(name, speeds, lambda law: _fit(plain._replace(law=law), base_fit))
        for name in FITTED
    ]


def _fit(problem: Problem, base_fit: BaseFit) -> FittedLaw:
    law, start = problem.law, base_fit.values
    if law.parameters:
        start = np.append(start, np.log(law.speed))
    spread = np.sqrt(np.maximum(np.diag(base_fit.covariance), 1e-20))
    scale = np.append(spread, [0.1] * law.parameters)
    try:
        found, used = without_outliers(problem, start, scale, base_fit.kept)
    except np.linalg.LinAlgError:
        return failed_fit(law, base_fit.kept.size)
    covariance, misfit, freedom = covariance_of_fit(found)
    last = found.x.size - law.parameters
    of_law = np.r_[: problem.parameters, last : found.x.size]  # without the levels
    values, spread = with_speed(law, found.x[of_law], covariance[np.ix_(of_law, of_law)])
    return FittedLaw(
        law, values, spread, misfit, freedom, int(used.sum()), problem.distance(found.x)
    )
