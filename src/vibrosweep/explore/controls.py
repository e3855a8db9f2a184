"""Sliders for every parameter, for launches and time, and the choice of the base."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from bokeh.layouts import column, row
from bokeh.models import CheckboxGroup, RadioButtonGroup, Slider

from vibrosweep.explore.choice import Choice, Spread
from vibrosweep.explore.labels import input_label
from vibrosweep.explore.points import Points
from vibrosweep.model.forcing import INPUTS, inputs_of
from vibrosweep.model.parameters import BASES, MOUNT, SPRUNG

# Parameters of a mount where the result has none: particles bunch at these values
MOUNT_VALUES: Final = {"mass_ratio": 0.001, "mount_frequency": 0.37, "mount_damping": 0.05}
STEPS: Final = 400
WIDTH: Final = 190  # least width of a slider, pixels
# Fixed ranges of sliders; the others follow from the values of the result
RANGES: Final = {
    "restitution": (0.0, 1.0),
    "phase": (-math.pi, math.pi),
    "mount_damping": (0.0, 1.0),
}
OF_LAUNCH: Final = {
    "particles": ("number of particles", 1, 100, 1),
    "first": ("first launch (forcing periods)", 0.0, 1.0, 0.005),
    "width": ("launches spread over (forcing periods)", 0.0, 2.0, 0.005),
    "periods": ("duration (forcing periods)", 1.0, 200.0, 1.0),
}


class Controls:
    """Widgets that show a choice and change it.

    Parameters
    ----------
    points
        Points of the result; their parameters set the ranges of the sliders.
    choice
        The realization that is shown at first.
    changed
        Function called, without arguments, after the user moved a widget and `choice` changed.
    """

    def __init__(self, points: Points, choice: Choice, changed: Callable[[], None]) -> None:
        self.choice = choice
        self._changed = changed
        self._setting = False
        # Range of each slider, kept here because a browser can change that of the widget itself
        self._ranges: dict[str, tuple[float, float]] = {}
        inputs = {**MOUNT_VALUES, **choice.inputs}
        names = [name for name in INPUTS if name in inputs_of(inputs, SPRUNG)]
        self.choice = choice.with_inputs(**{name: inputs[name] for name in names})
        self.sliders = {name: self._slider(name, points) for name in names}
        self.launch = {
            name: Slider(title=title, start=low, end=high, step=step, value=low, name=name)
            for name, (title, low, high, step) in OF_LAUNCH.items()
        }
        for name, slider in {**self.sliders, **self.launch}.items():
            self._ranges[name] = slider.start, slider.end
            slider.update(sizing_mode="stretch_width", min_width=WIDTH)
            slider.on_change("value", self._mover(name))
        self.base = RadioButtonGroup(labels=list(BASES), active=0, name="base")
        self.base.on_change("active", self._mover("base"))
        self.both = CheckboxGroup(
            labels=["high-bounce and moving base side by side"], active=[], name="both"
        )
        self.both.on_change("active", lambda attribute, old, new: self._changed())
        self.layout = column(
            self.base,
            self.both,
            row(
                *self.sliders.values(),
                *self.launch.values(),
                sizing_mode="stretch_width",
                styles={"flex-wrap": "wrap"},
            ),
            sizing_mode="stretch_width",
            name="controls",
        )
        self.set(self.choice)

    def clamped(self, name: str, value: float) -> float:
        """Clamp a value to the range of a slider."""
        low, high = self._ranges[name]
        return min(max(value, low), high)

    def set(self, choice: Choice) -> None:
        """Show a choice; parameters of the mount keep their values where the choice has none."""
        self.choice = choice.with_inputs(**{**self.choice.inputs, **choice.inputs})
        self._setting = True
        try:
            for name, slider in self.sliders.items():
                self._move(slider, self.choice.inputs[name])
                slider.visible = name not in MOUNT or choice.scene.base == SPRUNG
            spread = choice.spread or Spread()
            self._move(self.launch["particles"], choice.scene.particles)
            self._move(self.launch["first"], spread.first)
            self._move(self.launch["width"], spread.width)
            self._move(self.launch["periods"], self.choice.periods)
            self.base.active = BASES.index(choice.scene.base)
        finally:
            self._setting = False

    def _slider(self, name: str, points: Points) -> Slider:
        values = [self.choice.inputs[name]]
        if name in points.columns:
            known = points.columns[name].values
            values += [float(known.min()), float(known.max())]
        low, high = RANGES.get(name, (0.0, 2.0 * max(map(abs, values)) or 1.0))
        parameter = INPUTS[name]
        if parameter.low > 0.0:
            low = min(values) / 10.0
        low, high = min(low, *values), max(high, *values)
        step = float(f"{(high - low) / STEPS:.1g}")
        return Slider(
            title=input_label(name),
            start=low,
            end=min(high, parameter.high),
            step=step,
            value=values[0],
            format="0[.]000[000]",
            name=name,
        )

    def _move(self, slider: Slider, value: float) -> None:
        low, high = self._ranges[slider.name]
        low, high = self._ranges[slider.name] = min(low, value), max(high, value)
        slider.update(start=low, end=high, value=value)

    def _mover(self, name: str) -> Callable[[str, Any, Any], None]:
        def moved(attribute: str, old: Any, new: Any) -> None:
            if self._setting:
                return
            self.choice = self._after(name, new)
            self.set(self.choice)  # even if unchanged: the browser may have sent a forbidden value
            self._changed()

        return moved

    def _after(self, name: str, value: Any) -> Choice:
        """Return the choice after a widget was moved; an impossible value changes nothing."""
        choice = self.choice
        if name == "base":
            return choice.over(BASES[value]) if value in range(len(BASES)) else choice
        if value != value:
            return choice
        value = float(self.clamped(name, value))
        if name in self.sliders:
            # a duration in seconds has more periods at a higher frequency
            return choice.with_inputs(**{name: value}).shortened(self._ranges["periods"][1])
        if name == "particles":
            return choice.with_particles(int(value))
        if name == "periods":
            return choice.lasting(value)
        return choice.launched(replace(choice.spread or Spread(), **{name: value}))
