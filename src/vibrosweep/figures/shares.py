"""Shares against a parameter, with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from vibrosweep.analysis.datasets import require
from vibrosweep.errors import ParameterError
from vibrosweep.figures import data, style
from vibrosweep.store.arranged import require_datasets

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["share_curves"]

PARTS = ("share", "share_low", "share_high")


@style.styled
def share_curves(
    found: Sequence[xr.Dataset], labels: Sequence[str], *, ax: Axes | None = None
) -> Axes:
    """Draw shares against a parameter, each with the band of its 95 % intervals.

    Parameters
    ----------
    found
        Result of `vibrosweep.analysis.share_against` for each curve, all for one parameter.
    labels
        Name of each curve in the legend.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        A dataset is not a result of `share_against`.
    ParameterError
        There are not as many labels as curves, or they have different parameters.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import share_against
    >>> from vibrosweep.figures import share_curves
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, regimes=True, duration=1000.0)
    >>> names = ["locked", "resting"]
    >>> shares = [share_against(sweep, "amplitude", of=name, bins=5) for name in names]
    >>> share_curves(shares, names).get_ylabel()
    'share'
    """
    require_datasets(found)
    for one in found:
        require(one, "share_curves", *PARTS, source="share_against")
    if len(labels) != len(found):
        raise ParameterError(f"labels: {len(labels)} of them for {len(found)} curves")
    along = {str(name).removesuffix("_low") for one in found for name in one.coords}
    along = {name for name in along if not name.endswith("_high")}
    if len(along) != 1:
        raise ParameterError(
            f"curves of one parameter are needed, not of {', '.join(sorted(along))}"
        )
    (name,) = along
    axes = style.axes_on(ax, style.MEDIUM, 2.9)
    for one, label, colour in zip(found, labels, style.colours(len(found)), strict=True):
        x = 0.5 * (one[f"{name}_low"].values + one[f"{name}_high"].values)
        share, low, high = (one[part].values for part in PARTS)
        axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0.0)
        axes.plot(x, share, color=colour, marker="o", markersize=2.0, label=label)
    shared = {str(one.attrs.get("of", "")).replace("_", " ") for one in found}
    axes.set(ylabel=": ".join(["share", *shared]) if len(shared) == 1 else "share")
    axes.set_ylim(-0.02, 1.02)
    ends = found[0][f"{name}_low"].assign_attrs(long_name=name.replace("_", " "))
    axes.set_xlabel(data.label(ends.to_dataset(name=name), name))
    style.head(axes, "")
    return axes
