"""Claim 13: measured and predicted heights and periods."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.study.table4 import in_band, study_imperfections
from vibrosweep.study.verdict import Check, Number, Outcome

__all__ = ["measured_and_predicted"]

TOLERANCE: Final = 8.0
# Fewer repeats and shorter films than the study's, and its three smaller cases: in some seconds
SIZE: Final[dict[str, Any]] = {
    "cases": {"A": 1, "B": 5, "C": 20},
    "repeats": 2,
    "duration": 10.0,
    "seed": 0,
}


def measured_and_predicted(threads: int) -> Outcome:
    """Measured and predicted heights and periods agree within 8 %, Table 4.

    The virtual experiment takes its own time on one thread.
    """
    study = study_imperfections(**SIZE)
    return judged(study, in_band(study))


def judged(study: xr.Dataset, bands: xr.Dataset) -> Outcome:
    """The outcome of a virtual experiment.

    Parameters
    ----------
    study
        Dims (trial, method, reading, case): ``height_error``, ``period_error`` in per cent.
    bands
        Dims (trial, method, reading): whether each is in the study's range, and whether it grows.
    """
    within = [(study[f"{q}_error"] <= TOLERANCE).all("case") for q in ("height", "period")]
    agrees = within[0] & within[1]
    grows = bands["height_grows"] & bands["period_grows"]
    in_range = bands["height_in_band"] & bands["period_in_band"]
    return Outcome(
        as_stated=(
            Check(
                "share of settings with all differences within 8 %", _share(agrees), "at least", 1.0
            ),
            Check(
                "share of settings in which both differences grow with N",
                _share(grows),
                "at least",
                1.0,
            ),
        ),
        conditional=(
            Check(
                "settings with all differences within 8 % and both growing with N",
                float(np.count_nonzero(agrees & grows)),
                "at least",
                1.0,
            ),
        ),
        numbers=(
            Number(
                "settings tried: imperfection, its size, method and reading", float(agrees.size)
            ),
            Number(
                "settings within the ranges of Table 4 in every case, heights",
                float(np.count_nonzero(bands["height_in_band"])),
            ),
            Number("the same, periods", float(np.count_nonzero(bands["period_in_band"]))),
            Number("the same, both", float(np.count_nonzero(in_range))),
            Number("the same, both and growing", float(np.count_nonzero(in_range & grows))),
            Number("particles that could be compared, share", float(study["compared"].mean())),
        ),
    )


def _share(flags: xr.DataArray) -> float:
    return float(np.mean(flags.values))
