"""Periodic orbits, whether they attract or not."""

from __future__ import annotations

from typing import Unpack

import xarray as xr

from vibrosweep.analysis.branches import boundaries as trace_boundaries
from vibrosweep.analysis.branches import branches as follow_branches
from vibrosweep.analysis.closed_orbits import orbits as find_orbits
from vibrosweep.api.given_sweep import Spec, as_sweep
from vibrosweep.api.keyword_types import SweepKeywords, completed
from vibrosweep.runs.driver import count, thread_count

__all__ = ["boundaries", "branches", "orbits"]


@completed(by=SweepKeywords)
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
    """Search for the periodic orbits without rests, whether they attract or not.

    All orbits of one impact are found, apart from two that coincide within rounding; of others some
    may be missed.  Newton's method on the phases of all impacts starts from seeds that cover them
    evenly, and where trajectories nearly return.  An orbit is listed once, whatever impact and
    forcing period it is found to begin with.  Under a sine the number of seeds is at least ``seeds
    * 4**(min(p, 8) - 1)`` for p impacts, and that of launches at least ``8 * seeds``; there are
    more under harmonics.  Both grow to twice the number that led to the last new orbit, up to 32
    times these numbers.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords beside a result complete it.
    impacts, periods
        Largest numbers of impacts and of forcing periods of an orbit; up to 12 and 64.
    seeds
        Least number of seeds for orbits with one impact under a sine.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`; launches and times have no effect.

    Returns
    -------
    xarray.Dataset
        With the axes of a grid, or ``realization``, as first dims where parameters vary.  Dims
        (..., orbit): ``cycle_impacts`` and ``cycle_periods``, 0 past the last orbit; ``stable``;
        ``admissible``, a code: a particle can follow the orbit, would land earlier, or would rest.
        Dims (..., orbit, multiplier): ``multiplier_real`` and ``multiplier_imaginary``.  Dims (...,
        orbit, impact), from the impact before the shortest flight: ``impact_phase`` (turns),
        ``rebound_velocity`` (m s-1), and, for the flight that follows, ``flight_time`` (s) and
        ``arrival_velocity`` (m s-1).  Dims (..., impacts, periods): ``seeds``; ``late_orbits``, the
        number of new orbits to which the last half of the seeds led; ``saddle_points`` and
        ``other_points``, two numbers that differ over the high-bounce base only if orbits were
        missed, and ``balanced``, 1 if they are equal, which does not show that none was missed.

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
    return find_orbits(
        as_sweep(spec, keywords, "orbits"),
        thread_count(threads),
        impacts=count("impacts", impacts),
        periods=count("periods", periods),
        seeds=count("seeds", seeds),
    )


@completed(by=SweepKeywords)
def branches(
    spec: Spec | None = None,
    /,
    *,
    impacts: int = 1,
    periods: int = 1,
    doublings: int = 0,
    points: int = 1000,
    threads: int | None = None,
    **keywords: Unpack[SweepKeywords],
) -> xr.Dataset:
    """Follow periodic orbits along a parameter, round folds, and find their bifurcations.

    The orbits found at the values of the axis are followed in both directions, each once, until
    they leave the range of the axis, touch the base, or begin to rest.  Saddle-nodes, period
    doublings, grazings (in flight, or at a landing of speed 0) and rests are solutions of equations
    for the orbit, the parameter and the multiplier together.  A branch that no step continues is
    listed, and its end is ``lost``.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords beside a result complete it.
    impacts, periods
        Largest numbers of impacts and of forcing periods of the orbits at the values of the axis;
        up to 12 and 64.
    doublings
        Number of successive period doublings from which the new orbits are followed too; at most
        6, and up to orbits of 64 impacts.
    points
        Largest number of points of an orbit in each direction; at least 10.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`: ``restitution`` or a forcing is a list of two values or more;
        launches and times have no effect.

    Returns
    -------
    xarray.Dataset
        Dims (branch, point): the parameter under its name, ``stable``, ``admissible``; with dim
        multiplier ``multiplier_real`` and ``multiplier_imaginary``; with dim impact
        ``impact_phase`` (turns) and ``rebound_velocity`` (m s-1).  Dims (branch, event):
        ``bifurcation``, its kind; ``bifurcation_amplitude``, the parameter there, under its own
        name; and with dim impact ``bifurcation_phase``.  Dim branch: ``cycle_impacts``,
        ``cycle_periods``, ``parent``, the branch from which it was born; with dim end ``ends``,
        why it ends.

    Raises
    ------
    SpecError
        Keywords hold mistakes, all of which are listed, or there are other axes.
    ParameterError
        `impacts`, `periods`, `doublings` or `points` are not allowed, or the base couples
        particles.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.branches(restitution=0.5, amplitude=[1.0, 5.0])
    >>> met = found.isel(branch=0)
    >>> doubles = met.bifurcation_amplitude.where(met.bifurcation == 1).max().item()
    >>> bool(abs(doubles - vs.theory.amplitude_max(1, 0.5)) < 1e-12)
    True
    """
    return follow_branches(
        as_sweep(spec, keywords, "branches", 1),
        thread_count(threads),
        wanted=(count("impacts", impacts), count("periods", periods)),
        doublings=count("doublings", doublings, 0),
        points=count("points", points),
    )


@completed(by=SweepKeywords)
def boundaries(
    spec: Spec | None = None,
    /,
    *,
    impacts: int = 1,
    periods: int = 1,
    doublings: int = 0,
    points: int = 1000,
    threads: int | None = None,
    **keywords: Unpack[SweepKeywords],
) -> xr.Dataset:
    """Trace bifurcations of periodic orbits over the plane of restitution and forcing.

    At each restitution of the axis orbits are followed along the forcing, as by
    `vibrosweep.branches`; each of their bifurcations is then followed in both directions as a curve
    in the plane.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords beside a result complete it.
    impacts, periods, doublings
        As for `vibrosweep.branches`.
    points
        Largest number of points of a curve, and of an orbit, in each direction; at least 10.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`: ``restitution`` and a forcing are lists of two values or more.
        A curve that crosses none of the restitutions is not found.

    Returns
    -------
    xarray.Dataset
        Dims (curve, point): ``restitution``, the forcing under its name, ``amplitude`` and
        ``base_acceleration``; and the other variables of `vibrosweep.branches`.  Dim curve:
        ``bifurcation``, its kind.

    Raises
    ------
    SpecError
        Keywords hold mistakes, all of which are listed, or there are other axes.
    ParameterError
        `impacts`, `periods`, `doublings` or `points` are not allowed, or the base couples
        particles.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.boundaries(restitution=[0.5, 0.9], amplitude=[0.1, 5.0])
    >>> found.bifurcation.values.tolist()  # a doubling and a saddle-node
    [1, 0]
    """
    return trace_boundaries(
        as_sweep(spec, keywords, "boundaries", 1),
        thread_count(threads),
        wanted=(count("impacts", impacts), count("periods", periods)),
        doublings=count("doublings", doublings, 0),
        points=count("points", points),
    )
