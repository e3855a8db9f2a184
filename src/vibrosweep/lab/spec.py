"""TOML text -> virtual experiments, one for each number of particles; all mistakes at once."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from vibrosweep.errors import SpecError
from vibrosweep.lab.camera import Camera
from vibrosweep.lab.experiment import LABORATORY, Experiment, Variation
from vibrosweep.model.parameters import LAWS, PARAMETERS, STAGGERED
from vibrosweep.spec.messages import Mistakes, nearest, quoted
from vibrosweep.spec.schema import is_plain
from vibrosweep.spec.sweep import read_text

__all__ = ["ExperimentSpec", "read_experiments"]

Check = Callable[[object], Any]

MOST_PARTICLES: Final = 1000


class ExperimentSpec(NamedTuple):
    """A validated file: its title, and an experiment for each number of particles."""

    title: str
    experiments: tuple[Experiment, ...]


def read_experiments(path: str | os.PathLike[str]) -> ExperimentSpec:
    """Read and validate the file of a virtual experiment.

    Raises
    ------
    SpecError
        The file cannot be read, or holds mistakes; all of them are listed.
    """
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
    mistakes.raise_any()
    scene = tables["scene"]
    physical = {name: scene.pop(name, LABORATORY[name]) for name in PARAMETERS}
    numbers = scene.pop("particles", (5,))
    launch = scene.get("launch", STAGGERED)
    if not isinstance(launch, str) and any(number != len(launch) for number in numbers):
        mistakes.add("scene.launch", f"must list a time for each of {list(numbers)} particles")
    mistakes.raise_any()
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
    return ExperimentSpec(title, experiments)


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
            mistakes.add(f"{name}.{key}", str(error), value)
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
        if number and PARAMETERS[name].accepts(value):  # type: ignore[arg-type]
            return float(value)  # type: ignore[arg-type]
        raise ValueError(f"must be a number, {PARAMETERS[name].allowed}")

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


def _flag(value: object) -> bool:
    if isinstance(value, bool):
        return value
    raise ValueError("must be true or false")


def _launch(value: object) -> str | tuple[float, ...]:
    if value == STAGGERED:
        return STAGGERED
    if isinstance(value, list) and value:
        return tuple(_number(-1e6, 1e6, "s")(v) for v in value)
    raise ValueError(f'must be "{STAGGERED}" or a list of launch times in s')


def _rebound(value: object) -> str:
    if isinstance(value, str) and value in LAWS:
        return value
    raise ValueError(f"must be {quoted(LAWS)}")


_KEYS: Final[Mapping[str, Mapping[str, Check]]] = {
    "scene": {
        **{name: _parameter(name) for name in PARAMETERS},
        "particles": _particles,
        "launch": _launch,
        "rebound": _rebound,
    },
    "camera": {
        "frame_rate": _number(0.0, 1e6, "Hz", above=True),
        "pixel": _number(0.0, 1.0, "m", above=True),
        "noise": _number(0.0, 100.0, "pixels"),
        "whole_pixels": _flag,
        "exposure": _number(0.0, 1.0, "s"),
        "dropped": _number(0.0, 0.9, ""),
        "scale_error": _number(-0.5, 0.5, ""),
    },
    "variation": {
        name: _number(0.0, high, "")
        for name, high in (
            ("frequency_jitter", 0.1),
            ("frequency_setting", 0.2),
            ("amplitude_setting", 0.2),
            ("restitution_spread", 0.2),
        )
    },
    "trials": {
        "repeats": _whole(1, 1000),
        "transient": _number(0.0, 1e5, "s"),
        "duration": _number(0.0, 1e4, "s", above=True),
        "seed": _whole(0, 2**63 - 1),
    },
}
