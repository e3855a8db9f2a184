"""Separations against all pairs of recorded landings."""

import numpy as np
import pytest

from vibrosweep.sweep.engine import measure

LAWS = ["rest", "reflect"]


def all_pairs(found, i, contact_time, frequency, begin, end):
    """Smallest separations and shared base of realization i, from every pair of landings.

    Returns dt_min, dt_min_same_index, base_shared and the rounding of a difference of recorded
    times; base_shared is None where rounding decides.
    """
    landing, liftoff = found["landing_time"][i], found["liftoff_time"][i]
    who, number = np.nonzero(~np.isnan(landing))
    start, leave = landing[who, number], liftoff[who, number]
    leave = np.fmax(np.where(np.isnan(leave), np.inf, leave), start + contact_time)
    # a recorded time is a sum of whole periods and a phase, divided by the frequency
    rounding = 4.0 * np.spacing(np.max(np.abs(start), initial=end)) + 4e-16 / frequency

    inside = start >= begin
    t, p, n = start[inside], who[inside], number[inside]
    order = np.argsort(t, kind="stable")
    t, p, n = t[order], p[order], n[order]
    apart = np.abs(t[:, np.newaxis] - t)
    other = p[:, np.newaxis] != p
    same = other & (n[:, np.newaxis] == n)
    dt_min = np.min(apart, where=other, initial=np.inf)
    dt_same = np.min(apart, where=same, initial=np.inf)

    late = leave >= begin - rounding  # all who are on the base at some time in the window
    start, leave, who = start[late], leave[late], who[late]
    together = np.minimum(leave[:, np.newaxis], leave) - np.maximum(start[:, np.newaxis], start)
    in_window = np.minimum(leave[:, np.newaxis], leave) - begin
    margin = np.minimum(together, in_window)
    margin = np.max(margin, where=who[:, np.newaxis] != who, initial=-np.inf)
    shared = None if abs(margin) <= rounding else int(margin > 0)
    return dt_min, dt_same, shared, rounding


def check(scene, observation, workers, record, rows=None):
    """Compare what is measured with all pairs; return the measures."""
    measured = measure(scene, observation, workers)
    found = record(scene, observation)
    size = measured["dt_min"].size
    for i in range(size) if rows is None else rows:
        gap, same, shared, rounding = all_pairs(
            found,
            i,
            scene["contact_time"][i],
            scene["frequency"][i],
            observation.transient,
            observation.duration,
        )
        assert measured["status"][i] == 0
        for name, expected in (("dt_min", gap), ("dt_min_same_index", same)):
            if np.isinf(expected):
                assert np.isnan(measured[name][i])
            else:
                assert measured[name][i] == pytest.approx(expected, rel=0, abs=rounding)
        if shared is not None:
            assert measured["base_shared"][i] == shared
            assert measured["collision_free"][i] == 1 - shared
    return measured
