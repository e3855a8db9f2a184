"""Branches of periodic orbits along a parameter, and curves of their bifurcations over a plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from vibrosweep.analysis.orbits import cycle_name
from vibrosweep.figures import data, style
from vibrosweep.figures.plane import parameter_plane
from vibrosweep.model.parameters import OF_RESTITUTION

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NEEDS", "orbit_boundaries", "orbit_branches"]

NEEDS: Final = data.Needs(("bifurcation", "cycle_impacts", "cycle_periods", "admissible"))
# Parameters apart from the plane of restitution and forcing that set the boundaries
SHARED: Final = ("frequency", "gravity", "contact_time", *OF_RESTITUTION)
TIES: Final = (2, 3, 7)  # grazes and rest among the codes of `bifurcation`
THIN, THICK = 0.6, 1.8  # lines of unstable and of stable orbits
AT_BORDER: Final = 1e-9  # by which a modulus may exceed 1 where a stable part of a branch ends
# By the codes of `bifurcation`: the marker of a point, the dashes of a curve, and the name
KINDS: Final = (
    ("s", "-", "saddle-node"),
    ("o", "--", "period doubling"),
    ("^", "-.", "grazing"),
    ("v", ":", "rest"),
    ("o", "--", "period doubling"),
    ("D", "-", "corner"),
    ("P", ":", "yielding"),
    ("<", "-.", "grazing at a landing"),
)


@style.styled
def orbit_branches(branches: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the speeds of periodic orbits along a parameter, and where they bifurcate.

    Lines are thick where the orbit is stable, and coloured by the numbers of impacts and forcing
    periods.

    Parameters
    ----------
    branches
        Result of `vibrosweep.branches`.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import orbit_branches
    >>> found = vs.branches(restitution=0.5, amplitude=[1.0, 5.0], doublings=3)
    >>> orbit_branches(found).get_xlabel()
    'amplitude of the kick $A$ (m s$^{-1}$)'
    """
    NEEDS.check("orbit_branches", branches)
    along = str(branches.attrs["along"])
    axes = style.axes_on(ax, style.PAGE, 3.6)
    kinds = _by_kind(branches, "branch")
    for colour, (kind, rows) in zip(style.colours(len(kinds)), kinds.items(), strict=True):
        for i in rows:
            one = branches.isel(branch=i)
            at, speed = one[along].values, one["rebound_velocity"].values[:, : kind[0]]
            modulus = np.hypot(one["multiplier_real"].values, one["multiplier_imaginary"].values)
            stable = modulus[:, :1] <= 1.0 + AT_BORDER
            axes.plot(at, speed, color=colour, linewidth=THIN)
            axes.plot(at, np.where(stable, speed, np.nan), color=colour, linewidth=THICK)
        axes.plot([], [], color=colour, label=cycle_name(*kind))
    for width, name in ((THICK, "stable"), (THIN, "unstable")) if kinds else ():
        axes.plot([], [], color=style.GREY, linewidth=width, label=name)
    _mark_events(axes, branches, along)
    data.name_axes(axes, branches, along, "rebound_velocity")
    style.beside(axes, data.conditions(branches.drop_dims("point")))
    return axes


def _mark_events(axes: Axes, branches: xr.Dataset, along: str) -> None:
    """Mark each bifurcation, at the speeds of the nearest point of its branch."""
    seen = set()
    for i in range(branches.sizes["branch"]):
        one = branches.isel(branch=i)
        values, p = one[along].values, int(one["cycle_impacts"])
        phases = one["impact_phase"].values[:, 0]
        for code, at, phase in zip(
            one["bifurcation"].values,
            one[f"bifurcation_{along}"].values,
            one["bifurcation_phase"].values[:, 0],
            strict=True,
        ):
            if code < 0:
                continue
            marker, _, name = KINDS[code]
            off = np.abs(values - at) + np.abs((phases - phase + 0.5) % 1.0 - 0.5)
            speed = one["rebound_velocity"].values[np.nanargmin(off), :p]
            axes.plot(
                np.full(p, at),
                speed,
                marker,
                markersize=4.0,
                markerfacecolor="white",
                markeredgecolor="black",
                markeredgewidth=0.7,
                label="" if name in seen else name,
                zorder=4.0,
            )
            seen.add(name)


@style.styled
def orbit_boundaries(
    boundaries: xr.Dataset,
    *,
    sweep: xr.Dataset | None = None,
    variable: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the curves on which periodic orbits are born, double their period, graze or rest.

    Curves are thin where no particle can follow the orbit, since it would land earlier or rest.

    Parameters
    ----------
    boundaries
        Result of `vibrosweep.boundaries`.
    sweep
        Result of a sweep over restitution and amplitude, or acceleration, in the same scene with
        the same frequency, gravity and contact time; the curves are drawn over its plane.
    variable
        Variable of that sweep, as `vibrosweep.figures.parameter_plane` takes it.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, or contradicts the sweep.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import orbit_boundaries
    >>> found = vs.boundaries(restitution=[0.5, 0.9], amplitude=[0.1, 5.0])
    >>> orbit_boundaries(found).get_xlabel()
    'restitution $e$'
    """
    NEEDS.check("orbit_boundaries", boundaries)
    forcing = str(boundaries.attrs["forcing"])
    if sweep is None:
        axes = style.axes_on(ax, style.PAGE, 3.6)
        data.name_axes(axes, boundaries, "restitution", forcing)
    else:
        data.require_same_scene("orbit_boundaries", boundaries, sweep, SHARED)
        forcing = data.drawn_forcing(sweep) or forcing
        data.Needs((forcing,)).check("orbit_boundaries", boundaries)
        axes = parameter_plane(sweep, variable, ax=ax)
    view = axes.axis()
    kinds, seen = _by_kind(boundaries, "curve"), set()
    colours = style.colours(len(kinds))
    if sweep is not None:  # white is seen on every colour of a plane
        colours = ["white", *colours[:-1]]
    for colour, (kind, rows) in zip(colours, kinds.items(), strict=True):
        for i in rows:
            one = boundaries.isel(curve=i)
            code = int(one["bifurcation"])
            name = f"{cycle_name(*kind)}, {KINDS[code][2]}"
            # at a graze or rest, rounding decides whether the orbit is admissible
            admissible = (one["admissible"].values == 1) | (code in TIES)
            for chosen, width in ((np.ones_like(admissible), 0.5), (admissible, 1.3)):
                edge = [withStroke(linewidth=width + 1.0, foreground="black")]
                axes.plot(
                    one["restitution"].values,
                    np.where(chosen, one[forcing].values, np.nan),
                    color=colour,
                    linestyle=KINDS[code][1],
                    linewidth=width,
                    label=name if width > 1.0 and name not in seen else "",
                    zorder=3.0,
                    path_effects=edge if colour == "white" else None,
                )
            seen.add(name)
    if sweep is None:
        style.beside(axes, data.conditions(boundaries.drop_dims("point")))
    else:
        axes.axis(view)
        style.head(axes, style.remark_of(axes), columns=1)
    return axes


def _by_kind(lines: xr.Dataset, dim: str) -> dict[tuple[int, int], list[int]]:
    """Indices of lines by their impacts and periods."""
    found: dict[tuple[int, int], list[int]] = {}
    for i in range(lines.sizes[dim]):
        kind = int(lines["cycle_impacts"][i]), int(lines["cycle_periods"][i])
        found.setdefault(kind, []).append(i)
    return dict(sorted(found.items()))
