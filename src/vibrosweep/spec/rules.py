"""Rules between the keys of a sweep file: each reports a contradiction and its remedy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np

from vibrosweep.abilities import refusal
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import RANGE, Key, Mistakes, Text, Value, Word
from vibrosweep.model.forcing import (
    FORCINGS,
    INPUTS,
    completed,
    forcing_of,
    only_parameters,
    refuse_large,
)
from vibrosweep.model.measures import MEASURES, Measures
from vibrosweep.model.mount import MASS_RATIO, MASSES, OF_MOUNT, mount_mistakes
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    LAWS,
    MOUNT,
    SPRUNG,
    STAGGERED,
    dimensionless,
    launches,
)
from vibrosweep.model.times import Periods, Time, amount, precedes, unit_of
from vibrosweep.spec.schema import DRAWN, MAX_REALIZATIONS, SampleTable, SceneTable, Steps


@dataclass(frozen=True)
class Range:
    """A parameter is drawn from [low, high], low < high, in the parameter's unit."""

    low: float
    high: float


@dataclass(frozen=True)
class Axis:
    """The distinct values that a parameter takes along an axis of a grid, in its unit."""

    values: tuple[float, ...]


@dataclass(frozen=True)
class RecordSpec:
    """A scene of which every landing is recorded, in addition to the sweep."""

    parameters: dict[str, float]  # what `vibrosweep.model.forcing.inputs_of` names, in their units
    particles: int
    launch: str | tuple[float, ...]  # ``"staggered"`` or the launch times of all particles in s
    duration: Time  # end of the observation
    rebound: str  # one of `vibrosweep.model.parameters.LAWS`
    base: str  # one of `vibrosweep.model.parameters.BASES`


class Setting(NamedTuple):
    """Settings that all realizations share, apart from physical parameters."""

    particles: int = 1
    launch: str | tuple[float, ...] = STAGGERED
    duration: Time = 12.0
    rebound: str = LAWS[0]
    base: str = HIGH_BOUNCE


def kind(sample: SampleTable) -> str:
    """Return the kind of design; a path means ``"table"``."""
    known = isinstance(sample.design, str) and sample.design in (*DRAWN, "grid")
    return str(sample.design) if known else "table"


def setting(name: str, table: SceneTable, shared: Setting, mistakes: Mistakes) -> Setting:
    """Return the settings of the table ``name`` ([scene] or [record]), completed by ``shared``."""
    listed = len(table.launch) if isinstance(table.launch, tuple) else None
    particles = table.particles or listed or shared.particles
    launch = shared.launch if table.launch is None else table.launch
    if table.particles and isinstance(launch, tuple) and len(launch) != particles:
        holder = "scene.launch" if table.launch is None else f"{name}.launch"
        mistakes.add(
            f"{name}.particles",
            (f"contradicts the {len(launch)} launch times of ", Key(holder)),
            particles,
            "give one for each particle",
            involves=[f"{name}.launch", "scene.launch"],
        )
    base, rebound = table.base or shared.base, table.rebound or shared.rebound
    if table.base or table.rebound:
        own = [f"{name}.{key}" for key in ("base", "rebound")]
        wrong = refusal(base, law=rebound)
        if wrong:
            mistakes.add(f"{name}.", wrong, involves=[*own, "scene.base", "scene.rebound"])
    duration = shared.duration if table.duration is None else table.duration
    return Setting(particles, launch, duration, rebound, base)


def check_window(
    begin: Time, end: Time, frequencies: Collection[float], mistakes: Mistakes
) -> None:
    """Report if the window of measures is empty at one of the frequencies, in Hz."""
    if not precedes(begin, end, np.array([*frequencies], np.float64)):
        keys = [
            f"{key}_periods" if isinstance(time, Periods) else key
            for key, time in (("measure.transient", begin), ("scene.duration", end))
        ]
        rule = ("must be less than ", Key(keys[1]), f" = {amount(end)} {unit_of(end)}")
        mistakes.add(keys[0], rule, amount(begin), involves=["scene.duration", *keys])


def check_measures(base: str, measures: Measures, mistakes: Mistakes) -> None:
    """Report measures that cannot be had over a base."""
    for key in MEASURES:
        wrong = refusal(base, measure=key)
        if wrong and getattr(measures, key):
            mistakes.add(f"measure.{key}", wrong, True, involves=["scene.base"])


def check_forcing(scene: SceneTable, sample: SampleTable, mistakes: Mistakes) -> None:
    """Report if the forcing is given in two ways."""
    given: list[tuple[str, str, object]] = [
        (f"{table}.{name}", name, parameters[name])
        for table, parameters in (("scene", scene.parameters), ("sample", sample.parameters))
        for name in FORCINGS
        if name in parameters
    ]
    named = sample.columns or ()
    given += [("sample.columns", name, named) for name in FORCINGS if name in named]
    for key, name, value in given[1:]:
        first, before, _ = given[0]
        if name != before:
            also = Word(f"{before} in {first}", before)
            rule = (f"{name} gives the forcing, and so does ", also)
            mistakes.add(key, rule, value, "keep one of the two", involves=[first])


def check_mount(base: str, scene: SceneTable, sample: SampleTable, mistakes: Mistakes) -> None:
    """Report what is lacking of the mount of a base of finite mass, or is given for another base.

    Columns of a table that the file does not name are judged when the table is read.
    """
    if kind(sample) == "table" and sample.columns is None:
        return
    homes = dict.fromkeys(sample.columns or (), "sample.columns")
    homes |= {name: f"sample.{name}" for name in sample.parameters}
    homes |= {name: f"scene.{name}" for name in scene.parameters}
    involved = [f"{t}.{name}" for t in ("scene", "sample") for name in ("base", *OF_MOUNT)]
    for name, text in mount_mistakes(base, homes).items():
        key = homes.get(name, f"scene.{name}")
        mistakes.add(key, text if key.endswith(name) else f"{name} {text}", involves=involved)


def fixed_numbers(scene: SceneTable, sample: SampleTable, mistakes: Mistakes) -> dict[str, float]:
    """Return the parameters that are given as a number, in [scene] or in [sample], not in both."""
    in_scene, in_sample = scene.parameters, sample.parameters
    for name in in_sample:
        if name in in_scene:
            rule = ("is given as ", Key(f"scene.{name}"), f" = {in_scene[name]} too")
            mistakes.add(f"sample.{name}", rule, in_sample[name], "keep one of the two")
    return {**in_scene} | {n: v for n, v in in_sample.items() if isinstance(v, float)}


def sampled(sample: SampleTable, mistakes: Mistakes) -> dict[str, Range | Axis]:
    """Ranges under a drawn design, axes under a grid; in the order of `INPUTS`."""
    found: dict[str, Range | Axis] = {}
    for name, value in sample.parameters.items():
        if isinstance(value, float):
            continue
        key = f"sample.{name}"
        if kind(sample) == "table":
            mistakes.add(key, "must be a number, because the table lists what is sampled", value)
        elif kind(sample) == "grid":
            found[name] = _axis(key, value, mistakes)
        else:
            found[name] = _range(key, value, kind(sample), mistakes)
    return found


def _axis(key: str, value: tuple[float, ...] | Steps, mistakes: Mistakes) -> Axis:
    if isinstance(value, Steps):
        values = tuple(np.linspace(value.start, value.stop, value.num).tolist())
    else:
        values = value
    if len(set(values)) < len(values):
        mistakes.add(key, "names a value of the axis twice", value, "name each once")
    return Axis(values)


def _range(key: str, value: tuple[float, ...] | Steps, design: str, mistakes: Mistakes) -> Range:
    rule: Text
    if isinstance(value, Steps) or len(value) != 2:
        rule = ("must be a number or ", RANGE, f' under design = "{design}"')
        shown = asdict(value) if isinstance(value, Steps) else value
        mistakes.add(key, rule, shown, 'an axis needs "grid"')
        return Range(0.0, 1.0)
    low, high = value
    allowed = INPUTS[key.partition(".")[2]].allowed
    if low == high:
        rule = f"the range is empty: low must be less than high (allowed: {allowed})"
        mistakes.add(key, rule, value, f"to keep the parameter fixed write the number {low}")
    elif low > high:
        rule = f"the range is reversed: low must be less than high (allowed: {allowed})"
        mistakes.add(key, rule, value, ("write ", Value((high, low))))
    return Range(low, high)


def columns(
    sample: SampleTable, numbers: Collection[str], mistakes: Mistakes
) -> tuple[str, ...] | None:
    """Columns of the table to use; none of them may be a fixed number too."""
    if sample.columns is None:
        return None
    if kind(sample) != "table":
        remedy = 'give its path as the design, as in design = "table.csv"'
        mistakes.add(
            "sample.columns", "needs a table", sample.columns, remedy, involves=["sample.design"]
        )
    for name in sample.columns:
        if name in numbers:
            rule = f"{name} is a fixed number too"
            mistakes.add("sample.columns", rule, sample.columns, "keep one of the two")
    return sample.columns


def realizations(
    sample: SampleTable, spreads: Mapping[str, Range | Axis], mistakes: Mistakes
) -> int | None:
    """Return the number of realizations; None for a table when the file does not state it."""
    key, number, design = "sample.realizations", sample.realizations, kind(sample)
    if design == "table":
        return number
    if design == "grid":
        sizes = [len(axis.values) for axis in spreads.values() if isinstance(axis, Axis)]
        product = math.prod(sizes)
        if number is not None and number != product:
            rule, remedy = f"contradicts the grid, whose axes make {product}", "leave this key out"
            mistakes.add(key, rule, number, remedy, involves=["sample.design"])
        if product > MAX_REALIZATIONS:
            text = f"the grid's axes make {product}, at most {MAX_REALIZATIONS} are allowed"
            mistakes.add(key, text, involves=["sample.design"])
        return product
    if number is None and spreads:
        remedy = (
            "state how many realizations to draw from the ranges, a whole number, at least 1, or "
            "take a grid of values"
        )
        mistakes.add(key, "is missing", remedy=remedy, involves=["sample.design"])
    return number or 1


def record(
    table: SceneTable,
    shared: Setting,
    values: Mapping[str, float],
    varied: Collection[str] | None,
    mistakes: Mistakes,
) -> RecordSpec:
    """Return the recorded scene: [record] over the sweep's own ``values``.

    ``varied`` names the sampled parameters, None where only the table knows them.
    """
    given, own = table.parameters, setting("record", table, shared, mistakes)
    if varied is None:
        rule = "the recorded scene must state what the table samples"
        names = Value(["restitution", "amplitude"])
        remedy: Text = ("name the table's columns, as in ", Key("sample.columns"), " = ", names)
        mistakes.add("record", rule, remedy=remedy, involves=["sample.design", "sample.columns"])
    forcings = [name for name in FORCINGS if name in given]
    if len(forcings) > 1:
        first, second, *_ = forcings
        also = ("gives the forcing, and so does ", Key(f"record.{first}"))
        mistakes.add(f"record.{second}", also, given[second], "keep one of the two")
    # what the record does not take from the sweep: another way to give the same, another base
    replaced = {*FORCINGS} if forcings else set()
    replaced |= {*MASSES} if MASS_RATIO in given else set()
    replaced |= set() if MASSES.keys().isdisjoint(given) else {MASS_RATIO}
    replaced |= {*OF_MOUNT} if own.base != SPRUNG else set()
    for name in varied or ():
        if name in INPUTS and name not in given and name not in replaced:
            state = f"so state the value of the recorded scene (allowed: {INPUTS[name].allowed})"
            mistakes.add(f"record.{name}", f"is missing; the sweep samples it, {state}")
    found = {n: v for n, v in values.items() if n not in replaced} | {**given}
    tables = ("scene", "sample", "record")
    involved = [f"{t}.{name}" for t in tables for name in ("base", *OF_MOUNT)]
    for name, text in mount_mistakes(own.base, found).items():
        mistakes.add(f"record.{name}", text, involves=involved)
    if own.base == SPRUNG:
        found = {"mount_damping": MOUNT["mount_damping"].default, **found}
    return RecordSpec({name: found[name] for name in INPUTS if name in found}, *own)


def check_extremes(
    key: str, spreads: Mapping[str, Collection[float]], shared: Setting, mistakes: Mistakes
) -> None:
    """Report if a realization of the sweep, whose parameters have these values, is too extreme.

    The amplitude may follow from a forcing that makes it too large, and the mass ratio from masses;
    forcing periods may be too many to be counted exactly.
    """
    ends = [sorted({min(values), max(values)}) for values in spreads.values()]
    corners = np.array([*itertools.product(*ends)]).T
    values = completed(dict(zip(spreads, corners, strict=True)))
    # the phase does not affect the number of periods
    arrays = only_parameters(values) | {"phase": np.zeros(corners.shape[1])}
    try:
        refuse_large(values, forcing_of(spreads))
        dimensionless(arrays, shared.duration)
        launches(shared.launch, 1, np.max(arrays["frequency"], keepdims=True))
    except ParameterError as error:
        mistakes.add(f"{key}.", str(error))
