"""Comparison of recordings with prediction, and the sources of its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array, Flags
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError, TrackError, require_one_of
from vibrosweep.lab.fitting import Setup, fit_tracks
from vibrosweep.lab.impacts import METHODS, impacts_of
from vibrosweep.lab.oscillation import Trace
from vibrosweep.lab.prediction import (
    DRAWS,
    USED,
    ComparisonOptions,
    draw_parameters,
    parameters_of,
    predict,
)
from vibrosweep.lab.relative_errors import (
    MEASURED_AS,
    QUANTITIES,
    READINGS,
    comparable,
    errors_of,
    measured_means,
)
from vibrosweep.lab.speed_laws import law_text
from vibrosweep.lab.twin import camera_shares, predicted_motions
from vibrosweep.lab.variables import with_units
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
from vibrosweep.scene.scene import Scene

__all__ = ["compare", "compare_tracks"]

# Parameters that may be given: a particle is launched with the speed of its first flight
KNOWN: Final = {
    name: parameter
    for name, parameter in {**PARAMETERS, **OF_RESTITUTION}.items()
    if name != "launch_velocity"
}
# Flights of two predictions, whose starts differ by the error of a measurement, are as far apart as
# this share of the standard deviation of the flights of one: they are irregular
APART: Final = 0.5
REGULAR: Final = 1e-3  # relative standard deviation of flights that are all alike
FEWEST: Final = 8  # flights with which this can be told
CHANCE: Final = 1.36  # distance of two samples, over sqrt(1/n + 1/m), that chance exceeds in 5 %
SHARES: Final = ("frames", "pixels", "parameters")


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
        Law of a known restitution.  An estimated restitution has the best law if the bounces rule
        out a constant one.
    draws
        Parameter sets drawn within the errors of an estimate, at least 2.
    seed
        Seed of the random numbers.
    threads
        Number of threads, by default one per processor; the result does not depend on it.
    **known
        Known parameters: restitution (1), amplitude (m s-1), frequency (Hz), phase (rad), gravity
        (m s-2), contact_time (s), restitution_speed (m s-1) of a `restitution_law`.  The first four
        are estimated if they are not given.

    Returns
    -------
    xarray.Dataset
        Dims (case, quantity, reading): ``error`` in per cent, ``|measured - predicted| /
        measured``, its mean over the repeats, and the contributions of ``frames``, ``pixels``
        and ``parameters`` (in per cent of the measured value), which add in quadrature.
        Dims (case, quantity): ``measured``, ``measured_sd`` over the repeats, ``predicted`` (m, s).
        ``distribution_distance``, the largest difference of the cumulative distributions of
        measured and predicted flights, which counts where the motion is irregular.
        Dim case: ``irregular``, the share of particles whose single flights cannot be predicted;
        ``distribution_chance``, the distance that chance exceeds in 5 %;
        ``particles``, ``repeats``, ``compared``, and the parameters used.  Attributes:
        the base, the ``waveform`` and the ``restitution_law`` of the prediction.

    Raises
    ------
    TrackError
        A recording cannot be measured, or there is none.
    ParameterError
        There is no parameter of that name, or one is outside its range or not determined.

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
    if isinstance(recordings, xr.Dataset):
        recordings = [recordings]
    setup = Setup(base, exposure, motion, known.get("frequency"), trace)
    options = ComparisonOptions(known, method, setup, draws, rebound, seed, restitution_law)
    with Workers(thread_count(threads)) as workers:
        return compare(recordings, options, workers)


def compare(
    recordings: Sequence[xr.Dataset], options: ComparisonOptions, workers: Workers
) -> xr.Dataset:
    """Compare recordings with prediction, case by case; a case is a number of particles.

    Recordings are tracks from `read_tracks`; result and errors are those of `compare_tracks`.
    """
    _check(recordings, options)
    found = [_compare_recording(tracks, options, workers) for tracks in recordings]
    counts = sorted({int(row["particles"]) for row in found})
    repeats = ([row for row in found if row["particles"] == count] for count in counts)
    table = xr.concat(map(_case, repeats), "case")
    table = table.assign_coords(case=[f"N={count}" for count in counts])
    texts = {name: {row.attrs[name] for row in found} - {""} for name in found[0].attrs}
    return table.assign_attrs({name: "; ".join(sorted(text)) for name, text in texts.items()})


def _case(repeats: Sequence[xr.Dataset]) -> xr.Dataset:
    """Average over the recordings with one number of particles."""
    every = xr.concat(repeats, "repeat", combine_attrs="drop_conflicts")
    means = every.mean("repeat", keep_attrs=True)
    # contributions to an error, and standard errors, are averaged in quadrature
    for name in [*SHARES, *(name for name in means if str(name).endswith("_error"))]:
        means[name].values = np.sqrt((every[name] ** 2).mean("repeat").values)
    words = {"long_name": "standard deviation over the repeats"}
    spread = np.nan * means["measured"]
    if len(repeats) > 1:
        spread = every["measured"].std("repeat", ddof=1)
    return means.assign(
        measured_sd=spread.assign_attrs(words), repeats=((), len(repeats), {"units": "1"})
    ).assign_coords(particles=repeats[0]["particles"])


def _check(recordings: Sequence[xr.Dataset], options: ComparisonOptions) -> None:
    """Refuse wrong arguments before any recording is measured."""
    require_one_of("method", options.method, METHODS, TrackError)
    if not recordings:
        raise TrackError("there is no recording to compare: give at least one")
    require_one_of("rebound", options.rebound, LAWS)
    if options.draws < 2:
        raise ParameterError(
            f"draws = {options.draws}: must be at least 2, because one has no spread"
        )
    law = options.restitution_law
    require_one_of("restitution_law", law, RESTITUTION_LAWS)
    for name, text in speed_mistakes(law, options.known).items():
        raise ParameterError(f"{name}: {text}")
    if law != CONSTANT and "restitution" not in options.known:
        raise ParameterError(
            f"restitution_law = {law!r}: needs the restitution; give restitution and amplitude, or "
            f"leave out the law and its speed, which are then estimated"
        )
    if wrong := range_mistake(law, np.array(options.known.get("restitution", 1.0))):
        raise ParameterError(wrong)


def _compare_recording(
    tracks: xr.Dataset, options: ComparisonOptions, workers: Workers
) -> xr.Dataset:
    """Compare one recording with its prediction, and split the errors into contributions."""
    fitted = fit_tracks(tracks, options.gravity, options.setup)
    by_fit = impacts_of(tracks, fitted, options.gravity, "fit")
    impacts = impacts_of(tracks, fitted, options.gravity, options.method)
    among = comparable(by_fit)
    if not among.any():
        raise TrackError(
            f"{tracks.attrs['source']}: no particle has nearly all of its flights measured, so "
            f"nothing can be compared; film faster or closer"
        )
    numbers, scene, estimated = parameters_of(by_fit, options)
    sets, shapes, refused = draw_parameters(numbers, scene, estimated, options.draws, options.seed)
    found = predict(by_fit, sets, shapes, scene, workers)
    best = {name: means[0] for name, means in found.items()}
    if not np.isfinite(best["period"][among]).any():
        raise ParameterError(
            f"{tracks.attrs['source']}: with these parameters none of the particles makes a whole "
            f"flight, so nothing can be compared: check restitution, amplitude and frequency"
        )
    means = measured_means(impacts, among)
    used = {name: float(values[0]) for name, values in sets.items()}
    warnings = [f"{refused} drawn sets were not physical and were drawn anew"] if refused else []
    try:
        shares = camera_shares(tracks, by_fit, used, scene, options)
    except TrackError as error:
        shares = np.full((2, len(QUANTITIES), len(READINGS)), np.nan)
        warnings.append(f"the errors of the camera are not known: {error}")
    errors = [errors_of(impacts, best, among), *shares, _spreads(found, means, among)]
    both = [[np.nanmean(mean[q][among]) for q in QUANTITIES] for mean in (means, best)]
    columns = _parameter_columns(estimated, used, scene.waveform)
    columns["compared"] = among.mean(), "1", "share of the particles that could be compared"
    irregular, distances, chance = _distributions(by_fit, used, scene, among)
    columns["irregular"] = irregular, "1", "share of the particles whose single flights are chaotic"
    columns["distribution_chance"] = chance, "1", "distance that chance exceeds in 5 %"
    texts = {
        "method": options.method,
        "warning": "; ".join(warnings),
        "base_motion": impacts.attrs["base_motion"],
        "favoured_base": fitted.favoured_base,
        "waveform": scene.waveform.text,
        "restitution_law": scene.restitution_law,
        "law": "" if estimated is None else law_text(estimated),
    }
    words = {"long_name": "largest difference of the distributions of flights", "units": "1"}
    table = _table(errors, both, columns)
    table["distribution_distance"] = "quantity", distances, words
    return table.assign_coords(particles=among.size).assign_attrs(texts)


def _distributions(
    impacts: xr.Dataset, used: dict[str, float], scene: Scene, among: Flags
) -> tuple[float, Array, float]:
    """Compare flights as a whole.

    Returns the share of particles whose single flights cannot be predicted, because a start that
    differs by the error of its measurement leads to others; the largest differences of the
    cumulative distributions of heights and of periods; and that which chance exceeds in 5 %.
    """
    error = impacts.attrs["gravity"] * float(np.nanmedian(impacts["landing_time_error"]))
    nudged = impacts.assign(impact_speed=impacts["impact_speed"] + max(error, 1e-6))
    pairs = [predicted_motions(found, used, scene) for found in (impacts, nudged)]
    particles = np.flatnonzero(np.isfinite(impacts["flight_time"].values).any(axis=1))
    irregular, flights = [], []
    for particle, one, two in zip(particles, *pairs, strict=True):
        if not among[particle]:
            continue
        seen = one.end <= impacts.attrs["end"]
        flights.append(np.stack([one.apex[seen], (one.end - one.start)[seen]]))
        number = min(int(seen.sum()), int((two.end <= impacts.attrs["end"]).sum()))
        late = slice(number // 2, number)
        first, second = ((motion.end - motion.start)[late] for motion in (one, two))
        if number >= FEWEST:
            apart, spread = float(np.std(first - second)), float(first.std())
            irregular.append(apart > APART * spread > APART * REGULAR * float(first.mean()))
    predicted = np.concatenate(flights, axis=1)
    distances, chance = [], np.nan
    for sample, name in zip(predicted, MEASURED_AS.values(), strict=True):
        measured = impacts[name].values[among]
        measured = np.sort(measured[np.isfinite(measured)])
        every = np.concatenate([measured, sample])
        below = (np.searchsorted(np.sort(x), every, "right") / x.size for x in (measured, sample))
        distances.append(float(np.abs(next(below) - next(below)).max()))
        chance = CHANCE * float(np.sqrt(1.0 / measured.size + 1.0 / sample.size))
    return float(np.mean(irregular)) if irregular else 0.0, np.array(distances), chance


def _table(
    errors: Sequence[Array], means: Sequence[Any], numbers: Mapping[str, tuple[Any, str, str]]
) -> xr.Dataset:
    """Dataset of one recording: errors and their contributions, means, and single numbers."""
    words = {"error": "|measured - predicted| / measured"}
    words |= {name: f"error due to {name}" for name in SHARES}
    percent = {
        name: (values, "percent", text)
        for (name, text), values in zip(words.items(), errors, strict=True)
    }
    of_means = {
        name: ("quantity", values, {"long_name": f"{name} mean"})
        for name, values in zip(("measured", "predicted"), means, strict=True)
    }
    return xr.Dataset(
        {**with_units(("quantity", "reading"), percent), **of_means, **with_units((), numbers)},
        coords={
            "quantity": list(QUANTITIES),
            "units": ("quantity", ["m", "s"]),
            "reading": list(READINGS),
        },
    )


def _spreads(found: dict[str, Array], means: dict[str, Array], among: Flags) -> Array:
    """Standard deviation over the draws in per cent of the measured means, zero without draws.

    Its shape is (quantity, reading).
    """
    drawn = np.stack(list(found.values()))[:, 1:, among]
    if not drawn.shape[1]:
        return np.zeros((len(QUANTITIES), len(READINGS)))
    spread = 100.0 * drawn.std(axis=1) / [means[q][among] for q in QUANTITIES]
    worst = np.array(READINGS) == "worst"
    return np.asarray(np.where(worst, spread.max(1, keepdims=True), spread.mean(1, keepdims=True)))


def _parameter_columns(
    estimated: xr.Dataset | None, used: dict[str, float], shape: Waveform
) -> dict[str, tuple[Any, str, str]]:
    """Parameters of a prediction, with Gamma, and their standard errors, NaN for known ones."""
    velocity = used["amplitude"] / (1.0 + used["restitution"])
    gamma = shape.fall * used["frequency"] * velocity / used["gravity"]
    about = {name: (p.units, p.long_name) for name, p in KNOWN.items() if name in USED}
    about[ACCELERATION] = "1", "peak acceleration of the base in units of gravity"
    values, errors = {SPEED: np.nan, **used, ACCELERATION: gamma}, dict.fromkeys(about, np.nan)
    if estimated is not None:
        fitted = zip(estimated["parameter"].values, estimated["error"].values, strict=True)
        errors |= {name: error for name, error in fitted if name in about}
        errors[ACCELERATION] = float(estimated.get("base_acceleration_error", np.nan))
    words = "typical standard error, in one recording, of the "
    return {name: (values[name], *meaning) for name, meaning in about.items()} | {
        f"{name}_error": (error, about[name][0], f"{words}{name}") for name, error in errors.items()
    }
