"""Axes to draw on: those given, those of a new figure of pyplot, or those of a file."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from typing import Any, Final, ParamSpec

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotParams
from matplotlib.layout_engine import PlaceHolderLayoutEngine
from numpy.typing import NDArray

from vibrosweep.errors import ParameterError

P = ParamSpec("P")
Panels = NDArray[np.object_]  # axes of a figure, shape (panel,)

_FOR_FILE: Final = ContextVar("for_file", default=False)


def load_backend() -> None:
    """Load the backend of pyplot, unless for a file, so that its settings outlast the style."""
    if not _FOR_FILE.get():
        from matplotlib import pyplot

        pyplot.draw_if_interactive()  # type: ignore[no-untyped-call]


def axes_on(ax: Axes | None, width: float, height: float) -> Axes:
    """Return the axes to draw on: those given, or those of a new figure.

    Parameters
    ----------
    ax
        Axes that a user gave; None for a new figure of pyplot, which a notebook shows.
    width, height
        Inches of the new figure; figures of this package are `COLUMN`, `MEDIUM` or `PAGE` wide.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    ParameterError
        The argument is not an Axes.

    Examples
    --------
    >>> from vibrosweep.figures import style
    >>> axes = style.axes_on(None, style.MEDIUM, 3.0)
    >>> style.axes_on(axes, style.MEDIUM, 3.0) is axes
    True
    """
    axes: Axes = panels_on(ax, width, height, [[0]])[0]
    return axes


def panels_on(
    ax: Axes | Sequence[Axes] | Panels | None,
    width: float,
    height: float,
    mosaic: Sequence[Sequence[int]],
    **arrangement: Any,
) -> Panels:
    """Return the axes of several panels: those given, or those of a new figure.

    Parameters
    ----------
    ax
        Axes that a user gave, one for each panel; None for a new figure of pyplot.
    width, height
        Inches of the new figure.
    mosaic
        Rows of the numbers of panels, from 0 on: ``[[0, 0], [1, 2]]`` puts the first above two.
    **arrangement
        Further arguments of ``matplotlib.figure.Figure.subplot_mosaic``, for a new figure.

    Returns
    -------
    numpy.ndarray of matplotlib.axes.Axes
        The axes, shape (panel,).

    Raises
    ------
    ParameterError
        The arguments are not Axes, or not one for each panel.

    Examples
    --------
    >>> from vibrosweep.figures import style
    >>> style.panels_on(None, style.PAGE, 3.0, [[0, 1]], sharey=True).shape
    (2,)
    """
    count = len({panel for row in mosaic for panel in row})
    if ax is not None:
        given = np.asarray(ax, dtype=object).ravel()
        if given.size != count or not all(isinstance(one, Axes) for one in given):
            wanted = "axes of matplotlib" if count == 1 else f"{count} axes, one for each panel"
            raise ParameterError(f"ax = {ax}: give {wanted}")
        return given
    size: dict[str, Any] = {"figsize": (width, height), "layout": "constrained"}
    if _FOR_FILE.get():
        figure = Figure(**size)
    else:
        from matplotlib import pyplot  # chooses a backend, which files do not need

        figure = pyplot.figure(**size)
    panels = figure.subplot_mosaic([list(row) for row in mosaic], **arrangement)
    return np.array([panels[i] for i in range(count)], dtype=object)


def has_room(axes: Axes) -> bool:
    """Return whether a layout engine or `make_room` provides room around the axes."""
    figure = axes.get_figure(root=True)
    if figure is None or _arranges(figure):
        return figure is not None
    arranged = isinstance(figure.get_layout_engine(), PlaceHolderLayoutEngine)  # by make_room
    by_hand = not arranged and vars(figure.subplotpars) != vars(SubplotParams())
    return axes.figure is figure and axes.get_subplotspec() is not None and not by_hand


def make_room(axes: Axes) -> None:
    """Make room for labels and legends in a user's figure that no layout engine arranges."""
    figure = axes.get_figure(root=True)
    if figure and has_room(axes) and not _arranges(figure):
        with warnings.catch_warnings():  # the figure is too small, or has axes placed by hand
            warnings.simplefilter("ignore", UserWarning)
            figure.tight_layout()


def _arranges(figure: Figure) -> bool:
    engine = figure.get_layout_engine()
    return engine is not None and not isinstance(engine, PlaceHolderLayoutEngine)


def for_file(draw: Callable[P, Axes | Panels], *args: P.args, **kwargs: P.kwargs) -> Figure:
    """Draw for a file, on a figure without pyplot, so that no window opens.

    Parameters
    ----------
    draw
        Function of `vibrosweep.figures`, or any that takes its axes from `axes_on` or `panels_on`.
    *args, **kwargs
        Its arguments.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; ``savefig`` writes it.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import height_time, style
    >>> figure = style.for_file(height_time, vs.simulate())
    >>> len(figure.axes)
    1
    """
    token = _FOR_FILE.set(True)
    try:
        drawn = draw(*args, **kwargs)
    finally:
        _FOR_FILE.reset(token)
    figure: Figure = np.ravel(np.asarray(drawn, dtype=object))[0].get_figure(root=True)
    return figure
