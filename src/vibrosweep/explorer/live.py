"""The page of a running server: a plane, controls, and the motion behind a point."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, TypeVar
from urllib.parse import parse_qsl, urlencode

import numpy as np
from bokeh.document import Document
from bokeh.events import DocumentReady, RangesUpdate, SelectionGeometry, Tap
from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    CheckboxGroup,
    ColumnDataSource,
    CustomJS,
    RadioButtonGroup,
    Slider,
    Toggle,
)
from numpy.typing import NDArray

from vibrosweep.explorer.pictures import are_numbers, is_window, moving_point
from vibrosweep.explorer.points import LAUNCHED, Choice, Points, Spread, input_label
from vibrosweep.explorer.views import (
    AUTOMATIC,
    NO_MARKER,
    SCALES,
    TEMPLATE,
    WRAP,
    MotionView,
    PlaneView,
    Scale,
    code_block,
    code_picker,
    fill,
    paragraph,
    picker,
    picker_row,
    save_button,
    scale_pickers,
)
from vibrosweep.explorer.words import (
    PICTURES,
    TABLE,
    enclosed,
    facts_html,
    motion_lines,
    parameters_line,
    plane_lines,
    table,
    table_lines,
)
from vibrosweep.model.forcing import INPUTS, inputs_of
from vibrosweep.model.parameters import BASES, HIGH_BOUNCE, MOUNT, MOVING, SPRUNG

T = TypeVar("T")


class Background:
    """A thread that computes for one visitor, one task at a time; only the newest task waits.

    A task that has begun runs to its end, because a kernel cannot be interrupted.
    """

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(max_workers=1)
        self._tasks: list[Future[Any]] = []

    @property
    def busy(self) -> bool:
        """True while a task runs or waits."""
        return not all(task.done() for task in self._tasks)

    def call(self, work: Callable[[], T]) -> Future[T]:
        """Start a task; an earlier task that has not begun is cancelled."""
        for task in self._tasks:
            task.cancel()
        task = self._executor.submit(self._perform, work)
        self._tasks = [*(earlier for earlier in self._tasks if not earlier.done()), task]
        return task

    def _perform(self, work: Callable[[], T]) -> T:
        # a method, so that a running task keeps this object in the server's weak set
        return work()

    def close(self) -> None:
        """End the thread once the running task is finished."""
        self._executor.shutdown(wait=False, cancel_futures=True)


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
            values = settings(self.choice)
            for name, slider in self.launch.items():
                self._move(slider, values[name])
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
            self.choice = self.after(name, new)
            self.set(self.choice)  # even if unchanged: the browser may have sent a forbidden value
            self._changed()

        return moved

    def after(self, name: str, value: Any) -> Choice:
        """Return the choice after a widget was moved; an impossible value changes nothing."""
        choice = self.choice
        if name == "base":
            return choice.over(BASES[int(value)]) if value in range(len(BASES)) else choice
        if value != value or name not in self._ranges:
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


PLANE: Final = "plane"
SHOWN_ROWS: Final = 6
# ms from the last movement of a slider until the computation of regimes and exponents starts
PATIENCE: Final = 250
# ms until a changed view of a raster is painted
PAINT_DELAY: Final = 120
# s for which the page waits for a computation, so that its pictures are in the same message
AT_ONCE: Final = 0.1
PREPARING: Final = (
    "<b>The motion is being computed.</b> At the first use of an installation the kernels of a "
    "base are compiled first, which takes up to a minute."
)
COMPUTING: Final = (
    "Regimes and exponents are being computed; at the first use of an installation their kernels "
    "are compiled, which takes up to a minute."
)
DOWNLOAD: Final = """
const text = holder.data.text[0];
if (text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], {type: "text/csv"}));
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}
"""
ADDRESS: Final = 'history.replaceState(null, "", "#" + said.data.text[0])'
# `opened` is set in page.html; before the next task nothing is sent to the server
ASKED: Final = "if (opened.length > 1) setTimeout(() => { asked.data = {text: [opened]} })"
PLACE: Final = "document.getElementById('motion-2').hidden = !cb_obj.visible"
COPY: Final = "navigator.clipboard.writeText(code.text)"


def settings(choice: Choice) -> dict[str, float]:
    """Values of all widgets by their names, in the order in which they are to be set."""
    spread, scene = choice.spread or Spread(), choice.scene
    launch = {"particles": scene.particles, "first": spread.first, "width": spread.width}
    return {"base": BASES.index(scene.base), **choice.inputs, **launch, "periods": choice.periods}


@dataclass(frozen=True)
class Shown:
    """A motion: the choice, and the point that was chosen before the controls were moved."""

    index: int
    of_point: Choice
    choice: Choice

    @property
    def words(self) -> dict[str, str]:
        """What an address says of it: the point, and what the controls changed."""
        before = settings(self.of_point)
        changed = {n: repr(v) for n, v in settings(self.choice).items() if v != before[n]}
        return {"point": str(self.index), **changed}


class Page:
    """The page of one visitor, and its reactions to clicks and moves.

    Parameters
    ----------
    points
        Points of the result.
    document
        Bokeh document of the visitor.
    background
        Thread for computations that would keep the visitor waiting.
    first
        Returns the index of the point that is shown first; by default `moving_point`.
    """

    def __init__(
        self,
        points: Points,
        document: Document,
        background: Background,
        first: Callable[[], int] | None = None,
    ) -> None:
        self.points = points
        self.document = document
        self.background = background
        self.plane = PlaneView(points)
        self.index = points.count // 2  # of the point that was chosen last
        self._pinned: Shown | None = None
        self._begun = False
        self.controls = Controls(points, points.choice(self.index).shortened(), self._moved)
        self.motions = (MotionView("first"), MotionView("second"))
        second = self.motions[1].heading
        second.visible = False
        second.js_on_change("visible", CustomJS(code=PLACE))
        self.rows: NDArray[np.int64] = np.empty(0, np.int64)
        self._waiting: Any = None
        self._shown: list[Choice] = []
        self._scheduled = self._painting = False
        self._of_point = self.controls.choice
        self._build()
        self._listen()
        self._begin(first or partial(moving_point, points))

    def _build(self) -> None:
        self.pickers = {name: picker(self.plane, name) for name in ("x", "y", "colour", "marker")}
        self.pickers["marker"].visible = not self.plane.pixels
        self.status, self.facts = paragraph("status"), paragraph("facts")
        self.selection = paragraph(
            "selection", "Choose realizations for a table with the lasso or the box of the plane."
        )
        self.save = save_button()
        self.holder = ColumnDataSource({"text": [""]})
        # the state of the page, as the address gives it and as an opened address requests it
        self.said, self.asked = (ColumnDataSource({"text": [""]}) for _ in range(2))
        # a browser receives only models that belong to a widget
        self.save.tags = [self.holder, self.said, self.asked]
        self.scale, self.low, self.high = self.scales = scale_pickers(self.plane)
        self.pin = Toggle(label="Pin this motion, to see another beside it", name="pin")
        self.picture = code_picker([PLANE, *PICTURES, "table of the selection"])
        self.code = code_block()
        copy = Button(label="Copy")
        copy.js_on_click(CustomJS(args={"code": self.code}, code=COPY))
        remark = html.escape(self.points.remark)
        note = paragraph("remark", remark)
        note.visible = bool(remark)
        self.left = [
            picker_row("pickers", self.pickers.values()),
            picker_row("scales", self.scales),
            self.plane.figure,
            self.status,
            note,
            self.pin,
            self.controls.layout,
            self.selection,
            self.save,
        ]
        lines_of = row(self.picture, copy, styles={**WRAP, "align-items": "end"}, name="lines of")
        self.right = [self.facts, lines_of, self.code]

    def _listen(self) -> None:
        for name, menu in self.pickers.items():
            menu.on_change("value", self._picked(name, {option[0] for option in menu.options}))
        plot = self.plane.figure
        plot.on_event(Tap, self._tapped)
        plot.on_event(SelectionGeometry, self._selected)
        self.picture.on_change("value", lambda attribute, old, new: self._show_code())
        self.save.on_click(self._save)
        self.holder.js_on_change(
            "data", CustomJS(args={"holder": self.holder, "name": TABLE}, code=DOWNLOAD)
        )
        for one in self.scales:
            one.on_change("value", self._scaled)
        self.pin.on_change("active", lambda attribute, old, new: self._pin(bool(new)))
        plot.on_event(RangesUpdate, lambda event: self._say())
        self.said.js_on_change("data", CustomJS(args={"said": self.said}, code=ADDRESS))
        self.asked.on_change("data", lambda attribute, old, new: self._restore(new))
        if self.plane.pixels or self.plane.regular:
            for view in (plot.x_range, plot.y_range):
                view.on_change("start", self._view_changed)
                view.on_change("end", self._view_changed)
            plot.on_change("inner_width", self._view_changed)

    def attach(self) -> None:
        """Put the page into the document."""
        places = fill(self.document, self.left, self.motions, self.right)
        self.document.js_on_event(DocumentReady, CustomJS(args={"asked": self.asked}, code=ASKED))
        self.document.title = self.points.heading
        self.document.template = TEMPLATE
        self.document.template_variables.update(places)

    def _tapped(self, event: Any) -> None:
        if are_numbers(event.x, event.y):
            self.click(event.x, event.y)

    def click(self, x: float, y: float) -> None:
        """Show the realization at a place of the plane, at a point or between points."""
        index, near = self.plane.hit((x, y))
        axes = (self.plane.x, self.plane.y)
        free = all(name in INPUTS and name in self.points.varied for name in axes)
        if near or not free:
            self.select_point(index)
            return
        inputs = {
            name: self.controls.clamped(name, value)
            for name, value in zip(axes, (x, y), strict=True)
        }
        self.controls.set(self.controls.choice.with_inputs(**inputs))
        self._show("a place between the points")

    def select_point(self, index: int) -> None:
        """Show the realization of a point."""
        self._take(index)
        self._show(f"point {index} of {self.points.count}")

    def _take(self, index: int) -> None:
        """Set the controls to a point."""
        self._begun = True
        self.controls.set(self.points.choice(index).shortened())
        self.index, self._of_point = index, self.controls.choice

    def _begin(self, first: Callable[[], int]) -> None:
        """Show the first point, unless an address that was opened has chosen another."""
        future = self.background.call(first)
        wait([future], AT_ONCE)

        def begin() -> None:
            if not self._begun:
                self.select_point(self.index if future.exception() else future.result())

        if future.done():
            begin()
        else:
            self.status.text = PREPARING
            self._after(future, begin)

    @property
    def shown(self) -> Shown:
        """The motion that the controls show."""
        return Shown(self.index, self._of_point, self.controls.choice)

    def _pin(self, active: bool) -> None:
        """Keep the motion that is shown as the second one, or no longer."""
        self._pinned = self.shown if active else None
        self._show(self._what)

    def _scaled(self, attribute: str, old: Any, new: Any) -> None:
        """Colour the plane as the visitor chooses."""
        kind = self.scale.value if self.scale.value in SCALES else SCALES[0]
        low, high = (v if are_numbers(v) else None for v in (self.low.value, self.high.value))
        if Scale(kind, low, high) != self.plane.wish:
            self.plane.wish = Scale(kind, low, high)
            with self._one_message():
                self.plane.recolour()
                self._say()

    def _say(self) -> None:
        """Put the state of the page into its address."""
        plane, wish = self.plane, self.plane.wish
        state = {name: getattr(plane, name) for name in ("x", "y", "colour")}
        state |= {} if plane.marker == NO_MARKER else {"marker": plane.marker}
        state |= {} if wish.kind == SCALES[0] else {"scale": wish.kind}
        ends = {"from": wish.low, "to": wish.high}
        state |= {name: repr(end) for name, end in ends.items() if end is not None}
        if plane.window != plane.whole:
            state["window"] = ",".join(map(repr, plane.window))
        if self._pinned is not None:
            state["pinned"] = urlencode(self._pinned.words)
        self.said.data = {"text": [urlencode({**state, **self.shown.words})]}

    def _restore(self, data: Any) -> None:
        """Restore the state that an address requests; invalid entries change nothing."""
        texts = data.get("text")
        sent = isinstance(texts, list) and len(texts) == 1 and isinstance(texts[0], str)
        asked = dict(parse_qsl(texts[0].lstrip("#"))) if sent else {}
        for name, menu in self.pickers.items():
            menu.value = asked.get(name, menu.value)
        if asked.get("scale") in SCALES:
            self.scale.value = asked["scale"]
        for name, field in (("from", self.low), ("to", self.high)):
            field.value = _number(asked.get(name, ""))
        window = [_number(end) for end in asked.get("window", "").split(",")]
        if len(window) == len(self.plane.whole) and is_window(*window):
            for view, start, end in zip(self.plane.views, window[::2], window[1::2], strict=True):
                view.update(start=start, end=end)
        if "pinned" in asked:
            self._restore_motion(dict(parse_qsl(asked["pinned"])))
            self.pin.active = True
        self._restore_motion(asked)
        self._show("the state in the address")

    def _restore_motion(self, asked: Mapping[str, str]) -> None:
        """Set the controls to the motion that an address requests."""
        index = _number(asked.get("point", ""))
        if index is not None and index in range(self.points.count):
            self._take(int(index))
        for name in settings(self.controls.choice):
            value = _number(asked.get(name, ""))
            # a duration in seconds stays one, though it has more periods at a higher frequency
            if value is not None and value != settings(self.controls.choice)[name]:
                self.controls.set(self.controls.after(name, value))

    def _moved(self) -> None:
        """Show the choice of the controls once all messages that have arrived are processed."""
        if not self._scheduled:
            self._scheduled = True
            self.document.add_next_tick_callback(self._follow)

    def _follow(self) -> None:
        self._scheduled = False
        self._show("the settings of the controls")

    @contextmanager
    def _one_message(self) -> Iterator[None]:
        self.document.hold("combine")
        try:
            # Bokeh collects all models again after each new one, and that takes most of the time
            with self.document.models.freeze():
                yield
        finally:
            self.document.unhold()

    def _mark(self) -> None:
        """Put the ring where the shown motion is in the plane, if that is known."""
        for shown, pinned in ((self.shown, False), (self._pinned, True)):
            axes = (self.plane.x, self.plane.y)
            places = [None if shown is None else self._place(name, shown) for name in axes]
            self.plane.mark(*places, pinned=pinned)

    def _place(self, name: str, shown: Shown) -> float | None:
        choice = shown.choice
        if choice.lasting(1.0) == shown.of_point.lasting(1.0):
            return float(self.plane.values(name)[shown.index])
        if name == LAUNCHED and choice.scene.particles == 1:
            return choice.launch_time[0]
        return choice.scene.inputs.get(name)  # not known: a measure, which the result may not hold

    def _show(self, what: str) -> None:
        """Show the choice of the controls, once it is computed."""
        self._what = what
        self._mark()
        self._say()
        choice = self.controls.choice
        second = self._pinned is None and bool(self.controls.both.active)
        if second and choice.scene.base == SPRUNG:
            choice = choice.over(HIGH_BOUNCE)
        shown = [choice]
        if self._pinned is not None:
            shown.append(self._pinned.choice)
        elif second:
            shown.append(choice.over(MOVING if choice.scene.base == HIGH_BOUNCE else HIGH_BOUNCE))
        self._shown = shown
        self._stop_waiting()
        future = self.background.call(lambda: [one.simulate() for one in shown])
        wait([future], AT_ONCE)
        with self._one_message():
            if future.done():
                self._draw(future, shown, what)
            else:
                self.status.text, self.facts.text = PREPARING, ""
                self._after(future, lambda: self._show_late(future, shown, what))

    def _show_late(self, future: Future[Any], shown: list[Choice], what: str) -> None:
        """Show a simulation that took long, unless the visitor has chosen another one since."""
        if self._shown is shown:
            with self._one_message():
                self._draw(future, shown, what)

    def _draw(self, future: Future[Any], shown: list[Choice], what: str) -> None:
        """Draw the simulated motions, or say why they could not be computed."""
        error = future.exception()
        if error is not None:
            self.status.text = f"<b>not computed:</b> {html.escape(str(error))}"
            return
        pinned = ("", "" if self._pinned is None else "pinned: ")
        for motion, record, choice, first in zip(
            self.motions, future.result(), shown, pinned, strict=False
        ):
            motion.show(record, f"{first}{parameters_line(choice)}")
        self.motions[1].heading.visible = len(shown) > 1
        why = html.escape(self.plane.why_no_curves)
        self.status.text = f"<b>Click a point</b> to see its motion. Shown: {what}. {why}"
        self._show_code()
        self._later(shown)

    def _after(self, future: Future[Any], then: Callable[[], object]) -> None:
        """Call a function in the thread of the page once the background has finished."""

        def schedule(done: Future[Any]) -> None:
            if not done.cancelled():
                self.document.add_next_tick_callback(then)

        future.add_done_callback(schedule)

    def _stop_waiting(self) -> None:
        if self._waiting is not None:
            self.document.remove_timeout_callback(self._waiting)
            self._waiting = None

    def _later(self, shown: list[Choice]) -> None:
        """Compute regimes and exponents once the visitor has stopped moving the sliders."""
        self.facts.text = COMPUTING  # replaces the facts of the previous motion

        def compute() -> None:
            self._waiting = None
            future = self.background.call(lambda: "".join(map(facts_html, shown)))

            def show() -> None:
                if self._shown is shown:
                    self.facts.text = future.result()

            self._after(future, show)

        self._waiting = self.document.add_timeout_callback(compute, PATIENCE)

    def _show_code(self) -> None:
        picture = self.picture.value
        if picture == PLANE:
            plane = self.plane
            self.code.text = plane_lines(self.points, plane.x, plane.y, plane.colour)
        elif picture in PICTURES:
            self.code.text = motion_lines(self.controls.choice, picture)
        else:
            self.code.text = table_lines(self.points, TABLE)

    def _picked(self, name: str, options: set[str]) -> Any:
        def picked(attribute: str, old: str, new: str) -> None:
            if new not in options:
                self.pickers[name].value = getattr(self.plane, name)
                return
            setattr(self.plane, name, new)
            with self._one_message():
                if name in ("x", "y"):
                    self.plane.show()
                    self._mark()
                else:
                    if name == "colour":
                        self._unscale()
                    self.plane.recolour()
                self._show_code()
                self._say()

        return picked

    def _unscale(self) -> None:
        """Forget the chosen colours of another quantity."""
        self.plane.wish = AUTOMATIC
        self.scale.value, self.low.value, self.high.value = AUTOMATIC
        for one in self.scales:
            one.visible = not self.points.columns[self.plane.colour].codes

    def _view_changed(self, attribute: str, old: float, new: float) -> None:
        if not self._painting:
            self._painting = True
            self.document.add_timeout_callback(self._paint, PAINT_DELAY)

    def _paint(self) -> None:
        self._painting = False
        self.plane.paint()

    def _selected(self, event: Any) -> None:
        x, y = (self.plane.values(name) for name in (self.plane.x, self.plane.y))
        rows = enclosed(event.geometry, x, y) if event.final else None
        if rows is None:
            return
        self.rows = rows
        self.save.disabled = not self.rows.size
        self.selection.text = self._selection_html()

    def _selection_html(self) -> str:
        count = self.rows.size
        if not count:
            return "No point was chosen."
        shown = table(self.points, self.rows[:SHOWN_ROWS]).splitlines()
        rows = [f"<td>{'</td><td>'.join(line.split(','))}</td>" for line in shown]
        more = f"and {count - SHOWN_ROWS} more" if count > SHOWN_ROWS else ""
        body = "</tr><tr>".join(rows)
        return f"<b>{count} points are chosen</b><table><tr>{body}</tr></table>{more}"

    def _save(self) -> None:
        self.holder.data = {"text": [table(self.points, self.rows)]}


def _number(text: str) -> float | None:
    """Return a finite number, or None for any other text."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if are_numbers(value) else None
