"""A measured variable over restitution and amplitude, with the closed-form windows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes

from vibrosweep.analysis.records import base_name, has_closed_forms
from vibrosweep.arrays import Array
from vibrosweep.figures import data, paint, style
from vibrosweep.figures.paint import Points
from vibrosweep.figures.window_curves import Forcing, draw_windows
from vibrosweep.model.forcing import ACCELERATION
from vibrosweep.store.rows import flat

if TYPE_CHECKING:
    import xarray as xr

CHOICES: Final = ("dt_min", "rebound_height_max")
AXES: Final = ("restitution", "amplitude", "frequency", "gravity")
NEEDS: Final = data.Needs(AXES, one_of=CHOICES, varied=("restitution", "kick"))


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
    have no value, unless the variable is ``status``; the head of the figure says how many they are.

    Parameters
    ----------
    sweep
        Result of a sweep in which restitution and amplitude vary.
    variable
        Variable that sets the colour: a numeric one, or one of codes with the attributes
        ``flag_values`` and ``flag_meanings``.  By default ``dt_min`` if it was measured, otherwise
        ``rebound_height_max``.  Separations have a logarithmic scale, with a line at the
        contact time, and a separate marker where they are 0.
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
        NEEDS.check("parameter_plane", sweep)
        variable = next(name for name in CHOICES if name in sweep.variables)
    data.Needs((*AXES, variable), varied=NEEDS.varied).check("parameter_plane", sweep)
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


def _set_view(axes: Axes, points: Points) -> None:
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
    axes: Axes, points: Points, values: Array, sweep: xr.Dataset, variable: str
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
    bar = paint.paint_numbers(axes, points, values, label, apart, signed=signed)
    contact = data.fixed(sweep, "contact_time") if "contact_time" in sweep.variables else None
    if bar is None or not separation or contact is None:
        return
    low, high = bar.ax.get_ylim()
    if low < contact < high:
        bar.ax.axhline(contact, color="black")
        axes.plot([], [], color="black", label=f"$\\tau_c$ = {contact:.4g} s")
