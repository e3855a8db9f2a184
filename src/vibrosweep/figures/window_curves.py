"""The closed-form windows of locked motion, drawn over a plane of restitution and amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from vibrosweep import theory
from vibrosweep.arrays import Array
from vibrosweep.figures import style
from vibrosweep.model.window_begin import lower_end

__all__ = ["per_amplitude"]

MODES: Final = (1, 2, 3)
SAMPLES: Final = 201


@dataclass(frozen=True)
class Forcing:
    """Form in which the forcing is drawn."""

    symbol: str  # in mathtext, without dollar signs
    base: str  # one of `vibrosweep.model.parameters.BASES`
    # frequency, gravity: Hz and m s-2; with the defaults an amplitude is the dimensionless kick
    frequency: float = 1.0
    gravity: float = 2.0
    name: str = "amplitude"  # name of the forcing, one of `vibrosweep.model.forcing.FORCINGS`


@dataclass(frozen=True)
class Curve:
    """An end of the window of mode k: the onset of existence, or of instability, of the orbit."""

    mode: int
    is_upper: bool
    restitution: Array
    forcing: Array


def window_curves(
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    forcing: Forcing,
    modes: Sequence[int] = MODES,
) -> list[Curve]:
    """Return the ends of the windows of the modes that cross the view.

    The view is a range of the restitution and one of the forcing.
    """
    e = np.linspace(max(x_range[0], 0.0), min(x_range[1], 1.0), SAMPLES)
    scale = per_amplitude(forcing.name, e, forcing.frequency, forcing.gravity)
    ends = (False, lower_end), (True, theory.amplitude_max)
    curves = [
        Curve(k, is_upper, e, end(k, e, forcing.frequency, forcing.gravity, forcing.base) * scale)
        for is_upper, end in ends
        for k in modes
    ]
    low, high = y_range
    return [c for c in curves if np.any((c.forcing > low) & (c.forcing < high))]


def per_amplitude(name: str, e: Array, frequency: float | Array, gravity: float | Array) -> Array:
    """Return the ratio of a forcing to its amplitude A = (1 + e) V0."""
    if name == "amplitude":
        return np.ones_like(e)
    omega = 2.0 * np.pi * frequency
    units = {
        "base_velocity": 1.0,
        "base_displacement": 1.0 / omega,
        "base_acceleration": omega / gravity,
    }
    return np.asarray(units[name] / (1.0 + e))


def draw_windows(axes: Axes, forcing: Forcing, *, over: bool, modes: Sequence[int] = MODES) -> None:
    """Draw the ends of the windows into the present view and name each on its curve.

    With `over` the curves are drawn over cells, with a halo; otherwise they lie under the dots, and
    only their names lie over them.
    """
    curves = window_curves(axes.get_xlim(), axes.get_ylim(), forcing, modes)
    for curve in curves:
        axes.plot(
            curve.restitution,
            curve.forcing,
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
            curve.forcing[at],
            rf"${{{forcing.symbol}}}_{{{end}}}({curve.mode})$",
            rotation=_slope(curve, at),
            rotation_mode="anchor",
            transform_rotates_text=True,
            ha="center",
            va="center",
            fontsize=7.5,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.4},
            zorder=4.0,
            clip_on=True,
        )


def _slope(curve: Curve, at: int) -> float:
    """Angle of a curve in degrees of data space; the text turns with the scale of the axes."""
    run = curve.restitution[at + 1] - curve.restitution[at - 1]
    return float(np.degrees(np.arctan2(curve.forcing[at + 1] - curve.forcing[at - 1], run)))


def _label_places(axes: Axes, curves: list[Curve]) -> list[int | None]:
    """Place labels one after the other, each as far as possible from curves and other labels.

    None for a curve without enough space, such as one of a high mode at the edge of the view.
    """
    to_view = axes.transAxes.inverted()
    points = [
        to_view.transform(axes.transData.transform(np.column_stack([c.restitution, c.forcing])))
        for c in curves
    ]
    candidates = np.linspace(0.1, 0.9, 33) * (SAMPLES - 1)
    placed: list[Array] = []
    places: list[int | None] = []
    for i, curve in enumerate(points):
        others = [p for j, p in enumerate(points) if j != i] + placed
        space = {int(c): _free_space(curve[int(c)], others, len(placed)) for c in candidates}
        best = max(space, key=lambda c: space[c])
        inside = space[best] > 0.0
        placed += [curve[best][np.newaxis]] if inside else []
        places.append(best if inside else None)
    return places


def _free_space(at: Array, others: list[Array], labels: int) -> float:
    """Free space around a point, in fractions of the view; labels need more than curves do."""
    edge = float(min(at.min(), (1.0 - at).min()))
    distances = [float(np.hypot(*(other - at).T).min()) for other in others]
    curves, names = distances[: len(distances) - labels], distances[len(distances) - labels :]
    return min([3.0 * edge, 0.3, *(2.0 * d for d in curves), *names])
