"""Colours of numbers, codes and particles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from bokeh.models import FixedTicker, LinearColorMapper, LogColorMapper
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
    title: str  # label of the column, meaning of grey, and full range if the scale is narrower
    # low, high: ends of the scale, which `palette` divides evenly
    low: float
    high: float
    palette: Sequence[str] = Viridis256
    below: str = Viridis256[0]  # colour of values below the scale
    log: bool = False  # True for a logarithmic scale
    # Meanings of the codes that occur; the last one stands for all codes without a colour
    names: Sequence[str] = ()

    def scaled(self, values: Array) -> Array:
        """Numbers whose colours are linear between the ends of `mapping`: values or logarithms."""
        if not self.log:
            return values
        with np.errstate(divide="ignore"):  # zeros are below the scale
            return np.log(values)

    @property
    def mapping(self) -> dict[str, Any]:
        """Properties of the linear mapper with which all pictures of `scaled` are coloured."""
        low, high = self.scaled(np.array([self.low, self.high])).tolist()
        return {"palette": self.palette, "low": low, "high": high, "low_color": self.below}

    @property
    def bar(self) -> dict[str, Any]:
        """Properties of the colour bar."""
        kind = LogColorMapper if self.log else LinearColorMapper
        return {
            "ticker": FixedTicker(ticks=list(range(len(self.names)))) if self.names else "auto",
            "major_label_overrides": dict(enumerate(self.names)),
            # the last one, since it makes the browser build the bar anew, with the other two
            "color_mapper": kind(palette=self.palette, low=self.low, high=self.high),
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
        return Colouring(values, title, least, max(high, 1.01 * least), below=GREY, log=True)
    infinite = bool(np.any(values == -np.inf))
    title = f"{column.label}, grey: -∞" if infinite else column.label
    least, most = scale_ends(known) if known.size else (low, high)
    if (least, most) != (low, high):
        # values beyond the ends of the scale take the colours of the ends
        title += f", {low:.3g} to {high:.3g}"
        low, high = low if infinite else least, most
    elif low == high:
        low, high = low - 0.5, high + 0.5
    return Colouring(values, title, low, high, below=GREY if infinite else Viridis256[0])


def _of_codes(column: Column) -> Colouring:
    present = [code for code in column.codes if np.any(column.values == code)]
    names = [column.codes[code] for code in present]
    if len(present) > len(NAMED):
        rest = len(present) - len(NAMED) + 1
        names = [*names[: len(NAMED) - 1], f"{rest} others"]
    position = np.full(column.values.shape, np.nan)
    for i, code in enumerate(present):
        position[column.values == code] = min(i, len(names) - 1)
    palette = NAMED[: max(len(names), 1)]
    high = len(palette) - 0.5
    return Colouring(position, column.label, -0.5, high, palette, palette[0], names=names)


def particle_colours(count: int) -> list[str]:
    """One colour for each particle."""
    if count <= len(OKABE_ITO):
        return list(OKABE_ITO[:count])
    # without the palest tenth of the palette, in which thin lines would vanish on white
    return [Viridis256[int(i)] for i in np.linspace(0, 0.9 * 255, count)]
