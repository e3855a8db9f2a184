"""Read virtual experiments from TOML files."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Final, NamedTuple

from vibrosweep.errors import ParameterError, SpecError, refuse
from vibrosweep.lab.camera import Camera
from vibrosweep.lab.experiment import WINDOW, Experiment, Variation, with_defaults
from vibrosweep.mistakes import Mistakes
from vibrosweep.scene.keys import (
    MAX_SEED,
    SECTIONS,
    Check,
    Sections,
    flag,
    read_tables,
    whole_number,
)
from vibrosweep.scene.sweep import checked, read_text

MOST_PARTICLES: Final = 1000


class ExperimentSpec(NamedTuple):
    """Content of a valid file: its title, and an experiment for each number of particles."""

    title: str
    experiments: tuple[Experiment, ...]


def read_experiments(path: str | os.PathLike[str]) -> ExperimentSpec:
    """Read and validate the file of a virtual experiment; a SpecError lists all mistakes."""
    source = Path(path)
    mistakes = Mistakes(str(source))
    text = read_text(source)
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise SpecError(f"{source}: is not valid TOML: {error}") from error
    title, tables = read_tables(data, mistakes, _SECTIONS)
    refuse(mistakes)
    given = with_defaults({**data.get("scene", {}), **data.get("measure", {})})
    measure = {name: given.pop(name) for name in WINDOW if name in given}
    default = given.pop("particles", None)
    numbers = tables.get("scene", {}).get("particles", (default,))
    experiments = []
    for number in numbers:
        scene = {"particles": number, **given} if number else given
        described = {"title": str(source), "scene": scene, "measure": measure}
        sweep = checked(described, text, source, mistakes)
        try:
            experiments.append(
                Experiment(
                    sweep.scene,
                    camera=Camera(**tables.get("camera", {})),
                    variation=Variation(**tables.get("variation", {})),
                    **tables.get("trials", {}),
                )
            )
        except ParameterError as error:
            raise SpecError(f"{source}: {error}") from error
    return ExperimentSpec(title or "", tuple(experiments))


def _number(low: float, high: float, units: str, above: bool = False) -> Check:
    def check(value: object) -> float:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if number and (low < value if above else low <= value) and value <= high:  # type: ignore[operator]
            return float(value)  # type: ignore[arg-type]
        least = f"above {low:g}" if above else f"at least {low:g}"
        raise ValueError(f"must be a number {least} and at most {high:g}{units and ' ' + units}")

    return check


_COUNT: Final = whole_number(1, MOST_PARTICLES)


def _particles(value: object) -> tuple[int, ...]:
    if not isinstance(value, list):
        return (_COUNT(value),)
    if value and len(set(map(str, value))) == len(value):
        return tuple(map(_COUNT, value))
    raise ValueError("must be a whole number or a list of different ones")


_SECTIONS: Final[Sections] = {
    "scene": {**SECTIONS["scene"], "particles": _particles},
    "measure": {name: SECTIONS["measure"][name] for name in WINDOW},
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
            ("level_spread", 1.0, "m"),
        )
    },
    "trials": {
        "repeats": whole_number(1, 1000),
        "seed": whole_number(0, MAX_SEED),
    },
}
