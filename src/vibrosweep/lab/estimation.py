"""Restitution, amplitude, phase and frequency from landings, with standard errors.

Every instant has an error, and enters a speed of arrival, a speed of departure and a phase.
Ordinary least squares assumes errors in the departure alone and is therefore biased.  Instants and
parameters are adjusted together instead: the smallest weighted change of the instants is sought for
which every bounce obeys the map (the Gauss-Helmert model, which is total least squares with any
covariance).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.analysis import require
from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, TrackError
from vibrosweep.lab.adjustment import Adjustment, adjust, fit_laws
from vibrosweep.lab.base_harmonics import names_of, polar, slopes_of_sizes
from vibrosweep.lab.bounces import Bounces, bounces_of
from vibrosweep.lab.impacts import harmonic_numbers
from vibrosweep.lab.regression import (
    FEWEST,
    TWO_PI,
    frequencies_to_try,
    is_improbable,
    is_unphysical,
    ordinary_least_squares,
    weakest_signal,
)
from vibrosweep.lab.speed_laws import FittedLaw, Law, law_variables, laws_left, preferred_law
from vibrosweep.lab.variables import with_units
from vibrosweep.model.parameters import OF_RESTITUTION, PARAMETERS
from vibrosweep.model.restitution_laws import SPEED, restitution_at
from vibrosweep.model.shapes import Waveform

__all__ = ["estimate", "fit_phase"]

# Parameters are not determined if the signal in the weakest direction of the design matrix is below
# this multiple of the noise of the instants, or if the standard error of the restitution or the
# relative one of the amplitude exceeds its limit.
SIGNAL: Final = 10.0
WORST_RESTITUTION: Final = 0.1
WORST_AMPLITUDE: Final = 0.25
# Chi-square per degree of freedom above which the law does not describe the bounces
WORST_MISFIT: Final = 10.0
PHASES: Final = 1080  # number of trial phases, a third of a degree apart
# Share of the sum of squares of the kicks up to which a second minimum counts as equally good
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
        Forcing frequency in Hz, estimated by default.
    frequency_range
        Interval in which an unknown frequency is sought, Hz.

    Returns
    -------
    xarray.Dataset
        Dims (parameter, other): ``estimate``, ``error`` and ``covariance`` of restitution,
        amplitude (m s-1), phase (rad, at t = 0 on the clock of the tracks) and, if it was not
        given, frequency (Hz).  ``determined`` is 0 if the orbit determines them poorly or not at
        all, or if the restitution lies outside its range; the attribute ``warning`` gives the
        reason.  If the signal is too weak all are NaN.  ``misfit`` is the chi-square per degree of
        freedom.  If it exceeds 1, its square root multiplies the errors; if noise hardly explains
        it, the scatter of the residuals is added and the warning says so.

        Over a moving base the parameters are those of the base that `find_impacts` fitted to the
        landings, with the frequency that was given to it or that it found; the amplitude is
        A = (1 + e) V0.  The result then also holds ``base_displacement`` (m) and
        ``base_acceleration`` (in units of gravity) with their errors.  If a trace has several
        harmonics, amplitude and phase are those of the strongest, and ``weight_h`` and ``phase_h``
        (rad) those of harmonic h relative to it; the attribute ``waveform`` is the key of that name
        in a sweep file.

        Dim law: ``law_restitution`` and ``law_speed`` (m s-1) with their errors, for each law of
        restitution fitted to the same bounces.  The attribute ``restitution_law`` names the laws
        that the bounces do not rule out, the best first; it is empty if nothing is determined.  If
        a constant restitution is ruled out, all parameters are those of the best law, among them
        ``restitution_speed`` (m s-1) for a plastic one.

    Raises
    ------
    TrackError
        There are too few bounces, or no parameters describe them.
    ParameterError
        The frequency, or the interval in which it is sought, is outside its range.
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
    low, high = frequency_range
    for name, value in (("frequency", frequency), ("frequency_range", low)):
        if value is not None and not PARAMETERS["frequency"].accepts(value):
            allowed = PARAMETERS["frequency"].allowed
            raise ParameterError(f"{name} = {value!r}: must be {allowed}")
    if not low < high < np.inf:
        raise ParameterError(f"frequency_range = {frequency_range!r}: must rise, in Hz")
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
    tried = [_adjust_at(bounces, rate, free) for rate in rates]
    adjusted, signal = min(tried, key=_rank)
    fit, laws = _fit_and_laws(bounces, adjusted, signal, frequency)
    lost = np.isinf(adjusted.chi_square)
    if lost and (np.isnan(fit.misfit) or _warnings_of(fit, signal)[0]):
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
    found.attrs["restitution_law"] = " or ".join(laws_left(laws))
    return found.assign(law_variables(laws))


def _fit_and_laws(
    bounces: Bounces, adjusted: Adjustment, signal: float, frequency: float | None
) -> tuple[FittedLaw, list[FittedLaw]]:
    """Return the fit with constant restitution or, if the bounces rule that out, with the best law.

    The second value holds the fits of all laws; it is empty if the parameters are not determined.
    """
    fit = adjusted.with_law(Law())
    lost = np.isinf(fit.misfit)
    if not lost and _warnings_of(fit, signal)[0]:
        return fit, []
    laws = fit_laws(bounces, adjusted.values, frequency)
    if lost and np.isnan(laws[0].misfit):
        laws = laws[1:]  # any law that can be fitted rules out a constant restitution that cannot
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
    """Return a warning that says why parameters are not determined; empty if they are."""
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
    # relative derivatives of displacement and acceleration, V0 / w and w V0 / g for a sine
    relative = np.zeros((2, values.size))
    relative[:, 1] = 1.0 / velocity
    names = ["restitution", "amplitude", "phase"]
    if "frequency" in of_base:
        names += ["frequency", *names_of(numbers)]
        relative[:, 3] = -1.0 / rate, 1.0 / rate
        relative[:, 4 : len(names)] = slopes_of_sizes(shape, numbers)
    names += [SPEED] * (SPEED in of_base)
    size = np.array(
        [velocity / (shape.per_displacement * rate), shape.fall * rate * velocity / gravity]
    )
    error = size * np.sqrt(np.einsum("ki,ij,kj->k", relative, spread, relative))
    covariance = change @ spread @ change.T
    misfit, freedom = float(impacts["shaken_misfit"]), int(impacts["shaken_freedom"])
    about = {
        "misfit": (misfit, "1", "chi-square per degree of freedom"),
        "bounces": (float(impacts["shaken_bounces"]), "1", "bounces used"),
        "frequency_used": (rate, "Hz", "forcing frequency"),
        "base_displacement": (size[0], "m", "peak displacement of the base"),
        "base_displacement_error": (error[0], "m", "its standard error"),
        "base_acceleration": (size[1], "1", "peak acceleration in units of gravity"),
        "base_acceleration_error": (error[1], "1", "its standard error"),
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
    """Dataset of `estimate`; the first warning says why parameters are not determined."""
    known = {**PARAMETERS, **OF_RESTITUTION}
    units = [
        known[n].units if n in known else "1" if n.startswith("weight") else "rad" for n in names
    ]
    error = np.sqrt(np.diag(covariance))
    return xr.Dataset(
        {
            "estimate": ("parameter", values, {"long_name": "estimate"}),
            "error": ("parameter", error, {"long_name": "standard error"}),
            "covariance": (("parameter", "other"), covariance, {"long_name": "covariance"}),
            "determined": (
                (),
                np.int8(not warnings[0]),
                {"long_name": "the orbit determines them"},
            ),
            **with_units((), about),
        },
        coords={"parameter": names, "other": names, "units": ("parameter", units)},
        attrs={"warning": "; ".join(filter(None, warnings)), "waveform": shape.text},
    )


def fit_phase(
    impacts: xr.Dataset, *, amplitude: float, frequency: float, **of_restitution: Any
) -> float:
    """Find the phase of the forcing (rad) at t = 0 of a recording whose other parameters are known.

    `of_restitution` holds the arguments of `vibrosweep.theory.restitution_at` other than the speed.
    On a locked orbit two phases explain the bounces equally well; the phase is that of the stable
    branch, on which the kick decreases at impact.  Raises a TrackError without bounces.
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
    """Adjust the parameters at a frequency, or near it if that is free; return the signal too.

    The parameters are NaN if the signal is too weak.  If no fit converges they are those of the
    regression, with an infinite chi-square.
    """
    speeds, here = bounces.speeds(), bounces.variance[bounces.middle]
    start = ordinary_least_squares(speeds, rate)
    # the speed of arrival is half the time of flight times gravity
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
    """Sort key: the best adjustment has the smallest chi-square among the physical ones."""
    found, _ = tried
    chi_square = float(np.nan_to_num(found.chi_square, nan=np.inf))
    unphysical = not np.isfinite(chi_square) or is_unphysical(found.values, found.covariance)
    return unphysical, chi_square
