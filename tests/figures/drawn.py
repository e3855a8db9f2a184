"""What a reader sees in a figure: positions, extents and colours of its artists."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection, PathCollection, PolyCollection, QuadMesh
from matplotlib.colors import to_rgba
from matplotlib.container import BarContainer
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.path import Path

from vibrosweep.figures.style import for_file

NO_MARKER = ("None", "", None)


def drawn(figure, dataset, *args, **options):
    """Axes of a figure that is drawn for a file; those of a colour bar are last."""
    return for_file(figure, dataset, *args, **options).axes


def legend(axes):
    """Colour of each entry of the legend, by its text."""
    if axes.get_legend() is None:
        return {}
    handles, labels = axes.get_legend_handles_labels()
    return {label: colour_of(one) for one, label in zip(handles, labels, strict=True)}


def colour_of(handle):
    if isinstance(handle, Line2D):
        marker = handle.get_marker() not in NO_MARKER
        return to_rgba(handle.get_markerfacecolor() if marker else handle.get_color())
    one = handle[0] if isinstance(handle, BarContainer) else handle
    return tuple(np.atleast_2d(one.get_facecolor())[0])


def meshes(axes):
    return [one for one in axes.collections if isinstance(one, QuadMesh)]


def colour_at(axes, x, y):
    """Colour of the topmost cell at a point; None where no cell shows."""
    for mesh in reversed(meshes(axes)):
        corners = mesh.get_coordinates()
        across, up = corners[0, :, 0], corners[:, 0, 1]
        assert np.all(np.diff(across) > 0.0)
        assert np.all(np.diff(up) > 0.0)
        i, j = np.searchsorted(up, y) - 1, np.searchsorted(across, x) - 1
        if not (0 <= i < up.size - 1 and 0 <= j < across.size - 1):
            continue
        value = np.ma.asarray(mesh.get_array()).reshape(up.size - 1, -1)[i, j]
        if value is not np.ma.masked:
            return tuple(mesh.cmap(mesh.norm(value)))
    return None


def scattered(axes):
    """Rows of x, y and colour of all dots of scatters, topmost last."""
    rows = []
    for one in axes.collections:
        if not isinstance(one, PathCollection) or not len(one.get_offsets()):
            continue
        (marker,) = one.get_paths()
        if Path.CLOSEPOLY not in marker.codes and not np.all(one.get_linewidths() > 0.0):
            continue  # a cross of lines without width is not seen
        x, y = np.asarray(one.get_offsets()).T
        if one.get_array() is not None:
            colours = one.cmap(one.norm(one.get_array()))
        else:
            faces = one.get_facecolor()
            colours = np.broadcast_to(faces if len(faces) else one.get_edgecolor(), (x.size, 4))
        rows += [(a, b, tuple(c)) for a, b, c in zip(x, y, colours, strict=True)]
    return rows


def marked(axes):
    """Rows of x, y, colour and whether it is filled of all markers of lines."""
    rows = []
    for line in axes.lines:
        if line.get_marker() in NO_MARKER:
            continue
        edge, face = to_rgba(line.get_markeredgecolor()), to_rgba(line.get_markerfacecolor())
        known = np.isfinite(line.get_xdata()) & np.isfinite(line.get_ydata())
        at = zip(line.get_xdata()[known], line.get_ydata()[known], strict=True)
        rows += [(x, y, edge, face == edge) for x, y in at]
    return rows


def curves(axes):
    """Lines without markers: arrays of x and y, colour, width and dashes."""
    return [
        (
            np.asarray(line.get_xdata(), dtype=float),
            np.asarray(line.get_ydata(), dtype=float),
            to_rgba(line.get_color()),
            line.get_linewidth(),
            line.get_linestyle(),
        )
        for line in axes.lines
        if len(line.get_xdata()) and line.get_marker() in NO_MARKER
    ]


def bars(axes):
    """Left, right, bottom, top and colour of all bars that have a height."""
    boxes = [one for one in axes.patches if isinstance(one, Rectangle)]
    return [
        (
            one.get_x(),
            one.get_x() + one.get_width(),
            one.get_y(),
            one.get_y() + one.get_height(),
            tuple(one.get_facecolor()),
        )
        for one in boxes
        if np.isfinite(one.get_height())
    ]


def segments(axes):
    """Ends of all segments of collections of lines."""
    return [s for c in axes.collections if isinstance(c, LineCollection) for s in c.get_segments()]


def layers(axes, x):
    """Lower and upper end at an x of every polygon that is filled, and its colour."""
    found = []
    for one in axes.collections:
        if isinstance(one, PolyCollection):
            (path,) = one.get_paths()
            at = path.vertices[path.vertices[:, 0] == x, 1]
            found.append((at.min(), at.max(), tuple(one.get_facecolor()[0])))
    return found


def scale(bar):
    """Colour of a number by the colour bar that the reader sees."""
    shown = bar._colorbar
    return lambda value: tuple(shown.cmap(shown.norm(value)))


def near(rows, expected):
    """Assert that two lists hold the same rows of numbers (and other things), in any order."""

    def key(row):
        return tuple(
            tuple(np.round(part, 9)) if isinstance(part, tuple) else (round(float(part), 9),)
            for part in row
        )

    assert sorted(map(key, rows)) == sorted(map(key, expected))
