"""Keys that have no meaning without another key."""

from __future__ import annotations

from vibrosweep.mistakes import PYTHON, Key, Mistakes, Text
from vibrosweep.model.parameters import NOISE
from vibrosweep.scene.design import GRID, TABLE
from vibrosweep.scene.keys import Tables
from vibrosweep.scene.rules import kind


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
