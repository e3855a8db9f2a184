"""Restitution, amplitude, phase and frequency from landings, with standard errors.

Every instant carries an error and enters a speed of arrival, a speed of departure and a phase.
Ordinary least squares, which assumes errors in the departure alone, is therefore biased.  The
instants are adjusted together with the parameters instead (the Gauss-Helmert model, which is total
least squares for errors of any covariance): by the smallest weighted change of the instants for
which every bounce obeys the map.
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
    is_unphysical,
    weakest_signal,
    widen,
    with_subharmonics,
)
from vibrosweep.lab.remarks import SIGNAL, misfit_warning, why_undetermined
from vibrosweep.lab.speed_laws import FittedLaw, law_variables, laws_left, preferred_law
from vibrosweep.lab.variables import with_units
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.model.restitution_laws import SPEED, restitution_at
from vibrosweep.model.shapes import Waveform

__all__ = ["PARAMETER_UNITS", "estimate", "fit_phase"]


PARAMETER_UNITS: Final = {
    "restitution": "1",
    "amplitude": "m s-1",
    "phase": "rad",
    "frequency": "Hz",
    SPEED: "m s-1",
}
# Number of phases that are tried, a third of a degree apart.  A second minimum is equally good if
# its sum of squares exceeds the smallest by at most this share of the sum of squares of the kicks.
PHASES: Final = 1080
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
        Forcing frequency in Hz; estimated if it is not given.
    frequency_range
        Interval in which an unknown frequency is sought, Hz.

    Returns
    -------
    xarray.Dataset
        Dims (parameter, other): ``estimate``, ``error`` and ``covariance`` of restitution,
        amplitude (m s-1), phase (rad, at t = 0 of the tracks' clock) and, if it was not known,
        frequency (Hz).  ``determined`` is 0 if the orbit determines them poorly or not at all, or
        if one lies outside its physical range; the attribute ``warning`` gives the reason.  Without
        any signal all are NaN.  ``misfit`` is the chi-square per degree of freedom.  If it exceeds
        1, the errors are scaled by its square root; if noise is an improbable explanation, the
        scatter of the residuals is added and the warning says so.

        Over a moving base the parameters come from its fit to the landings, with the frequency
        that was given to `find_impacts` or found by it; the amplitude is A = (1 + e) V0.  The
        result then holds ``base_displacement`` (m) and ``base_acceleration`` (in units of gravity)
        with their errors.  Where a trace has several harmonics, amplitude and phase are those of
        the strongest, and ``weight_h`` and ``phase_h`` (rad) those of the others relative to it.
        The attribute ``waveform`` holds that key of a sweep file.

        Dim law: ``law_restitution`` and ``law_speed`` (m s-1) with their errors, of each law of
        restitution fitted to the same bounces.  The attribute ``restitution_law`` names those that
        the bounces do not rule out, the best first; empty where nothing is determined.  If a
        constant restitution is ruled out, all parameters are those of the best law, and those of
        a plastic one include ``restitution_speed`` (m s-1).

    Raises
    ------
    TrackError
        There are too few bounces, or no parameters describe them.
    ParameterError
        The frequency, or the interval in which it is sought, is outside its range.
    DataError
        The dataset is no result of `find_impacts`.

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
    rates = (
        with_subharmonics(bounces.speeds(), frequency_range) if frequency is None else [frequency]
    )
    tried = [_adjust_at(bounces, rate, free) for rate in rates]
    found, signal = min(tried, key=_rank)
    rate = float(found.values[3]) if free else rates[0]
    names = ["restitution", "amplitude", "phase"] + ["frequency"] * free
    lost = bool(np.isinf(found.chi_square))
    if lost:
        laws = fit_laws(bounces, found.values, rate, free=free)
        # without a fit of a constant restitution it is ruled out by any other
        laws = laws[1:] if np.isnan(laws[0].misfit) else laws
        law: FittedLaw | None = preferred_law(laws) or laws[0]
    else:
        freedom = bounces.middle.size - found.values.size
        misfit = found.chi_square / freedom
        covariance = widen(found.covariance, misfit, freedom, found.influences)
        values, covariance, shape = polar(found.values, covariance)
        warnings = (
            why_undetermined(signal, values, covariance, misfit),
            misfit_warning(misfit, freedom),
        )
        laws = [] if warnings[0] else fit_laws(bounces, found.values, rate, free=free)
        law = preferred_law(laws)
    if law is not None and np.isfinite(law.misfit):
        values, covariance, shape = polar(law.values, law.covariance)
        rate = float(law.values[3]) if free else rates[0]
        names += [SPEED] * law.law.parameters
        misfit, freedom = law.misfit, law.freedom
        warnings = (
            why_undetermined(signal, values, covariance, misfit),
            misfit_warning(misfit, freedom),
        )
    if lost and (law is None or np.isnan(law.misfit) or warnings[0]):
        raise TrackError(
            f"{impacts.attrs['source']}: no restitution and forcing describe the bounces: look for "
            f"exchanged names, flights that fit badly, and a wrong frequency"
        )
    about = {
        "misfit": (misfit, "1", "chi-square per degree of freedom"),
        "bounces": (bounces.middle.size, "1", "bounces used"),
        "signal": (signal, "1", "signal of the weakest direction"),
        "frequency_used": (rate, "Hz", "forcing frequency"),
    }
    one = _estimate_dataset(names, values, covariance, about, warnings, shape).assign(
        law_variables(laws)
    )
    return one.assign_attrs(restitution_law=" or ".join(laws_left(laws)))


def _estimate_moving_base(impacts: xr.Dataset) -> xr.Dataset:
    """Parameters from the fit of a moving base."""
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
    # V0 / w and w V0 / g: their relative errors are those of V0 and of f
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
    warnings = why_undetermined(SIGNAL, kicks, covariance, misfit), misfit_warning(misfit, freedom)
    of_laws = impacts[[name for name in impacts.data_vars if impacts[name].dims == ("law",)]]
    one = _estimate_dataset(names, kicks, covariance, about, warnings, shape)
    law = impacts.attrs["restitution_law"]
    return one.merge(of_laws).assign_attrs({**one.attrs, "restitution_law": law})


def _estimate_dataset(
    names: list[str],
    values: Array,
    covariance: Array,
    about: Mapping[str, tuple[Any, str, str]],
    warnings: tuple[str, str],
    shape: Waveform,
) -> xr.Dataset:
    """Dataset of `estimate`; the first warning concerns parameters that are not determined."""
    units = [PARAMETER_UNITS.get(n, "1" if n.startswith("weight") else "rad") for n in names]
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
        coords={
            "parameter": names,
            "other": names,
            "units": ("parameter", units),
        },
        attrs={"warning": "; ".join(filter(None, warnings)), "waveform": shape.text},
    )


def fit_phase(
    impacts: xr.Dataset, *, amplitude: float, frequency: float, **of_restitution: Any
) -> float:
    """Phase of the forcing at t = 0 of a recording, rad, if all other parameters are known.

    `of_restitution` are the arguments of `vibrosweep.theory.restitution_at` beside the speed.
    On a locked orbit two phases explain the bounces equally well; the function returns that of the
    stable branch, on which the kick decreases at impact.  Raises a TrackError without bounces.
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
    """Parameters at a frequency, or near it if that is free, and their signal.

    They are NaN if the signal is below the noise.  If no fit converges, they are those of the
    regression, with an infinite chi-square.
    """
    first = _regression(bounces, rate)
    signal = _signal(bounces, first, rate)
    unknown = np.full(3 + free, np.nan)
    every = np.outer(unknown, unknown)
    none = Adjustment(unknown, every, np.nan, np.full(bounces.middle.size, np.nan), every)
    if signal < SIGNAL:
        return none, signal
    try:
        return adjust(bounces, first, rate, free), signal
    except np.linalg.LinAlgError:
        start = np.append(first, rate) if free else first
        return none._replace(values=start, chi_square=np.inf), signal


def _regression(bounces: Bounces, rate: float) -> Array:
    """Restitution, S and C by ordinary least squares."""
    arrive, leave, time = bounces.speeds()
    wave = np.stack([arrive, np.sin(TWO_PI * rate * time), np.cos(TWO_PI * rate * time)], axis=1)
    return np.asarray(np.linalg.lstsq(wave, leave, rcond=1e-9)[0])


def _signal(bounces: Bounces, values: Array, rate: float) -> float:
    """Return `weakest_signal` of bounces whose speeds follow from times of flight."""
    arrive, _, time = bounces.speeds()
    here = bounces.variance[bounces.middle]
    speed = bounces.gravity**2 / 4.0 * (here + bounces.variance[bounces.middle - 1])
    turned = (TWO_PI * rate) ** 2 * here
    amplitude = float(np.hypot(*values[1:3]))
    blurs = float(speed.mean()), float(turned.mean())
    return weakest_signal(arrive, TWO_PI * rate * time, amplitude, blurs)


def _rank(tried: tuple[Adjustment, float]) -> tuple[bool, float]:
    """Sort key whose minimum is the best adjustment: physical ones come first."""
    found, _ = tried
    chi_square = float(np.nan_to_num(found.chi_square, nan=np.inf))
    unphysical = not np.isfinite(chi_square) or is_unphysical(found.values, found.covariance)
    return unphysical, chi_square
