"""Laws of restitution over a moving base, each fitted together with the motion of the base."""

from __future__ import annotations

import numpy as np

from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.oscillation import Problem, Shaken, Trace, spread_of, without_outliers
from vibrosweep.lab.speed_laws import FITTED, FittedLaw, best, speeds_of, trials, unfitted


def fit_laws(
    contacts: Contacts, shaken: Shaken, *, free: bool, trace: Trace | None = None
) -> list[FittedLaw]:
    """Fit the laws of `FITTED` to contacts, without their outliers.

    `free` and `trace` are those of `fit_shaken`, which gave `shaken`.
    """
    owner = np.searchsorted(shaken.particles, contacts.particle)
    known = None if free or trace is not None else shaken.oscillation.frequency
    speeds = shaken.oscillation.velocity(contacts.time) - contacts.arrival
    speeds = np.maximum(speeds[shaken.kept], 1e-6)
    plain = Problem(contacts, owner, known, 1.0, trace)
    return [
        best([_fit(plain._replace(law=law), shaken) for law in trials(name, speeds)])
        for name in FITTED
    ]


def _fit(problem: Problem, shaken: Shaken) -> FittedLaw:
    law, start = problem.law, shaken.values
    if law.parameters:
        start = np.append(start, np.log(law.speed))
    spread = np.sqrt(np.maximum(np.diag(shaken.covariance), 1e-20))
    scale = np.append(spread, [0.1] * law.parameters)
    try:
        found, used = without_outliers(problem, start, scale, shaken.kept)
    except np.linalg.LinAlgError:
        return unfitted(law, shaken.kept.size)
    covariance, misfit, freedom = spread_of(found)
    last = found.x.size - law.parameters
    of_law = np.r_[: problem.parameters, last : found.x.size]  # without the levels
    values, spread = speeds_of(law, found.x[of_law], covariance[np.ix_(of_law, of_law)])
    return FittedLaw(
        law, values, spread, misfit, freedom, int(used.sum()), problem.distance(found.x)
    )
