"""Analyses that compute realizations: windows, bifurcations, basins, Sobol' indices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Unpack

import xarray as xr

from vibrosweep.analysis.basins import basins as find_basins
from vibrosweep.analysis.bifurcation import OfImpacts
from vibrosweep.analysis.bifurcation import bifurcation as follow_orbits
from vibrosweep.analysis.sensitivity import sobol_indices
from vibrosweep.api.given_sweep import Spec, as_sweep, warned
from vibrosweep.api.keyword_types import SweepKeywords, WindowKeywords, completed
from vibrosweep.api.proved import windows_found
from vibrosweep.runs.driver import count, thread_count

__all__ = ["basins", "bifurcation", "sobol", "windows"]

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
        is taken; keywords beside a result complete it.
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
            True to continue orbits along the scan, up and down, instead of launching them anew at
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
        Dims (condition, direction, restitution, window): ``A_min`` and ``A_max`` (m s-1), the
        middles of brackets of width ``A_min_bracket`` and ``A_max_bracket``, NaN where a window
        reaches the end of the scan and past the last window; ``window_ends``, a code for windows
        that reach an end of the scan, and for ends beyond which the condition is undetermined.
        Names begin with the symbol of the scanned forcing: ``A``, ``V0``, ``B``, ``Gamma``.  Dims
        (condition, direction, restitution): ``window_count`` and ``widest``, the index of the
        widest window, -1 if there is none.  Dims (condition, direction, restitution, scan):
        ``holds``, 1 where the condition holds, 0 where it fails, -1 where it is undetermined.  With
        `prove` also ``min_proof``, ``max_proof`` and ``inside_proof``, with the dims of ``A_min``:
        codes for a proof, or for the reason why there is none; and ``A_min_low``, ``A_min_high``,
        ``A_max_low``, ``A_max_high``, which enclose proved ends.  Under noise also ``share``,
        ``share_low`` and ``share_high`` with the dims of ``holds``: the share of replicas (for
        ``locked(k)`` of replicas and particles) for which the condition holds, with its 95 %
        interval (Clopper & Pearson 1934).

    Raises
    ------
    SpecError
        Keywords hold mistakes, all of which are listed, or the scan has other axes.
    ParameterError
        A condition cannot be continued, or the points do not fit into memory.
    MissingFlintError
        Proofs are asked for, and python-flint is not installed.

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
    return warned(windows_found(checked, thread_count(threads)))


@completed(by=SweepKeywords)
def bifurcation(
    spec: Spec | None = None,
    /,
    *,
    observable: str | OfImpacts = "rebound_velocity",
    samples: int = 64,
    threads: int | None = None,
    **keywords: Unpack[SweepKeywords],
) -> xr.Dataset:
    """Follow orbits up and down the forcing, from each point to the next.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords beside a result complete it.
    observable
        ``"rebound_velocity"`` (m s-1), ``"rebound_height"`` (m), ``"flight_time"`` (s),
        ``"impact_phase"`` (turns), or a function of the phase of landing (turns), the speed at
        lift-off (m s-1) and gravity (m s-2), on arrays of any shape.
    samples
        Number of impacts that are kept at each point, once the orbit has settled.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`; the forcing, in any of its four forms, is an ascending list.
        Without a duration orbits are followed until they settle.

    Returns
    -------
    xarray.Dataset
        Dims (direction, amplitude, particle, sample), where the forcing that was given replaces
        ``amplitude``: the observable under its name, ``observable`` for a function.  Dims
        (direction, amplitude, particle): ``regime``, ``cycle_impacts``, ``cycle_periods``,
        ``cycle_rests``, ``lyapunov_largest`` with its error.

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
    checked = as_sweep(spec, keywords, "bifurcation", 1)
    return warned(follow_orbits(checked, observable, samples, thread_count(threads)))


@completed(by=SweepKeywords)
def basins(
    spec: Spec | None = None, /, *, threads: int | None = None, **keywords: Unpack[SweepKeywords]
) -> xr.Dataset:
    """Find the attractor that each launch leads to.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords beside a result complete it.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`: ``launch_velocity`` is a list (m s-1); ``launch`` gives the
        launch times (s), or ``particles`` the number of staggered ones; ``restitution`` or a
        forcing may be a list too.  Without a duration orbits are followed until they settle.

    Returns
    -------
    xarray.Dataset
        Dims (launch_velocity, launch_time): ``basin``, an index into the dim attractor, -1 for
        unsettled launches; and ``slot``, the number of the time-shifted copy of the attractor.  Dim
        attractor, the most frequent first: ``fraction`` of the launches with its 95 % interval,
        ``fraction_low`` and ``fraction_high``; ``regime``, ``cycle_impacts``, ``cycle_periods``,
        ``cycle_rests``, ``lyapunov_largest``; and, at the impact before the shortest flight of the
        cycle, ``impact_phase`` (turns) and ``rebound_velocity`` (m s-1).  Scalars:
        ``unsettled_fraction``, ``basin_entropy``, ``boundary_entropy``, ``uncertainty_exponent``
        and its error.  If a parameter is a list, it is the first dim of all variables but
        ``regime``, ``cycle_periods`` and ``cycle_rests``, which an attractor keeps from value to
        value; it is identified with the nearest attractor of its kind at the next value.

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
        is taken; keywords beside a result complete it.
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
        ``_high``; dim output: ``mean`` and ``standard_deviation``, in the output's own unit.

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
