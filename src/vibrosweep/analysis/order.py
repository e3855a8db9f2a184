"""Changes of the order in which particles land."""

from __future__ import annotations

import numpy as np
import xarray as xr

from vibrosweep.analysis.datasets import require, table
from vibrosweep.arrays import Array
from vibrosweep.store.arranged import arranged

__all__ = ["order_of_landings"]


def order_of_landings(record: xr.Dataset, *, since: float = 0.0) -> xr.Dataset:
    """Count changes of the sequence of landings, and overtakings of particles.

    The sequence s_1, s_2, ... names the particle of each landing in the order of time (particles
    that land together stand in the order of their numbers).  N particles keep their order as long
    as each landing repeats the one N places before, s_(k+N) = s_k; each k at which this fails is a
    change.  One of two particles overtakes the other where the first of them to make impact n is
    the second to make impact n + 1.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    since
        Landings from this time on, in s, are taken.

    Returns
    -------
    xarray.Dataset
        Dim ``realization``: ``sequence_changes`` among the ``sequence_pairs`` compared, with
        ``sequence_change_fraction``; ``overtakings`` among the ``impact_pairs`` compared, with
        ``overtaking_fraction``.  A fraction is NaN if nothing was compared.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import order_of_landings
    >>> record = vs.simulate(launch_time=[0.125, 0.13], duration=200.0)
    >>> found = order_of_landings(record, since=190.0)
    >>> found.sequence_changes.values, found.sequence_pairs.values
    (array([8]), array([18]))
    """
    record = arranged(record)
    require(record, "order_of_landings", "landing_time")
    times = record["landing_time"].values
    times = np.where(times >= since, times, np.nan)
    sequence = np.array([_sequence_changes(one) for one in times]).reshape(-1, 2)
    impacts = np.array([_overtakings(one) for one in times]).reshape(-1, 2)
    with np.errstate(invalid="ignore"):
        fractions = [pair[:, 0] / pair[:, 1] for pair in (sequence, impacts)]
    return table(
        "realization",
        sequence_changes=(sequence[:, 0], "changes of the landing sequence"),
        sequence_pairs=(sequence[:, 1], "landings N places apart compared"),
        sequence_change_fraction=(fractions[0], "fraction of landings that change the sequence"),
        overtakings=(impacts[:, 0], "overtakings between two impacts"),
        impact_pairs=(impacts[:, 1], "pairs of successive impacts compared"),
        overtaking_fraction=(fractions[1], "fraction of successive impacts with an overtaking"),
    )


def _sequence_changes(times: Array) -> tuple[int, int]:
    """Changes and comparisons of one realization; times of shape (particle, impact)."""
    particles = times.shape[0]
    known = np.isfinite(times)
    sequence = np.nonzero(known)[0][np.argsort(times[known], kind="stable")]
    pairs = max(sequence.size - particles, 0)
    return int(np.count_nonzero(sequence[particles:] != sequence[:pairs])), pairs


def _overtakings(times: Array) -> tuple[int, int]:
    """Overtakings and comparisons of one realization; times of shape (particle, impact)."""
    overtakings = pairs = 0
    for i in range(times.shape[0] - 1):
        ahead = np.sign(times[i + 1 :] - times[i])
        product = ahead[:, 1:] * ahead[:, :-1]
        overtakings += int(np.count_nonzero(product < 0.0))
        pairs += int(np.count_nonzero(np.isfinite(product)))
    return overtakings, pairs
