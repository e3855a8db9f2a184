"""Rules between the keys of a sweep file: each reports a contradiction and its remedy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from vibrosweep.abilities import refusal
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import PYTHON, RANGE, Key, Mistakes, Text, Value, Word
from vibrosweep.model.forcing import (
    FORCINGS,
    INPUTS,
    completed,
    forcing_of,
    only_parameters,
    refuse_extreme,
)
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.mount import MASS_RATIO, MASSES, OF_MOUNT, mount_mistakes
from vibrosweep.model.parameters import (
    MOUNT,
    NOISE,
    OF_RESTITUTION,
    SPRUNG,
    STREAM_PARTICLES,
    STREAMS,
    dimensionless,
    launches,
)
from vibrosweep.model.restitution_laws import CONSTANT, speed_mistakes
from vibrosweep.model.scene_measures import Measures
from vibrosweep.model.times import Periods, Time, amount, precedes, unit_of
from vibrosweep.scene.design import DESIGNS, GRID, TABLE, Axis, Range
from vibrosweep.scene.keys import MAX_REALIZATIONS, Steps, Tables, inputs_in
from vibrosweep.scene.scene import Scene

# The base and the law of restitution, with the parameters that only some of them need
DEPENDENT: Final = ("base", *OF_MOUNT, "restitution_law", *OF_RESTITUTION)
Table = Mapping[str, Any]  # valid values of a table of a sweep file, by key


def kind(sample: Table) -> str:
    """Return the kind of design; a path means ``"table"``."""
    design = sample.get("design", "uniform")
    known = isinstance(design, str) and design in (*DESIGNS, GRID)
    return str(design) if known else TABLE


def settings(name: str, table: Table, shared: Table, mistakes: Mistakes) -> dict[str, Any]:
    """Return the settings of the table ``name`` ([scene] or [record]), completed by ``shared``.

    These are the fields of a `Scene`, apart from its inputs and measures.
    """
    found = {key: table.get(key, value) for key, value in shared.items()}
    launch = found["launch"]
    if "launch" in table and "particles" not in table and isinstance(launch, tuple):
        found["particles"] = len(launch)
    if "particles" in table and isinstance(launch, tuple) and len(launch) != found["particles"]:
        holder = f"{name}.launch" if "launch" in table else "scene.launch"
        mistakes.add(
            f"{name}.particles",
            (f"contradicts the {len(launch)} launch times of ", Key(holder)),
            found["particles"],
            "give one for each particle",
            involves=[f"{name}.launch", "scene.launch"],
        )
    wrong = refusal(found["base"], law=found["rebound"])
    if wrong and not {"base", "rebound"}.isdisjoint(table):
        involved = [f"{t}.{k}" for t in (name, "scene") for k in ("base", "rebound")]
        mistakes.add(f"{name}.", wrong, involves=involved)
    return found


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


def check_measures(
    base: str, noise: Collection[str], measures: Measures, mistakes: Mistakes
) -> None:
    """Report measures that do not work with the base or the noise."""
    for key in MEASURES:
        wrong = refusal(base, measure=key, noise=noise)
        if wrong and getattr(measures, key):
            mistakes.add(f"measure.{key}", wrong, True, involves=["scene.base"])


def check_noise(
    scene: Table, homes: Mapping[str, str], sizes: Mapping[str, int], mistakes: Mistakes
) -> None:
    """Report noise that the base does not support, or too many realizations or particles for it.

    `scene` holds the settings of the scene; `homes` names the table that gives each kind of noise.
    """
    for name, home in homes.items():
        if wrong := refusal(scene["base"], noise=(name,)):
            mistakes.add(f"{home}.{name}", wrong, involves=["scene.base", "record.base"])
    for key, most in (("sample.realizations", STREAMS), ("scene.particles", STREAM_PARTICLES)):
        number = sizes.get(key, 0)
        if homes and number > most:
            rule = f"with noise it must be at most {most}, the number of random sequences"
            mistakes.add(key, rule, number)


def noise_homes(numbers: Table, sample: Table, varied: Collection[str]) -> dict[str, str]:
    """Return the table that gives each kind of noise that is not zero."""
    on = [name for name in NOISE if name in varied or numbers.get(name, 0.0) != 0.0]
    return {name: "sample" if name in sample or name in varied else "scene" for name in on}


def check_forcing(scene: Table, sample: Table, mistakes: Mistakes) -> None:
    """Report a forcing that is given in two ways."""
    given: list[tuple[str, str, object]] = [
        (f"{table}.{name}", name, parameters[name])
        for table, parameters in (("scene", scene), ("sample", sample))
        for name in FORCINGS
        if name in parameters
    ]
    named = sample.get("columns", ())
    given += [("sample.columns", name, named) for name in FORCINGS if name in named]
    for key, name, value in given[1:]:
        first, before, _ = given[0]
        if name != before:
            also = Word(f"{before} in {first}", before)
            rule = (f"{name} gives the forcing, and so does ", also)
            mistakes.add(key, rule, value, "keep one of the two", involves=[first])


def check_given(base: str, law: str, scene: Table, sample: Table, mistakes: Mistakes) -> None:
    """Report parameters that the base or the law of restitution lacks, or does not have.

    If the file does not name the columns of its table, they are checked when the table is read.
    """
    if kind(sample) == TABLE and "columns" not in sample:
        return
    homes = dict.fromkeys(sample.get("columns", ()), "sample.columns")
    homes |= {name: f"sample.{name}" for name in inputs_in(sample)}
    homes |= {name: f"scene.{name}" for name in inputs_in(scene)}
    involved = [f"{t}.{name}" for t in ("scene", "sample") for name in DEPENDENT]
    for name, text in {**mount_mistakes(base, homes), **speed_mistakes(law, homes)}.items():
        key = homes.get(name, f"scene.{name}")
        mistakes.add(key, text if key.endswith(name) else f"{name} {text}", involves=involved)


def fixed_numbers(scene: Table, sample: Table, mistakes: Mistakes) -> dict[str, float]:
    """Return the parameters that are given as numbers; report those that are given twice."""
    in_scene, in_sample = inputs_in(scene), inputs_in(sample)
    for name in in_sample:
        if name in in_scene:
            rule = ("is given as ", Key(f"scene.{name}"), f" = {in_scene[name]} too")
            mistakes.add(f"sample.{name}", rule, in_sample[name], "keep one of the two")
    return {**in_scene} | {n: v for n, v in in_sample.items() if isinstance(v, float)}


def sampled(sample: Table, mistakes: Mistakes) -> dict[str, Range | Axis]:
    """Return the ranges, or under a grid the axes, in the order of `INPUTS`."""
    found: dict[str, Range | Axis] = {}
    for name, value in inputs_in(sample).items():
        if isinstance(value, float):
            continue
        key = f"sample.{name}"
        if kind(sample) == TABLE:
            mistakes.add(key, "must be a number, because the table gives what varies", value)
        elif kind(sample) == GRID:
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


def check_unused(tables: Tables, mistakes: Mistakes, *, every: bool) -> None:
    """Report keys that have no meaning because another key is missing.

    If `every` is False, only keywords are reported: the text that a result of an earlier version
    holds may have such keys.
    """
    scene, sample, measure = (tables.get(name, {}) for name in ("scene", "sample", "measure"))
    design, unless = kind(sample), " as well, or leave it out"
    unused: dict[str, tuple[Text, Text]] = {}
    if "seed" in sample and design in (GRID, TABLE):
        rule = f"nothing is drawn under a {design}"
        unused["sample.seed"] = (rule, "leave it out, or take a design that draws")
    random = NOISE.keys() & {*scene, *sample, *sample.get("columns", ())}
    if "noise_seed" in scene and not random and (design != TABLE or "columns" in sample):
        unused["scene.noise_seed"] = ("nothing is random", f"give {', '.join(NOISE)}{unless}")
    if "tolerance" in measure and "trust" not in measure:
        rule = "bounds the error up to which landings are trusted"
        unused["measure.tolerance"] = (rule, ("give ", Key("measure.trust"), unless))
    for key, (words, remedy) in unused.items():
        table, _, name = key.partition(".")
        if every or PYTHON.key(key) in mistakes.given:
            value = tables[table][name]
            mistakes.add(key, words, value, remedy, involves=["sample.design", "measure.trust"])


def columns(sample: Table, numbers: Collection[str], mistakes: Mistakes) -> tuple[str, ...] | None:
    """Return the columns of the table to use; report those that are also fixed numbers."""
    named: tuple[str, ...] | None = sample.get("columns")
    if named is not None and kind(sample) != TABLE:
        remedy = 'give its path as the design, as in design = "table.csv"'
        involved = ["sample.design"]
        mistakes.add("sample.columns", "needs a table", named, remedy, involves=involved)
    for name in named or ():
        if name in numbers:
            rule = f"{name} is a fixed number too"
            mistakes.add("sample.columns", rule, named, "keep one of the two")
    return named


def realizations(
    sample: Table, spreads: Mapping[str, Range | Axis], mistakes: Mistakes
) -> int | None:
    """Return the number of realizations; None for a table whose length the file does not state."""
    key, number, design = "sample.realizations", sample.get("realizations"), kind(sample)
    if design == TABLE:
        return number
    if design == GRID:
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
    table: Table,
    shared: Table,
    values: Mapping[str, float],
    varied: Collection[str] | None,
    mistakes: Mistakes,
) -> dict[str, Any]:
    """Return the fields of the recorded scene: [record], completed by ``values`` of the sweep.

    ``varied`` names the sampled parameters; None if they are known only from the table.
    """
    given, fields = inputs_in(table), settings("record", table, shared, mistakes)
    base, law = fields["base"], fields["restitution_law"]
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
    # values of the sweep that [record] gives in another way, or that its base or law does not have
    replaced = {*FORCINGS} if forcings else set()
    replaced |= {*MASSES} if MASS_RATIO in given else set()
    replaced |= set() if MASSES.keys().isdisjoint(given) else {MASS_RATIO}
    replaced |= {*OF_MOUNT} if base != SPRUNG else set()
    replaced |= {*OF_RESTITUTION} if law == CONSTANT else set()
    for name in varied or ():
        if name in INPUTS and name not in given and name not in replaced:
            state = f"so state the value of the recorded scene (allowed: {INPUTS[name].allowed})"
            mistakes.add(f"record.{name}", f"is missing; the sweep samples it, {state}")
    found = {n: v for n, v in values.items() if n not in replaced} | {**given}
    tables = ("scene", "sample", "record")
    involved = [f"{t}.{name}" for t in tables for name in DEPENDENT]
    for name, text in {**mount_mistakes(base, found), **speed_mistakes(law, found)}.items():
        mistakes.add(f"record.{name}", text, involves=involved)
    homes = dict.fromkeys(noise_homes(found, {}, ()), "record")
    check_noise(fields, homes, {}, mistakes)
    if base == SPRUNG:
        found = {"mount_damping": MOUNT["mount_damping"].default, **found}
    return {**fields, "inputs": inputs_in(found), "given": frozenset(found)}


def check_extremes(
    key: str, scene: Scene, sampled: Mapping[str, Range | Axis], mistakes: Mistakes
) -> None:
    """Report parameters whose extreme values cannot be computed together.

    The forcing may give too large an amplitude, the masses too large a mass ratio, and a run may
    have more forcing periods than can be counted exactly.
    """
    ends: dict[str, tuple[float, ...]] = {name: (value,) for name, value in scene.inputs.items()}
    ends |= {name: tuple(sorted({*spread.ends})) for name, spread in sampled.items()}
    ends = {name: values for name, values in ends.items() if name not in NOISE}
    corners = np.array([*itertools.product(*ends.values())]).T
    values = completed(dict(zip(ends, corners, strict=True)), scene.waveform)
    # the phase does not affect the number of periods
    arrays = only_parameters(values) | {"phase": np.zeros(corners.shape[1])}
    try:
        refuse_extreme(values, forcing_of(ends), scene.restitution_law)
        dimensionless(arrays, scene.duration)
        launches(scene.launch, 1, np.max(arrays["frequency"], keepdims=True))
    except ParameterError as error:
        mistakes.add(f"{key}.", str(error))
