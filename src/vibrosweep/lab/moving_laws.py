"""Laws of restitution over a moving base, each fitted together with the motion of the base."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.oscillation import MOST_STEPS, ROUNDS, Problem, Shaken, Trace
from vibrosweep.lab.speed_laws import FITTED, FittedLaw, best, summary, trials, unfitted


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
    kept = shaken.kept
    for _ in range(ROUNDS):
        try:
            found = least_squares(
                problem.whitened,
                start,
                problem.derivatives,
                x_scale=np.append(spread, [0.1] * law.parameters),
                args=(kept,),
                max_nfev=MOST_STEPS,
            )
        except np.linalg.LinAlgError:
            return unfitted(law, kept.size)
        start, kept = found.x, problem.near(found.x)
    slopes = np.asarray(found.jac)
    size = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0
    inverse = np.linalg.pinv((slopes / size).T @ (slopes / size), hermitian=True)
    freedom = max(found.fun.size - found.x.size, 1)
    error = np.sqrt(np.diag(inverse) * max(1.0, 2.0 * found.cost / freedom)) / size
    ends = float(found.x[0]), float(found.x[-1])
    errors = float(error[0]), float(error[-1])
    return summary(law, ends, errors, problem.distance(found.x))
