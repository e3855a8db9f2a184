"""Separations of a sweep, also against independent landings, and shares of realizations.

Independent landings come close by chance.  Particle i lands n_i times in a window T, at phases of
the density rho_i (in turns); if it lands at most about once per forcing period, coincidences of
particles are a Poisson process: with

    Lambda = sum over pairs i < j of (2 n_i n_j / T) int rho_i rho_j

z = Lambda dt_min is distributed as Exp(1), and chance gives a separation at least as small with
the probability 1 - exp(-z).  Uniform phases make the integral 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.datasets import (
    completed,
    equal_parts,
    per_realization,
    require,
    share_interval,
    shares,
    table,
    variable,
)
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError, count, finite, require_one_of
from vibrosweep.mistakes import quoted
from vibrosweep.model.measures import UNDETERMINED, VARIABLES, Regime, Status, known
from vibrosweep.model.parameters import as_numbers
from vibrosweep.store.arranged import arranged, flat, require_dataset, require_datasets

__all__ = [
    "QUANTILES",
    "compare_separations",
    "order_against_chance",
    "separation_against",
    "separation_distribution",
    "separations_against_chance",
    "share_against",
]

QUANTILES: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
MEASURES: Final = ("dt_min", "dt_min_same_index")
FREE: Final = "collision_free"
OF_SWEEPS: Final = (FREE, *(regime.meaning for regime in Regime))
# Harmonics of a density of phases: peaks down to 1/32 of a turn are resolved
HARMONICS: Final = 16
# Phases count as discrete, as on a cycle of up to ten impacts, where the mean square of the upper
# half of the harmonics exceeds this: a smooth density has hardly any such harmonics
POINTS: Final = 0.1
# Most landings per forcing period: above it landings cluster (chattering) and are not independent
OFTEN: Final = 1.2
# Rounding of shifted times, relative to the window
ROUNDING: Final = 1e-13
MOST: Final = 10**6  # surrogates
_NAMES: Final = {
    "coincidence_rate": ("rate of coincidences of independent landings, Lambda", "s-1"),
    "dt_min": ("smallest separation in the window", "s"),
    "dt_min_over_chance": ("smallest separation times the rate, z: Exp(1) for chance", "1"),
    "dt_min_chance": ("probability that chance gives a dt_min at least as small", "1"),
    "phase_factor": ("rate of coincidences over that of uniform phases", "1"),
    "dt_min_surrogate_share": ("share of surrogates with a dt_min at least as small", "1"),
    "order_over_chance": ("N R^2 of the last landings: Exp(1) for many uniform phases", "1"),
    "order_chance": ("probability that chance gives an order parameter at least as large", "1"),
    "gap_chance": ("probability that chance gives a smallest gap at least as small", "1"),
}


def separation_distribution(
    sweep: xr.Dataset, *, measure: str = "dt_min", quantiles: Sequence[float] = QUANTILES
) -> xr.Dataset:
    """Quantiles and empirical distribution of a separation over the realizations of a sweep.

    Parameters
    ----------
    sweep
        Result of a sweep with separations.
    measure
        ``"dt_min"`` or ``"dt_min_same_index"``.
    quantiles
        In [0, 1]; the quantile q is the least separation that a share q of them does not exceed.

    Returns
    -------
    xarray.Dataset
        ``separation_quantile`` (quantile) in s; ``separation`` (rank) in s, sorted, and
        ``cumulative_fraction`` (rank), the fraction of realizations with at most that separation.
        Scalars: ``zero_fraction``, ``collision_free_fraction`` with the ends of its Wilson 95 %
        interval, and the number ``known`` of realizations in which the separation is defined.
        Separations of realizations that did not complete are left out: later landings might have
        been closer.

    Raises
    ------
    DataError
        The sweep lacks a variable.
    ParameterError
        The measure is not one of the two.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import separation_distribution
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, particles=2, separation=True)
    >>> found = separation_distribution(sweep, quantiles=[0.5])
    >>> found.separation.dims, found.separation_quantile.attrs["units"]
    (('rank',), 's')
    """
    sweep = _checked(sweep, "separation_distribution", measure, quantiles)
    values = sweep[measure].values
    rank = np.sort(values[np.isfinite(values)])
    share = np.arange(1, rank.size + 1) / max(rank.size, 1)
    found = table(
        "rank",
        separation=(rank, VARIABLES[measure].long_name, "s"),
        cumulative_fraction=(share, "fraction of realizations with at most this separation"),
    )
    parts = [_statistics(values, sweep["collision_free"].values, quantiles)]
    return xr.merge([found, _parts(parts, measure, quantiles).squeeze("part", drop=True)])


def separation_against(
    sweep: xr.Dataset,
    parameter: str,
    *,
    bins: int = 10,
    measure: str = "dt_min",
    quantiles: Sequence[float] = QUANTILES,
) -> xr.Dataset:
    """Separation against a sampled parameter, in bins that hold equally many realizations.

    Parameters
    ----------
    sweep
        Result of a sweep with separations.
    parameter
        Name of a parameter that differs between realizations, such as ``"restitution"``.
    bins
        Number of bins; fewer where the parameter takes fewer values.
    measure, quantiles
        As for `separation_distribution`.

    Returns
    -------
    xarray.Dataset
        Dim ``part``: the scalars and quantiles of `separation_distribution` for each bin, with
        coordinates ``{parameter}_low`` and ``{parameter}_high``, its ends.

    Raises
    ------
    DataError
        The sweep lacks a variable, or the parameter is the same in all realizations.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import separation_against
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, particles=2, separation=True)
    >>> separation_against(sweep, "amplitude", bins=5).separation_quantile.dims
    ('part', 'quantile')
    """
    sweep = _checked(sweep, "separation_against", measure, quantiles)
    require(sweep, "separation_against", parameter)
    parts, ends = equal_parts(sweep, parameter, bins, "separation_against")
    dt, free = sweep[measure].values, sweep["collision_free"].values
    found = [_statistics(dt[part], free[part], quantiles) for part in parts]
    return _parts(found, measure, quantiles).assign_coords(ends)


def compare_separations(
    sweeps: Sequence[xr.Dataset], *, measure: str = "dt_min", quantiles: Sequence[float] = QUANTILES
) -> xr.Dataset:
    """Separation against the number of particles and the time of observation.

    Parameters
    ----------
    sweeps
        Results of sweeps that differ in the number of particles, in the duration, or both.
    measure, quantiles
        As for `separation_distribution`.

    Returns
    -------
    xarray.Dataset
        Dim ``part``, one for each sweep in the given order: the scalars and quantiles of
        `separation_distribution`, with coordinates ``particles`` and ``duration`` (s).

    Raises
    ------
    DataError
        A sweep lacks a variable or its number of particles.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import compare_separations
    >>> shared = {"amplitude": (0.2, 3.5), "realizations": 50, "separation": True}
    >>> found = compare_separations([vs.sweep(**shared, particles=n) for n in (2, 5)])
    >>> found.particles.values.tolist()
    [2, 5]
    """
    require_datasets(sweeps)
    sweeps = [_checked(sweep, "compare_separations", measure, quantiles) for sweep in sweeps]
    for sweep in sweeps:
        if "particles" not in sweep.attrs:
            raise DataError(
                "compare_separations needs the number of particles, which the dataset does not "
                "state: open the result of vibrosweep run"
            )
    parts = [_statistics(s[measure].values, s["collision_free"].values, quantiles) for s in sweeps]
    particles = np.array([int(s.attrs["particles"]) for s in sweeps])
    durations = np.array([_duration(s) for s in sweeps])
    comment = "NaN where it differs between realizations"
    return _parts(parts, measure, quantiles).assign_coords(
        particles=variable("part", particles, "particles"),
        duration=variable("part", durations, "end of the observation", "s", comment=comment),
    )


def _duration(sweep: xr.Dataset) -> float:
    values = np.unique(sweep["duration"].values)
    values = values[~np.isnan(values)]
    return float(values[0]) if values.size == 1 else np.nan


def _checked(
    sweep: xr.Dataset, analysis: str, measure: str, quantiles: Sequence[float]
) -> xr.Dataset:
    """Return a sweep along one dim; raise an error if an argument is wrong or data are missing."""
    sweep = flat(sweep)
    require_one_of("measure", measure, MEASURES)
    levels = as_numbers("quantiles", quantiles)
    if levels.ndim != 1 or not np.all((levels >= 0.0) & (levels <= 1.0)):
        raise ParameterError(
            f"quantiles = {quantiles!r}: must be a list of numbers, at least 0 and at most 1"
        )
    require(sweep, analysis, measure, "collision_free", "duration")
    known = np.where(completed(sweep), sweep[measure].values, np.nan)
    return sweep.assign({measure: (("realization",), known, sweep[measure].attrs)})


def _statistics(dt: Array, free: NDArray[np.int8], quantiles: Sequence[float]) -> Array:
    """Number known, zero fraction, collision-free fraction and its interval, then quantiles."""
    known = dt[np.isfinite(dt)]
    # take a separation that occurs: interpolation would fill the gap above the separation zero
    at = (
        np.quantile(known, quantiles, method="inverted_cdf")
        if known.size
        else np.full(len(quantiles), np.nan)
    )
    zero = np.mean(known == 0.0) if known.size else np.nan
    decided = free[free != UNDETERMINED]
    if not decided.size:
        return np.array([known.size, zero, np.nan, np.nan, np.nan, *at])
    count = np.count_nonzero(decided == 1)
    low, high = share_interval(np.asarray(count), decided.size).values()
    return np.array([known.size, zero, count / decided.size, low, high, *at])


def _parts(parts: Sequence[Array], measure: str, quantiles: Sequence[float]) -> xr.Dataset:
    """Dataset of the `_statistics` of parts of the realizations."""
    statistics = np.array(parts)
    known, zero, free, free_low, free_high = statistics[:, :5].T
    words = f"quantile of: {VARIABLES[measure].long_name}"
    found = table(
        "part",
        known=(known.astype(np.int64), "realizations with a separation"),
        zero_fraction=(zero, "fraction with separation zero"),
        collision_free_fraction=(free, "fraction in which no two particles share the base"),
        collision_free_low=(free_low, "lower end of its Wilson 95 % interval"),
        collision_free_high=(free_high, "upper end of its Wilson 95 % interval"),
    )
    return found.assign(
        separation_quantile=variable(("part", "quantile"), statistics[:, 5:], words, "s")
    ).assign_coords(quantile=variable("quantile", np.asarray(quantiles), "quantile"))


class _Window(NamedTuple):
    """Landings of one realization; each array of shape (landing,)."""

    who: NDArray[np.int64]
    time: Array  # since the beginning of the window, forcing periods
    phase: Array  # of the forcing, turns
    periods: int  # in the window
    particles: int


def order_against_chance(
    record: xr.Dataset, *, since: float = 0.0, surrogates: int = 199, seed: int = 0
) -> xr.Dataset:
    """Compare separations, order parameter and gaps of a record with chance.

    The rate Lambda uses the phases of the record: its integrals are sums over 16 harmonics,
    without bias because no landing is paired with itself.  A surrogate keeps the phases of each
    particle and shifts its landings by a random whole number of periods, circularly in a window of
    whole periods: a difference from the surrogates shows order beyond that of the phases.  The
    order parameter R and the smallest gap of the phases of the last landings, one per particle, are
    compared with those of N independent uniform phases: N R^2 is Exp(1) for large N (the
    probability has Rayleigh's correction of order 1/N), and the smallest gap on the circle exceeds
    x with the probability (1 - N x)^(N - 1).

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    since
        Beginning of the window, in s; it ends after the last whole period.
    surrogates
        Number of surrogates.
    seed
        Seed of the random shifts.

    Returns
    -------
    xarray.Dataset
        Dim ``realization``: ``dt_min`` (s), ``coincidence_rate`` (s-1) and its ratio to that of
        uniform phases ``phase_factor``, ``dt_min_over_chance``, ``dt_min_chance``,
        ``dt_min_surrogate_share``, ``order_over_chance``, ``order_chance`` and ``gap_chance``.
        Variables that assume independent landings are NaN where a particle rests, lands more than
        1.2 times per period, keeps to few phases, as a locked one does, or was not simulated to the
        end.

    Raises
    ------
    DataError
        The record lacks a variable.
    ParameterError
        The window is shorter than a forcing period, or an argument is not allowed.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import order_against_chance
    >>> record = vs.simulate(amplitude=9.0, rebound="reflect", launch_time=[0.0, 0.5],
    ...                      duration=300.0)
    >>> found = order_against_chance(record, since=50.0)
    >>> bool(0.0 < found.dt_min_chance < 1.0)
    True
    """
    record = arranged(record)
    needed = ("landing_time", "rested", "frequency", "phase", "duration")
    require(record, "order_against_chance", *needed)
    surrogates, since = count("surrogates", surrogates, most=MOST), finite("since", since)
    random = np.random.default_rng(count("seed", seed, 0))
    found = [
        _against_chance(record, i, since, random.integers(2**63, size=2), surrogates)
        for i in range(record.sizes["realization"])
    ]
    return _dataset({name: np.array([values[name] for values in found]) for name in _NAMES})


def separations_against_chance(sweep: xr.Dataset) -> xr.Dataset:
    """Compare the smallest separations of a sweep with chance, for uniform phases.

    A sweep keeps no phases.  Where landings prefer some phases, coincidences are more frequent
    than for uniform ones; `order_against_chance` takes that into account.

    Parameters
    ----------
    sweep
        Result of a sweep with separations and results of each particle.

    Returns
    -------
    xarray.Dataset
        Dim ``realization``: ``dt_min`` (s), ``coincidence_rate`` (s-1), ``dt_min_over_chance`` and
        ``dt_min_chance``; NaN where a particle rests in the window, lands more than 1.2 times per
        period, is locked (as far as the sweep has regimes), or was not simulated to the end.

    Raises
    ------
    DataError
        The sweep lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import separations_against_chance
    >>> sweep = vs.sweep(amplitude=(4.0, 9.0), rebound="reflect", realizations=50, particles=5,
    ...                  separation=True, per_particle=True)
    >>> separations_against_chance(sweep).dt_min_chance.dims
    ('realization',)
    """
    sweep = flat(sweep)
    needed = ("dt_min", "particle_impact_count", "rest_count", "frequency", "duration", "transient")
    require(sweep, "separations_against_chance", *needed)
    if "particle" not in sweep["particle_impact_count"].dims:
        raise DataError("separations_against_chance needs the results of all particles")
    dt, count = sweep["dt_min"].values, sweep["particle_impact_count"].values
    count = np.where(count == UNDETERMINED, np.nan, count)
    window = per_realization(sweep, "duration") - per_realization(sweep, "transient")
    most = OFTEN * (per_realization(sweep, "frequency") * window)
    rate = (count.sum(axis=1) ** 2 - (count**2).sum(axis=1)) / window
    known = (sweep["rest_count"].values == 0) & (sweep["at_rest_count"].values == 0)
    known &= (count <= most[:, np.newaxis]).all(axis=1) & completed(sweep)
    if "locked_count" in sweep:
        known &= sweep["locked_count"].values == 0
    z = np.where(known, rate * dt, np.nan)
    found = {"coincidence_rate": rate, "dt_min": dt, "dt_min_over_chance": z}
    return _dataset({**found, "dt_min_chance": -np.expm1(-z)})


def _dataset(values: dict[str, Array]) -> xr.Dataset:
    dims = ("realization",)
    return xr.Dataset({name: variable(dims, one, *_NAMES[name]) for name, one in values.items()})


def _against_chance(
    record: xr.Dataset, realization: int, since: float, seeds: NDArray[Any], surrogates: int
) -> dict[str, float]:
    """Values of the variables of one realization."""
    frequency, turns, duration = (
        float(per_realization(record, name)[realization])
        for name in ("frequency", "phase", "duration")
    )
    counts = record["impact_count"].values[realization] if "impact_count" in record else 0
    if np.all(counts == UNDETERMINED) or not np.isfinite(duration):  # without results
        return dict.fromkeys(_NAMES, np.nan)
    periods = int((duration - since) * frequency * (1.0 + ROUNDING))
    if periods < 1:
        raise ParameterError(
            f"since = {since:g} s leaves less than a forcing period until {duration:g} s: begin "
            f"the window earlier, or record for longer"
        )
    landing = record["landing_time"].values[realization]
    inside = (landing >= since) & (landing < since + periods / frequency)
    who = np.nonzero(inside)[0]
    time = (landing[inside] - since) * frequency
    phase = frequency * landing[inside] + turns / (2.0 * np.pi)
    window = _Window(who, time, phase, periods, landing.shape[0])
    smallest = _smallest(window.time, window.who)
    shares = _surrogates(window, smallest, seeds, surrogates)
    rests = bool((record["rested"].values[realization][inside] == 1).any())
    rate, uniform = _rates(window)
    status = record["status"].isel(realization=realization) if "status" in record else 0
    lost = np.any(status != Status.COMPLETED)
    z = np.nan if rests or lost or not rate > 0.0 else rate * smallest
    return {
        "coincidence_rate": rate * frequency,
        "dt_min": smallest / frequency,
        "dt_min_over_chance": z,
        "dt_min_chance": -np.expm1(-z),
        "phase_factor": rate / uniform if uniform else np.nan,
        "dt_min_surrogate_share": shares,
        **_phases(window),
    }


def _smallest(time: Array, who: NDArray[np.int64]) -> float:
    """Smallest separation of landings of different particles; NaN unless two have landed."""
    order = np.argsort(time, kind="stable")
    gaps, other = np.diff(time[order]), np.diff(who[order]) != 0
    return float(gaps[other].min()) if other.any() else np.nan


def _rates(window: _Window) -> tuple[float, float]:
    """Rate of coincidences per period, and that of uniform phases.

    The former is NaN where landings are not independent samples of a density of phases.
    """
    count = np.bincount(window.who, minlength=window.particles).astype(np.float64)
    uniform = float(count.sum() ** 2 - (count**2).sum()) / window.periods
    order = np.arange(1, HARMONICS + 1)[:, np.newaxis]
    wave = np.exp(2j * np.pi * order * window.phase)
    sums = np.array(  # over the landings of each particle
        [
            np.bincount(window.who, part, window.particles)
            for harmonic in wave
            for part in (harmonic.real, harmonic.imag)
        ]
    ).reshape(HARMONICS, 2, window.particles)
    square = (sums**2).sum(axis=1)
    pairs = (sums.sum(axis=2) ** 2).sum(axis=1) - square.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        upper = ((square - count) / (count * (count - 1.0)))[HARMONICS // 2 :].mean(axis=0)
        noise = 3.0 / (count * np.sqrt(HARMONICS / 2))
    if np.any(count > OFTEN * window.periods) or np.any(upper > POINTS + noise):
        return np.nan, uniform
    return uniform + 2.0 * float(pairs.sum()) / window.periods, uniform


def _surrogates(window: _Window, smallest: float, seeds: NDArray[Any], number: int) -> float:
    """Share of the surrogates, counting the record as one, with a dt_min at least as small."""
    if np.isnan(smallest):
        return np.nan
    random = np.random.default_rng(seeds)
    reach = smallest + ROUNDING * window.periods
    found = 1
    for _ in range(number):
        shift = random.integers(window.periods, size=window.particles)
        shifted = (window.time + shift[window.who]) % window.periods
        found += _smallest(shifted, window.who) <= reach
    return found / (number + 1)


def _phases(window: _Window) -> dict[str, float]:
    """Order parameter and smallest gap of the last landings against uniform phases."""
    order = np.argsort(window.time, kind="stable")
    last = dict(zip(window.who[order], window.phase[order], strict=True))
    phases = np.array(list(last.values())) % 1.0
    n = phases.size
    if n < 2:
        return dict.fromkeys(("order_over_chance", "order_chance", "gap_chance"), np.nan)
    z = n * float(abs(np.exp(2j * np.pi * phases).mean())) ** 2
    gap = float(np.diff(np.sort(phases), append=phases.min() + 1.0).min())
    above = float(np.clip(np.exp(-z) * (1.0 + (2.0 * z - z * z) / (4.0 * n)), 0.0, 1.0))
    below = 1.0 - max(0.0, 1.0 - n * gap) ** (n - 1)
    return {"order_over_chance": z, "order_chance": above, "gap_chance": below}


def share_against(result: xr.Dataset, parameter: str, *, of: str, bins: int = 10) -> xr.Dataset:
    """Share of what a sweep, or a search for windows under noise, finds, against a parameter.

    Parameters
    ----------
    result
        Result of a sweep, or of `vibrosweep.windows` under noise, at one restitution.
    parameter
        Name of a parameter that differs between realizations, such as ``"amplitude"``; of windows,
        the scanned forcing.
    of
        Of a sweep ``"collision_free"``, for realizations in which no two particles share the base,
        or a regime, for particles: ``"at_rest"``, ``"resting"``, ``"locked"``, ``"aperiodic"`` or
        ``"unsettled"``.  Of windows under noise, one of their conditions.
    bins
        Number of bins that hold equally many realizations; a parameter that takes no more values
        has one for each value.  Windows have one for each point of their scan.

    Returns
    -------
    xarray.Dataset
        Dim ``part``: ``share`` with the ends ``share_low`` and ``share_high`` of its 95 % interval
        (Clopper & Pearson 1934), NaN where nothing is known, with coordinates ``{parameter}_low``
        and ``{parameter}_high``, the ends of the bin.  A realization counts as one trial, however
        many particles it has, and counts only if it is known in full.

    Raises
    ------
    DataError
        The result lacks a variable, or the parameter is the same in all realizations.
    ParameterError
        `of` names nothing that the result knows.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import share_against
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, regimes=True, duration=1000.0)
    >>> share_against(sweep, "amplitude", of="locked", bins=5).share.dims
    ('part',)
    """
    require_dataset(result)
    if "scan" in result.dims:
        return _of_windows(result, parameter, of)
    _require_name(of, OF_SWEEPS)
    sweep, name = flat(result), of if of == FREE else f"{of}_count"
    require(sweep, "share_against", name, parameter)
    parts, ends = equal_parts(sweep, parameter, bins, "share_against")
    particles = 1.0
    if of != FREE:
        if "particles" not in sweep.attrs:
            raise DataError("share_against needs the number of particles, which the result lacks")
        particles = float(sweep.attrs["particles"])
    decided = known(name, sweep) & completed(sweep)
    held = np.where(decided, per_realization(sweep, name) / particles, 0.0)
    found = shares(*(np.array([v[p].sum() for p in parts]) for v in (held, 1.0 * decided)))
    return _shares(found, of).assign_coords(ends)


def _of_windows(windows: xr.Dataset, parameter: str, of: str) -> xr.Dataset:
    """Shares of replicas at the points of a scan."""
    names = ("share", "share_low", "share_high")
    if "share" not in windows:
        raise DataError("share_against takes windows under noise, and there are no shares in these")
    _require_name(of, tuple(map(str, np.atleast_1d(windows["condition"].values))))
    if parameter != windows.attrs["forcing"]:
        raise ParameterError(f"parameter = {parameter}: must be {windows.attrs['forcing']}")
    one = windows[[*names]]
    if "condition" in one.dims:
        one = one.sel(condition=of)
    if one.sizes["scan"] != one["share"].size:
        raise DataError(
            "share_against takes one restitution: choose it, as found.isel(restitution=0)"
        )
    scan = one["scan"].variable
    ends = {f"{parameter}_{end}": ("part", scan.values, scan.attrs) for end in ("low", "high")}
    values = [one[name].values.ravel() for name in names]
    return _shares((values[0], values[1], values[2]), of).assign_coords(ends)


def _require_name(of: str, names: tuple[str, ...]) -> None:
    if not isinstance(of, str) or of not in names:
        raise ParameterError(f"of = {of!r}: must be {quoted(names)}")


def _shares(found: tuple[Array, Array, Array], of: str) -> xr.Dataset:
    words = f"share, {of.replace('_', ' ')}"
    return table(
        "part",
        share=(found[0], words),
        share_low=(found[1], f"lower end of the 95 % interval, {words}"),
        share_high=(found[2], f"upper end of the 95 % interval, {words}"),
    ).assign_attrs(of=of)
