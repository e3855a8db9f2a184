"""Sweeps, in memory or into a file: a sweep file, a mapping, a result, or keywords."""

from __future__ import annotations

import os
import tomllib
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Unpack

import xarray as xr

from vibrosweep.analysis.common import OBSERVATION
from vibrosweep.api.keyword_types import SweepKeywords, completed
from vibrosweep.errors import (
    DataError,
    ExistingOutputError,
    ParameterError,
    ShortObservationWarning,
    count,
)
from vibrosweep.kernels.statistics import compiled
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.observables import Observable
from vibrosweep.runs.driver import (
    added,
    cleared,
    is_of,
    kept_text,
    origin,
    require_switch,
    run_sweep,
    sweep_in_memory,
    thread_count,
)
from vibrosweep.scene.sweep import Sweep, keyword_spec, read_spec
from vibrosweep.store.disk import check_output, path_of
from vibrosweep.store.parts import replaces
from vibrosweep.store.reading import open_sweep
from vibrosweep.waiting import showing

__all__ = ["Spec", "as_sweep", "run", "sweep", "warned"]


@completed(by=SweepKeywords)
def sweep(
    spec: Spec | None = None,
    /,
    *,
    observables: Iterable[Observable] = (),
    threads: int | None = None,
    progress: bool | None = None,
    **keywords: Unpack[SweepKeywords],
) -> xr.Dataset:
    """Compute realizations in memory.

    Every keyword below is also a key of a sweep file, and means the same there.  A physical
    parameter that is a number is fixed, a tuple ``(low, high)`` is a range from which realizations
    are drawn, and a list or 1-D array is an axis of a grid.

    Parameters
    ----------
    spec
        Instead of keywords: a mapping of them, the path of a sweep file, or a result, whose sweep
        is taken; keywords given with a result complete it.
    observables
        Functions that are called at every landing.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    progress
        True to show a progress bar; by default in a notebook and on a terminal.
    **keywords
        The sweep:

        restitution, frequency, phase, gravity, launch_velocity, contact_time
            Physical parameters (1, Hz, rad, m s-2, m s-1, s).
        amplitude, base_velocity, base_displacement, base_acceleration
            The forcing, a physical parameter given in one of four ways: amplitude A of the kick
            (m s-1), or peak velocity V0 (m s-1), displacement B (m) or acceleration Gamma (in units
            of gravity) of the base; A = (1 + e) V0, V0 = 2 pi f B, Gamma = 2 pi f V0 / g.  By
            default the amplitude of Table 1.
        particles, launch
            Number of particles in each realization, and ``"staggered"`` launches (particle j at
            j / (particles * frequency)) or a list of launch times in s.
        duration, duration_periods
            End of the observation in s, 12 by default, or in forcing periods.
        base, rebound
            The base: ``"high-bounce"``, which stays at height zero and kicks, ``"moving"``, or
            ``"sprung"``, a moving base of finite mass, which recoils.  The law of rebound:
            ``"rest"``, or, over the high-bounce base only, ``"reflect"``.
        waveform
            Shape of the motion of the base: ``"sine"``, ``"parabolic"``, or the harmonics of its
            velocity with number, weight and phase in rad,
            ``{"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}``.
        restitution_law, restitution_speed, restitution_exponent, restitution_points
            Law by which the restitution depends on the impact speed, and the speed (m s-1) that
            scales it: ``"constant"``; ``"plastic"``: it falls above this speed, at which yielding
            begins; ``"viscoelastic"``: ``restitution`` is its value at this speed; ``"power"``: it
            falls with the power -``restitution_exponent`` above this speed; ``"points"``: it is
            linear between ``restitution_points``, two or more pairs of speed (m s-1) and
            restitution, or a CSV file with these columns, and constant beyond both ends; or a law
            registered with `vibrosweep.register_law`.
        restitution_noise, restitution_noise_relative, kick_noise, drive_noise, noise_seed
            Standard deviations, each a physical parameter: of the restitution at each impact (1),
            absolute or in units of ``restitution``, of which one can be given; of the velocity of
            the base at each impact (m s-1); of the amplitude in each forcing period, in units of
            the amplitude (1).  The seed of the random numbers, 0 by default.
        mass_ratio, particle_mass, base_mass, mount_frequency, mount_damping
            For the sprung base, as physical parameters: the mass of one particle in units of that
            of the base, or both masses (kg); natural frequency (Hz) and damping ratio (0.05 by
            default) of its mount.
        design, realizations, seed
            ``"uniform"``, ``"latin"`` or ``"sobol"`` for ranges, with the number of realizations
            and a seed; ``"grid"`` for axes; or a table of realizations, as pandas.DataFrame,
            xarray.Dataset, dict of columns, or path (.csv, .nc): its columns are physical
            parameters, and others, which the result keeps as coordinates.
        columns
            Columns of the table to use, all by default.
        transient, transient_periods
            Beginning of the window in which quantities are measured, in s or in forcing periods.
        separation, per_particle, regimes, lyapunov, trust, ordering, joint, impact_speed
            Measures besides landings, heights and flight times: True or False.
        undecided
            True to count decisions over a base of finite mass that rounding may have changed.
        tolerance, impact_budget
            Largest error of a landing time, in s, that ``trust`` accepts; number of impacts after
            which a particle is abandoned.
        title
            Title of the sweep.

    Returns
    -------
    xarray.Dataset
        Measured variables with units and meanings as attributes, and parameters as coordinates.
        The dims are the axes of a grid, for other designs ``realization``; and ``particle`` for
        measures of each particle.  The attribute ``notes`` says which defaults were taken, and
        whether the observation is too short for the requested regimes or exponents.

    Raises
    ------
    SpecError
        Keywords are unknown, contradict each other, or have values that are not allowed; all
        mistakes are listed.
    TableError
        The table of realizations holds mistakes.
    ParameterError
        The result does not fit into memory, or a setting of this call is wrong.
    RunError
        The computation failed twice, which is a fault of vibrosweep.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sweep(restitution=(0.80, 0.98), amplitude=(0.2, 3.5), realizations=50, seed=1)
    >>> found.rebound_height_max.dims, found.rebound_height_max.attrs["units"]
    (('realization',), 'm')
    """
    checked = _with_observables(as_sweep(spec, keywords), observables)
    if checked.record is not None:
        raise ParameterError(
            "record: a sweep in memory keeps no landings; write it to a file with vibrosweep.run, "
            "or call vibrosweep.simulate"
        )
    require_switch("progress", progress)
    with showing(progress) as advance:
        return sweep_in_memory(checked, threads=thread_count(threads), advance=advance)


def run(
    spec: Spec,
    output: str | os.PathLike[str],
    *,
    observables: Iterable[Observable] = (),
    threads: int | None = None,
    chunk: int | None = None,
    force: bool = False,
    progress: bool | None = None,
) -> xr.Dataset:
    """Compute a sweep into a file and open it; an interrupted run is continued.

    Parameters
    ----------
    spec
        Path of the sweep file (TOML), or a mapping of the keywords of `sweep`, or of the tables of
        a sweep file, as `tomllib` reads them.
    output
        Path of the result.  An existing result of the same sweep is opened.  One with fewer
        realizations is continued, if its design is uniform or a Sobol' sequence.  Another existing
        file is an error, unless `force`.
    observables
        As for `sweep`.  An unfinished run is continued only with functions that compute the same.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    chunk
        Realizations in a chunk, by default some seconds of work; the result does not depend on it.
    force
        True to replace an existing output and discard an unfinished run.
    progress
        True to show a progress bar; by default in a notebook and on a terminal.

    Returns
    -------
    xarray.Dataset
        As `sweep` returns it; values are read from the file when they are needed.

    Raises
    ------
    SpecError, TableError, OutputError, ParameterError
        The sweep or its table holds mistakes, or the output cannot be written.
    RunError
        Another process computes this output, an unfinished run of another sweep is in the way, or
        chunks failed; the same call again computes those that are missing.

    Examples
    --------
    >>> import tempfile, vibrosweep as vs
    >>> sweep = {"restitution": (0.80, 0.98), "realizations": 50, "particles": 2}
    >>> with tempfile.TemporaryDirectory() as folder, vs.run(sweep, f"{folder}/out.h5") as found:
    ...     print(found.sizes["realization"])
    50
    """
    path = path_of("output", output)
    given = as_sweep(spec, {}, kept=lambda: kept_text(path))
    checked = _with_observables(given, observables)
    chunk = None if chunk is None else count("chunk", chunk)
    require_switch("force", force)
    require_switch("progress", progress)
    try:
        check_output(path, force=force or replaces(path), inputs=checked.inputs)
    except ExistingOutputError as error:
        if is_of(checked, path):
            cleared(checked, path)
            return open_sweep(path)
        if not added(checked, path):
            raise ExistingOutputError(path, origin(checked, path)) from error
    with showing(progress) as advance:
        run_sweep(
            checked, path, threads=thread_count(threads), chunk=chunk, force=force, advance=advance
        )
    return open_sweep(path)


def _with_observables(spec: Sweep, observables: Iterable[Observable]) -> Sweep:
    """Add observables to a sweep, and compile them, so that a mistake shows before a long run."""
    completed_spec = spec.with_observables(observables)
    for observable in completed_spec.scene.measures.observables:
        compiled(observable)
    return completed_spec


Spec = str | os.PathLike[str] | Mapping[str, Any]


def as_sweep(
    spec: Spec | Sweep | None,
    keywords: Mapping[str, Any],
    analysis: str = "",
    realizations: int | None = None,
    kept: Callable[[], str] | None = None,
    **defaults: Any,
) -> Sweep:
    """Return the sweep that a path, a mapping or a result describes, or keywords if `spec` is None.

    A sweep, which the command line has checked, is returned as it is.
    `analysis` is passed to `keyword_spec`, `kept` to `read_spec`.  `defaults` complete keywords, a
    mapping or a result, but not a file; so does `realizations` where keywords or a mapping hold
    ranges.  Raises a SpecError that lists all mistakes, a ParameterError for keywords with a file
    or a mapping and for a `spec` of another type, and a DataError for a dataset that does not hold
    the sweep from which it was computed.
    """
    if isinstance(spec, Sweep):
        return spec
    if spec is not None and hasattr(spec, "attrs"):
        completed = {**defaults, **_sweep_of(spec.attrs), **keywords}
        return keyword_spec(completed, analysis, keywords)
    stated = spec if isinstance(spec, Mapping) else keywords
    if any(name in INPUTS and isinstance(value, tuple) for name, value in stated.items()):
        defaults["realizations"] = realizations
    if spec is None:
        return keyword_spec({**defaults, **keywords}, analysis, keywords)
    if keywords:
        raise ParameterError(
            f"{', '.join(keywords)}: cannot be given together with a sweep file or a mapping; "
            f"write it there"
        )
    if isinstance(spec, Mapping):
        return keyword_spec({**defaults, **spec}, analysis, kept=kept)
    if isinstance(spec, str | os.PathLike):
        return read_spec(spec, kept)
    raise ParameterError(
        f"{type(spec).__name__}: is not a sweep; give keywords, a mapping, or the path of a sweep "
        f"file"
    )


def _sweep_of(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of the sweep file of a result."""
    if "sweep_file" not in attributes:
        raise DataError(
            "the dataset is not a result of vibrosweep.sweep, run or open_sweep, or has lost its "
            "attributes, which hold the sweep: give keywords, or the path of a sweep file"
        )
    return tomllib.loads(str(attributes["sweep_file"]))


def warned(found: xr.Dataset) -> xr.Dataset:
    """Warn of an observation that is too short, and return the result, whose notes say so too."""
    if short := found.attrs["notes"].partition(OBSERVATION)[2]:
        warnings.warn(short, ShortObservationWarning, stacklevel=3)
    return found
