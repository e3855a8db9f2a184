"""Errors that imperfections of the laboratory make, next to those of the study's Table 4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vibrosweep.figures import style

if TYPE_CHECKING:
    import xarray as xr

LARGEST_SHOWN: Final = 30.0  # per cent


@style.styled
def imperfections(
    study: xr.Dataset,
    reading: str,
    procedure: str,
    *,
    ax: Sequence[Axes] | NDArray[np.object_] | None = None,
) -> NDArray[np.object_]:
    """Draw the errors that each imperfection makes by itself, in every case.

    From the result of `study.table4.study_imperfections`, by one reading and procedure.  Bars are
    standard errors of the mean over repeats.
    """
    names = [
        f"{name.replace('_', ' ')} {size:g}{'' if unit == '1' else ' ' + unit}"
        for name, size, unit in zip(
            study["imperfection"].values, study["size"].values, study["units"].values, strict=True
        )
    ]
    rows = np.arange(len(names))[::-1]
    height = 0.19 * len(names) + 0.8
    panels = style.panels_on(ax, style.PAGE, height, [[0, 1]], sharey=True)
    for axes, q in zip(panels, ("height", "period"), strict=True):
        low, high = study.attrs[f"study_{q}"]
        axes.axvspan(low, high, color="0.9")
        error, spread = (
            study[f"{q}_error{end}"].sel(reading=reading, procedure=procedure)
            for end in ("", "_sd")
        )
        spread = spread / study.attrs["repeats"] ** 0.5
        for c, case in enumerate(study["case"].values):
            shown = error.sel(case=case).values
            doubt = spread.sel(case=case).values
            axes.errorbar(
                np.minimum(shown, LARGEST_SHOWN),
                rows + 0.16 * (1.5 - c),
                xerr=np.where(shown > LARGEST_SHOWN, np.nan, doubt),
                linestyle="none",
                elinewidth=0.8,
                marker="osD^"[c],
                markersize=3.2,
                color=style.OKABE_ITO[c],
                label=f"{case} (N = {int(study['particles'].values[c])})",
                clip_on=False,
            )
        axes.set_xscale("symlog", linthresh=1.0)
        axes.set(xlim=(0.0, LARGEST_SHOWN), xlabel=f"error of {q} (%)")
        axes.set_xticks([0, 1, 3, 10, 30], ["0", "1", "3", "10", "30 +"])
        axes.set_yticks(rows, names)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", linewidth=0.3, color="0.85")
        axes.set_title(f"shaded: study, {low:g} to {high:g} %")
    panels[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))  # one for both panels
    return panels
