"""Read virtual experiments from TOML, one for each number of particles."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from vibrosweep.errors import ParameterError, SpecError, refuse
from vibrosweep.lab.camera import Camera
from vibrosweep.lab.experiment import LABORATORY, Experiment, Variation
from vibrosweep.mistakes import Mistakes, nearest
from vibrosweep.model.forcing import (
    FORCINGS,
    INPUTS,
    completed,
    inputs_of,
    only_parameters,
)
from vibrosweep.model.mount import mount_mistakes
from vibrosweep.model.parameters import BASES, HIGH_BOUNCE, LAWS, STAGGERED
from vibrosweep.scene.keys import MAX_SEED, Check, flag, is_plain, one_of
from vibrosweep.scene.sweep import read_text

MOST_PARTICLES: Final = 1000


class ExperimentSpec(NamedTuple):
    """A validated file: its title, and an experiment for each number of particles."""

    title: str
    experiments: tuple[Experiment, ...]


def read_experiments(path: str | os.PathLike[str]) -> ExperimentSpec:
    """Read and validate the file of a virtual experiment; a SpecError lists all mistakes."""
    source = Path(path)
    mistakes = Mistakes(str(source))
    try:
        data = tomllib.loads(read_text(source))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SpecError(f"{source}: is not valid TOML: {error}") from error
    title = data.pop("title", "")
    if not isinstance(title, str) or not is_plain(title):
        mistakes.add("title", "must be one line of text", title)
    tables = {name: _table(name, data.pop(name, {}), mistakes) for name in _KEYS}
    for name, value in data.items():
        mistakes.add(name, f"is not known; known here: title, {', '.join(_KEYS)}", value)
    refuse(mistakes)
    scene = tables["scene"]
    physical = _physical(scene, mistakes)
    numbers = scene.pop("particles", (5,))
    launch = scene.get("launch", STAGGERED)
    if not isinstance(launch, str) and any(number != len(launch) for number in numbers):
        mistakes.add("scene.launch", f"must list a time for each of {list(numbers)} particles")
    refuse(mistakes)
    try:
        experiments = tuple(
            Experiment(
                scene=physical,
                particles=number,
                camera=Camera(**tables["camera"]),
                variation=Variation(**tables["variation"]),
                **scene,
                **tables["trials"],
            )
            for number in numbers
        )
    except ParameterError as error:
        raise SpecError(f"{source}: {error}") from error
    return ExperimentSpec(title, experiments)


def _physical(scene: dict[str, Any], mistakes: Mistakes) -> dict[str, float]:
    """Take the physical parameters out of the table of a scene; defaults are the laboratory's."""
    given = {name: scene.pop(name) for name in INPUTS if name in scene}
    base = scene.get("base", HIGH_BOUNCE)
    for name, text in mount_mistakes(base, given).items():
        mistakes.add(f"scene.{name}", text)
    forcings = [name for name in FORCINGS if name in given]
    if len(forcings) > 1:
        mistakes.add(f"scene.{forcings[1]}", f"{forcings[0]} is given too; keep one of them")
    refuse(mistakes)
    names = inputs_of(given or ["amplitude"], base)
    known = {**{n: p.default for n, p in INPUTS.items()}, **LABORATORY, **given}
    values = completed({name: np.array([known[name]]) for name in names})
    return {name: float(value[0]) for name, value in only_parameters(values).items()}


def _table(name: str, data: object, mistakes: Mistakes) -> dict[str, Any]:
    """Check the keys of a table; what is wrong is noted."""
    if not isinstance(data, Mapping):
        mistakes.add(name, f"must be a table: write [{name}] on a line of its own", data)
        return {}
    sound = {}
    for key, value in data.items():
        known = _KEYS[name]
        if key not in known:
            guess = nearest(key, known)
            hint = f'; did you mean "{guess}"?' if guess else ""
            mistakes.add(
                f"{name}.{key}", f"is not known{hint} Known here: {', '.join(known)}", value
            )
            continue
        try:
            sound[key] = known[key](value)
        except ValueError as error:
            mistakes.add(f"{name}.{key}", error.args, value)
    return sound


def _number(low: float, high: float, units: str, above: bool = False) -> Check:
    def check(value: object) -> float:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if number and (low < value if above else low <= value) and value <= high:  # type: ignore[operator]
            return float(value)  # type: ignore[arg-type]
        least = f"above {low:g}" if above else f"at least {low:g}"
        raise ValueError(f"must be a number {least} and at most {high:g}{units and ' ' + units}")

    return check


def _parameter(name: str) -> Check:
    def check(value: object) -> float:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if number and INPUTS[name].accepts(value):  # type: ignore[arg-type]
            return float(value)  # type: ignore[arg-type]
        raise ValueError(f"must be a number, {INPUTS[name].allowed}")

    return check


def _whole(low: int, high: int) -> Check:
    def check(value: object) -> int:
        if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high:
            return value
        raise ValueError(f"must be a whole number from {low} to {high}")

    return check


def _particles(value: object) -> tuple[int, ...]:
    check = _whole(1, MOST_PARTICLES)
    if isinstance(value, list) and value and len(set(map(str, value))) == len(value):
        return tuple(check(v) for v in value)
    if not isinstance(value, list):
        return (check(value),)
    raise ValueError("must be a whole number or a list of different ones")


def _launch(value: object) -> str | tuple[float, ...]:
    if value == STAGGERED:
        return STAGGERED
    if isinstance(value, list) and value:
        return tuple(_number(-1e6, 1e6, "s")(v) for v in value)
    raise ValueError(f'must be "{STAGGERED}" or a list of launch times in s')


_KEYS: Final[Mapping[str, Mapping[str, Check]]] = {
    "scene": {
        **{name: _parameter(name) for name in INPUTS},
        "base": partial(one_of, BASES),
        "particles": _particles,
        "launch": _launch,
        "rebound": partial(one_of, LAWS),
    },
    "camera": {
        "frame_rate": _number(0.0, 1e6, "Hz", above=True),
        "pixel": _number(0.0, 1.0, "m", above=True),
        "noise": _number(0.0, 100.0, "pixels"),
        "whole_pixels": flag,
        "exposure": _number(0.0, 1.0, "s"),
        "dropped": _number(0.0, 0.9, ""),
        "scale_error": _number(-0.5, 0.5, ""),
    },
    "variation": {
        name: _number(0.0, high, units)
        for name, high, units in (
            ("frequency_jitter", 0.1, ""),
            ("frequency_setting", 0.2, ""),
            ("amplitude_setting", 0.2, ""),
            ("restitution_spread", 0.2, ""),
            ("restitution_exponent", 0.5, ""),
            ("level_spread", 1.0, "m"),
        )
    },
    "trials": {
        "repeats": _whole(1, 1000),
        "transient": _number(0.0, 1e5, "s"),
        "duration": _number(0.0, 1e4, "s", above=True),
        "seed": _whole(0, MAX_SEED),
    },
}
