"""Search for imperfections that produce the errors of the study's Table 4 and their growth.

Each imperfection acts alone on an experiment that is otherwise perfect, in all four cases; the
prediction is for the perfect experiment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import xarray as xr

from study.bases import HIGH_BOUNCE, MOVING
from vibrosweep.errors import TrackError
from vibrosweep.lab import (
    QUANTITIES,
    READINGS,
    Camera,
    Experiment,
    Variation,
    comparable,
    find_impacts,
    perform_trials,
    predicted_means,
    prediction_errors,
)

# Cases of Table 4 by their number of particles, and the range of its errors in per cent.
CASES: Final = {"A": 1, "B": 5, "C": 20, "D": 50}
STUDY: Final = {"height": (3.8, 7.1), "period": (2.9, 6.0)}
METHODS: Final = ("fit", "sign_change")
ACCELERATION: Final = "base_acceleration"
# Without noise, rounding or blur: only the effect of separate frames remains.
PERFECT: Final = Camera(frame_rate=240.0, noise=0.0, whole_pixels=False)
# At this phase the staggered launch of a single particle leads to a locked orbit; with one that
# rests, case A would have nothing to compare.
# 23 Hz does not divide a frame rate: a flight lasts 10.4 frames at 240 Hz, so that the phases at
# which frames are taken vary.
SCENE: Final[dict[str, Any]] = {
    **Experiment().parameters,
    "phase": float(np.pi),
    "frequency": 23.0,
    "amplitude": 1.2 / 23.0,
    "launch_velocity": 5.0 / 23.0,
}


# Percentage points by which an error must grow from the first case to the last.
GROWTH: Final = 1.0


@dataclass(frozen=True)
class Imperfection:
    """One imperfection in some sizes."""

    name: str  # in the result
    units: str  # of its sizes
    sizes: tuple[float, ...]  # from small to large
    # Field of `Camera` or of `Variation` that takes the size; or the acceleration of a base that
    # moves, with heights counted from where it is at rest
    key: str
    always: Mapping[str, Any] = field(default_factory=dict)  # other fields that are set with it

    def applied(self, experiment: Experiment, size: float) -> Experiment:
        """Return the experiment with this imperfection."""
        if self.key == ACCELERATION:
            numbers = experiment.parameters
            turn = 2.0 * math.pi * numbers["frequency"]
            numbers["amplitude"] = (1.0 + numbers["restitution"]) * size * numbers["gravity"] / turn
            scene = replace(experiment.scene, base=MOVING, inputs=numbers)
            return replace(experiment, scene=scene)
        changes = {self.key: size, **self.always}
        camera = {k: v for k, v in changes.items() if k in Camera.__dataclass_fields__}
        variation = {k: v for k, v in changes.items() if k in Variation.__dataclass_fields__}
        return replace(
            experiment,
            camera=replace(experiment.camera, **camera),
            variation=replace(experiment.variation, **variation),
        )


_PIXELS: Final = MappingProxyType({"noise": 1.0, "whole_pixels": True})
IMPERFECTIONS: Final = (
    Imperfection("frame_rate", "Hz", (480.0, 240.0, 120.0), "frame_rate"),
    Imperfection("pixel", "m", (5e-5, 1e-4, 1.5e-4, 2e-4, 3e-4), "pixel", _PIXELS),
    Imperfection("exposure", "s", (1e-3, 2e-3), "exposure"),
    Imperfection("dropped_frames", "1", (0.02, 0.1), "dropped"),
    Imperfection("scale_error", "1", (0.02, 0.05), "scale_error"),
    Imperfection("frequency_jitter", "1", (0.001, 0.01, 0.02, 0.03), "frequency_jitter"),
    Imperfection("frequency_setting", "1", (0.01, 0.03, 0.05), "frequency_setting"),
    Imperfection("amplitude_setting", "1", (0.05, 0.1), "amplitude_setting"),
    Imperfection("restitution_spread", "1", (0.01, 0.02, 0.03), "restitution_spread"),
    Imperfection("moving_base", "1", (0.4,), ACCELERATION),
    Imperfection(
        "all_together_by_pixel",
        "m",
        (1e-4, 1.5e-4, 2e-4),
        "pixel",
        MappingProxyType(
            {
                **_PIXELS,
                "exposure": 1e-3,
                "dropped": 0.01,
                "scale_error": 0.01,
                "frequency_jitter": 0.002,
                "frequency_setting": 0.002,
                "amplitude_setting": 0.02,
                "restitution_spread": 0.02,
            }
        ),
    ),
)


def study_imperfections(
    *,
    scene: Mapping[str, Any] = SCENE,
    imperfections: tuple[Imperfection, ...] = IMPERFECTIONS,
    cases: Mapping[str, int] = CASES,
    repeats: int = 4,
    transient: float = 20.0,
    duration: float = 60.0,
    seed: int = 0,
) -> xr.Dataset:
    """Errors of height and period that each imperfection makes by itself, in every case.

    The scene holds every parameter of `vibrosweep.PARAMETERS`; cases map letters to numbers of
    particles.  By default there are four repeats from 20 s to 60 s, as long as the study's.

    Dims (trial, procedure, reading, case): ``height_error``, ``period_error`` in per cent, the mean
    over the repeats, and their standard deviations ``height_error_sd``, ``period_error_sd``;
    ``compared(trial, case)`` is the share of the particles that could be compared.  A trial is one
    imperfection of one size: coordinates ``imperfection``, ``size`` and ``units``.
    """
    trials = [(one, size) for one in imperfections for size in one.sizes]
    plain = Experiment(
        **scene,
        repeats=repeats,
        transient=transient,
        duration=duration,
        camera=PERFECT,
        seed=seed,
    )
    return xr.Dataset(
        _tried(trials, plain, tuple(cases.values())),
        coords={
            "imperfection": ("trial", [one.name for one, _ in trials]),
            "size": ("trial", [size for _, size in trials]),
            "units": ("trial", [one.units for one, _ in trials]),
            "procedure": list(METHODS),
            "reading": list(READINGS),
            "case": list(cases),
            "particles": ("case", list(cases.values())),
        },
        attrs={
            "repeats": repeats,
            "transient": transient,
            "duration": duration,
            "seed": seed,
            **{f"study_{q}": STUDY[q] for q in QUANTITIES},
        },
    )


def _tried(
    trials: Sequence[tuple[Imperfection, float]], plain: Experiment, cases: Sequence[int]
) -> dict[str, Any]:
    """Variables of `study_imperfections`."""
    shape = (len(trials), len(METHODS), len(READINGS), len(cases))
    found = {f"{q}_error{end}": np.full(shape, np.nan) for q in QUANTITIES for end in ("", "_sd")}
    compared = np.zeros((len(trials), len(cases)))
    for i, (one, size) in enumerate(trials):
        for c, particles in enumerate(cases):
            of_particles = replace(plain, scene=replace(plain.scene, particles=particles))
            each = list(_repeats(one.applied(of_particles, size)))
            compared[i, c] = np.mean([share for share, _ in each])
            for q in QUANTITIES:
                values = np.array([by_method[q] for _, by_method in each])
                found[f"{q}_error"][i, ..., c] = values.mean(axis=0)
                found[f"{q}_error_sd"][i, ..., c] = values.std(axis=0, ddof=min(1, len(each) - 1))
    dims = ("trial", "procedure", "reading", "case")
    words = {q: f"error of {q}, |measured - predicted| / measured" for q in QUANTITIES}
    variables: dict[str, Any] = {
        name: (dims, values, {"units": "percent", "long_name": words[name.split("_")[0]]})
        for name, values in found.items()
    }
    described = {"units": "1", "long_name": "share of the particles that could be compared"}
    return {**variables, "compared": (("trial", "case"), compared, described)}


def _repeats(experiment: Experiment) -> Iterator[tuple[float, dict[str, list[list[float]]]]]:
    """Share of particles compared, and errors by quantity as [method][reading], of each repeat."""
    # predicted by the study's model, even if the base moves
    scene = replace(experiment.scene, base=HIGH_BOUNCE)
    predicted = predicted_means(replace(experiment, scene=scene))
    gravity = experiment.parameters["gravity"]
    for trial in perform_trials(experiment):
        try:
            by_method = [
                find_impacts(
                    trial.tracks,
                    gravity=gravity,
                    exposure=experiment.camera.exposure,
                    method=method,
                    motion="level",
                )
                for method in METHODS
            ]
        except TrackError:  # the imperfection is so large that nothing can be measured
            nothing = [[np.nan] * len(READINGS) for _ in METHODS]
            yield 0.0, dict.fromkeys(QUANTITIES, nothing)
            continue
        if experiment.scene.base != HIGH_BOUNCE:  # the zero of the film is the base at rest
            for one in by_method:
                one["rebound_height"] = one["rebound_height"] + one.attrs["base"]
        among = comparable(by_method[0])
        each = [prediction_errors(impacts, predicted, among) for impacts in by_method]
        yield (
            float(among.mean()),
            {q: [[one[q][reading] for reading in READINGS] for one in each] for q in QUANTITIES},
        )


def in_band(study: xr.Dataset) -> xr.Dataset:
    """Flags of the trials that explain Table 4: dims (trial, procedure, reading).

    For ``height`` and ``period``: ``*_in_band``, the errors of all cases lie inside the study's
    range; ``*_grows``, the error of the last case exceeds that of the first by more than a
    percentage point and by more than two standard errors of the difference.
    """
    found = {}
    for q in QUANTITIES:
        error, spread = study[f"{q}_error"], study[f"{q}_error_sd"]
        low, high = STUDY[q]
        found[f"{q}_in_band"] = ((error >= low) & (error <= high)).all("case")
        rise = error.isel(case=-1, drop=True) - error.isel(case=0, drop=True)
        doubt = (spread.isel(case=[0, -1]) ** 2).sum("case") ** 0.5 / study.attrs["repeats"] ** 0.5
        found[f"{q}_grows"] = (rise > GROWTH) & (rise > 2.0 * doubt)
    return xr.Dataset(found)


def verdict(study: xr.Dataset) -> list[str]:
    """Describe the imperfections that explain the ranges of Table 4, and their growth with N."""
    judged = in_band(study)
    lines = []
    for q in QUANTITIES:
        low, high = STUDY[q]
        for what, words in (
            ("in_band", f"errors of {low} to {high} % in every case are made by"),
            ("grows", "errors that grow with the number of particles are made by"),
        ):
            made = _listed(study, judged[f"{q}_{what}"])
            lines.append(f"{q}: {words} {made or 'nothing that was tried'}")
    both = judged["height_in_band"] & judged["period_in_band"]
    grow = both & judged["height_grows"] & judged["period_grows"]
    lines.append(f"both in their ranges: {_listed(study, both) or 'nothing that was tried'}")
    lines.append(f"both, and growing: {_listed(study, grow) or 'nothing that was tried'}")
    return lines


def _listed(study: xr.Dataset, chosen: xr.DataArray) -> str:
    """Name the chosen imperfections: size, method, and the readings for which it holds."""
    parts = []
    for i, name in enumerate(study["imperfection"].values):
        size, units = study["size"].values[i], str(study["units"].values[i])
        for m, method in enumerate(study["procedure"].values):
            readings = study["reading"].values[chosen.values[i, m]]
            if readings.size:
                unit = "" if units == "1" else f" {units}"
                parts.append(f"{name} {size:g}{unit} ({method}: {', '.join(readings)})")
    return "; ".join(parts)
