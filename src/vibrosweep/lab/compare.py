"""Comparison of recordings with prediction, as in Table 4 of the study, with shares of errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError, TrackError
from vibrosweep.lab.comparison import (
    CASES,
    QUANTITIES,
    READINGS,
    STUDY,
    comparable,
    measured_means,
    prediction_errors,
)
from vibrosweep.lab.estimation import estimate, fit_phase
from vibrosweep.lab.fitting import View, fit_tracks
from vibrosweep.lab.impacts import check_method, impacts_of
from vibrosweep.lab.oscillation import Trace
from vibrosweep.lab.prediction import DRAWS, draw, predict
from vibrosweep.lab.twin import Comparison, camera_shares
from vibrosweep.model.forcing import ACCELERATION
from vibrosweep.model.parameters import LAWS, PARAMETERS
from vibrosweep.runs.driver import thread_count

__all__ = ["compare", "compare_tracks"]

KNOWN: Final = ("restitution", "amplitude", "frequency", "phase", "gravity", "contact_time")
USED: Final = ("restitution", "amplitude", "frequency")
SHARES: Final = ("frames", "pixels", "parameters")


class _Compared(NamedTuple):
    """Measured means, predictions, errors and shares of one recording, by quantity."""

    compared: float
    measured: dict[str, float]
    predicted: dict[str, float]
    error: dict[str, dict[str, float]]
    share: dict[str, dict[str, dict[str, float]]]
    parameters: dict[str, float]
    deviation: dict[str, float]
    favoured: str
    motion: str
    warning: str


def compare_tracks(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    method: str = "fit",
    base: float | None = None,
    exposure: float = 0.0,
    motion: str = "detect",
    trace: Trace | None = None,
    rebound: str = "rest",
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
    draws
        Parameter sets drawn within the errors of an estimate, at least 2.
    seed
        Of the random numbers.
    threads
        Number of threads, by default one per processor; the result does not depend on it.
    **known
        Parameters that are known: restitution (1), amplitude (m s-1), frequency (Hz), phase (rad),
        gravity (m s-2), contact_time (s).  The first four are estimated where they are not given.

    Returns
    -------
    xarray.Dataset
        Dims (case, quantity, reading): ``error`` in per cent, ``|measured - predicted| /
        measured``, the mean over the repeats, and the contributions of ``frames``, ``pixels``
        and ``parameters``, each alone (in per cent of the measured value); their squares add.
        Dims (case, quantity): ``measured``, ``measured_sd`` over the repeats, ``predicted`` (m, s).
        Dim case: ``particles``, ``repeats``, ``compared``, and the parameters used.

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
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=5.0))
    >>> known = {"restitution": 0.9, "amplitude": 0.06, "frequency": 20.0}
    >>> found = vs.lab.compare_tracks(film[0].tracks, **known)
    >>> found.error.dims
    ('case', 'quantity', 'reading')
    """
    for name, value in known.items():
        if name not in KNOWN:
            raise ParameterError(f"{name}: is not a parameter; known are {', '.join(KNOWN)}")
        if not PARAMETERS[name].accepts(value):
            raise ParameterError(f"{name} = {value!r}: must be {PARAMETERS[name].allowed}")
    several = [recordings] if isinstance(recordings, xr.Dataset) else recordings
    view = View(base, exposure, motion, known.get("frequency"), trace)
    how = Comparison(known, method, view, draws, rebound, seed)
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
    letters = {number: letter for letter, number in CASES.items()}
    studied = set(counts) <= letters.keys()
    warnings = {one.warning for row in rows for one in row if one.warning}
    return xr.Dataset(
        {**_errors(rows), **_means(rows)},
        coords={
            "case": [letters.get(count, f"N={count}") for count in counts],
            "particles": ("case", counts),
            "quantity": list(QUANTITIES),
            "units": ("quantity", ["m", "s"]),
            "reading": list(READINGS),
        },
        attrs={
            "method": how.method,
            "warning": "; ".join(sorted(warnings)),
            "base_motion": ", ".join(sorted({one.motion for row in rows for one in row})),
            "favoured_base": ", ".join(sorted({one.favoured for row in rows for one in row})),
            # the ranges of the study hold for its own cases
            **({f"study_{q}": STUDY[q] for q in QUANTITIES} if studied else {}),
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


def _errors(rows: Sequence[Sequence[_Compared]]) -> dict[str, Any]:
    """Variables of dims (case, quantity, reading): the errors and their contributions."""
    found = np.empty((1 + len(SHARES), len(rows), len(QUANTITIES), len(READINGS)))
    for i, row in enumerate(rows):
        for j, q in enumerate(QUANTITIES):
            for k, reading in enumerate(READINGS):
                found[0, i, j, k] = np.mean([one.error[q][reading] for one in row])
                for m, name in enumerate(SHARES, start=1):
                    # contributions add as squares, so their squares are averaged
                    parts = [one.share[name][q][reading] ** 2 for one in row]
                    found[m, i, j, k] = np.sqrt(np.mean(parts))
    words = ["|measured - predicted| / measured", *(f"error due to {name}" for name in SHARES)]
    return {
        name: (("case", "quantity", "reading"), values, {"units": "percent", "long_name": text})
        for name, values, text in zip(("error", *SHARES), found, words, strict=True)
    }


def _means(rows: Sequence[Sequence[_Compared]]) -> dict[str, Any]:
    """Variables of dims (case, quantity) and (case): measured and predicted means, parameters."""
    measured, spread, predicted = np.empty((3, len(rows), len(QUANTITIES)))
    for i, row in enumerate(rows):
        for j, q in enumerate(QUANTITIES):
            values = np.array([one.measured[q] for one in row])
            measured[i, j] = values.mean()
            spread[i, j] = values.std(ddof=1) if len(row) > 1 else np.nan
            predicted[i, j] = np.mean([one.predicted[q] for one in row])
    dims = ("case", "quantity")
    used = {
        name: (
            "case",
            [float(np.mean([one.parameters[name] for one in row])) for row in rows],
            {"units": PARAMETERS[name].units, "long_name": PARAMETERS[name].long_name},
        )
        for name in USED
    }
    errors = {
        f"{name}_error": (
            "case",
            [float(np.sqrt(np.mean([one.deviation[name] ** 2 for one in row]))) for row in rows],
            {"long_name": f"typical standard error of the {name} of one recording"},
        )
        for name in (*USED, ACCELERATION)
    }
    return {
        "measured": (dims, measured, {"long_name": "measured mean"}),
        "measured_sd": (dims, spread, {"long_name": "standard deviation over the repeats"}),
        "predicted": (dims, predicted, {"long_name": "predicted mean"}),
        "repeats": ("case", [len(row) for row in rows], {"units": "1"}),
        "compared": (
            "case",
            [float(np.mean([one.compared for one in row])) for row in rows],
            {"units": "1", "long_name": "share of the particles that could be compared"},
        ),
        **used,
        ACCELERATION: (
            "case",
            [float(np.mean([one.deviation["gamma"] for one in row])) for row in rows],
            {"units": "1", "long_name": "peak acceleration of the base in units of gravity"},
        ),
        **errors,
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
    scene, estimated = _parameters(by_fit, how)
    sets, refused = draw(scene, estimated, how.draws, how.seed)
    found = predict(by_fit, sets, workers, how.rebound)
    best = {"height": found.height[0], "period": found.period[0]}
    error = prediction_errors(impacts, best, among)
    means = measured_means(impacts, among)
    one = {name: float(values[0]) for name, values in sets.items()}
    spread = {
        q: 100.0 * np.std(values[1:, among], axis=0) / means[q][among]
        if len(values) > 1
        else np.zeros(int(among.sum()))
        for q, values in (("height", found.height), ("period", found.period))
    }
    share = camera_shares(tracks, by_fit, one, how)
    share["parameters"] = {
        q: dict.fromkeys(READINGS, float(values.mean())) | {"worst": float(values.max())}
        for q, values in spread.items()
    }
    warning = f"{refused} drawn sets were not physical and were drawn anew" if refused else ""
    return _Compared(
        float(among.mean()),
        {q: float(np.nanmean(means[q])) for q in QUANTITIES},
        {q: float(np.nanmean(best[q][among])) for q in QUANTITIES},
        error,
        share,
        one,
        _deviations(estimated, one),
        fitted.favoured_base,
        impacts.attrs["base_motion"],
        warning,
    )


def _deviations(estimated: xr.Dataset | None, used: dict[str, float]) -> dict[str, float]:
    """Standard errors of the parameters, NaN for known ones, and the acceleration of the base."""
    errors = dict.fromkeys((*USED, ACCELERATION), float("nan"))
    velocity = used["amplitude"] / (1.0 + used["restitution"])
    gamma = 2.0 * np.pi * used["frequency"] * velocity / used["gravity"]
    if estimated is not None:
        errors |= {
            str(name): float(error)
            for name, error in zip(
                estimated["parameter"].values, estimated["error"].values, strict=True
            )
        }
        if "base_acceleration_error" in estimated:
            errors[ACCELERATION] = float(estimated["base_acceleration_error"])
    return {**errors, "gamma": gamma}


def _parameters(impacts: xr.Dataset, how: Comparison) -> tuple[dict[str, float], xr.Dataset | None]:
    """Known parameters of the scene, and the estimate of the others."""
    scene = {name: how.known.get(name, p.default) for name, p in PARAMETERS.items()}
    given = {"restitution", "amplitude"} & how.known.keys()
    if len(given) == 1:
        raise ParameterError(
            f"{given.pop()} is given alone: give restitution and amplitude, or leave both to be "
            f"estimated"
        )
    if not given:
        return scene, estimate(impacts, frequency=how.known.get("frequency"))
    if "frequency" not in how.known:
        raise ParameterError("the frequency is missing: give it with restitution and amplitude")
    if "phase" not in how.known and impacts.attrs["base_motion"] == "moving":
        _, sine, cosine = impacts["shaken"].values[:3]
        scene["phase"] = float(np.arctan2(cosine, sine))
    elif "phase" not in how.known:
        scene["phase"] = fit_phase(
            impacts, **{n: scene[n] for n in ("restitution", "amplitude", "frequency")}
        )
    return scene, None
