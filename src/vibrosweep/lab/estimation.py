"""Restitution, amplitude, phase and frequency from landings, with standard errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded, solveh_banded
from scipy.sparse import csr_array, diags_array

from vibrosweep.analysis import require
from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError
from vibrosweep.lab.impacts import BOUNCED, DOUBTFUL, OF_BOUNCES, harmonic_numbers
from vibrosweep.lab.regression import (
    FAR,
    FEWEST,
    FITTED,
    TWO_PI,
    FittedLaw,
    Law,
    Speeds,
    best_fit,
    failed_fit,
    fit_law,
    frequencies_to_try,
    is_improbable,
    is_unphysical,
    law_variables,
    ordinary_least_squares,
    possible_laws,
    preferred_law,
    robust_covariance,
    weakest_signal,
    widen,
    with_speed,
)
from vibrosweep.lab.traces import names_of, parameters_dataset, polar, sizes_of
from vibrosweep.lab.variables import require_parameter, require_range_of_frequencies
from vibrosweep.model.restitution_laws import CONSTANT, PLASTIC, SPEED, restitution_at
from vibrosweep.model.shapes import Waveform

__all__ = ["estimate", "fit_phase"]

# -----------------------------------------------------------------------------
# Bounces as equations between landing times, which a camera measures.
#
# Gravity is known, so that the speeds before and after a bounce at time t are
# v = g (t - previous lift-off) / 2 and v' = g (next landing - t) / 2, and the impact map
#
#     v' = e v + S sin(2 pi f t) + C cos(2 pi f t),      S = A cos phi,   C = A sin phi
#
# involves three successive instants, which all have errors.

# Half bandwidth of the covariance of the equations: a bounce shares an instant with the second
# bounce after it, and the errors of neighbouring instants are correlated.
BAND = 3


@dataclass(frozen=True)
class Bounces:
    """Instants of landing and lift-off in order, with the indices of the bounces."""

    # Landings and lift-offs of all particles, s; a bounce is one instant, a stay is two
    instant: Array
    # variance, covariance: of each instant, and of each with the next, s^2; shapes (instant,) and
    # (instant - 1,)
    variance: Array
    covariance: Array
    # Index in `instant` of each bounce, shape (bounce,): the instant before it is the lift-off that
    # began its flight, the one after it the next landing
    middle: NDArray[np.intp]
    gravity: float  # m s-2

    def speeds(self, instant: Array | None = None) -> Speeds:
        """Return time and speeds of each bounce, optionally from other instants."""
        t = self.instant if instant is None else instant
        half, i = self.gravity / 2.0, self.middle
        return Speeds(half * (t[i] - t[i - 1]), half * (t[i + 1] - t[i]), t[i])

    def jacobian(self, before: Array, at: Array, after: Array) -> csr_array:
        """Jacobian of the equations by the instants, shape (bounce, instant).

        The arguments are the derivatives of each equation by the instant before its bounce, by the
        instant of the bounce, and by the one after it.
        """
        columns = self.middle[:, np.newaxis] + np.array([-1, 0, 1])
        entries = np.stack([before, at, after], axis=1).ravel()
        starts = np.arange(0, entries.size + 1, 3)
        shape = (self.middle.size, self.instant.size)
        return csr_array((entries, columns.ravel(), starts), shape=shape)

    @property
    def errors(self) -> csr_array:
        """Covariance of the instants, s^2."""
        diagonals = [self.covariance, self.variance, self.covariance]
        return diags_array(diagonals, offsets=[-1, 0, 1]).tocsr()  # type: ignore[arg-type]


def bounces_of(impacts: xr.Dataset) -> Bounces:
    """Gather the bounces of a result of `find_impacts` between two complete flights."""
    landed = np.arange(impacts.sizes["impact"]) < impacts["impact_count"].values[:, np.newaxis]

    def column(name: str) -> Array:
        return np.asarray(impacts[name].values[landed])

    quality, instants = column("quality"), ("landing_time", "liftoff_time")
    bounced = quality == BOUNCED
    # landing and lift-off are one instant at a bounce, two for a stay on the base
    single = np.stack([np.ones_like(bounced), ~bounced], axis=1)
    instant = np.stack([column(name) for name in instants], axis=1)
    error = np.stack([column(f"{name}_error") for name in instants], axis=1)
    link = np.nan_to_num(column("next_covariance"))
    link = np.stack([np.where(bounced, link, 0.0), link], axis=1)
    # the flight after the last landing of a particle is incomplete
    seen = np.isfinite(column("flight_time"))
    sound = (quality != DOUBTFUL) & np.isfinite(instant[:, 0])
    whole = bounced & seen & np.append(sound, False)[1:]
    whole &= np.append(False, seen & sound)[:-1]
    return Bounces(
        instant[single],
        error[single] ** 2,
        link[single][:-1],
        np.cumsum(single)[::2][whole] - 1,
        impacts.attrs["gravity"],
    )


def solve(matrix: csr_array, right: Array) -> Array:
    """Solve a system whose symmetric positive definite matrix has the half bandwidth `BAND`."""
    return np.asarray(solveh_banded(_band(matrix), right, lower=True))


def whiten(matrix: csr_array, right: Array) -> Array:
    """Whiten columns whose covariance is `matrix`."""
    factor = cholesky_banded(_band(matrix), lower=True)
    return np.asarray(solve_banded((len(factor) - 1, 0), factor, right))


def _band(matrix: csr_array) -> Array:
    size = matrix.shape[0]
    band = np.zeros((BAND + 1, size))
    for k in range(min(BAND + 1, size)):
        band[k, : size - k] = matrix.diagonal(-k)
    return band


# -----------------------------------------------------------------------------
# Adjustment of instants together with the parameters of bounces on a base of constant level.
#
# The adjustment is the smallest weighted change of the instants with which every bounce obeys the
# map, under one of the laws of restitution.

# Largest number of iterations of the adjustment, and the step in standard errors at which it stops
ROUNDS: Final = 50
CLOSE: Final = 1e-6
# The same for the plastic law, whose kink may prevent convergence
ROUGH: Final = 1e-2
BETWEEN: Final = (0.05, 0.999)  # range of the restitution in a law that depends on speed
LONGEST: Final = 0.3  # longest step of the logarithm of a speed


class Adjustment(NamedTuple):
    """Result of the adjustment."""

    # values, covariance: e, S, C, f if it is free, and the logarithm of a yield speed
    values: Array
    covariance: Array
    chi_square: float
    distance: Array  # squared distance of each bounce in standard errors
    # Covariance from the scatter of the residuals, added if noise does not explain them
    influences: Array

    def with_law(self, law: Law) -> FittedLaw:
        """Return the adjustment as a fit of its law."""
        number = self.distance.size
        freedom = number - self.values.size
        misfit = self.chi_square / freedom
        covariance = widen(self.covariance, misfit, freedom, self.influences)
        values, covariance = with_speed(law, self.values, covariance)
        distance = np.minimum(self.distance, FAR)
        return FittedLaw(law, values, covariance, misfit, freedom, number, distance)


def adjust(
    bounces: Bounces,
    start: Array,
    frequency: float,
    free: bool,
    law: Law = Law(),  # noqa: B008
) -> Adjustment:
    """Adjust instants and parameters together, starting from e, S and C at a frequency in Hz.

    The frequency is a parameter if `free`.  Raises a LinAlgError if the iteration does not
    converge, or if a parameter has no effect.
    """
    values = np.append(start, frequency) if free else start
    if law.parameters:
        values = np.append(values, np.log(law.speed))
    errors, instant = bounces.errors, bounces.instant.copy()
    half, close = bounces.gravity / 2.0, ROUGH if law.name == PLASTIC else CLOSE
    for _ in range(ROUNDS):
        e, s, c = values[:3]
        f = values[3] if free else frequency
        arrive, leave, time = bounces.speeds(instant)
        sine, cosine = np.sin(TWO_PI * f * time), np.cos(TWO_PI * f * time)
        turning = TWO_PI * (s * cosine - c * sine)
        by_e, *others = law.derivatives(arrive, e, values[-1])
        columns = [by_e, sine, cosine] + ([time * turning] if free else []) + others
        design = -np.stack(columns, axis=1)
        ends = np.full(time.size, half)
        after, q = law.rebound_speed(arrive, e, values[-1])
        slopes = bounces.jacobian(q * ends, -(1.0 + q) * ends - f * turning, ends)
        closure = leave - after - s * sine - c * cosine
        closure = closure + slopes @ (bounces.instant - instant)
        spread = slopes @ errors @ slopes.T
        weighted = solve(spread, np.column_stack([design, closure]))
        normal = design.T @ weighted[:, :-1]
        if not np.all(np.diag(normal) > 0.0):
            raise np.linalg.LinAlgError("no bounce depends on a parameter")
        scale = 1.0 / np.sqrt(np.diag(normal))
        inverse = scale[:, np.newaxis] * np.linalg.pinv(normal * np.outer(scale, scale)) * scale
        step = -inverse @ (design.T @ weighted[:, -1])
        forces = weighted[:, -1] + weighted[:, :-1] @ step
        instant = bounces.instant - errors @ (slopes.T @ forces)
        if law.parameters:
            step[-1] = np.clip(step[-1], -LONGEST, LONGEST)
        values = values + step
        if law.name != CONSTANT:
            values[0] = np.clip(values[0], *BETWEEN)
        if np.all(np.abs(step) <= close * np.sqrt(np.diag(inverse))):
            break
    else:
        raise np.linalg.LinAlgError("the adjustment does not converge")
    white = whiten(spread, np.column_stack([design, spread @ forces]))
    influences = robust_covariance(white[:, -1], white[:, :-1], inverse)
    chi_square = float(forces @ (spread @ forces))
    return Adjustment(values, inverse, chi_square, white[:, -1] ** 2, influences)


def fit_laws(bounces: Bounces, start: Array, frequency: float | None) -> list[FittedLaw]:
    """Fit the laws of `FITTED`, starting from the parameters of a constant restitution.

    If `frequency` (Hz) is None, it is one of these parameters.
    """
    speeds = np.maximum(bounces.speeds()[0], 1e-6)

    def fitted(name: str, values: Array) -> FittedLaw:
        return fit_law(name, speeds, partial(_fit, bounces, values, frequency))

    fits = [fitted(name, start) for name in FITTED]
    best = best_fit(fits)
    if np.isnan(best.misfit):
        return fits
    # a law whose fit failed may converge from the parameters of the best one
    return [fitted(fit.law.name, best.values) if np.isnan(fit.misfit) else fit for fit in fits]


def _fit(bounces: Bounces, values: Array, frequency: float | None, law: Law) -> FittedLaw:
    try:
        # first at a fixed yield speed, because the parameters of a constant e may be far off
        for tried in dict.fromkeys((law._replace(fixed=True), law)):
            rate = float(values[3]) if frequency is None else frequency
            found = adjust(bounces, values[:3], rate, frequency is None, tried)
            values = found.values
    except np.linalg.LinAlgError:
        return failed_fit(law, bounces.middle.size)
    return found.with_law(law)


# -----------------------------------------------------------------------------
# Restitution, amplitude, phase and frequency from landings, with standard errors.
#
# Every instant has an error, and enters an arrival speed, a departure speed and a phase.
# Ordinary least squares assumes errors of the departure alone and is therefore biased.  Instants
# and parameters are adjusted together instead, by the smallest weighted change of the instants for
# which every bounce obeys the map (the Gauss-Helmert model, total least squares with a full
# covariance).

# Parameters are not determined if the signal-to-noise ratio in the weakest direction of the design
# matrix is below this limit, or if the standard error of the restitution or the relative error of
# the amplitude exceeds its limit.
SIGNAL: Final = 10.0
WORST_RESTITUTION: Final = 0.1
WORST_AMPLITUDE: Final = 0.25
# Reduced chi-square above which the model does not describe the bounces
WORST_MISFIT: Final = 10.0
PHASES: Final = 1080  # number of trial phases, a third of a degree apart
# Difference, relative to the sum of squares of the kicks, up to which two minima are equally good
TIE: Final = 0.01


def estimate(
    impacts: xr.Dataset,
    *,
    frequency: float | None = None,
    frequency_range: tuple[float, float] = (1.0, 100.0),
) -> xr.Dataset:
    """Estimate restitution, forcing and phase from landings.

    Parameters
    ----------
    impacts
        Result of `find_impacts`.
    frequency
        Forcing frequency in Hz; by default it is estimated.
    frequency_range
        Interval to search for an unknown frequency, Hz.

    Returns
    -------
    xarray.Dataset
        - ``estimate``, ``error``, ``covariance``, dims (parameter, other): of restitution,
          amplitude (m s-1), phase (rad, at t = 0 on the clock of the tracks) and, if it was not
          given, frequency (Hz); all NaN if the signal is too weak;
        - ``determined``: 0 if the orbit determines them poorly or not at all, or if the restitution
          lies outside its range; the attribute ``warning`` gives the reason;
        - ``misfit``: chi-square per degree of freedom.  If it exceeds 1, the errors are multiplied
          by its square root; if noise hardly explains it, the scatter of the residuals is added and
          the attribute ``warning`` states this;
        - ``law_restitution`` and ``law_speed`` (m s-1) with their errors, dim law: each law of
          restitution fitted to the same bounces.  The attribute ``restitution_law`` names the laws
          that the bounces do not rule out, the best first; it is empty if nothing is determined.
          If a constant restitution is ruled out, all parameters are those of the best law, among
          them ``restitution_speed`` (m s-1) for a plastic one;
        - ``base_displacement`` (m) and ``base_acceleration`` (in units of gravity) with their
          errors, ``contact`` and ``scatter``, as in the result of `find_impacts`, over a moving
          base.

        Over a moving base the parameters are those of the base that `find_impacts` fitted to the
        landings, with the frequency that was given to it or that it found; the amplitude is
        A = (1 + e) V0.  If a trace has several harmonics, amplitude and phase are those of the
        strongest, and ``weight_h`` and ``phase_h`` (rad) those of harmonic h relative to it; the
        attribute ``waveform`` is the key of that name in a sweep file.

    Raises
    ------
    TrackError
        There are too few bounces, or no parameters fit them.
    ParameterError
        The frequency, or the interval to search, is outside its range.
    DataError
        The dataset is not a result of `find_impacts`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab import Experiment, perform_trials
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=10.0))
    >>> found = vs.lab.estimate(vs.lab.find_impacts(film[0].tracks), frequency=20.0)
    >>> found.parameter.values.tolist()
    ['restitution', 'amplitude', 'phase']
    """
    require(impacts, "estimate", "landing_time", "quality", source="find_impacts")
    require_range_of_frequencies(frequency_range)
    if frequency is not None:
        require_parameter("frequency", frequency)
    if impacts.attrs["base_motion"] == "moving":
        return _estimate_moving_base(impacts)
    bounces = bounces_of(impacts)
    if bounces.middle.size < FEWEST:
        raise TrackError(
            f"{impacts.attrs['source']}: only {bounces.middle.size} bounces have a whole flight on "
            f"either side; at least {FEWEST} are needed: film for longer, or faster"
        )
    free = frequency is None
    rates = frequencies_to_try(bounces.speeds(), frequency, frequency_range)
    tried = sorted((_adjust_at(bounces, rate, free) for rate in rates), key=_rank)
    for adjusted, signal in [*tried, tried[0]]:
        # at the true frequency a constant e may fail where a law fits
        fit, laws = _fit_and_laws(bounces, adjusted, signal, frequency)
        unfit = np.isnan(fit.misfit) or _warnings_of(fit, signal)[0]
        if not unfit:
            break
    if unfit and np.isinf(adjusted.chi_square):
        raise TrackError(
            f"{impacts.attrs['source']}: no restitution and forcing describe the bounces: look for "
            f"exchanged names, flights that fit badly, and a wrong frequency"
        )
    rate = float(fit.values[3]) if free else rates[0]
    values, covariance, shape = polar(fit.values, fit.covariance)
    names = ["restitution", "amplitude", "phase"] + ["frequency"] * free
    names += [SPEED] * fit.law.parameters
    about = {
        "misfit": (fit.misfit, "1", "chi-square per degree of freedom"),
        "bounces": (bounces.middle.size, "1", "bounces used"),
        "signal": (signal, "1", "signal of the weakest direction"),
        "frequency_used": (rate, "Hz", "forcing frequency"),
    }
    warnings = _warnings_of(fit, signal)
    found = _estimate_dataset(names, values, covariance, about, warnings, shape)
    found.attrs["restitution_law"] = " or ".join(possible_laws(laws))
    return found.assign(law_variables(laws))


def _fit_and_laws(
    bounces: Bounces, adjusted: Adjustment, signal: float, frequency: float | None
) -> tuple[FittedLaw, list[FittedLaw]]:
    """Return the fit with a constant restitution or, if that is ruled out, with the best law.

    The second value holds the fits of all laws; it is empty if the parameters are not determined.
    """
    fit = adjusted.with_law(Law())
    lost = np.isinf(fit.misfit)
    if not lost and _warnings_of(fit, signal)[0]:
        return fit, []
    laws = fit_laws(bounces, adjusted.values, frequency)
    if lost and np.isnan(laws[0].misfit):
        laws = laws[1:]  # a constant e that cannot be fitted is ruled out by any law that can
    return preferred_law(laws) or (laws[0] if lost else fit), laws


def _warnings_of(fit: FittedLaw, signal: float) -> tuple[str, str]:
    """Warnings that the parameters are not determined, and that the residuals are too large."""
    values, covariance, _ = polar(fit.values, fit.covariance)
    return _warnings(signal, values, covariance, fit.misfit, fit.freedom)


def _warnings(
    signal: float, values: Array, covariance: Array, misfit: float, freedom: int
) -> tuple[str, str]:
    """Warnings of `_warnings_of`, from e, amplitude and other parameters with their covariance."""
    undetermined, scattered = _why_undetermined(signal, values, covariance, misfit), ""
    if is_improbable(misfit, freedom):
        scattered = (
            f"the bounces scatter more than the noise of the tracks explains (misfit "
            f"{misfit:.3g}, where about 1 is expected): the errors are widened; look for bounces "
            f"too low to be seen"
        )
    return undetermined, scattered


def _why_undetermined(signal: float, values: Array, covariance: Array, misfit: float) -> str:
    """Return the reason why parameters are not determined; empty if they are."""
    error = np.sqrt(np.diag(covariance))
    if signal < SIGNAL:
        return (
            "the orbit does not determine restitution and amplitude: all bounces happen at nearly "
            "the same phases and speeds, as those of a locked orbit do; change the frequency or "
            "the amplitude, or film the approach to the orbit"
        )
    if not 0.0 <= values[0] <= 1.0:
        return (
            f"the restitution comes out as {values[0]:.4g} ± {error[0]:.2g}, where 0 to 1 is "
            f"possible: the landings do not determine it; check the scale, the frequency, and "
            f"whether the base moves, or film faster or closer"
        )
    if misfit > WORST_MISFIT:
        return (
            f"no restitution and forcing describe the bounces: misfit {misfit:.3g} where noise "
            f"alone makes about 1; check the frequency, and whether the base moves; if its motion "
            f"is not a sine, give its trace or the track of a mark on it"
        )
    if error[0] > WORST_RESTITUTION or error[1] > WORST_AMPLITUDE * values[1]:
        return "restitution and amplitude are hardly determined: film for longer, or closer"
    return ""


def _estimate_moving_base(impacts: xr.Dataset) -> xr.Dataset:
    """Turn the moving base that `find_impacts` fitted into a result of `estimate`."""
    require(impacts, "estimate", "shaken", *OF_BOUNCES, source="find_impacts")
    values, covariance = impacts["shaken"].values, impacts["shaken_covariance"].values
    of_base = impacts["of_base"].values.astype(str).tolist()
    rate, gravity = float(impacts["shaken_frequency"]), impacts.attrs["gravity"]
    numbers = harmonic_numbers(impacts)
    plain, spread, shape = polar(values, covariance, numbers)  # e, V0, phi and perhaps f
    e, velocity = plain[:2]
    change = np.eye(values.size)
    change[1, :2] = velocity, 1.0 + e
    kicks = plain.copy()
    kicks[1] = (1.0 + e) * velocity
    names = ["restitution", "amplitude", "phase"]
    if "frequency" in of_base:
        names += ["frequency", *names_of(numbers)]
    names += [SPEED] * (SPEED in of_base)
    covariance = change @ spread @ change.T
    misfit, freedom = float(impacts["shaken_misfit"]), int(impacts["shaken_freedom"])
    about = {
        "misfit": (misfit, "1", "chi-square per degree of freedom"),
        "bounces": (float(impacts["shaken_bounces"]), "1", "bounces used"),
        "frequency_used": (rate, "Hz", "forcing frequency"),
        **sizes_of(plain, spread, shape, numbers, gravity, rate),
        **{k: (float(impacts[k]), *about) for k, about in OF_BOUNCES.items()},
    }
    warnings = _warnings(SIGNAL, kicks, covariance, misfit, freedom)
    found = _estimate_dataset(names, kicks, covariance, about, warnings, shape)
    found.attrs["restitution_law"] = impacts.attrs["restitution_law"]
    of_laws = [name for name in impacts.data_vars if impacts[name].dims == ("law",)]
    return found.merge(impacts[of_laws], combine_attrs="override")


def _estimate_dataset(
    names: list[str],
    values: Array,
    covariance: Array,
    about: Mapping[str, tuple[Any, str, str]],
    warnings: tuple[str, str],
    shape: Waveform,
) -> xr.Dataset:
    """Dataset of `estimate`; the first warning is the reason why parameters are not determined."""
    determined = (np.int8(not warnings[0]), "1", "the orbit determines them")
    found = parameters_dataset(
        names, values, covariance, {"determined": determined, **about}, shape
    )
    return found.assign_attrs(warning="; ".join(filter(None, warnings)))


def fit_phase(
    impacts: xr.Dataset, *, amplitude: float, frequency: float, **of_restitution: Any
) -> float:
    """Find the phase of the forcing (rad) at t = 0 of a recording whose other parameters are known.

    `of_restitution` holds the arguments of `vibrosweep.theory.restitution_at` except the speed.  On
    a locked orbit two phases fit the bounces equally well; the one on the stable branch, where the
    kick decreases at impact, is returned.  Raises a TrackError without bounces.
    """
    arrive, leave, time = bounces_of(impacts).speeds()
    if not time.size:
        raise TrackError(f"{impacts.attrs['source']}: no bounce has a whole flight on either side")
    kick = leave - restitution_at(arrive, **of_restitution) * arrive
    angle = TWO_PI * frequency * time
    trial = np.linspace(-np.pi, np.pi, PHASES, endpoint=False)
    wave = amplitude * np.sin(angle + trial[:, np.newaxis])
    misfit = np.sum((kick - wave) ** 2, axis=1)
    falling = np.cos(angle + trial[:, np.newaxis]).mean(axis=1) < 0.0
    near = misfit <= misfit.min() + TIE * float(kick @ kick)
    chosen = np.flatnonzero(near & falling if (near & falling).any() else near)
    return float(trial[chosen[np.argmin(misfit[chosen])]])


def _adjust_at(bounces: Bounces, rate: float, free: bool) -> tuple[Adjustment, float]:
    """Adjust the parameters at a frequency, or near it if it is free; also return the signal.

    The parameters are NaN if the signal is too weak.  If no fit converges they are those of the
    regression, with an infinite chi-square.
    """
    speeds, here = bounces.speeds(), bounces.variance[bounces.middle]
    start = ordinary_least_squares(speeds, rate)
    # the arrival speed is gravity times half the flight time
    of_arrival = bounces.gravity**2 / 4.0 * (here + bounces.variance[bounces.middle - 1])
    signal = weakest_signal(speeds, rate, start[1:], of_arrival, here)
    unknown = np.full(3 + free, np.nan)
    every = np.outer(unknown, unknown)
    none = Adjustment(unknown, every, np.nan, np.full(bounces.middle.size, np.nan), every)
    if signal < SIGNAL:
        return none, signal
    try:
        return adjust(bounces, start, rate, free), signal
    except np.linalg.LinAlgError:
        start = np.append(start, rate) if free else start
        return none._replace(values=start, chi_square=np.inf), signal


def _rank(tried: tuple[Adjustment, float]) -> tuple[bool, float]:
    """Sort key: physical adjustments first, in the order of chi-square."""
    found, _ = tried
    chi_square = float(np.nan_to_num(found.chi_square, nan=np.inf))
    unphysical = not np.isfinite(chi_square) or is_unphysical(found.values, found.covariance)
    return unphysical, chi_square
