"""The closed-form windows of locked motion, drawn over a plane of restitution and amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from vibrosweep.figures import style
from vibrosweep.figures.data import Array
from vibrosweep.model import theory
from vibrosweep.model.parameters import BASES

__all__ = ["Curve", "draw_windows", "window_curves"]

MODES: Final = (1, 2, 3)
SAMPLES: Final = 201


@dataclass(frozen=True)
class Curve:
    """An end of the window of mode k: where the orbit begins to exist, or ceases to be stable."""

    mode: int
    is_upper: bool
    restitution: Array
    amplitude: Array


def window_curves(
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    frequency: float,
    gravity: float,
    modes: Sequence[int] = MODES,
    base: str = BASES[0],
) -> list[Curve]:
    """Return both ends of the windows of the modes, as far as they cross the view.

    Parameters
    ----------
    x_range, y_range
        The view: restitution and amplitude.
    frequency, gravity
        In Hz and m/s2.  With frequency 1 and gravity 2 the amplitude is the dimensionless kick.
    modes
        The modes k.
    base
        One of `vibrosweep.model.parameters.BASES`.
    """
    e = np.linspace(max(x_range[0], 0.0), min(x_range[1], 1.0), SAMPLES)
    curves = [
        Curve(k, is_upper, e, end(k, e, frequency, gravity))
        for is_upper, end in (
            (False, theory.amplitude_min),
            (True, partial(theory.amplitude_max, base=base)),
        )
        for k in modes
    ]
    low, high = y_range
    return [c for c in curves if np.any((c.amplitude > low) & (c.amplitude < high))]


def draw_windows(
    axes: Axes,
    frequency: float,
    gravity: float,
    symbol: str,
    *,
    over: bool,
    modes: Sequence[int] = MODES,
    base: str = BASES[0],
) -> None:
    """Draw the ends of the windows into the present view and name each on its curve.

    Parameters
    ----------
    axes
        Axes whose limits are set.
    frequency, gravity
        As for `window_curves`.
    symbol
        Symbol of the amplitude in mathtext, without dollar signs.
    over
        Draw the curves over cells, with a halo; else under dots, so that they hide none.
    modes
        The modes k.
    base
        One of `vibrosweep.model.parameters.BASES`.
    """
    curves = window_curves(axes.get_xlim(), axes.get_ylim(), frequency, gravity, modes, base)
    for curve in curves:
        axes.plot(
            curve.restitution,
            curve.amplitude,
            color="black",
            linewidth=1.0,
            linestyle=(0, (4, 1.5)) if curve.is_upper else "-",
            path_effects=style.halo() if over else None,
            zorder=3.0 if over else 0.9,
        )
    for curve, at in zip(curves, _label_places(axes, curves), strict=True):
        if at is None:
            continue
        end = r"\mathrm{max}" if curve.is_upper else r"\mathrm{min}"
        axes.text(
            curve.restitution[at],
            curve.amplitude[at],
            rf"${symbol}_{{{end}}}({curve.mode})$",
            rotation=_slope(curve, at),
            rotation_mode="anchor",
            transform_rotates_text=True,
            ha="center",
            va="center",
            fontsize=7.5,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.6},
            zorder=4,
            clip_on=True,
        )


def _slope(curve: Curve, at: int) -> float:
    """Angle in degrees in data space; the text turns with the axes' own scaling."""
    run = curve.restitution[at + 1] - curve.restitution[at - 1]
    return float(np.degrees(np.arctan2(curve.amplitude[at + 1] - curve.amplitude[at - 1], run)))


def _label_places(axes: Axes, curves: list[Curve]) -> list[int | None]:
    """Place each label, one after the other, where it is farthest from curves and labels.

    None for a curve that has no room in the view: one of a high mode crosses it steeply at its rim.
    """
    to_view = axes.transAxes.inverted()
    points = [
        to_view.transform(axes.transData.transform(np.column_stack([c.restitution, c.amplitude])))
        for c in curves
    ]
    candidates = np.linspace(0.1, 0.9, 33) * (SAMPLES - 1)
    placed: list[Array] = []
    places: list[int | None] = []
    for i, own in enumerate(points):
        others = [p for j, p in enumerate(points) if j != i] + placed
        room = {int(c): _room(own[int(c)], others, len(placed)) for c in candidates}
        best = max(room, key=lambda c: room[c])
        inside = room[best] > 0.0
        placed += [own[best][np.newaxis]] if inside else []
        places.append(best if inside else None)
    return places


def _room(at: Array, others: list[Array], labels: int) -> float:
    """Room around a point, in fractions of the view; labels need more than curves do."""
    edge = float(min(at.min(), (1.0 - at).min()))
    distances = [float(np.hypot(*(other - at).T).min()) for other in others]
    curves, names = distances[: len(distances) - labels], distances[len(distances) - labels :]
    return min([3.0 * edge, 0.3, *(2.0 * d for d in curves), *names])
