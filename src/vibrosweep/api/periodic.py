"""Periodic orbits, whether they attract or not.

All take the keywords of `vibrosweep.sweep`, or the path of a sweep file, or a mapping.
"""

from __future__ import annotations

from typing import Unpack

import xarray as xr

from vibrosweep.analysis.closed_orbits import orbits_of_spec
from vibrosweep.api.given_sweep import Spec, as_sweep
from vibrosweep.api.keyword_types import SweepKeywords
from vibrosweep.runs.driver import count, thread_count

__all__ = ["orbits"]


def orbits(
    spec: Spec | None = None,
    /,
    *,
    impacts: int = 4,
    periods: int = 4,
    seeds: int = 8,
    threads: int | None = None,
    **keywords: Unpack[SweepKeywords],
) -> xr.Dataset:
    """Find all periodic orbits without rest, whether they attract or not.

    Newton's method on the phases of all impacts starts from seeds that cover them evenly; equal
    orbits are told once, whatever impact and forcing period they begin with.  Twice as many seeds
    are taken as led to the last new orbit, at least ``seeds * 4**(p - 1)`` for p impacts in q
    periods.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, or the path of a sweep file.
    impacts, periods
        Impacts of an orbit, and forcing periods that they take, at most; up to 12 and 64.
    seeds
        Of orbits with one impact, at least.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`, of which launches and times do not matter.

    Returns
    -------
    xarray.Dataset
        With the axes of a grid, or ``realization``, as first dims where parameters vary.  Dims
        (..., orbit): ``cycle_impacts`` and ``cycle_periods``, 0 past the last orbit; ``stable``;
        ``admissible``, which tells that a particle takes the orbit, or that it would land earlier,
        or rest.  Dims (..., orbit, multiplier): ``multiplier_real`` and ``multiplier_imaginary``.
        Dims (..., orbit, impact), from the impact before the shortest flight: ``impact_phase``
        (turns), ``rebound_velocity`` (m s-1), and of the flight that follows ``flight_time`` (s)
        and ``arrival_velocity`` (m s-1).  Dims (..., impacts, periods): ``seeds``; ``late_orbits``,
        new ones that their last half led to; ``saddle_points`` and ``other_points``, which are
        equally many over the high-bounce base, and ``balanced``, whether they are.

    Raises
    ------
    SpecError
        Keywords hold mistakes, all of which are listed.
    ParameterError
        `impacts`, `periods` or `seeds` are not allowed, the base couples particles, or the orbits
        do not fit into memory.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.orbits(amplitude=1.2, impacts=2, periods=2)
    >>> stable = found.cycle_periods.where(found.stable == 1, drop=True)
    >>> stable.values.tolist(), bool((found.balanced == 1).all())
    ([1.0, 2.0], True)
    """
    impacts, periods = count("impacts", impacts), count("periods", periods)
    checked = as_sweep(spec, keywords)
    return orbits_of_spec(checked, impacts, periods, count("seeds", seeds), thread_count(threads))
