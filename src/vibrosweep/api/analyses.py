"""Analyses that compute realizations: windows, bifurcations, basins, Sobol' indices, orbits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import xarray as xr

from vibrosweep.analysis.basins import basins as find_basins
from vibrosweep.analysis.bifurcation import OfImpacts
from vibrosweep.analysis.bifurcation import bifurcation as follow_orbits
from vibrosweep.analysis.orbits import boundaries as trace_boundaries
from vibrosweep.analysis.orbits import branches as follow_branches
from vibrosweep.analysis.orbits import orbits as find_orbits
from vibrosweep.analysis.sensitivity import sobol_indices
from vibrosweep.analysis.separations import QUANTILES, separation_against, separation_distribution
from vibrosweep.analysis.windows import find_windows
from vibrosweep.api.keyword_types import (
    RealizationKeywords,
    SweepKeywords,
    WindowKeywords,
    completed,
)
from vibrosweep.api.sweeps import Spec, as_sweep, sweep, warned
from vibrosweep.errors import ParameterError, count
from vibrosweep.runs.driver import thread_count

__all__ = [
    "basins",
    "bifurcation",
    "boundaries",
    "branches",
    "orbits",
    "separations",
    "sobol",
    "windows",
]

# Realizations in the base sample of Sobol' indices
SOBOL_SAMPLE = 1024


@completed(by=WindowKeywords)
def windows(
    spec: Spec | None = None, /, *, threads: int | None = None, **keywords: Unpack[WindowKeywords]
) -> xr.Dataset:
    """Find the intervals of the forcing in which conditions hold, for every restitution.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords given with a result complete it.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`; without a duration, conditions on orbits are judged after a
        time in which orbits settle.  In addition, or with another meaning:

        amplitude, base_velocity, base_displacement, base_acceleration
            One of them, the forcing that is scanned (m s-1, m s-1, m, 1): a list of the two or more
            points of the coarse scan, or a tuple, a range scanned at 150 evenly spaced values.
        restitution
            A number, a list, or a tuple, a range taken at 25 evenly spaced values.
        conditions
            A list of ``"locked(k)"``, ``"ordered"``, ``"periodic"``, ``"separated"``,
            ``"collision_free"`` and ``"regular"``; by default ``["locked(1)"]``.
        continuation
            True to continue orbits along the scan, up and down, instead of launching new ones at
            every point; False by default.
        prove
            True to prove, in ball arithmetic, the ends of ``locked(k)`` as bifurcations of its
            orbit, and attraction between them; False by default.  Needs python-flint.
        tolerance
            Largest width of the bracket around an end, relative to the end; 1e-9 by default, 1e-3
            under noise.
        noise_replicas
            Under noise, the number of replicas of each point, 100 by default.  Replica r has stream
            r of random numbers at all points.  A condition then counts as true where it holds in at
            least half of the replicas.  For ``locked(k)`` particles begin on the locked orbit; a
            particle is locked if it does not rest and each of its flights lasts k periods to within
            1/4.

    Returns
    -------
    xarray.Dataset
        Dims: c stands for (condition, direction, restitution).  Names of ends begin with
        the symbol of the scanned forcing: ``A``, ``V0``, ``B``, ``Gamma``.

        ========================================  =========  =======================================
        variable                                  dims       meaning
        ========================================  =========  =======================================
        ``A_min``, ``A_max``                      c, window  ends (m s-1), the middles of brackets;
                                                             NaN where a window reaches the end of
                                                             the scan, and past the last window
        ``A_min_bracket``, ``A_max_bracket``      c, window  widths of these brackets
        ``window_ends``                           c, window  code: the window reaches an end of the
                                                             scan, or the condition is undetermined
                                                             beyond an end
        ``window_count``, ``widest``              c          number of windows; index of the widest,
                                                             -1 if there is none
        ``holds``                                 c, scan    1 where the condition holds, 0 where it
                                                             fails, -1 where it is undetermined
        ``min_proof``, ``max_proof``              c, window  with `prove`: codes for a proof of an
                                                             end, or for the reason why there is
                                                             none
        ``inside_proof``                          c, window  with `prove`: the same for the inside
        ``A_min_low``, ``A_min_high``, ...        c, window  with `prove`: numbers that enclose
                                                             proved ends
        ``share``, ``share_low``, ``share_high``  c, scan    under noise: share of replicas (for
                                                             ``locked(k)`` of replicas and
                                                             particles) for which the condition
                                                             holds, with its 95 % interval (Clopper
                                                             & Pearson 1934)
        ========================================  =========  =======================================

    Raises
    ------
    SpecError
        Keywords hold mistakes, all of which are listed, or the scan has other axes.
    ParameterError
        A condition cannot be continued, or the points do not fit into memory.
    MissingFlintError
        Proofs are requested, and python-flint is not installed.

    Warns
    -----
    ShortObservationWarning
        Orbits are observed for too short a time to tell what all of them settle on; the attribute
        ``notes`` of the result says so too.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.windows(restitution=[0.8, 0.9], amplitude=[0.1, 1.0, 2.0, 4.0])
    >>> one = found.isel(condition=0, direction=0, window=0)
    >>> closed = vs.theory.amplitude_max(1, one.restitution.values)
    >>> bool((abs(one.A_max - closed) <= one.A_max_bracket).all())
    True
    """
    checked = as_sweep(spec, keywords, "windows", 1, windows={})
    found = find_windows(checked, thread_count(threads))
    if (checked.windows or {}).get("prove"):
        from vibrosweep.proof import prove_windows

        found = prove_windows(found, checked.scene)
    return warned(found)


@completed(by=SweepKeywords)
def bifurcation(
    spec: Spec | None = None,
    /,
    *,
    observable: str | OfImpacts = "rebound_velocity",
    samples: int = 64,
    launches: int = 8,
    threads: int | None = None,
    **keywords: Unpack[SweepKeywords],
) -> xr.Dataset:
    """Continue orbits up and down the forcing, with new launches at each point.

    An attractor that orbits reach neither on the way up nor on the way down is found if one of the
    launches leads to it.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords given with a result complete it.
    observable
        ``"rebound_velocity"`` (m s-1), ``"rebound_height"`` (m), ``"flight_time"`` (s),
        ``"impact_phase"`` (turns), or a function of the phase of landing (turns), the speed at
        lift-off (m s-1) and gravity (m s-2), on arrays of any shape.
    samples
        Number of impacts that are recorded at each point, once the orbit has settled; four times
        as many of an aperiodic one.
    launches
        Number of new launches at each point, staggered over one forcing period.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`; the forcing, in any of its four forms, is an ascending list.
        Without a duration orbits are simulated until they settle.

    Returns
    -------
    xarray.Dataset
        Dims: o stands for (direction, amplitude, particle), where the forcing that was given
        replaces ``amplitude``.

        ==============================================  =========  ================================
        variable                                        dims       meaning
        ==============================================  =========  ================================
        the observable, under its name                  o, sample  ``observable`` for a function
        ``regime``, ``cycle_impacts``,                  o          codes and numbers as in sweeps
        ``cycle_periods``, ``cycle_rests``
        ``lyapunov_largest`` with its error             o          per impact
        the same, names begin with ``launched_``        launch     of the new launches: launch in
                                                                   place of direction and particle
        ``attractors``                                  amplitude  number of different ones found
        ``chaos_low``, ``chaos_high``                              neighbouring points between which
                                                                   the first positive exponent
                                                                   appears, by three standard
                                                                   errors; else NaN
        ==============================================  =========  ================================

    Raises
    ------
    SpecError
        Keywords hold mistakes, all of which are listed, or there are other axes.
    ParameterError
        The observable is not known, or the impacts do not fit into memory.

    Warns
    -----
    ShortObservationWarning
        Orbits are observed for too short a time to tell what all of them settle on; the attribute
        ``notes`` of the result says so too.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.bifurcation(amplitude=[0.6, 0.7, 0.8], samples=4, duration_periods=2000)
    >>> table = found.rebound_velocity.to_series().dropna()
    >>> table.index.names
    FrozenList(['direction', 'amplitude', 'particle', 'sample'])
    """
    samples = count("samples", samples)
    launches = count("launches", launches)
    checked = as_sweep(spec, keywords, "bifurcation", 1)
    return warned(follow_orbits(checked, observable, samples, launches, thread_count(threads)))


@completed(by=SweepKeywords)
def basins(
    spec: Spec | None = None, /, *, threads: int | None = None, **keywords: Unpack[SweepKeywords]
) -> xr.Dataset:
    """Find the attractor that each launch leads to.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords given with a result complete it.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`: ``launch_velocity`` is a list (m s-1); ``launch`` gives the
        launch times (s), or ``particles`` the number of staggered ones; ``restitution`` or a
        forcing may be a list too.  Without a duration orbits are simulated until they settle.

    Returns
    -------
    xarray.Dataset
        =======================================  ============================  =====================
        variable                                 dims                          meaning
        =======================================  ============================  =====================
        ``basin``                                launch_velocity, launch_time  index into the dim
                                                                               attractor, -1 for
                                                                               unsettled launches
        ``slot``                                 launch_velocity, launch_time  number of the
                                                                               time-shifted copy of
                                                                               the attractor
        ``fraction``                             attractor                     share of the
                                                                               launches; the most
                                                                               frequent attractor is
                                                                               the first
        ``fraction_low``, ``fraction_high``      attractor                     95 % interval of this
                                                                               share
        ``regime``                               attractor                     regime of the
                                                                               attractor
        ``cycle_impacts``                        attractor                     impacts in a cycle
        ``cycle_periods``, ``cycle_rests``       attractor                     forcing periods and
                                                                               rests in a cycle
        ``lyapunov_largest``                     attractor                     largest Lyapunov
                                                                               exponent per impact
        ``impact_phase`` (turns)                 attractor                     at the impact before
                                                                               the shortest flight
                                                                               of the cycle
        ``rebound_velocity`` (m s-1)             attractor                     at the same impact
        ``unsettled_fraction``                                                 share of launches
                                                                               that have not settled
        ``basin_entropy``, ``boundary_entropy``                                mean entropies of
                                                                               boxes of launches
        ``uncertainty_exponent``                                               1 for a smooth
                                                                               boundary; and its
                                                                               error
        =======================================  ============================  =====================

        If a parameter is a list, it is the first dim of all variables but ``regime``,
        ``cycle_periods`` and ``cycle_rests``, which an attractor keeps from value to value;
        it is identified with the nearest attractor of its kind at the next value.

    Raises
    ------
    SpecError
        Keywords hold mistakes, all of which are listed, or there are other axes.
    ParameterError
        The launches do not fit into memory.

    Warns
    -----
    ShortObservationWarning
        Orbits are observed for too short a time to tell what all of them settle on; the attribute
        ``notes`` of the result says so too.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.basins(launch_velocity=[3.0, 4.0, 5.0], particles=20, duration=2000.0)
    >>> found.basin.dims, found.basin.shape
    (('launch_velocity', 'launch_time'), (3, 20))
    """
    return warned(find_basins(as_sweep(spec, keywords, "basins", 1), thread_count(threads)))


@completed(by=SweepKeywords)
def sobol(
    spec: Spec | None = None,
    /,
    *,
    outputs: Sequence[str] | None = None,
    confidence: float = 0.95,
    threads: int | None = None,
    **keywords: Unpack[SweepKeywords],
) -> xr.Dataset:
    """First-order and total Sobol' indices of measured variables with respect to parameters.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords given with a result complete it.
    outputs
        Measured variables with one number for each realization; by default
        ``rebound_height_max``, ``rebound_height_mean``, ``flight_time_mean`` and, for two or more
        particles, ``dt_min``.
    confidence
        Level of the intervals, from a bootstrap.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`: parameters that vary are tuples ``(low, high)``, and
        ``realizations`` is the size of the base sample, a power of 2, 1024 by default; (parameters
        + 2) times as many are computed.

    Returns
    -------
    xarray.Dataset
        Dims (output, parameter): ``first_order`` and ``total_order``, each with ``_low`` and
        ``_high``; dim output: ``mean`` and ``standard_deviation``, in the unit of the output.

    Raises
    ------
    SpecError
        Keywords hold mistakes, all of which are listed, or no parameter varies.
    DataError
        A realization did not complete, or an output is undetermined or undefined in some
        realization, or the same in all.
    ParameterError
        The number of realizations is not a power of 2, or `outputs` or `confidence` is not allowed.

    Warns
    -----
    ShortObservationWarning
        Orbits are observed for too short a time to tell what all of them settle on; the attribute
        ``notes`` of the result says so too.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sobol(restitution=(0.8, 0.98), amplitude=(0.2, 3.5), realizations=64)
    >>> found.total_order.dims, found.parameter.values.tolist()
    (('output', 'parameter'), ['restitution', 'amplitude'])
    """
    checked = as_sweep(spec, keywords, "sobol", SOBOL_SAMPLE)
    return warned(sobol_indices(checked, outputs, confidence, thread_count(threads)))


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
        is taken; keywords given with a result complete it.
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
        The axes of a grid, or ``realization``, are first dims where parameters vary;
        further dims are these:

        ====================================  =================  ===================================
        variable                              dims               meaning
        ====================================  =================  ===================================
        ``cycle_impacts``, ``cycle_periods``  orbit              0 past the last orbit
        ``stable``                            orbit              whether the orbit attracts
        ``admissible``                        orbit              code: a particle can follow the
                                                                 orbit, would land earlier, or would
                                                                 rest
        ``multiplier_real``                   orbit, multiplier  real parts of the multipliers
        ``multiplier_imaginary``              orbit, multiplier  their imaginary parts
        ``impact_phase`` (turns)              orbit, impact      from the impact before the shortest
                                                                 flight on
        ``rebound_velocity`` (m s-1)          orbit, impact      velocity at lift-off
        ``flight_time`` (s)                   orbit, impact      of the flight that follows
        ``impact_speed`` (m s-1)              orbit, impact      at the end of that flight
        ``seeds``                             impacts, periods   number of seeds tried
        ``late_orbits``                       impacts, periods   new orbits to which the last half
                                                                 of the seeds led
        ``saddle_points``, ``other_points``   impacts, periods   numbers that differ over the
                                                                 high-bounce base only if orbits
                                                                 were missed
        ``balanced``                          impacts, periods   1 if they are equal, which does not
                                                                 show that none was missed
        ====================================  =================  ===================================

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
    """Continue periodic orbits along a parameter, past folds, and find their bifurcations.

    The orbits found at the values of the axis are continued in both directions, each once, until
    they leave the range of the axis, touch the base, or begin to rest.  Saddle-nodes, period
    doublings, grazings (in flight, or at a landing of speed 0) and rests are solutions of equations
    for the orbit, the parameter and the multiplier together.  A branch that no step continues is
    listed, and its end is ``lost``.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords given with a result complete it.
    impacts, periods
        Largest numbers of impacts and of forcing periods of the orbits at the values of the axis;
        up to 12 and 64.
    doublings
        Number of successive period doublings from which the new orbits are continued too; at most
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
        The parameter has its own name, as here ``amplitude``.

        =========================================  =========================  ======================
        variable                                   dims                       meaning
        =========================================  =========================  ======================
        ``amplitude``, ``stable``, ``admissible``  branch, point              the parameter, and
                                                                              codes as in `orbits`
        ``multiplier_real``                        branch, point, multiplier  real parts of the
                                                                              multipliers
        ``multiplier_imaginary``                   branch, point, multiplier  their imaginary parts
        ``impact_phase`` (turns)                   branch, point, impact      phase of the forcing
        ``rebound_velocity`` (m s-1)               branch, point, impact      velocity at lift-off
        ``bifurcation``                            branch, event              kind of each event
        ``bifurcation_amplitude``                  branch, event              the parameter there
        ``bifurcation_phase``                      branch, event, impact      phases of the impacts
                                                                              there
        ``cycle_impacts``, ``cycle_periods``       branch                     of the orbit
        ``parent``                                 branch                     the branch from which
                                                                              it was born
        ``ends``                                   branch, end                why it ends
        =========================================  =========================  ======================

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

    At each restitution of the axis orbits are continued along the forcing, as by
    `vibrosweep.branches`; each of their bifurcations is then continued in both directions as a
    curve in the plane.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords given with a result complete it.
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


@completed(by=RealizationKeywords)
def separations(
    spec: Spec | xr.Dataset | None = None,
    /,
    *,
    against: str | None = None,
    bins: int = 10,
    measure: str = "dt_min",
    quantiles: Sequence[float] = QUANTILES,
    threads: int | None = None,
    **keywords: Unpack[RealizationKeywords],
) -> xr.Dataset:
    """Distribution of the smallest separation between landings of different particles.

    Parameters
    ----------
    spec
        Instead of keywords: the result of a sweep with separations, or an argument of
        `vibrosweep.sweep`.
    against
        Parameter against which the distribution is given, in bins that hold equally many
        realizations; by default all realizations are taken together.
    bins
        Number of bins.
    measure
        ``"dt_min"``, over all landings, or ``"dt_min_same_index"``, over equal impact numbers.
    quantiles
        In [0, 1]; the quantile q is the least number that a share q of separations do not exceed.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`; ``separation=True`` is implied.

    Returns
    -------
    xarray.Dataset
        ``separation_quantile`` (quantile) in s, ``zero_fraction``, ``collision_free_fraction`` with
        the ends of its Wilson 95 % interval, and the number ``known`` of realizations with a
        separation: scalars, or along dim ``part``, with the ends of each bin as coordinates.
        Without `against` also ``separation`` (rank) in s, sorted, with ``cumulative_fraction``.

    Raises
    ------
    SpecError
        Keywords hold mistakes; all of them are listed.
    DataError
        The result lacks separations, or `against` does not differ between realizations.
    ParameterError
        The measure is not one of the two, or `bins` or `quantiles` are not allowed.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.separations(amplitude=(0.5, 3.5), realizations=64, particles=5)
    >>> int(found.known)
    64
    """
    bins = count("bins", bins)
    if isinstance(spec, xr.Dataset):
        if keywords:
            raise ParameterError(f"{', '.join(keywords)}: cannot be given together with a result")
        result = spec
    else:
        needed = {"separation": True} if spec is None else {}
        complete: dict[str, Any] = needed | dict(keywords)
        result = sweep(spec, threads=threads, **complete)
    if against is None:
        return separation_distribution(result, measure=measure, quantiles=quantiles)
    return separation_against(result, against, bins=bins, measure=measure, quantiles=quantiles)
