"""Claims 13, 20, 22 and 23: Table 4, the uncertainty of heights, masses, a camera from above."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep import theory
from vibrosweep.lab.comparison import STUDY
from vibrosweep.study.claims_on_contact import DIAMETERS
from vibrosweep.study.estimates import CONFIDENCE, Estimate
from vibrosweep.study.samples import Plan
from vibrosweep.study.table4 import IMPERFECTIONS, study_imperfections
from vibrosweep.study.verdict import ANY_BASE, Evidence, Outcome, Reading, check, number

__all__ = ["camera_from_above", "height_uncertainty", "masses", "measured_and_predicted"]

Array = NDArray[np.float64]

TOLERANCE: Final = 8.0  # per cent
# Films shorter than the study's, two of its cases, one size of each imperfection: in half a minute
SIZE: Final[dict[str, Any]] = {
    "cases": {"A": 1, "C": 20},
    "duration": 2.0,
    "imperfections": tuple(
        replace(one, sizes=(one.sizes[len(one.sizes) // 2],)) for one in IMPERFECTIONS
    ),
}
# Sections 3.2.2 to 3.2.8 of the study
FREQUENCIES: Final = (8.0, 35.0)  # Hz
PLATFORM: Final = 180.0  # mm
PIXELS: Final = 1080  # of the short side of the film
UNCERTAINTY: Final = 0.05
MASSES: Final = (3.5, 4.5)  # g
# Stainless steels, g cm-3: ferritic to austenitic
DENSITIES: Final = (7.7, 8.0)
# From a camera that just sees the platform to one a metre away, mm
DISTANCES: Final = (250.0, 1000.0)


def measured_and_predicted(plan: Plan) -> Outcome:
    """Measured and predicted heights and periods agree within 8 %, Table 4.

    The virtual experiment takes its own time on one thread.
    """
    return Outcome([judged(study_imperfections(**SIZE, repeats=plan.seeds, seed=plan.first_seed))])


def judged(study: xr.Dataset) -> Evidence:
    """Judge a virtual experiment.

    Parameters
    ----------
    study
        Result of `study_imperfections`; its repeats are the sample.

    Returns
    -------
    Evidence
        A setting is an imperfection of some size, a method and a reading.  Its intervals are
        widened for the number of settings, so that none of them passes by chance.
    """
    settings = int(np.prod([study.sizes[d] for d in ("trial", "procedure", "reading")]))
    passes, possible = (np.ones(settings, np.bool_) for _ in range(2))
    inside, conceivable = passes.copy(), passes.copy()
    largest = 0.0
    for quantity, (bottom, top) in STUDY.items():
        error, half = _with_interval(study, quantity, settings)
        rise = error[:, -1] - error[:, 0]
        doubt = np.hypot(half[:, -1], half[:, 0])
        passes &= (error + half <= TOLERANCE).all(axis=1) & (rise - doubt > 0.0)
        possible &= ~(error - half > TOLERANCE).any(axis=1) & ~(rise + doubt <= 0.0)
        inside &= ((error - half >= bottom) & (error + half <= top)).all(axis=1)
        conceivable &= ~((error + half < bottom) | (error - half > top)).any(axis=1)
        largest = max(largest, float(np.nanmax(error)))
    found = _count(passes, possible)
    return Evidence(
        theory.FIXED[0],
        readings=(
            Reading(
                "whatever the imperfection",
                (check("settings within 8 % that grow with N", found, "at least", settings),),
            ),
        ),
        conditions=(
            Reading(
                "for some imperfection, in some reading of a difference",
                (check("settings within 8 % that grow with N", found, "at least", 1.0),),
            ),
        ),
        numbers=(
            number("settings tried: imperfection, its size, method, reading", settings),
            number("largest difference of any setting", largest, "%"),
            number(
                "settings within the ranges of Table 4 in every case",
                _count(inside & passes, conceivable & possible),
            ),
            number("particles that could be compared, share", float(study["compared"].mean())),
        ),
    )


def _with_interval(study: xr.Dataset, quantity: str, settings: int) -> tuple[Array, Array]:
    """Mean difference in per cent and half its interval, shape (setting, case).

    Where nothing could be measured nothing is known, not even that it fails.
    """
    from scipy.stats import t

    dims = ("trial", "procedure", "reading", "case")
    repeats = study.attrs["repeats"]
    error, spread = (
        study[f"{quantity}_error{end}"].transpose(*dims).values.reshape(settings, -1)
        for end in ("", "_sd")
    )
    if repeats < 2:
        return error, np.full_like(error, np.inf)
    factor = t.ppf(1.0 - 0.5 * (1.0 - CONFIDENCE) / settings, repeats - 1) / math.sqrt(repeats)
    return error, factor * spread


def _count(surely: NDArray[np.bool_], possibly: NDArray[np.bool_]) -> Estimate:
    low, high = (float(np.count_nonzero(each)) for each in (surely, possibly))
    return Estimate(low, low, high)


def _any_base(
    reading: Reading, condition: Reading | None = None, numbers: tuple[Any, ...] = ()
) -> Outcome:
    conditions = () if condition is None else (condition,)
    return Outcome([Evidence(ANY_BASE, (reading,), conditions, numbers)])


def height_uncertainty(plan: Plan) -> Outcome:
    """The uncertainty of heights stays below 5 %, sec. 3.2.8."""
    pixel = PLATFORM / PIXELS

    def half_pixel(frequency: float) -> float:
        return 0.5 * pixel / (1e3 * float(theory.locked_height(1, frequency)))

    limit = math.sqrt(UNCERTAINTY * 9.81e3 / 8.0 / (0.5 * pixel))
    what = "half a pixel over the height of mode 1"
    slow, fast = (
        check(f"{what} at {f:g} Hz", half_pixel(f), "at most", UNCERTAINTY) for f in FREQUENCIES
    )
    return _any_base(
        Reading("at all of 8 to 35 Hz, a film that shows the whole platform", (slow, fast)),
        Reading(f"below {limit:.0f} Hz, or where flights are higher than mode 1", (slow,)),
        (number("pixel of a film that shows the platform", pixel, "mm"),),
    )


def masses(plan: Plan) -> Outcome:
    """The spheres of Table 3 are of 8 to 10 mm and weigh 3.5 to 4.5 g."""
    lightest, heaviest = (
        density * math.pi / 6.0 * (0.1 * diameter) ** 3
        for density, diameter in zip(DENSITIES, DIAMETERS, strict=True)
    )
    bounds = [
        10.0 * (6.0 * mass / (math.pi * density)) ** (1.0 / 3.0)
        for mass, density in zip(MASSES, reversed(DENSITIES), strict=True)
    ]
    return _any_base(
        Reading(
            "solid stainless steel",
            (
                check("lightest sphere of 8 mm", lightest, "at least", MASSES[0], "g"),
                check("heaviest sphere of 10 mm", heaviest, "at most", MASSES[1], "g"),
            ),
        ),
        numbers=(
            number("heaviest sphere of 10 mm", heaviest, "g"),
            number("diameter of the lightest mass of Table 3", bounds[0], "mm"),
            number("diameter of the heaviest mass of Table 3", bounds[1], "mm"),
        ),
    )


def camera_from_above(plan: Plan) -> Outcome:
    """A camera above the platform, normal to it, measures heights, Fig. 7 and sec. 3.2.5."""
    edge = 0.5 * PIXELS

    def shift(frequency: float, distance: float) -> float:
        """Pixels by which 5 % of the height moves the image of a ball at the rim."""
        return UNCERTAINTY * 1e3 * float(theory.locked_height(1, frequency)) / distance * edge

    near, far = DISTANCES
    slow, fast = FREQUENCIES
    what = "image of 5 % of the height of mode 1 at the rim"
    return _any_base(
        Reading(
            "without perspective, as the study wants it",
            (check(what, 0.0, "at least", 1.0, "pixel"),),
        ),
        Reading(
            f"by perspective alone: at {slow:g} Hz, {near / 10:g} cm above",
            (check(what, shift(slow, near), "at least", 1.0, "pixel"),),
        ),
        (
            number(f"the same at {fast:g} Hz, {near / 10:g} cm above", shift(fast, near), "pixel"),
            number(f"the same at {slow:g} Hz, {far / 10:g} cm above", shift(slow, far), "pixel"),
        ),
    )
