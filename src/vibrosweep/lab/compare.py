"""Comparison of recordings with prediction, and sources of the errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array, Flags
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError, TrackError
from vibrosweep.lab.comparison import (
    QUANTITIES,
    READINGS,
    comparable,
    errors_of,
    measured_means,
)
from vibrosweep.lab.fitting import View, fit_tracks
from vibrosweep.lab.impacts import check_method, impacts_of
from vibrosweep.lab.oscillation import Trace
from vibrosweep.lab.prediction import (
    DRAWS,
    USED,
    Comparison,
    Prediction,
    draw,
    parameters_of,
    predict,
)
from vibrosweep.lab.speed_laws import law_text
from vibrosweep.lab.twin import camera_shares
from vibrosweep.model.forcing import ACCELERATION
from vibrosweep.model.parameters import LAWS, OF_RESTITUTION, PARAMETERS
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    RESTITUTION_LAWS,
    SPEED,
    range_mistake,
    speed_mistakes,
)
from vibrosweep.model.shapes import Waveform
from vibrosweep.runs.driver import thread_count

__all__ = ["compare", "compare_tracks"]

KNOWN: Final = {
    **{
        name: PARAMETERS[name]
        for name in ("restitution", "amplitude", "frequency", "phase", "gravity", "contact_time")
    },
    **OF_RESTITUTION,
}
SHARES: Final = ("frames", "pixels", "parameters")


class _Compared(NamedTuple):
    """Comparison of one recording with its prediction."""

    # Error and its contributions in per cent, shape (1 + len(SHARES), quantity, reading)
    errors: Array
    means: Array  # measured and predicted, m and s; shape (2, quantity)
    # Share of the particles that were compared, parameters of the prediction and their errors
    numbers: dict[str, float]
    texts: dict[str, str]  # attributes of the result


def compare_tracks(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    method: str = "fit",
    base: float | None = None,
    exposure: float = 0.0,
    motion: str = "detect",
    trace: Trace | None = None,
    rebound: str = "rest",
    restitution_law: str = CONSTANT,
    draws: int = DRAWS,
    seed: int = 0,
    threads: int | None = None,
    **known: float,
) -> xr.Dataset:
    """Compare recordings with prediction, case by case; a case is a number of particles.

    Parameters
    ----------
    recordings
        Tracks, as `read_tracks` returns them, of one recording or of several.
    method, base, exposure, motion, trace
        As in `find_impacts`.
    rebound
        Law of rebound, ``"rest"`` or ``"reflect"``.
    restitution_law
        Law of a restitution that is known.  An estimated restitution has the best law where the
        bounces rule out a constant one.
    draws
        Parameter sets drawn within the errors of an estimate, at least 2.
    seed
        Of the random numbers.
    threads
        Number of threads, by default one per processor; the result does not depend on it.
    **known
        Parameters that are known: restitution (1), amplitude (m s-1), frequency (Hz), phase (rad),
        gravity (m s-2), contact_time (s), restitution_speed (m s-1) of a `restitution_law`.  The
        first four are estimated where they are not given.

    Returns
    -------
    xarray.Dataset
        Dims (case, quantity, reading): ``error`` in per cent, ``|measured - predicted| /
        measured``, the mean over the repeats, and the contributions of ``frames``, ``pixels``
        and ``parameters``, each alone (in per cent of the measured value); their squares add.
        Dims (case, quantity): ``measured``, ``measured_sd`` over the repeats, ``predicted`` (m, s).
        Dim case: ``particles``, ``repeats``, ``compared``, and the parameters used.  Attributes:
        the base, the ``waveform`` and the ``restitution_law`` of the prediction.

    Raises
    ------
    TrackError
        A recording cannot be measured, or there is none.
    ParameterError
        A parameter is not known by that name or outside its range, or is not determined.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab import Experiment, perform_trials
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=10.0))
    >>> known = {"restitution": 0.9, "amplitude": 0.06, "frequency": 20.0}
    >>> found = vs.lab.compare_tracks(film[0].tracks, **known)
    >>> found.error.dims
    ('case', 'quantity', 'reading')
    """
    for name, value in known.items():
        if name not in KNOWN:
            raise ParameterError(f"{name}: is not a parameter; known are {', '.join(KNOWN)}")
        if not KNOWN[name].accepts(value):
            raise ParameterError(f"{name} = {value!r}: must be {KNOWN[name].allowed}")
    several = [recordings] if isinstance(recordings, xr.Dataset) else recordings
    view = View(base, exposure, motion, known.get("frequency"), trace)
    how = Comparison(known, method, view, draws, rebound, seed, restitution_law)
    with Workers(thread_count(threads)) as workers:
        return compare(several, how, workers)


def compare(recordings: Sequence[xr.Dataset], how: Comparison, workers: Workers) -> xr.Dataset:
    """Compare recordings with prediction, case by case; a case is a number of particles.

    Recordings are tracks as of `read_tracks`; result and errors are those of `compare_tracks`.
    """
    _check(recordings, how)
    groups: dict[int, list[_Compared]] = {}
    for tracks in recordings:
        groups.setdefault(tracks.sizes["particle"], []).append(_one(tracks, how, workers))
    counts = sorted(groups)
    rows = [groups[count] for count in counts]
    texts = [one.texts for row in rows for one in row]
    return xr.Dataset(
        {**_errors(rows), **_means(rows)},
        coords={
            "case": [f"N={count}" for count in counts],
            "particles": ("case", counts),
            "quantity": list(QUANTITIES),
            "units": ("quantity", ["m", "s"]),
            "reading": list(READINGS),
        },
        attrs={
            "method": how.method,
            **{name: "; ".join(sorted({one[name] for one in texts} - {""})) for name in texts[0]},
        },
    )


def _check(recordings: Sequence[xr.Dataset], how: Comparison) -> None:
    """Refuse wrong arguments before recordings are measured."""
    check_method(how.method)
    if not recordings:
        raise TrackError("there is no recording to compare: give at least one")
    if how.rebound not in LAWS:
        raise ParameterError(f"rebound = {how.rebound!r}: must be one of {', '.join(LAWS)}")
    if how.draws < 2:
        raise ParameterError(f"draws = {how.draws}: must be at least 2, as one has no spread")
    law = how.restitution_law
    if law not in RESTITUTION_LAWS:
        allowed = ", ".join(RESTITUTION_LAWS)
        raise ParameterError(f"restitution_law = {law!r}: must be one of {allowed}")
    for name, text in speed_mistakes(law, how.known).items():
        raise ParameterError(f"{name}: {text}")
    if law != CONSTANT and "restitution" not in how.known:
        raise ParameterError(
            f"restitution_law = {law!r}: needs the restitution; give restitution and amplitude, or "
            f"leave out the law and its speed, which are estimated then"
        )
    if wrong := range_mistake(law, np.array(how.known.get("restitution", 1.0))):
        raise ParameterError(wrong)


def _errors(rows: Sequence[Sequence[_Compared]]) -> dict[str, Any]:
    """Variables of dims (case, quantity, reading): the errors and their contributions."""
    repeats = [np.stack([one.errors for one in row], axis=-1) for row in rows]
    # contributions add as squares, so their squares are averaged
    shares = [np.sqrt(np.mean(found[1:] ** 2, axis=-1)) for found in repeats]
    errors = [np.mean(found[:1], axis=-1) for found in repeats]
    columns = np.concatenate([errors, shares], axis=1).swapaxes(0, 1)
    words = ["|measured - predicted| / measured", *(f"error due to {name}" for name in SHARES)]
    return {
        name: (("case", "quantity", "reading"), values, {"units": "percent", "long_name": text})
        for name, values, text in zip(("error", *SHARES), columns, words, strict=True)
    }


def _means(rows: Sequence[Sequence[_Compared]]) -> dict[str, Any]:
    """Variables of dims (case, quantity) and (case): measured and predicted means, parameters."""
    repeats = [np.stack([one.means for one in row], axis=-1) for row in rows]
    measured, predicted = np.array([found.mean(axis=-1) for found in repeats]).swapaxes(0, 1)
    spread = [
        found[0].std(axis=-1, ddof=1) if len(row) > 1 else np.full(len(QUANTITIES), np.nan)
        for found, row in zip(repeats, rows, strict=True)
    ]
    dims = ("case", "quantity")
    compared = {"units": "1", "long_name": "share of the particles that could be compared"}
    gamma = {"units": "1", "long_name": "peak acceleration of the base in units of gravity"}
    about: dict[str, dict[str, str]] = {
        "compared": compared,
        **{n: {"units": KNOWN[n].units, "long_name": KNOWN[n].long_name} for n in USED},
        ACCELERATION: gamma,
        **{
            f"{name}_error": {"long_name": f"typical standard error of the {name} of one recording"}
            for name in (*USED, ACCELERATION)
        },
    }

    def average(name: str, row: Sequence[_Compared]) -> float:
        values = np.array([one.numbers[name] for one in row])
        values = values[np.isfinite(values)]  # a constant restitution has no speed
        if not values.size:
            return float("nan")
        return float(np.sqrt(np.mean(values**2)) if name.endswith("_error") else np.mean(values))

    return {
        "measured": (dims, measured, {"long_name": "measured mean"}),
        "measured_sd": (dims, spread, {"long_name": "standard deviation over the repeats"}),
        "predicted": (dims, predicted, {"long_name": "predicted mean"}),
        "repeats": ("case", [len(row) for row in rows], {"units": "1"}),
        **{
            name: ("case", [average(name, row) for row in rows], attributes)
            for name, attributes in about.items()
        },
    }


def _one(tracks: xr.Dataset, how: Comparison, workers: Workers) -> _Compared:
    """Measure and predict one recording, and split its errors into contributions."""
    fitted = fit_tracks(tracks, how.gravity, how.view)
    by_fit = impacts_of(tracks, fitted, how.gravity, "fit")
    impacts = impacts_of(tracks, fitted, how.gravity, how.method)
    among = comparable(by_fit)
    if not among.any():
        raise TrackError(
            f"{tracks.attrs['source']}: no particle's flights are nearly all seen, so nothing can "
            f"be compared; film faster or closer"
        )
    numbers, scene, estimated = parameters_of(by_fit, how)
    sets, shapes, refused = draw(numbers, scene, estimated, how.draws, how.seed)
    found = predict(by_fit, sets, shapes, scene, workers)
    best = {"height": found.height[0], "period": found.period[0]}
    if not np.isfinite(best["period"][among]).any():
        raise ParameterError(
            f"{tracks.attrs['source']}: with these parameters none of the particles makes a whole "
            f"flight, so nothing can be compared: check restitution, amplitude and frequency"
        )
    means = measured_means(impacts, among)
    used = {name: float(values[0]) for name, values in sets.items()}
    warnings = [f"{refused} drawn sets were not physical and were drawn anew"] if refused else []
    try:
        shares = camera_shares(tracks, by_fit, used, scene, how)
    except TrackError as error:
        shares = np.full((2, len(QUANTITIES), len(READINGS)), np.nan)
        warnings.append(f"the errors of the camera are not known: {error}")
    spread = _spreads(found, means, among)
    by_parameters = np.where(
        np.array(READINGS) == "worst", spread.max(1, keepdims=True), spread.mean(1, keepdims=True)
    )
    return _Compared(
        np.stack([errors_of(impacts, best, among), *shares, by_parameters]),
        np.array([[np.nanmean(each[q][among]) for q in QUANTITIES] for each in (means, best)]),
        {"compared": float(among.mean()), **_used(estimated, used, scene.waveform)},
        {
            "warning": "; ".join(warnings),
            "base_motion": impacts.attrs["base_motion"],
            "favoured_base": fitted.favoured_base,
            "waveform": scene.waveform.text,
            "restitution_law": scene.restitution_law,
            "law": "" if estimated is None else law_text(estimated),
        },
    )


def _spreads(found: Prediction, means: dict[str, Array], among: Flags) -> Array:
    """Spread of the predictions over the draws in per cent of the measured means.

    Shape (quantity, particle); zero without draws.
    """
    drawn = np.stack(found)[:, 1:, among]
    if not drawn.shape[1]:
        return np.zeros((len(QUANTITIES), int(among.sum())))
    return np.asarray(100.0 * drawn.std(axis=1) / [means[q][among] for q in QUANTITIES])


def _used(
    estimated: xr.Dataset | None, used: dict[str, float], shape: Waveform
) -> dict[str, float]:
    """Parameters of a prediction, Gamma among them, and their standard errors, NaN if known."""
    velocity = used["amplitude"] / (1.0 + used["restitution"])
    gamma = shape.fall * used["frequency"] * velocity / used["gravity"]
    errors = {f"{name}_error": float("nan") for name in (*USED, ACCELERATION)}
    if estimated is not None:
        names = estimated["parameter"].values
        errors |= {f"{n}_error": float(estimated["error"].sel(parameter=n)) for n in names}
        if "base_acceleration_error" in estimated:
            errors[f"{ACCELERATION}_error"] = float(estimated["base_acceleration_error"])
    return {SPEED: float("nan"), **used, ACCELERATION: gamma, **errors}
