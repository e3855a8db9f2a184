"""Figures of a record of every landing: height against time, and the return map."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import offset_copy
from matplotlib.typing import ColorType
from numpy.typing import NDArray

from vibrosweep import theory
from vibrosweep.analysis.records import (
    BaseMotion,
    ParticleFlights,
    base_motion,
    base_name,
    course,
    has_closed_forms,
    moves,
)
from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, finite
from vibrosweep.figures import data, style
from vibrosweep.model.orbit_theory import lower_end

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["highest", "parabolas"]

HEIGHT_NEEDS: Final = data.Requirements(
    (
        "landing_time",
        "liftoff_time",
        "rebound_velocity",
        "rested",
        "launch_time",
        "launch_velocity",
        "gravity",
        "frequency",
        "duration",
    )
)
# Longer paths are cut: the Agg renderer holds the outline of a whole path in memory
FLIGHTS_PER_PATH: Final = 200
# With more flights a vector file is larger than the same picture in pixels
VECTOR_FLIGHTS: Final = 20_000
REST, RIDE = 3.0, 1.2  # points: widths of bars of rests, and of rests on a base that moves
BELOW: Final = 0.06  # room under the base for them, relative to the greatest height
# Forcing periods that a reader can distinguish across a page
READABLE_PERIODS: Final = 40.0
SAMPLES: Final = 48  # points of a moving base in a forcing period
MOST_SAMPLES: Final = 50_000
RETURN_NEEDS: Final = data.Requirements(
    (
        "landing_time",
        "rebound_velocity",
        "launch_velocity",
        "restitution",
        "amplitude",
        "frequency",
        "gravity",
        "duration",
    )
)
EARLY: Final = "#9CCBEA"  # a tint of the palette's sky blue
LATE: Final = style.OKABE_ITO[1]
MOST_MODES: Final = 12


@style.styled
def height_time(
    record: xr.Dataset,
    particles: Sequence[int] | None = None,
    until: float | None = None,
    *,
    realization: int = 0,
    mark_landings: bool | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw height against time: one parabola per flight, and a bar on the base per rest.

    A moving base is drawn under the parabolas.  A parabola is a quadratic Bezier curve: the figure
    shows the exact trajectory at every magnification, not a polygon through samples of it.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    particles
        Positions of the particles to draw; by default all.
    until
        End of the drawing in s; by default, and at most, the end of the observation.
    realization
        Position of the realization in the record.
    mark_landings
        True to mark every landing by a dot; by default only if a single particle is drawn.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The record lacks a variable.
    ParameterError
        There is no such particle or realization, or ``until`` is not after the first launch.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import height_time
    >>> height_time(vs.simulate(launch_time=[0.0, 0.125]), until=5.0).get_xlabel()
    'time $t$ (s)'
    """
    HEIGHT_NEEDS.check("height_time", record)
    one = data.one_realization(record, realization)
    if not (mark_landings is None or isinstance(mark_landings, bool)):
        raise ParameterError(f"mark_landings = {mark_landings!r}: must be True, False or None")
    base, shown = base_motion(one, "height_time"), _shown(one, particles)
    one = one.isel(particle=shown)
    begin, stop = _window(one, until)
    flown = course(one, base, stop)
    # A single particle, which is one curve, needs less height
    axes = style.axes_on(ax, style.PAGE, 2.3 if len(shown) == 1 else 2.8)
    colours = _colours(axes, shown)
    gravity = float(one["gravity"])
    _draw_flights(axes, flown, colours, gravity)
    _draw_rests(axes, one, stop, colours, base)
    if mark_landings if mark_landings is not None else len(shown) == 1:
        _draw_landings(axes, one, stop, colours, base)
    top = max(base.reach, highest(flown, gravity)) or 1.0
    floor = -BELOW * top - base.reach
    axes.set(xlim=(begin, stop), ylim=(floor, 1.05 * top))
    axes.set(xlabel="time $t$ (s)", ylabel="height $y$ (m)")
    if base.reach:  # shade the region under the base
        t = _sampled(base, begin, stop)
        axes.fill_between(
            t, base.height(t), floor, facecolor="0.9", edgecolor="0.55", linewidth=0.6
        )
    if 1 < len(shown) <= len(style.OKABE_ITO):
        for i, colour in zip(shown, colours, strict=True):
            axes.plot([], [], color=colour, label=f"particle {i}")
    style.head(
        axes, data.joined(data.conditions(one), data.incomplete(one, "particles")), columns=5
    )
    return axes


def readable_until(record: xr.Dataset) -> float:
    """End of the interval, in s, that is readable on a page: at most 40 forcing periods."""
    one = data.one_realization(record, 0)
    begin = float(one["launch_time"].values.min())
    return min(begin + READABLE_PERIODS / float(one["frequency"]), float(one["duration"]))


def _shown(one: xr.Dataset, particles: Sequence[int] | None) -> list[int]:
    count = one.sizes["particle"]
    if particles is None:
        return list(range(count))
    given = particles if np.iterable(particles) else ()
    shown = {int(i) for i in given if isinstance(i, Integral) and 0 <= i < count}
    if not shown or not shown.issuperset(given):
        raise ParameterError(
            f"particles = {particles!r}: give at least one, and numbers from 0 to {count - 1}"
        )
    return sorted(shown)


def _window(one: xr.Dataset, until: float | None) -> tuple[float, float]:
    duration = float(one["duration"])
    begin = min(0.0, float(one["launch_time"].values.min(initial=0.0)))
    stop = duration if until is None else finite("until", until)
    if not begin < stop <= duration:
        raise ParameterError(
            f"until = {stop:g} s is outside the observation: give a time after {begin:g} s and at "
            f"most {duration:g} s"
        )
    return begin, stop


def _colours(axes: Axes, shown: list[int]) -> list[ColorType]:
    """One colour per particle, with a colour bar if there are too many for a legend."""
    if len(shown) <= len(style.OKABE_ITO):
        return list(style.OKABE_ITO[: len(shown)])
    # without the palest tenth of the map, in which thin lines would vanish on white
    cmap = ListedColormap(colormaps[style.SEQUENTIAL_MAP](np.linspace(0.0, 0.9, 256)))
    norm = Normalize(shown[0], shown[-1])
    ticks = MaxNLocator(6, integer=True)
    style.bar(axes, ScalarMappable(norm, cmap), "particle", pad=0.01, ticks=ticks)
    return [cmap(norm(i)) for i in shown]


def parabolas(flown: ParticleFlights, gravity: float) -> Array:
    """Return the flights of all particles as quadratic Bezier curves: shape (flight, 3 points, 2).

    Such a curve is a parabola: its middle point is where the tangents at both ends meet.
    """
    flies = flown.flies
    start, velocity, height = flown.start[flies], flown.velocity[flies], flown.height[flies]
    lasts = flown.end[flies] - start
    meet = height + velocity * lasts / 2.0
    end = height + velocity * lasts - gravity * lasts**2 / 2.0
    times = np.stack([start, start + lasts / 2.0, start + lasts], axis=-1)
    return np.stack([times, np.stack([height, meet, end], axis=-1)], axis=-1)


def highest(flown: ParticleFlights, gravity: float) -> float:
    """Greatest height in m that flights reach, at least 0."""
    rise = np.clip(flown.velocity / gravity, 0.0, flown.end - flown.start)
    top = flown.height + rise * (flown.velocity - gravity * rise / 2.0)
    return float(np.max(top, initial=0.0, where=flown.flies))


def _draw_flights(
    axes: Axes, flown: ParticleFlights, colours: list[ColorType], gravity: float
) -> None:
    paths, path_colours, curves = [], [], parabolas(flown, gravity)
    of_particles = np.split(curves, np.cumsum(flown.flies.sum(axis=1))[:-1])
    for of_particle, colour in zip(of_particles, colours, strict=True):
        for first in range(0, len(of_particle), FLIGHTS_PER_PATH):
            part = of_particle[first : first + FLIGHTS_PER_PATH]
            codes = np.tile([Path.MOVETO, Path.CURVE3, Path.CURVE3], len(part))
            paths.append(Path(part.reshape(-1, 2), codes))
            path_colours.append(colour)
    crowded = len(colours) > len(style.OKABE_ITO)
    axes.add_collection(
        PathCollection(
            paths,
            facecolors="none",
            edgecolors=path_colours,
            linewidths=0.6 if crowded else 0.9,
            capstyle="round",
            rasterized=len(curves) > VECTOR_FLIGHTS,
        ),
        autolim=False,
    )


def _sampled(base: BaseMotion, begin: float, stop: float) -> Array:
    """Instants at which the curve of the base is sampled."""
    count = int(min(SAMPLES * base.frequency * (stop - begin), MOST_SAMPLES)) + 2
    return np.linspace(begin, stop, count)


def _draw_rests(
    axes: Axes, one: xr.Dataset, stop: float, colours: list[ColorType], base: BaseMotion
) -> None:
    """Draw a bar for every rest, just below the base, where it hides neither flights nor landings.

    A rest lasts from the landing to the lift-off, which is NaN where the particle rests for good.
    """
    landing, rested = one["landing_time"].values, one["rested"].values == 1
    particle, impact = np.nonzero(rested & (landing < stop))
    leaves = np.fmin(one["liftoff_time"].values, stop)
    rests = np.stack([landing, leaves], axis=-1)[particle, impact]
    times = [_sampled(base, *rest) if base.reach else rest for rest in rests]
    # black for one particle, as its colour would hide its landings, and for many, as bars overlap
    plain = not 1 < len(colours) <= len(style.OKABE_ITO)
    width = RIDE if base.reach else REST
    below = offset_copy(axes.transData, axes.get_figure(root=True), y=-width, units="points")
    axes.add_collection(
        LineCollection(
            [np.stack([t, base.height(t)], axis=-1) for t in times],
            colors=["black" if plain else colours[i] for i in particle],
            linewidths=width,
            capstyle="butt",
            transform=below,
            zorder=2.5,
        ),
        autolim=False,
    )
    if len(rests):
        axes.plot([], [], color="black", linewidth=width, label="at rest on the base")


def _draw_landings(
    axes: Axes, one: xr.Dataset, stop: float, colours: list[ColorType], base: BaseMotion
) -> None:
    for particle, colour in enumerate(colours):
        landing = one["landing_time"].values[particle]
        landing = landing[landing <= stop]
        axes.plot(
            landing,
            base.height(landing),
            "o",
            markersize=2.6,
            color=colour,
            label="landing" if particle == 0 else None,
            clip_on=False,
            zorder=3,
        )


@style.styled
def return_map(record: xr.Dataset, *, realization: int = 0, ax: Axes | None = None) -> Axes:
    """Draw the arrival velocity at each landing, downwards, against that at the previous one.

    All points lie in the strip of slope e and half-width A; over a moving base, whose height
    changes between landings, the half-width is A + 2 V0 with V0 = A / (1 + e).  Points of the
    second half of the observation are darker and on top.  Diamonds on the identity line mark the
    stable closed-form locked orbits of mode k, crosses the unstable ones.  Over a base of finite
    mass neither strip nor orbits have a closed form, and the figure shows the points alone.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Position of the realization in the record; all its particles are drawn.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The record lacks a variable.
    ParameterError
        There is no such realization.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import return_map
    >>> return_map(vs.simulate(launch_time=[0.0, 0.125])).get_xlabel()
    'arrival velocity $v_n$ (m s$^{-1}$)'
    """
    from vibrosweep.analysis.records import return_points

    RETURN_NEEDS.check("return_map", record)
    one = data.one_realization(record, realization)
    before, after, known = return_points(one)
    half = float(one["duration"]) / 2.0
    late = one["landing_time"].values[known] > half
    before, after = before[known], after[known]
    axes = style.axes_on(ax, style.COLUMN, 4.1)
    floor = float(one["amplitude"]) or float(one["launch_velocity"]) or 1.0
    top = 1.06 * max(float(np.max(before, initial=floor)), float(np.max(after, initial=floor)))
    # over a moving base a particle may still be rising when it lands
    lowest = min(float(np.min(before, initial=0.0)), float(np.min(after, initial=0.0)))
    if has_closed_forms(one):
        _draw_strip(axes, one, lowest, top)
        _draw_locked(axes, one, top)
    _draw_points(axes, before, after, late, half)
    view = (1.06 * lowest - 0.03 * top, top)
    axes.set(xlim=view, ylim=view, aspect="equal", xlabel="arrival velocity $v_n$ (m s$^{-1}$)")
    axes.set_ylabel("next arrival velocity $v_{n+1}$ (m s$^{-1}$)")
    style.head(
        axes, data.joined(data.conditions(one), data.incomplete(one, "particles")), columns=2
    )
    return axes


def _draw_strip(axes: Axes, one: xr.Dataset, lowest: float, top: float) -> None:
    """Shade |v' - e v| <= A, or A + 2 V0 over a moving base, and draw the identity."""
    e, amplitude = float(one["restitution"]), float(one["amplitude"])
    width, words = amplitude, "A"
    if moves(one):
        width, words = amplitude * (3.0 + e) / (1.0 + e), "A + 2 V_0"
    ends = np.linspace(1.1 * lowest, top, 201)
    axes.fill_between(
        ends,
        np.maximum(e * ends - width, 1.1 * lowest),
        e * ends + width,
        facecolor="0.92",
        edgecolor="0.6",
        linewidth=0.5,
        label=rf"$|v_{{n+1}} - e\,v_n| \leq {words}$",
        zorder=1,
    )
    both, name = [0.0, top], "$v_{n+1} = v_n$"
    axes.plot(both, both, color="black", linestyle=style.DASHED, linewidth=0.8, label=name)


def _draw_points(
    axes: Axes, before: Array, after: Array, late: NDArray[np.bool_], half: float
) -> None:
    size = float(np.clip(20.0 / np.sqrt(np.sqrt(before.size + 1)), 0.8, 3.5))
    for chosen, colour, name in (
        (~late, EARLY, rf"$t \leq {half:.4g}$ s"),
        (late, LATE, f"$t > {half:.4g}$ s"),
    ):
        axes.plot(
            before[chosen],
            after[chosen],
            "o",
            markersize=size,
            markeredgewidth=0.0,
            color=colour,
            rasterized=before.size > style.MANY,
            zorder=2.5,
        )
        # a separate marker: the dots of a long record are too small to show their colour
        if np.any(chosen):
            axes.plot([], [], "o", markersize=3.5, color=colour, label=name)


def _draw_locked(axes: Axes, one: xr.Dataset, top: float) -> None:
    """Mark the closed-form locked orbits, all of whose arrival speeds are g k / (2 f)."""
    e, amplitude, frequency, gravity = (
        float(one[name]) for name in ("restitution", "amplitude", "frequency", "gravity")
    )
    reach = top / float(theory.locked_velocity(1, frequency, gravity))
    modes = np.arange(1, min(int(reach), MOST_MODES) + 1)
    of_modes = modes, e, frequency, gravity, base_name(one)
    exists = amplitude >= lower_end(*of_modes)
    stable = amplitude <= theory.amplitude_max(*of_modes)
    speeds = theory.locked_velocity(modes, frequency, gravity)
    for chosen, marker, name in (
        (exists & stable, "D", "locked, stable"),
        (exists & ~stable, "X", "locked, unstable"),
    ):
        if np.any(chosen):
            axes.plot(
                speeds[chosen],
                speeds[chosen],
                marker,
                markersize=7.0,
                markerfacecolor="none",  # the points of an attractor lie inside
                markeredgecolor="black",
                markeredgewidth=0.9,
                label=name,
                zorder=3,
            )
    if np.any(exists):
        style.name_levels(axes, speeds[exists], [f"mode $k$ = {k}" for k in modes[exists]])
