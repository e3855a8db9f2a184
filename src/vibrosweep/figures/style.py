"""Look of figures and the axes that they are drawn on, without touching global state."""

from __future__ import annotations

import functools
import inspect
import re
import textwrap
import warnings
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from typing import Any, Final, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotParams
from matplotlib.layout_engine import PlaceHolderLayoutEngine
from matplotlib.text import Text
from matplotlib.typing import ColorType
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.store.arranged import arranged, require_dataset, require_datasets

__all__ = [
    "COLUMN",
    "GREY",
    "MEDIUM",
    "OKABE_ITO",
    "PAGE",
    "RC",
    "axes_on",
    "colours",
    "for_file",
    "head",
    "panels_on",
    "styled",
]


def __dir__() -> list[str]:
    return sorted(__all__)


P = ParamSpec("P")
R = TypeVar("R")
Panels = NDArray[np.object_]  # axes of a figure, shape (panel,)

# What an argument of a figure must be, by its annotation
DOORS: Final[dict[object, Callable[[object], None]]] = {
    "xr.Dataset": require_dataset,
    "Sequence[xr.Dataset]": require_datasets,
}
# Widths in inches: one column, one and a half, and two columns of a journal page.
COLUMN: Final = 3.5
MEDIUM: Final = 5.0
PAGE: Final = 7.0
# Above this number, points are gathered in cells instead of drawn one by one
MANY: Final = 20_000
LETTERS_PER_INCH: Final = 14  # of a remark
ENTRIES_PER_INCH: Final = 4  # of a legend in letters of usual size, beside the axes
LETTERS_OF_TITLES: Final = 8  # for each inch of room
BESIDE: Final = 0.5  # inches of the width of a figure that a remark cannot use
LEFT: Final = 1.0  # inches of it that a legend above narrow axes cannot use
UNDER: Final = 0.5  # inches of the height of a figure below its axes
# Inches: in less width no legend stands beside the axes, and letters are smaller
NARROW: Final = 4.5
SMALL: Final[dict[str, Any]] = {
    "fontsize": 7.0,
    "title_fontsize": 7.0,
    "handlelength": 1.2,
    "columnspacing": 0.8,
}
REMARK: Final = 2.9  # inches of a remark beside the axes
MARGIN: Final = 0.2  # inches that stay free
MOST_LINES: Final = 3  # of a label
INSIDE: Final = 0.7  # share of the remaining width for a remark inside the axes
SEQUENTIAL_MAP: Final = "viridis"
DIVERGING_MAP: Final = "coolwarm"  # of signed numbers
DENSITY_MAP: Final = "cividis_r"
GREY: Final = "0.45"
DASHED: Final = (0, (5, 2))
# The palette of Okabe and Ito, distinct under every common colour blindness, without its yellow,
# in which thin lines vanish on white
OKABE_ITO: Final = (
    "#0072B2",  # blue
    "#D55E00",  # vermillion
    "#009E73",  # green
    "#CC79A7",  # purple
    "#E69F00",  # orange
    "#56B4E9",  # sky blue
    "#000000",
)
# The keys are typed loosely because matplotlib names each of them in a type, from 3.11 on
RC: Final[dict[Any, Any]] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.titlesize": 8.0,
    "axes.titlelocation": "left",
    "axes.titlepad": 4.0,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.facecolor": "white",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "text.color": "black",
    "axes.labelcolor": "black",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.fontsize": 8.0,
    "legend.title_fontsize": 8.0,
    "legend.borderpad": 0.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.2,
    "legend.borderaxespad": 0.4,
    "lines.linewidth": 0.9,
    "text.usetex": False,
    "pdf.fonttype": 42,  # journals want embedded TrueType, not Type 3
    "savefig.bbox": None,  # keeps the designed sizes
}
_FOR_FILE: Final = ContextVar("for_file", default=False)


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Decorate a drawing function to run in the style of this package; rcParams stay unchanged.

    Parameters
    ----------
    draw
        Function that returns the axes on which it draws.

    Returns
    -------
    function
        The function, which runs under `RC`.

    Examples
    --------
    >>> from vibrosweep.figures import style
    >>> @style.styled
    ... def empty(*, ax=None):
    ...     return style.axes_on(ax, style.COLUMN, 2.0)
    >>> float(empty().figure.get_figwidth())
    3.5
    """
    signature = inspect.signature(draw)
    doors = {
        n: DOORS[p.annotation] for n, p in signature.parameters.items() if p.annotation in DOORS
    }

    @functools.wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, given in signature.bind(*args, **kwargs).arguments.items():
            if name in doors:
                doors[name](given)
        if kwargs.get("ax") is None:
            load_backend()
        with mpl.rc_context(RC):
            named: Any = {name: _read(value) for name, value in kwargs.items()}
            drawn = draw(*map(_read, args), **named)
            for axes in np.ravel(np.asarray(drawn, dtype=object)):
                _fit_labels(axes)
            if kwargs.get("ax") is not None:
                make_room(np.ravel(np.asarray(kwargs["ax"], dtype=object))[0])
            return drawn

    return wrapper


def _read(given: Any) -> Any:
    """Return an argument of a figure; a dataset, or each of several, as `arranged` returns it."""
    if isinstance(given, list | tuple):
        return [_read(one) for one in given]
    return arranged(given) if hasattr(given, "data_vars") else given


def colours(count: int) -> list[ColorType]:
    """Return different colours from the palette, or from the sequential map if it has too few.

    Parameters
    ----------
    count
        Number of colours.

    Returns
    -------
    list
        Colours as matplotlib takes them.

    Examples
    --------
    >>> from vibrosweep.figures import style
    >>> style.colours(2)
    ['#0072B2', '#D55E00']
    """
    if count <= len(OKABE_ITO):
        return list(OKABE_ITO[:count])
    return [mpl.colormaps[SEQUENTIAL_MAP](i / (count - 1)) for i in range(count)]


def halo() -> list[patheffects.AbstractPathEffect]:
    """Return a white outline that keeps lines and words readable on top of colour."""
    return [patheffects.withStroke(linewidth=2.2, foreground="white")]


def name_levels(axes: Axes, levels: Array, names: Sequence[str]) -> None:
    """Name levels of the vertical axis on the right-hand side of the axes."""
    right = axes.secondary_yaxis("right")
    right.set_yticks(levels, names)
    right.tick_params(length=0, pad=2, labelcolor="0.25")
    right.spines["right"].set_visible(False)


def head(axes: Axes, remark: str, columns: int = 4) -> None:
    """Put a remark, and the legend if there is one, above the axes, where they hide no data.

    If a user placed the axes by hand, so that there may be no room, the legend is put inside.

    Parameters
    ----------
    axes
        Axes on which all entries of the legend have been drawn.
    remark
        Text, broken into lines after commas; it may be empty.
    columns
        Number of columns of the legend.

    Returns
    -------
    None
        The axes have changed.

    Examples
    --------
    >>> from vibrosweep.figures import style
    >>> axes = style.axes_on(None, style.MEDIUM, 3.0)
    >>> style.head(axes, "without a legend")
    >>> axes.get_title()
    'without a legend'
    """
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0)}
    _explain(axes, _in_lines(remark, room(axes)[0]), place, columns)


def beside(axes: Axes, remark: str) -> None:
    """Put a remark and the legend to the right of the axes, or above them if they are narrow."""
    if is_narrow(axes):
        head(axes, remark)
    else:
        place = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
        _explain(axes, _in_lines(remark, REMARK), place)


def remark_of(axes: Axes) -> str:
    """Return the remark that `head` or `beside` has put on the axes."""
    legend = axes.get_legend()
    return legend.get_title().get_text() if legend else axes.get_title(loc="left")


def _explain(axes: Axes, remark: str, place: dict[str, Any], columns: int = 1) -> None:
    """Put a remark and the legend at a place outside the axes, if there is room.

    The legend has as many of the columns as fit into the width.
    """
    handles, labels = axes.get_legend_handles_labels()
    width, height = room(axes)
    if not has_room(axes):
        remark = _in_lines(remark, INSIDE * width)
        place, columns = {"loc": "best", "frameon": True, "borderpad": 0.4, "fontsize": 7.0}, 1
    elif width < NARROW or len(handles) > ENTRIES_PER_INCH * height:
        place |= SMALL
    if remark:
        axes.set_title("" if handles else remark)
    above = place["loc"] == "lower left"
    for ncols in range(columns, 0, -1) if handles else ():
        place |= {"title": remark or None, "alignment": "left", "ncols": ncols}
        legend = axes.legend(handles, labels, **place)
        wide = legend.get_window_extent().width / legend.figure.dpi
        if wide <= width - LEFT:
            break
        if above and width < NARROW and wide <= width - _right(axes):  # above the label of y, too
            axes.legend(
                handles, labels, **(place | {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)})
            )
            break


def _right(axes: Axes) -> float:
    """Inches of the width of a figure to the right of narrow axes, roughly."""
    bars = any(one.colorbar for one in axes.collections)
    return LEFT if bars or axes.child_axes else MARGIN


def is_narrow(axes: Axes) -> bool:
    """Return whether the axes have too little width for a long legend."""
    return room(axes)[0] < NARROW


def letters(axes: Axes) -> int:
    """Return the number of letters of a title that fit above the axes."""
    return max(8, round(LETTERS_OF_TITLES * room(axes)[0]))


def bar(axes: Axes, mappable: ScalarMappable, label: str, **options: Any) -> Colorbar:
    """Draw a thin labelled bar of colours to the right of the axes."""
    options = {"pad": 0.02, "aspect": 30, "fraction": 0.05} | options
    drawn = axes.figure.colorbar(mappable, ax=axes, label=label, **options)
    if is_narrow(axes):
        drawn.ax.tick_params(labelsize=SMALL["fontsize"])
        drawn.ax.yaxis.label.set_fontsize(RC["xtick.labelsize"])
    _break(drawn.ax.yaxis.label, room(axes)[1] - 2.0 * UNDER)
    return drawn


def _fit_labels(axes: Axes) -> None:
    """Break labels that are longer than their axis into lines."""
    width, height = room(axes)
    above = axes.get_legend()
    taken = 0.0 if above is None else above.get_window_extent().height / axes.figure.dpi
    if above is not None and taken > height / 2.0:  # beside the axes
        taken = 0.0
    _break(axes.xaxis.label, width - BESIDE)
    _break(axes.yaxis.label, height - UNDER - taken)


def _break(label: Text, inches: float) -> None:
    """Break a label into lines that are at most as long, if that is possible."""
    text, figure = label.get_text(), label.get_figure(root=True)
    if figure is None or not text:
        return
    # neither units nor mathtext are broken
    whole = re.sub(r"\$[^$]*\$|\([^)]*\)", lambda part: part[0].replace(" ", "\xa0"), text)
    for lines in range(1, MOST_LINES + 1):
        box = label.get_window_extent()
        if max(box.width, box.height) <= inches * figure.dpi:
            return
        broken = textwrap.fill(whole.replace("\n", " "), max(len(whole) // (lines + 1) + 4, 8))
        label.set_text(broken.replace("\xa0", " "))


def room(axes: Axes) -> tuple[float, float]:
    """Width and height in inches that the axes have in their figure, with all around them."""
    figure, spec = axes.get_figure(root=True), axes.get_subplotspec()
    size = figure.get_size_inches() if figure else (PAGE, PAGE)
    if spec is None:
        place = axes.get_position()
        return float(size[0]) * place.width, float(size[1]) * place.height
    spec = spec.get_topmost_subplotspec()
    rows, columns = spec.get_gridspec().get_geometry()
    return (
        float(size[0]) * len(spec.colspan) / columns,
        float(size[1]) * len(spec.rowspan) / rows,
    )


def _in_lines(remark: str, width: float) -> str:
    """Break a remark after commas into lines of a width in inches."""
    lines: list[str] = []
    for part in remark.split(", "):
        longer = f"{lines[-1]}, {part}" if lines else part
        drawn = re.sub(r"\\[a-z]+|[$^{}]", "", longer)  # roughly, without markup of mathtext
        if lines and len(drawn) > LETTERS_PER_INCH * (width - BESIDE):
            lines[-1] += ","
            lines.append(part)
        else:
            lines[-1:] = [longer]
    return "\n".join(lines)


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
        try:
            given = np.asarray(ax, dtype=object).ravel()
        except TypeError:  # a dataset
            given = np.empty(0, dtype=object)
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
