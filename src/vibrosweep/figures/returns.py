"""The return map of arrival speeds, drawn from the record of every landing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vibrosweep import theory
from vibrosweep.analysis.records import base_name, has_closed_forms, moves
from vibrosweep.arrays import Array
from vibrosweep.figures import data, style
from vibrosweep.model.window_begin import lower_end

if TYPE_CHECKING:
    import xarray as xr

NEEDS: Final = data.Needs(
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

    NEEDS.check("return_map", record)
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
        (~late, EARLY, f"to {half:.4g} s"),
        (late, LATE, f"after {half:.4g} s"),
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
        style.name_levels(axes, speeds[exists], [f"$k={k}$" for k in modes[exists]])
