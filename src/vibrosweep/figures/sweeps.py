"""Figures of a sweep: planes, heights, distributions of separations, shares, Sobol' indices."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import LogNorm
from matplotlib.ticker import NullLocator
from numpy.typing import ArrayLike

from vibrosweep import theory
from vibrosweep.analysis.datasets import completed, require
from vibrosweep.analysis.records import base_name, has_closed_forms, moves, recoils
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.figures import data, paint, style
from vibrosweep.figures.paint import Places
from vibrosweep.figures.style import Panels
from vibrosweep.figures.windows import Forcing, draw_windows
from vibrosweep.model.forcing import ACCELERATION
from vibrosweep.model.measures import VARIABLES
from vibrosweep.store.arranged import flat, require_datasets

if TYPE_CHECKING:
    import xarray as xr

CHOICES: Final = ("dt_min", "rebound_height_max")
AXES: Final = ("restitution", "amplitude", "frequency", "gravity")
PLANE_NEEDS: Final = data.Requirements(AXES, one_of=CHOICES, varied=("restitution", "kick"))
RESTITUTION_NEEDS: Final = data.Requirements(
    (
        "restitution",
        "amplitude",
        "frequency",
        "gravity",
        "launch_velocity",
        "rebound_height_max",
        "flight_height_max",
    ),
    varied=("restitution",),
)
CELLS: Final = 160
LARGEST_DOT: Final = 14.0
# Of two plateaus closer than this fraction of the axis only one is drawn
LABEL_GAP: Final = 0.06
# Left edges, beside which smaller values are bars: the least of separations (s), and that of ratios
# to chance
EDGE: Final = 1e-9
EDGE_OF_CHANCE: Final = 1e-3
BESIDE_THE_AXIS: Final = 0.1  # width of the bars of smaller values, relative to the axis
MEANINGLESS: Final = "a realization in which no particle rests or is locked, as chance assumes"
SEPARATION_NEEDS: Final = data.Requirements(
    ("dt_min", "collision_free", "contact_time", "duration"), known=("dt_min",)
)


@style.styled
def parameter_plane(
    sweep: xr.Dataset, variable: str | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw a measured variable over restitution and amplitude.

    The closed forms of locked orbits are drawn over it: the orbit of mode k exists above the solid
    curve and is stable up to the dashed one.  The vertical axis is the acceleration of the base in
    g if the forcing was given in that form; otherwise the amplitude, or, if frequency or gravity
    differ between realizations, the dimensionless kick 2 f A / g, in which the curves depend on
    neither.  A grid is drawn as cells, a random design as dots; very many realizations are drawn
    as small cells with their median (for codes: the commonest).  Realizations that did not complete
    have no value, unless the variable is ``status``; the heading of the figure states how many.

    Parameters
    ----------
    sweep
        Result of a sweep in which restitution and amplitude vary.
    variable
        Variable that sets the colour: a numeric one, or one of codes with the attributes
        ``flag_values`` and ``flag_meanings``.  By default ``dt_min`` if it was measured, otherwise
        ``rebound_height_max``.  Separations have a logarithmic scale, with a mark at the
        contact time, and a separate marker where they are 0; so have heights over more than a
        decade.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, or restitution or amplitude does not vary.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import parameter_plane
    >>> sweep = vs.sweep(restitution=(0.8, 0.98), amplitude=(0.2, 3.5), realizations=50)
    >>> parameter_plane(sweep, "flight_time_mean").get_xlabel()
    'restitution $e$'
    """
    sweep = flat(sweep)
    if variable is None:
        PLANE_NEEDS.check("parameter_plane", sweep)
        variable = next(name for name in CHOICES if name in sweep.variables)
    data.Requirements((*AXES, variable), varied=PLANE_NEEDS.varied).check("parameter_plane", sweep)
    values = data.measured(sweep, variable)
    axes = style.axes_on(ax, style.MEDIUM, 3.6)
    forcing, vertical, label = _vertical(sweep)
    points = paint.scatter_points(data.quantity(sweep, "restitution"), vertical)
    axes.set(xlabel=data.label(sweep, "restitution"), ylabel=label)
    _set_view(axes, points)
    if has_closed_forms(sweep):
        draw_windows(axes, forcing, over=points.cells is not None)
    _paint_variable(axes, points, values, sweep, variable)
    # a colour bar names its variable, but a legend does not
    coded = "flag_values" in sweep[variable].attrs
    named = data.label(sweep, variable).replace("\n", " ") if coded else ""
    lost = data.incomplete(sweep, "realizations")
    style.head(axes, data.joined(named, data.conditions(sweep), lost))
    return axes


def _vertical(sweep: xr.Dataset) -> tuple[Forcing, Array, str]:
    """Name, values and label of the vertical axis."""
    base = base_name(sweep)
    name = data.drawn_forcing(sweep)
    if name is None:
        return Forcing("a", base), data.kick(sweep), "kick $a = 2 f A / g$"
    values, label = data.quantity(sweep, name), data.label(sweep, name)
    if name == ACCELERATION:
        return Forcing(data.SYMBOLS[name], base, name=name), values, label
    frequency, gravity = (float(data.quantity(sweep, n)[0]) for n in ("frequency", "gravity"))
    return Forcing("A", base, frequency, gravity), values, label


def _set_view(axes: Axes, points: Places) -> None:
    """Fit the view to the design; the closed forms end there too."""
    if points.cells is not None:
        # half a cell around the outermost points, but no restitution or forcing that is not allowed
        axes.set_xlim(max(points.cells.x_edges[0], 0.0), min(points.cells.x_edges[-1], 1.0))
        axes.set_ylim(max(points.cells.y_edges[0], 0.0), points.cells.y_edges[-1])
        return
    for values, set_limits in ((points.x, axes.set_xlim), (points.y, axes.set_ylim)):
        margin = 0.02 * float(np.ptp(values))
        set_limits(float(values.min()) - margin, float(values.max()) + margin)


def _paint_variable(
    axes: Axes, points: Places, values: Array, sweep: xr.Dataset, variable: str
) -> None:
    attributes = sweep[variable].attrs
    if "flag_values" in attributes:
        codes = np.atleast_1d(attributes["flag_values"]).astype(np.float64)
        paint.paint_codes(axes, points, values, codes, str(attributes["flag_meanings"]).split())
        return
    apart = {-np.inf: data.MINUS_INFINITY, np.inf: r"$\infty$"}
    separation = variable.startswith("dt_min")
    if separation:
        apart = {0.0: "landing or resting together"}
    label = data.label(sweep, variable)
    signed = variable.startswith("lyapunov") or bool(np.any(values < 0.0))
    logarithmic = separation or ("height" in variable and _wide(values))
    bar = paint.paint_numbers(
        axes, points, values, label, apart, signed=signed, logarithmic=logarithmic
    )
    contact = data.fixed(sweep, "contact_time") if "contact_time" in sweep.variables else None
    if bar is None or not separation or contact is None:
        return
    low, high = bar.ax.get_ylim()
    if low < contact < high:
        for drawn, at in ((bar.ax, [contact]), (axes, [])):
            drawn.plot(
                [0.0] * len(at),
                at,
                ">",
                markersize=5.0,
                color=style.OKABE_ITO[1],
                clip_on=drawn is axes,
                label=f"$\\tau_c$ = {contact:.4g} s",
            )


def _wide(values: Array) -> bool:
    """Return whether numbers lie above zero, over more than a decade."""
    known = values[np.isfinite(values)]
    return known.size > 0 and known.max() > 10.0 * known.min() > 0.0


@style.styled
def height_against_restitution(sweep: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the maximum rebound height against restitution, with the closed-form plateaus.

    Filled dots are the maximum over rebounds.  Where the launch was higher than every rebound, an
    open circle shows the maximum that includes the launch.  The plateaus H_k = g k^2 / (8 f^2) are
    the heights of the locked orbits of mode k.  Over a moving base the apexes of stable locked
    orbits lie in the shaded band from H_k to H_k + (2 s_m / pi^2) H_1 (`vibrosweep.theory`); over a
    base of finite mass neither is drawn.  If frequency or gravity differ between realizations,
    heights have the unit H_1, and the plateaus lie at k^2.  More than 20,000 realizations are
    counted in cells, without circles.  Realizations that did not complete are left out, and the
    heading of the figure states how many.

    Parameters
    ----------
    sweep
        Result of a sweep in which the restitution varies.  If the amplitude varies too, it
        colours the dots.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, or the restitution does not vary.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import height_against_restitution
    >>> sweep = vs.sweep(restitution=(0.8, 0.98), realizations=50)
    >>> height_against_restitution(sweep).get_xlabel()
    'restitution $e$'
    """
    sweep = flat(sweep)
    RESTITUTION_NEEDS.check("height_against_restitution", sweep)
    unit, one_height = _height_unit(sweep)
    restitution = data.quantity(sweep, "restitution")
    rebound = data.measured(sweep, "rebound_height_max") / unit
    flight = data.measured(sweep, "flight_height_max") / unit
    axes = style.axes_on(ax, style.MEDIUM, 3.3)
    heights = np.concatenate([rebound, flight])
    top = 1.06 * float(np.max(heights, where=np.isfinite(heights), initial=0.0)) or one_height
    # over a moving base a particle may stay below the mean level of the base
    lowest = 1.06 * float(np.min(heights, where=np.isfinite(heights), initial=0.0))
    axes.set(xlim=_span(restitution), ylim=(lowest - 0.02 * top, top))
    if restitution.size > style.MANY:
        _draw_density(axes, restitution, rebound)
    else:
        _draw_dots(axes, sweep, restitution, rebound)
        _draw_launches(axes, restitution, rebound, flight)
    if not moves(sweep):
        _draw_launch_height(axes, sweep, unit)
    elif has_closed_forms(sweep):
        _draw_bands(axes, one_height, top)
    if not recoils(sweep):
        _draw_plateaus(axes, one_height, top)
    in_metres = r"rebound height $H_{\mathrm{max}}$ (m)"
    in_units = r"rebound height $H_{\mathrm{max}} / H_1$, $H_1 = g / 8 f^2$"
    axes.set_xlabel(data.label(sweep, "restitution"))
    axes.set_ylabel(in_metres if unit.ndim == 0 else in_units)
    style.head(axes, _remark(sweep, rebound))
    legend = axes.get_legend()
    for handle in legend.legend_handles if legend else ():
        if isinstance(handle, PathCollection):  # dots of many realizations are too small to see
            handle.set_sizes([LARGEST_DOT])
    return axes


def plateaus(one_height: float, top: float) -> tuple[Array, Array]:
    """Return modes k and heights of the distinguishable plateaus below ``top``."""
    modes = np.arange(1, min(int(np.sqrt(top / one_height)), 1000) + 1, dtype=np.float64)
    heights = one_height * modes**2
    kept: list[int] = []
    for i, height in enumerate(heights):
        if height <= top and (not kept or height - heights[kept[-1]] >= LABEL_GAP * top):
            kept.append(i)
    return modes[kept], heights[kept]


def _height_unit(sweep: xr.Dataset) -> tuple[Array, float]:
    """Return the unit of height of each realization, and the height of mode 1 in that unit."""
    frequency, gravity = (data.quantity(sweep, name) for name in ("frequency", "gravity"))
    heights = theory.locked_height(1, frequency, gravity)
    if data.varies(sweep, "frequency") or data.varies(sweep, "gravity"):
        return heights, 1.0
    return np.ones(()), float(heights[0])


def _span(values: Array) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    margin = 0.03 * (high - low)
    return low - margin, high + margin


def _draw_dots(axes: Axes, sweep: xr.Dataset, restitution: Array, height: Array) -> None:
    """Draw a dot per realization, coloured by the forcing if that varies."""
    name = data.drawn_forcing(sweep)
    known = np.isfinite(height)  # the legend takes the colour of the first dot
    forcing = (data.quantity(sweep, name) if name else data.kick(sweep))[known]
    coloured = np.ptp(forcing) > 0.0 if forcing.size else False
    dots = axes.scatter(
        restitution[known],
        height[known],
        s=float(np.clip(4000.0 / restitution.size, 1.5, LARGEST_DOT)),
        c=forcing if coloured else style.OKABE_ITO[0],
        cmap=style.SEQUENTIAL_MAP if coloured else None,
        linewidths=0,
        rasterized=restitution.size > 5000,
        label="rebounds",
        zorder=2.5,
    )
    if coloured:
        words = data.label(sweep, name) if name else "kick $2 f A / g$"
        figure = axes.get_figure(root=True)
        engine = figure.get_layout_engine() if figure else None
        # some layout engines themselves place the bar beyond the names of the plateaus
        moved = engine is not None and not engine.colorbar_gridspec
        style.bar(axes, dots, words, pad=0.02 if moved else 0.1)


def _draw_density(axes: Axes, restitution: Array, height: Array) -> None:
    known = np.isfinite(height)
    counts, x_edges, y_edges = np.histogram2d(
        restitution[known],
        height[known],
        bins=CELLS,
        range=(axes.get_xlim(), axes.get_ylim()),
    )
    mesh = axes.pcolormesh(
        x_edges,
        y_edges,
        np.ma.masked_equal(counts.T, 0.0),
        cmap=style.DENSITY_MAP,
        norm=LogNorm(1.0, max(counts.max(), 2.0)),
        rasterized=True,
    )
    style.bar(axes, mesh, "realizations per cell")


def _draw_launches(axes: Axes, restitution: Array, rebound: Array, flight: Array) -> None:
    """Draw the maximum that includes the launch, where it differs from that of the rebounds."""
    differs = np.isfinite(flight) & ~(flight <= rebound)
    if np.any(differs):
        axes.scatter(
            restitution[differs],
            flight[differs],
            s=10.0,
            facecolors="none",
            edgecolors=style.GREY,
            linewidths=0.5,
            label="including the launch",
            zorder=2.2,
        )


def _draw_launch_height(axes: Axes, sweep: xr.Dataset, unit: Array) -> None:
    velocity, gravity = data.quantity(sweep, "launch_velocity"), data.quantity(sweep, "gravity")
    heights = np.unique(data.merged(velocity**2 / (2.0 * gravity * unit)))
    if heights.size == 1:
        axes.axhline(
            float(heights[0]),
            color=style.OKABE_ITO[1],
            linestyle=style.DASHED,
            linewidth=1.0,
            label="launch $v_0^2 / 2g$",
            zorder=2.3,
        )


def _draw_plateaus(axes: Axes, one_height: float, top: float) -> None:
    """Draw the heights of locked orbits as lines, named on the right-hand side."""
    modes, heights = plateaus(one_height, top)
    for height in heights:
        axes.axhline(float(height), color="black", alpha=0.45, linewidth=0.6, zorder=1.5)
    if modes.size:
        style.name_levels(axes, heights, [f"$H_{{{int(k)}}}$" for k in modes])


def _draw_bands(axes: Axes, one_height: float, top: float) -> None:
    """Shade the range of the apexes of stable locked orbits over a moving base."""
    e = np.linspace(max(axes.get_xlim()[0], 0.0), min(axes.get_xlim()[1], 1.0), 101)
    highest = theory.amplitude_max(1, e, 1.0, 2.0, base="moving")
    above = theory.locked_apex(1, e, highest, 1.0, 2.0) / theory.locked_height(1, 1.0, 2.0) - 1.0
    for height in plateaus(one_height, top)[1]:
        upper = height + above * one_height  # all bands are as wide as that of mode 1
        axes.fill_between(e, height, upper, color="0.9", linewidth=0.0, zorder=0.8)


def _remark(sweep: xr.Dataset, height: Array) -> str:
    unknown = int(np.count_nonzero(completed(sweep) & ~np.isfinite(height)))
    absent = f"no rebound in {unknown} of {height.size} realizations" if unknown else ""
    return data.joined(data.conditions(sweep), absent, data.incomplete(sweep, "realizations"))


class _NeedsForChance(data.Requirements):
    """Requirements of the comparison with chance, which some realization must allow."""

    def lacking(self, dataset: xr.Dataset) -> str | None:
        from vibrosweep.analysis.separations import separations_against_chance

        if reason := super().lacking(dataset):
            return reason
        ratio = separations_against_chance(dataset)["dt_min_over_chance"].values
        return None if np.isfinite(ratio).any() else MEANINGLESS


CHANCE_NEEDS: Final = _NeedsForChance(
    (
        "dt_min",
        "particle_impact_count",
        "rest_count",
        "at_rest_count",
        "frequency",
        "duration",
        "transient",
    ),
    known=("dt_min",),
)


@style.styled
def separation_distributions(
    found: Sequence[xr.Dataset],
    names: Sequence[str],
    contact_time: ArrayLike,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draw empirical distributions of the smallest separation.

    Parameters
    ----------
    found
        Result of `vibrosweep.analysis.separation_distribution` for each curve.
    names
        Names of the curves.
    contact_time
        Contact time in s, marked by a line; several are marked by a band from the least to the
        greatest.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        A dataset is not a result of `separation_distribution`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import separation_distributions
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, particles=2, separation=True)
    >>> axes = separation_distributions([vs.separations(sweep)], ["two particles"], 1e-4)
    >>> axes.get_xscale()
    'log'
    """
    for one in found:
        needed = ("separation", "cumulative_fraction")
        require(one, "separation_distributions", *needed, source="separation_distribution")
    curves = [(one["separation"].values, one["cumulative_fraction"].values) for one in found]
    least, greatest = float(np.min(contact_time)), float(np.max(contact_time))
    known = np.concatenate([[least / 10.0, 1.0], *(values for values, _ in curves)])
    left = 10.0 ** np.floor(np.log10(np.min(known, initial=1.0, where=known >= EDGE)))
    axes = _distributions(ax, curves, names, (float(left), float(known.max())), "s", linewidth=1.2)
    if least < greatest:
        axes.axvspan(least, greatest, color="0.9", zorder=0.5)
    else:
        axes.axvline(least, color="black", linestyle=style.DASHED, linewidth=0.8)
    axes.annotate(
        r"$\tau_c$",
        (least, 0.03),
        xytext=(3, 0),
        textcoords="offset points",
        path_effects=style.halo(),
    )
    axes.set_xlabel(r"smallest separation $\Delta t_{\mathrm{min}}$ (s)")
    style.head(axes, "")
    return axes


def _distributions(
    ax: Axes | None,
    curves: Sequence[tuple[Array, Array]],
    labels: Sequence[str],
    ends: tuple[float, float],
    units: str,
    linewidth: float | None = None,
) -> Axes:
    """Draw the fractions at sorted values; those of values below the left end as bars beside it."""
    axes, (left, right) = style.axes_on(ax, style.MEDIUM, 2.9), ends
    drawn = zip(curves, labels, style.colours(len(labels)), strict=True)
    for (values, fraction), label, colour in drawn:
        axes.step(
            np.concatenate([[left], np.maximum(values, left), [right]]),
            np.concatenate([[0.0 if values.size else np.nan], fraction, [1.0]]),
            where="post",
            color=colour,
            linewidth=linewidth,
            label=label,
        )
    axes.set(xscale="log", xlim=ends, ylim=(0.0, 1.02))
    axes.set_ylabel("cumulative fraction")
    below = [
        float(np.max(fraction, initial=0.0, where=values < left)) for values, fraction in curves
    ]
    if any(below):
        _draw_below(axes, below, ends, units)
    return axes


def _draw_below(axes: Axes, below: Sequence[float], ends: tuple[float, float], units: str) -> None:
    """Draw bars of the fractions of values below the left end of an axis, which say so."""
    left, right = ends
    begin = left * (left / right) ** BESIDE_THE_AXIS
    edges = np.geomspace(begin, left, len(below) + 1)
    colours = style.colours(len(below))
    axes.bar(edges[:-1], below, np.diff(edges), align="edge", color=colours, alpha=0.6)
    axes.text(
        float(np.sqrt(begin * left)),
        0.03,
        f"below $10^{{{np.log10(left):.0f}}}$ {units}".rstrip(),
        rotation=90.0,
        ha="center",
        va="bottom",
        fontsize=7.5,
        path_effects=style.halo(),
    )
    decades = np.arange(round(np.log10(left)), np.log10(right) + 1e-9, 1.0)
    axes.set_xticks(10.0 ** decades[:: max(1, decades.size // 5)], minor=False)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlim(begin, right)


@style.styled
def separations_over_chance(
    found: Sequence[xr.Dataset], names: Sequence[str], *, ax: Axes | None = None
) -> Axes:
    """Draw distributions of the smallest separation relative to its mean for chance landings.

    The black curve is the distribution for chance.  Realizations in which the ratio has no meaning
    are left out; the legend says how many remain.

    Parameters
    ----------
    found
        Result of `vibrosweep.analysis.order_against_chance` or `separations_against_chance` for
        each curve.
    names
        Names of the curves.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        A dataset is not a result of these analyses, or the ratio has no meaning in any realization.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import separations_against_chance
    >>> from vibrosweep.figures import separations_over_chance
    >>> sweep = vs.sweep(amplitude=(4.0, 9.0), rebound="reflect", realizations=50, particles=5,
    ...                  separation=True, per_particle=True)
    >>> axes = separations_over_chance([separations_against_chance(sweep)], ["five particles"])
    >>> axes.get_xscale()
    'log'
    """
    for one in found:
        name = "dt_min_over_chance"
        require(one, "separations_over_chance", name, source="separations_against_chance")
    ratios = [one["dt_min_over_chance"].values for one in found]
    known = [np.sort(ratio[np.isfinite(ratio)]) for ratio in ratios]
    largest = [float(z[-1]) for z in known if z.size]
    if not largest:
        raise DataError(f"figure separations_over_chance needs {MEANINGLESS}")
    ends = (EDGE_OF_CHANCE, max(10.0, *largest))
    curves = [(z, np.arange(1, z.size + 1) / max(z.size, 1)) for z in known]
    labels = [
        f"{name}: {z.size} of {ratio.size} realizations"
        for name, z, ratio in zip(names, known, ratios, strict=True)
    ]
    axes = _distributions(ax, curves, labels, ends, "")
    z = np.geomspace(*ends, 200)
    axes.plot(z, -np.expm1(-z), color="black", linewidth=1.2, label="chance: $1 - e^{-z}$")
    axes.set_xlabel(r"$z = \Lambda\,\Delta t_{\mathrm{min}}$")
    style.head(axes, "", columns=1)
    return axes


SHARE_PARTS: Final = ("share", "share_low", "share_high")


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
        require(one, "share_curves", *SHARE_PARTS, source="share_against")
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
        share, low, high = (one[part].values for part in SHARE_PARTS)
        axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0.0)
        axes.plot(x, share, color=colour, marker="o", markersize=2.0, label=label)
    shared = {str(one.attrs.get("of", "")).replace("_", " ") for one in found}
    axes.set(ylabel=": ".join(["share", *shared]) if len(shared) == 1 else "share")
    axes.set_ylim(-0.02, 1.02)
    ends = found[0][f"{name}_low"].assign_attrs(long_name=name.replace("_", " "))
    axes.set_xlabel(data.label(ends.to_dataset(name=name), name))
    style.head(axes, "")
    return axes


@style.styled
def sobol_bars(indices: xr.Dataset, *, ax: Axes | Sequence[Axes] | Panels | None = None) -> Panels:
    """Draw first-order and total indices of each output, with their intervals.

    Parameters
    ----------
    indices
        Result of `vibrosweep.sobol`.
    ax
        Axes to draw on, one for each output; by default those of a new figure of pyplot.

    Returns
    -------
    numpy.ndarray of matplotlib.axes.Axes
        The axes, shape (output,).

    Raises
    ------
    DataError
        The dataset is not a result of `vibrosweep.sobol`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import sobol_bars
    >>> found = vs.sobol(restitution=(0.8, 0.98), amplitude=(0.2, 3.5), realizations=64)
    >>> len(sobol_bars(found)) == found.sizes["output"]
    True
    """
    parts = ("first_order", "total_order")
    require(indices, "sobol_bars", "output", "parameter", *parts, source="sobol")
    outputs = [str(name) for name in indices["output"].values]
    names = [str(name) for name in indices["parameter"].values]
    at = np.arange(len(names), dtype=np.float64)
    height, row = 1.5 + 0.24 * len(names), list(range(len(outputs)))
    panels = style.panels_on(ax, style.PAGE, height, [row], sharex=True, sharey=True)
    for axes, output in zip(panels, outputs, strict=True):
        one = indices.sel(output=output)
        for name, shift, colour, label in (
            ("first_order", -0.2, style.OKABE_ITO[0], "alone"),
            ("total_order", 0.2, style.OKABE_ITO[5], "with interactions"),
        ):
            axes.barh(at + shift, one[name].values, height=0.36, color=colour, label=label)
            # an interval need not hold the index, and so cannot be drawn as its error
            low, high = one[f"{name}_low"].values, one[f"{name}_high"].values
            axes.hlines(at + shift, low, high, color="black", linewidth=0.7)
        words = VARIABLES[output].long_name if output in VARIABLES else output
        axes.set_title(textwrap.fill(words, style.letters(axes)))
        axes.axvline(0.0, color="black", linewidth=0.6)
        axes.set_xlabel("Sobol' index")
        axes.set_yticks(at, [f"{n.replace('_', ' ')}{data.symbol(n)}" for n in names])
        axes.set_ylim(at[-1] + 0.6, -0.6)  # the first parameter is on top
        if axes.get_position().x0 > panels[0].get_position().x0:  # it stands beside the first
            axes.tick_params(labelleft=False)
    style.head(panels[0], panels[0].get_title(loc="left"), columns=1)
    if style.has_room(panels[0]):  # there is more of it above the names of the parameters
        legend = panels[0].get_legend()
        legend.set_loc("lower right")
        legend.set_bbox_to_anchor((1.0, 1.0), panels[0].transAxes)
    return panels
