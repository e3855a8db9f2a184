"""Share of the landings after which a particle rests, as a function of the restitution."""

from collections.abc import Iterator

import xarray as xr
from matplotlib.axes import Axes

import vibrosweep as vs


def rest_share(sweep: xr.Dataset) -> xr.Dataset:
    """Share of the landings of each realization after which the particle rested."""
    vs.analysis.require(sweep, "rest_share", "rest_count", "impact_count", "restitution")
    landings = sweep["impact_count"].where(sweep["impact_count"] > 0)
    share = (sweep["rest_count"] / landings).assign_attrs(
        long_name="share of landings after which the particle rested", units="1"
    )
    return xr.Dataset({"rest_share": share}, attrs={"base": sweep.attrs["base"]})


def lines(result: xr.Dataset) -> Iterator[str]:
    """Smallest and largest share, for ``vibrosweep info``."""
    share = result["rest_share"]
    ends = f"{share.min():.3g} to {share.max():.3g}"
    yield f"rest_share over the {result.attrs['base']} base: {ends}"


def draw(result: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Plot the share against the restitution, for ``vibrosweep figures``."""
    axes = vs.figures.style.axes_on(ax, width=5.0, height=3.0)
    axes.plot(result["restitution"], result["rest_share"], ".")
    axes.set(xlabel="coefficient of restitution", ylabel="share of landings with a rest")
    return axes


REST_SHARE = vs.register_kind(vs.ResultKind("rest_share", "the package rest-share", lines, draw))
