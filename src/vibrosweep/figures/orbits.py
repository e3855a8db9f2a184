"""Attractors and periodic orbits: orbits, branches, boundaries, basins, bifurcations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.typing import ColorType

from vibrosweep.analysis.basins import UNSETTLED, name_of
from vibrosweep.analysis.orbits import cycle_name
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.figures import data, style
from vibrosweep.figures.paint import between, paint_grid
from vibrosweep.figures.style import Panels
from vibrosweep.figures.sweeps import parameter_plane
from vibrosweep.model.measures import Regime
from vibrosweep.model.parameters import OF_RESTITUTION
from vibrosweep.store.arranged import require_dataset

if TYPE_CHECKING:
    import xarray as xr

ORBIT_NEEDS: Final = data.Requirements(
    ("cycle_impacts", "cycle_periods", "stable", "admissible", "impact_phase", "rebound_velocity")
)
# Parameters that set the orbits and the basins alike
SHARED_BY_ORBITS: Final = (
    "restitution",
    "amplitude",
    "frequency",
    "gravity",
    "contact_time",
    *OF_RESTITUTION,
)
ORBIT_DIMS: Final = frozenset(("orbit", "impact", "impacts", "periods", "multiplier"))
LINE_NEEDS: Final = data.Requirements(
    ("bifurcation", "cycle_impacts", "cycle_periods", "admissible")
)
# Parameters apart from the plane of restitution and forcing that set the boundaries
SHARED_BY_BOUNDARIES: Final = ("frequency", "gravity", "contact_time", *OF_RESTITUTION)
TIES: Final = (2, 3, 7)  # grazes and rest among the codes of `bifurcation`
THIN, THICK = 0.6, 1.8  # lines of unstable and of stable orbits
MOST_CYCLES: Final = 6, 4  # numbers of impacts and periods that are named, also in narrow axes
AT_BORDER: Final = 1e-9  # by which a modulus may exceed 1 where a stable part of a branch ends
# By the codes of `bifurcation`: the marker of a point, the dashes of a curve, and the name
KINDS: Final = (
    ("s", "-", "saddle-node"),
    ("o", "--", "period doubling"),
    ("^", "-.", "grazing"),
    ("v", ":", "rest"),
    ("o", "--", "period doubling"),
    ("D", "-", "corner"),
    ("P", ":", "kink"),
    ("<", "-.", "grazing at a landing"),
)
BASIN_NEEDS: Final = data.Requirements(
    ("basin", "fraction", "regime", "cycle_impacts", "cycle_periods")
)
OTHERS: Final = "0.75"
MOST_ATTRACTORS: Final = 8, 5  # that the legend names, also in narrow axes
DIAGRAM_NEEDS: Final = data.Requirements(("direction", "lyapunov_largest", "regime"))
# From the bottom to the top, with smaller and smaller dots, so that all stay visible
ORDER: Final = (
    ("launched", style.OKABE_ITO[2], 2.6),
    ("down", style.OKABE_ITO[1], 1.4),
    ("up", style.OKABE_ITO[0], 0.5),
)
NOT_REPEATED: Final = (Regime.APERIODIC, Regime.UNSETTLED)
ROWS: Final = 300  # of the pixels in which impacts of such orbits are counted
DARKEST: Final = 0.75
# Observables of a diagram over which orbits can be drawn, which hold them too
DRAWN_OVER: Final = ("rebound_velocity", "impact_phase")


@style.styled
def periodic_orbits(
    orbits: xr.Dataset, *, basins: xr.Dataset | None = None, ax: Axes | None = None
) -> Axes:
    """Draw periodic orbits: filled where they are stable, hollow where they are not.

    For one realization the figure shows their impacts by phase and speed at lift-off; along one
    axis of a grid their speeds; over two axes the number of stable orbits.  Orbits that no
    particle can follow are left out.

    Parameters
    ----------
    orbits
        Result of `vibrosweep.orbits`.
    basins
        Result of `vibrosweep.basins` in the same scene with the same parameters, apart from the
        phase of the base; the impacts are drawn over it, each at the time of launch that has its
        phase.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, has other dims, or several points while basins are given, or
        contradicts the basins.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import periodic_orbits
    >>> found = vs.orbits(amplitude=1.2, impacts=2, periods=2)
    >>> periodic_orbits(found).get_xlabel()
    'phase of the impact, turns'
    """
    ORBIT_NEEDS.check("periodic_orbits", orbits)
    varied = [str(dim) for dim in orbits["stable"].dims if dim not in ORBIT_DIMS]
    if "realization" in varied or len(varied) > 2 or (varied and basins is not None):
        raise DataError(
            f"figure periodic_orbits draws one realization, or a grid of one or two axes; over "
            f"basins only one realization: choose with .isel() along {', '.join(varied)}"
        )
    if basins is not None:
        data.require_same_scene("periodic_orbits", orbits, basins, SHARED_BY_ORBITS)
        axes = basins_of_attraction(basins, ax=ax)
        _draw_over(axes, orbits, _launch_times(orbits, basins))
        style.beside(axes, data.conditions(basins))
        return axes
    axes = style.axes_on(ax, style.PAGE, 3.6)
    if len(varied) == 2:
        _draw_numbers(axes, orbits, varied)
        style.head(axes, data.conditions(orbits))
    else:
        (along,) = varied or ("impact_phase",)
        _draw_points(axes, orbits, np.broadcast_to(*_aligned(orbits, along)))
        data.name_axes(axes, orbits, along, "rebound_velocity")
        style.beside(axes, data.conditions(orbits))
    return axes


def _aligned(orbits: xr.Dataset, along: str) -> tuple[Array, tuple[int, ...]]:
    values, shape = orbits[along].values, orbits["rebound_velocity"].shape
    return values.reshape(values.shape + (1,) * (len(shape) - values.ndim)), shape


def _launch_times(orbits: xr.Dataset, basins: xr.Dataset) -> Array:
    """Times at which the base has the phases of the impacts, in the period from the first cell."""
    first, frequency = between(np.sort(basins["launch_time"].values))[0], float(basins["frequency"])
    turns = orbits["impact_phase"].values - float(basins["phase"]) / (2.0 * np.pi)
    return np.asarray(first + np.mod(turns - frequency * first, 1.0) / frequency)


def _draw_over(axes: Axes, orbits: xr.Dataset, across: Array) -> None:
    """Draw all impacts of the admissible orbits, in black and white."""
    admissible = orbits["admissible"].values == 1
    stable, speed = orbits["stable"].values == 1, orbits["rebound_velocity"].values
    low, high = axes.get_ylim()
    for chosen, marker, size, face, edge, name in (
        (admissible & ~stable, "o", 3.0, "white", "black", "unstable orbit"),
        (admissible & stable, "D", 5.0, "black", "white", "stable orbit"),
    ):
        axes.plot(
            across[chosen].ravel(),
            speed[chosen].ravel(),
            marker,
            markersize=size,
            markerfacecolor=face,
            markeredgecolor=edge,
            markeredgewidth=0.7,
            zorder=3.0,
            label=name if chosen.any() else None,
        )
    axes.set_ylim(low, high)


def _draw_points(axes: Axes, orbits: xr.Dataset, across: Array) -> None:
    """Draw all impacts of the admissible orbits, in one colour for each (p, q)."""
    admissible = orbits["admissible"].values == 1
    stable, speed = orbits["stable"].values == 1, orbits["rebound_velocity"].values
    p, q = orbits["cycle_impacts"].values, orbits["cycle_periods"].values
    kinds = sorted({(int(a), int(b)) for a, b in zip(p[admissible], q[admissible], strict=True)})
    colours = style.colours(len(kinds))
    many = int(admissible.sum()) > style.MANY // 10
    size = 1.2 if many else 4.5
    for kind, colour in zip(kinds, colours, strict=True):
        of_kind = admissible & (p == kind[0]) & (q == kind[1])
        for chosen, filled in ((of_kind & ~stable, False), (of_kind & stable, True)):
            axes.plot(
                across[chosen].ravel(),
                speed[chosen].ravel(),
                "o",
                markersize=size,
                markeredgewidth=0.3 if many else 0.8,
                markeredgecolor=colour,
                markerfacecolor=colour if filled else "white",
                rasterized=many,
                zorder=3.0 + filled,
            )
        axes.plot([], [], "o", color=colour, markersize=4.5, label=cycle_name(*kind))
    for name, face in (("stable", "0.3"), ("unstable", "white")):
        axes.plot([], [], "o", markeredgecolor="0.3", markerfacecolor=face, label=name)


def _draw_numbers(axes: Axes, orbits: xr.Dataset, plane: list[str]) -> None:
    """Draw the number of stable admissible orbits at each point of a plane."""
    across, up = plane
    attracting = (orbits["stable"] == 1) & (orbits["admissible"] == 1)
    number = attracting.sum("orbit")
    most = max(1, int(number.max()))
    scale = {"vmin": -0.5, "vmax": most + 0.5}
    drawn = paint_grid(axes, number, across, up, cmap=style.SEQUENTIAL_MAP, **scale)
    data.name_axes(axes, orbits, across, up)
    style.bar(axes, drawn, "stable orbits")


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
    LINE_NEEDS.check("orbit_branches", branches)
    along = str(branches.attrs["along"])
    axes = style.axes_on(ax, style.PAGE, 3.6)
    kinds = _by_kind(axes, branches, "branch")
    for colour, (kind, rows) in zip(style.colours(len(kinds)), kinds.items(), strict=True):
        for i in rows:
            one = branches.isel(branch=i)
            speed = one["rebound_velocity"].values[:, : int(one["cycle_impacts"])]
            at = one[along].values
            modulus = np.hypot(one["multiplier_real"].values, one["multiplier_imaginary"].values)
            stable = modulus[:, :1] <= 1.0 + AT_BORDER
            axes.plot(at, speed, color=colour, linewidth=THIN)
            axes.plot(at, np.where(stable, speed, np.nan), color=colour, linewidth=THICK)
        axes.plot([], [], color=colour, label=kind)
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
    LINE_NEEDS.check("orbit_boundaries", boundaries)
    forcing = str(boundaries.attrs["forcing"])
    if sweep is None:
        axes = style.axes_on(ax, style.PAGE, 3.6)
        data.name_axes(axes, boundaries, "restitution", forcing)
    else:
        data.Requirements(("frequency", "gravity")).check("orbit_boundaries", sweep)
        data.require_same_scene("orbit_boundaries", boundaries, sweep, SHARED_BY_BOUNDARIES)
        forcing = data.drawn_forcing(sweep) or forcing
        data.Requirements((forcing,)).check("orbit_boundaries", boundaries)
        axes = parameter_plane(sweep, variable, ax=ax)
    view = axes.axis()
    kinds, seen = _by_kind(axes, boundaries, "curve"), set()
    colours = style.colours(len(kinds))
    if sweep is not None:  # white is seen on every colour of a plane
        colours = ["white", *colours[:-1]]
    for colour, (kind, rows) in zip(colours, kinds.items(), strict=True):
        effects = None
        if colour == "white":
            effects = [withStroke(linewidth=2.3, foreground="black")]
        for i in rows:
            one = boundaries.isel(curve=i)
            code = int(one["bifurcation"])
            # at a graze or rest, rounding decides whether the orbit is admissible
            admissible = (one["admissible"].values == 1) | (code in TIES)
            beside = np.convolve(~admissible, np.ones(3), "same") > 0.0  # joins both parts
            for chosen, width in ((beside, 0.5), (admissible, 1.3)):
                axes.plot(
                    one["restitution"].values,
                    np.where(chosen, one[forcing].values, np.nan),
                    color=colour,
                    linestyle=KINDS[code][1],
                    linewidth=width,
                    zorder=3.0,
                    path_effects=effects,
                )
            seen.add(KINDS[code][1:])
        axes.plot([], [], color=colour, path_effects=effects, label=kind)
    for dashes, name in sorted(seen):
        axes.plot([], [], color=style.GREY, linestyle=dashes, label=name)
    if sweep is None:
        style.beside(axes, data.conditions(boundaries.drop_dims("point")))
    else:
        axes.axis(view)
        style.head(axes, style.remark_of(axes))
    return axes


def _by_kind(axes: Axes, lines: xr.Dataset, dim: str) -> dict[str, list[int]]:
    """Indices of lines by the names of their cycles; the longest ones share one name."""
    found: dict[tuple[int, int], list[int]] = {}
    for i in range(lines.sizes[dim]):
        kind = int(lines["cycle_impacts"][i]), int(lines["cycle_periods"][i])
        found.setdefault(kind, []).append(i)
    kinds = sorted(found)
    most = MOST_CYCLES[style.is_narrow(axes)]
    kept = len(kinds) if len(kinds) <= most else most - 1
    named = {cycle_name(*kind): found[kind] for kind in kinds[:kept]}
    if others := [i for kind in kinds[kept:] for i in found[kind]]:
        named[f"{len(kinds) - kept} longer cycles"] = others
    return named


@style.styled
def basins_of_attraction(basins: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the attractor that each launch leads to, with the fraction of launches in each basin.

    Parameters
    ----------
    basins
        Result of `vibrosweep.basins`.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, or holds basins along a parameter.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import basins_of_attraction
    >>> found = vs.basins(launch_velocity=[3.0, 4.0, 5.0], particles=20, duration=2000.0)
    >>> basins_of_attraction(found).get_xlabel()
    'time of launch (s)'
    """
    BASIN_NEEDS.check("basins_of_attraction", basins)
    if "along" in basins.attrs:
        along = basins.attrs["along"]
        raise DataError(
            f"figure basins_of_attraction draws basins at one value of {along}: compute them with "
            f"a single value, or draw basin_shares"
        )
    axes = style.axes_on(ax, style.PAGE, 3.6)
    names, shares, colours = _named(axes, basins)
    reached = basins["basin"].values
    unsettled = float((reached == UNSETTLED).mean())
    drawn = basins["basin"].clip(max=len(names) - 1)
    cmap = ListedColormap(["white", *colours])
    scale = {"vmin": UNSETTLED - 0.5, "vmax": len(names) - 0.5}
    paint_grid(axes, drawn, "launch_time", "launch_velocity", cmap=cmap, **scale)
    for name, share, colour in zip(names, shares, colours, strict=True):
        label = f"{name}, {100.0 * float(share):.3g} %"
        axes.plot([], [], "s", color=colour, label=label, markersize=5.0)
    if unsettled > 0.0:
        label = f"unsettled, {100.0 * unsettled:.3g} %"
        axes.plot([], [], "s", color="white", markeredgecolor="0.5", label=label, markersize=5.0)
    data.name_axes(axes, basins, "launch_time", "launch_velocity")
    style.beside(axes, data.conditions(basins))
    return axes


@style.styled
def basin_shares(basins: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the share of the launches that leads to each attractor, along a parameter.

    Shares are stacked; the white remainder up to 1 is the share of unsettled launches.

    Parameters
    ----------
    basins
        Result of `vibrosweep.basins` along a parameter.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, or holds basins at one value only.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import basin_shares
    >>> found = vs.basins(amplitude=[0.6, 1.2], launch_velocity=[3.0, 5.0], duration=2000.0)
    >>> basin_shares(found).get_xlabel()
    'amplitude of the kick $A$ (m s$^{-1}$)'
    """
    BASIN_NEEDS.check("basin_shares", basins)
    if "along" not in basins.attrs:
        raise DataError(
            "figure basin_shares draws basins along a parameter: compute them with a list of "
            "amplitudes or restitutions besides launch_velocity"
        )
    along = str(basins.attrs["along"])
    axes = style.axes_on(ax, style.PAGE, 3.6)
    basins = basins.sortby(along)
    names, shares, colours = _named(axes, basins)
    values = basins[along].values
    if values.size == 1:
        values, shares = between(values), np.repeat(shares, 2, axis=1)
    axes.stackplot(values, shares, colors=colours, labels=names, linewidth=0.0)
    if (basins["basin"].values == UNSETTLED).any():
        axes.plot([], [], "s", color="white", markeredgecolor="0.5", label="unsettled")
    axes.set(xlim=(values[0], values[-1]), ylim=(0.0, 1.0), ylabel="share of the launches")
    axes.set_xlabel(data.label(basins, along))
    style.beside(axes, data.conditions(basins))
    return axes


def _named(axes: Axes, basins: xr.Dataset) -> tuple[list[str], Array, list[ColorType]]:
    """Names of attractors, their fractions, shape (name, ...), and colours.

    The rarest share one name.
    """
    fraction = basins["fraction"].transpose("attractor", ...).values
    names = [name_of(basins.isel(attractor=i)) for i in range(fraction.shape[0])]
    most = MOST_ATTRACTORS[style.is_narrow(axes)]
    if len(names) < most:
        return names, fraction, list(style.OKABE_ITO[: len(names)])
    kept = most - 1
    if len(names) > most:
        fraction = np.concatenate([fraction[:kept], fraction[kept:].sum(axis=0, keepdims=True)])
        names[kept:] = [f"{len(names) - kept} others"]
    return names, fraction, [*style.OKABE_ITO[:kept], OTHERS]


@style.styled
def bifurcation_diagram(
    diagram: xr.Dataset,
    *,
    orbits: xr.Dataset | None = None,
    ax: Sequence[Axes] | Panels | None = None,
) -> Panels:
    """Draw the impacts of all particles along the forcing, up and down, above their exponents.

    The axis is the forcing as given.  Impacts of orbits in which no repetition was found are
    counted in grey pixels, the darker the more of them at a value of the forcing; others are dots.
    New launches at each point are drawn under orbits that are continued up and down, black marks
    at the top show where attractors coexist, and a dotted line where the first exponent above zero
    lies, if the diagram holds them.  An orbit with rests has the exponent minus infinity, drawn at
    the lower edge.  The head of the figure states the share of unsettled orbits, whose impacts
    need not belong to an attractor.

    Parameters
    ----------
    diagram
        Result of `vibrosweep.bifurcation`.
    orbits
        Result of `vibrosweep.branches` or `vibrosweep.orbits` along the same forcing in the same
        scene, whose stable orbits are drawn over the impacts.
    ax
        Two axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    numpy.ndarray of matplotlib.axes.Axes
        The axes of the impacts and of the exponents.

    Raises
    ------
    DataError
        The dataset lacks a variable, or contradicts the orbits, or these lack the observable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import bifurcation_diagram
    >>> found = vs.bifurcation(amplitude=[0.6, 0.7, 0.8], samples=4, duration_periods=2000)
    >>> len(bifurcation_diagram(found))
    2
    """
    DIAGRAM_NEEDS.check("bifurcation_diagram", diagram)
    layout = {"sharex": True, "height_ratios": (3.0, 1.0)}
    upper, lower = panels = style.panels_on(ax, style.PAGE, 5.0, [[0], [1]], **layout)
    name, along = str(diagram.attrs["observable"]), str(diagram.attrs["forcing"])
    at, words = diagram[along].values, along.removeprefix("base_")
    irregular: list[Array] = []
    for way, colour, size in ORDER:
        values, regimes = _of(diagram, name, way), _of(diagram, "regime", way)
        if values is None or regimes is None:
            continue
        never = np.isin(regimes, NOT_REPEATED)[..., np.newaxis]
        irregular.append(np.where(never, values, np.nan).reshape(at.size, -1))
        values = np.where(never, np.nan, values)
        x, y = np.broadcast_arrays(at[:, np.newaxis], values.reshape(at.size, -1))
        look = {"color": colour, "linewidths": 0.0, "rasterized": True}
        upper.scatter(x, y, s=size, **look)
        label = "new launches" if way == "launched" else f"{words} {way}"
        upper.plot([], [], ".", color=colour, markersize=6.0, label=label)
    _draw_density(upper, at, np.concatenate(irregular, axis=1))
    if orbits is not None:
        _draw_stable(upper, orbits, diagram, name, along)
    _mark_coexistence(upper, diagram, at)
    _exponents(lower, diagram, at)
    lower.set_xlim(upper.get_xlim())  # axes of a user need not share them
    upper.set_ylabel(data.label(diagram, name))
    lower.set_xlabel(data.label(diagram, along))
    if upper.get_position().x0 != lower.get_position().x0:  # a user has put them side by side
        upper.set_xlabel(data.label(diagram, along))
    narrow = style.is_narrow(lower)
    lower.set_ylabel("exponent" if narrow else "largest Lyapunov exponent per impact")
    drawn = {along, "amplitude", "base_acceleration"}
    head = data.conditions(diagram.drop_vars(drawn, errors="ignore"))
    unsettled = np.mean(diagram["regime"].values == Regime.UNSETTLED)
    style.head(upper, f"{head}, {unsettled:.2g} of the orbits unsettled" if unsettled else head)
    return panels


def _of(diagram: xr.Dataset, name: str, way: str) -> Array | None:
    """Values of orbits continued up or down, or of new launches, at each point."""
    if way != "launched":
        return np.asarray(diagram[name].sel(direction=way).values)
    anew = diagram.get(f"launched_{name}")
    return None if anew is None or not anew.size else np.asarray(_of_launches(anew).values)


def _of_launches(variable: xr.DataArray) -> xr.DataArray:
    """Return a variable that has no direction, also where a mask of the dataset gave it one."""
    return variable.max("direction") if "direction" in variable.dims else variable


def _draw_density(axes: Axes, at: Array, values: Array) -> None:
    """Count impacts in pixels, one column for each point, darkest where most of its impacts are."""
    at, values = np.sort(at), values[np.argsort(at)]
    known = values[np.isfinite(values)]
    if not known.size:
        return
    edges = np.linspace(known.min(), known.max(), ROWS + 1)
    counts = np.array([np.histogram(one[np.isfinite(one)], edges)[0] for one in values])
    most = np.maximum(counts.max(axis=1, keepdims=True), 1)
    axes.pcolormesh(
        between(at),
        edges,
        np.ma.masked_equal(np.sqrt(counts / most), 0.0).T,
        cmap="Greys",
        vmin=-0.3,  # a single impact is seen, too
        vmax=1.0 / DARKEST,
        rasterized=True,
        zorder=0.8,
    )
    axes.plot([], [], "s", color="0.45", markersize=5.0, label="no repetition found")


def _draw_stable(
    axes: Axes, orbits: xr.Dataset, diagram: xr.Dataset, name: str, along: str
) -> None:
    """Draw the stable orbits that particles can follow, in black."""
    require_dataset(orbits)
    figure, of_branches = "bifurcation_diagram", "branch" in orbits.dims
    (LINE_NEEDS if of_branches else ORBIT_NEEDS).check(figure, orbits)
    dims = [str(dim) for dim in orbits["admissible"].dims if dim not in ORBIT_DIMS]
    found = str(orbits.attrs.get("along", "")) if of_branches else ", ".join(dims)
    if found != along:
        raise DataError(
            f"figure {figure} draws orbits along {along}, but these are along {found or 'nothing'}"
        )
    if name not in DRAWN_OVER:
        raise DataError(
            f"figure {figure} draws orbits over {' or '.join(DRAWN_OVER)}, but this diagram shows "
            f"{name}: leave the orbits out, or compute it again with observable="
        )
    data.require_same_scene(figure, orbits, diagram, ("restitution", *SHARED_BY_BOUNDARIES))
    stable = (orbits["stable"] == 1) & (orbits["admissible"] == 1)
    x, y = orbits[along], orbits[name].where(stable)
    if of_branches:
        for branch in orbits["branch"]:
            one = {"branch": int(branch)}
            axes.plot(x.isel(one), y.isel(one), color="black", linewidth=1.0, zorder=3.0)
    else:
        impacts = y.transpose(along, ...).values.reshape(x.size, -1)
        axes.plot(x, impacts, ".", color="black", markersize=2.0, zorder=3.0)
    axes.plot([], [], color="black", linewidth=1.0, label="stable orbits")


def _mark_coexistence(axes: Axes, diagram: xr.Dataset, at: Array) -> None:
    """Mark points with several attractors at the top, and the first exponent above zero."""
    if "attractors" not in diagram:
        return
    several = at[_of_launches(diagram["attractors"]).values > 1]
    if several.size:
        axes.plot(
            several,
            np.ones_like(several),
            "|",
            transform=axes.get_xaxis_transform(),
            color="black",
            markersize=5.0,
            markeredgewidth=0.6,
            label="attractors coexist",
        )
    first = float(_of_launches(diagram["chaos_high"]).max())
    if np.isfinite(first):
        name = "first exponent above 0"
        axes.axvline(first, color="black", linestyle=":", linewidth=0.9, label=name)


def _exponents(axes: Axes, diagram: xr.Dataset, at: Array) -> None:
    found = ((_of(diagram, "lyapunov_largest", way), colour, size) for way, colour, size in ORDER)
    shown = [(values, colour, size) for values, colour, size in found if values is not None]
    every = np.concatenate([values.ravel() for values, _, _ in shown])
    known, resting = every[np.isfinite(every)], bool(np.any(every == -np.inf))
    low, high = (float(known.min()), float(known.max())) if known.size else (-1.0, 0.0)
    floor = low - (0.25 * max(high - low, 0.1) if resting else 0.0)
    for exponents, colour, size in shown:
        values = np.where(exponents == -np.inf, floor, exponents)
        for particle in range(values.shape[1]):
            axes.plot(at, values[:, particle], ".", color=colour, markersize=size + 0.8)
    axes.axhline(0.0, color=style.GREY, linewidth=0.7, zorder=0.5)
    axes.set_ylim(floor - 0.06 * (high - floor), max(high, 0.0) + 0.08 * (high - floor))
    if resting:
        bins, apart = (1, 0.4) if style.is_narrow(axes) else (3, 0.2)
        each = np.asarray(MaxNLocator(bins).tick_values(low, max(high, 0.0)))
        ticks = each[(each > floor + apart * (high - floor)) & (each <= max(high, 0.0))]
        names = (f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks)
        axes.set_yticks([floor, *ticks], [r"$-\infty$", *names])
