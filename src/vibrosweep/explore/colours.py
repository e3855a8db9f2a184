"""Colours of numbers, codes and particles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from bokeh.models import (
    BasicTicker,
    ColorMapper,
    FixedTicker,
    LinearColorMapper,
    LogColorMapper,
)
from bokeh.palettes import Viridis256

from vibrosweep.arrays import Array
from vibrosweep.explore.points import Column
from vibrosweep.figures.style import OKABE_ITO, scale_ends

GREY: Final = "#b5b5b5"
NAMED: Final = (*OKABE_ITO, GREY)
UNKNOWN: Final = "rgba(0, 0, 0, 0)"


@dataclass(frozen=True)
class Colouring:
    """Colours of a column."""

    # Values to be coloured, shape (point,): numbers, or for codes their position in `names`
    values: Array
    mapper: ColorMapper  # from values to colours
    title: str  # label of the column, meaning of grey, and full range if the scale is narrower
    # Meanings of the codes that occur; the last one stands for all codes without a colour
    names: Sequence[str] = ()

    @property
    def scale(self) -> dict[str, Any]:
        """Properties of the colour bar."""
        names = self.names
        return {
            "color_mapper": self.mapper,
            "ticker": FixedTicker(ticks=list(range(len(names)))) if names else BasicTicker(),
            "major_label_overrides": dict(enumerate(names)),
        }


def colouring(column: Column) -> Colouring:
    """Colour a column: codes in a palette, numbers along a scale, zeros of separations in grey."""
    if column.codes:
        return _of_codes(column)
    values = column.values
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    positive = known[known > 0.0]
    if column.zero_apart and positive.size:
        # a few almost coincident landings would stretch the scale to the limits of precision
        least = max(float(np.quantile(positive, 0.01)), 1e-6 * high)
        title = f"{column.label}, grey: 0" if low == 0.0 else column.label
        return Colouring(values, _scale(LogColorMapper, least, max(high, 1.01 * least)), title)
    infinite = bool(np.any(values == -np.inf))
    title = f"{column.label}, grey: -∞" if infinite else column.label
    least, most = scale_ends(known) if known.size else (low, high)
    if (least, most) != (low, high):
        # values beyond the ends of the scale take the colours of the ends
        title += f", {low:.3g} to {high:.3g}"
        low, high = low if infinite else least, most
    elif low == high:
        low, high = low - 0.5, high + 0.5
    below = GREY if infinite else Viridis256[0]
    return Colouring(values, _scale(LinearColorMapper, low, high, below), title)


def _scale(kind: type[ColorMapper], low: float, high: float, below: str = GREY) -> ColorMapper:
    return kind(palette=Viridis256, low=low, high=high, low_color=below, nan_color=UNKNOWN)


def _of_codes(column: Column) -> Colouring:
    present = [code for code in column.codes if np.any(column.values == code)]
    names = [column.codes[code] for code in present]
    if len(present) > len(NAMED):
        rest = len(present) - len(NAMED) + 1
        names = [*names[: len(NAMED) - 1], f"{rest} others"]
    position = np.full(column.values.shape, np.nan)
    for i, code in enumerate(present):
        position[column.values == code] = min(i, len(names) - 1)
    mapper = LinearColorMapper(
        palette=NAMED[: len(names)] if len(names) < len(NAMED) else NAMED,
        low=-0.5,
        high=max(len(names), 1) - 0.5,
        nan_color=UNKNOWN,
    )
    return Colouring(position, mapper, column.label, names)


def particle_colours(count: int) -> list[str]:
    """One colour for each particle."""
    if count <= len(OKABE_ITO):
        return list(OKABE_ITO[:count])
    # without the palest tenth of the palette, in which thin lines would vanish on white
    return [Viridis256[int(i)] for i in np.linspace(0, 0.9 * 255, count)]
