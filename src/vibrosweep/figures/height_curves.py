"""Height against time, drawn from the record of every landing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator
from matplotlib.typing import ColorType

from vibrosweep.analysis.records import BaseMotion, base_motion
from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.figures import data, style
from vibrosweep.figures.motion import Motion, highest, motions, parabolas

if TYPE_CHECKING:
    import xarray as xr

NEEDS: Final = data.Needs(
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
REST: Final = "black"
# Forcing periods that a reader can distinguish across a page
READABLE_PERIODS: Final = 40.0
SAMPLES: Final = 48  # points of a moving base in a forcing period
MOST_SAMPLES: Final = 50_000


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
    NEEDS.check("height_time", record)
    one = data.one_realization(record, realization)
    base, shown = base_motion(one, "height_time"), _shown(one, particles)
    one = one.isel(particle=shown)
    begin, stop = _window(one, until)
    drawn = motions(one, base, stop)
    # A single particle, which is one curve, needs less height
    axes = style.axes_on(ax, style.PAGE, 2.3 if len(shown) == 1 else 2.8)
    colours = _colours(axes, shown)
    gravity = float(one["gravity"])
    _draw_flights(axes, drawn, colours, gravity)
    _draw_rests(axes, drawn, colours, base)
    if mark_landings if mark_landings is not None else len(shown) == 1:
        _draw_landings(axes, drawn, colours, base)
    top = max([base.reach, *(highest(motion, gravity) for motion in drawn)]) or 1.0
    floor = -0.03 * top - base.reach
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
    if not particles or not all(0 <= i < count for i in particles):
        raise ParameterError(
            f"particles = {list(particles)}: give at least one, and numbers from 0 to {count - 1}"
        )
    return sorted(set(particles))


def _window(one: xr.Dataset, until: float | None) -> tuple[float, float]:
    duration = float(one["duration"])
    begin = min(0.0, float(one["launch_time"].values.min(initial=0.0)))
    stop = duration if until is None else until
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
    axes.figure.colorbar(
        ScalarMappable(norm, cmap),
        ax=axes,
        label="particle",
        pad=0.01,
        aspect=30,
        ticks=MaxNLocator(6, integer=True),
    )
    return [cmap(norm(i)) for i in shown]


def _draw_flights(
    axes: Axes, drawn: list[Motion], colours: list[ColorType], gravity: float
) -> None:
    paths, path_colours, flights = [], [], 0
    for motion, colour in zip(drawn, colours, strict=True):
        curves = parabolas(motion, gravity)
        flights += len(curves)
        for first in range(0, len(curves), FLIGHTS_PER_PATH):
            part = curves[first : first + FLIGHTS_PER_PATH]
            codes = np.tile([Path.MOVETO, *[Path.CURVE3] * 4], len(part))
            paths.append(Path(part.reshape(-1, 2), codes))
            path_colours.append(colour)
    crowded = len(drawn) > len(style.OKABE_ITO)
    axes.add_collection(
        PathCollection(
            paths,
            facecolors="none",
            edgecolors=path_colours,
            linewidths=0.6 if crowded else 0.9,
            capstyle="round",
            rasterized=flights > VECTOR_FLIGHTS,
        ),
        autolim=False,
    )


def _sampled(base: BaseMotion, begin: float, stop: float) -> Array:
    """Instants at which the curve of the base is sampled."""
    count = int(min(SAMPLES * base.frequency * (stop - begin), MOST_SAMPLES)) + 2
    return np.linspace(begin, stop, count)


def _draw_rests(
    axes: Axes, drawn: list[Motion], colours: list[ColorType], base: BaseMotion
) -> None:
    """Draw a bar on the base for every rest, thick enough to be distinguished from the axis."""
    # black for one particle, as its colour would hide its landings, and for many, as bars overlap
    plain = not 1 < len(drawn) <= len(style.OKABE_ITO)
    stays = [(i, rest) for i, motion in enumerate(drawn) for rest in motion.rests]
    times = [_sampled(base, *rest) if base.reach else rest for _, rest in stays]
    bar_colours = [REST if plain else colours[i] for i, _ in stays]
    axes.add_collection(
        LineCollection(
            [np.stack([t, base.height(t)], axis=-1) for t in times],
            colors=bar_colours,
            linewidths=3.0,
            capstyle="butt",
            zorder=2.5,
        ),
        autolim=False,
    )
    if stays:
        axes.plot([], [], color=REST, linewidth=3.0, label="at rest on the base")


def _draw_landings(
    axes: Axes, drawn: list[Motion], colours: list[ColorType], base: BaseMotion
) -> None:
    for motion, colour in zip(drawn, colours, strict=True):
        axes.plot(
            motion.landings,
            base.height(motion.landings),
            "o",
            markersize=2.6,
            color=colour,
            label="landing" if motion is drawn[0] else None,
            clip_on=False,
            zorder=3,
        )
