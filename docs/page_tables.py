"""Tables of pages, written from the registry of measures and the table of abilities.

``python docs/page_tables.py`` replaces the tables between their markers.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import Any, Final

from vibrosweep.abilities import ANALYSES, OF_CONSTANT, refusal
from vibrosweep.model.measures import ALWAYS, MEASURES, OF_EACH, OPTIONS, RECORD, Variable
from vibrosweep.model.observables import KEYS
from vibrosweep.model.parameters import BASES, LAWS, NOISE
from vibrosweep.model.restitution_laws import RESTITUTION_LAWS
from vibrosweep.model.shapes import WAVEFORMS

PAGES: Final = ("sweep-files.md", "results.md")
# The name of a variable within a sentence
NAME: Final = re.compile(r"(?<![`\w.])((?<=see )\w+|[a-z]+(_[a-z\d]+)+)(?![`\w])")
LONG: Final = 40  # characters above which a comment is not repeated
_ALL: Final = (*ALWAYS, *(v for measure in MEASURES.values() for v in measure.variables))


def _keys() -> Iterator[str]:
    """Yield the keys of [measure] with their defaults."""
    yield "| key | meaning | default | cost |"
    yield "|---|---|---|---|"
    for key, default in KEYS.items():
        if key in OPTIONS:
            units = "" if OPTIONS[key].units == "1" else f" ({OPTIONS[key].units})"
            value = "" if default is None else f"{default:g}"
            yield f"| `{key}` | {OPTIONS[key].meaning}{units} | {value} | |"
        else:
            measure = MEASURES[key]
            includes = "".join(f"; includes `{other}`" for other in measure.requires)
            yield f"| `{key}` | {measure.meaning}{includes} | false | {measure.cost} |"


def _variables() -> Iterator[str]:
    """Yield every variable under the key that asks for it."""
    yield "| variable | meaning |"
    yield "|---|---|"
    yield from _rows("always", ALWAYS)
    for key, measure in MEASURES.items():
        yield from _rows(f"`{key} = true`", measure.variables)
    yield from _rows("`[record]`", RECORD.values())


def _rows(key: str, variables: Collection[Variable]) -> Iterator[str]:
    yield f"| **{key}** | |"
    by_particle = [v for v in variables if v.long_name.endswith(OF_EACH)]
    if by_particle:
        names = ", ".join(f"`{v.name}`" for v in by_particle)
        yield f"| {names} (particle) | the same variables of each particle |"
    for variable in (v for v in variables if v not in by_particle):
        dim = variable.dims[-1]
        named = [variable.units] * (variable.units != "1") + [dim] * (dim != "realization")
        brackets = f" ({', '.join(named)})" if named else ""
        comment, codes = _comment(variable), []
        for value, name in variable.flags:
            code = f"{value} `{name}`"
            if f"{name}: " in comment:
                comment = comment.replace(f"{name}: ", f"{code}: ")
            else:
                codes.append(code)
        meaning = "; ".join(filter(None, (variable.long_name, ", ".join(codes), comment)))
        meaning = NAME.sub(r"`\g<0>`", meaning)
        yield f"| `{variable.name}`{brackets} | {meaning} |"


def _comment(variable: Variable) -> str:
    """Return the comment of a variable, or a reference to a variable with the same comment."""
    comment = variable.comment
    holders = [v for v in _ALL if len(comment) > LONG and comment in v.comment]
    home = max(holders, key=lambda v: len(v.comment), default=variable)
    return comment if home is variable else f"see `{home.name}`"


def _abilities() -> Iterator[str]:
    """Yield what a base, or noise, does not support."""
    yield f"| | {' | '.join(f'`{base}`' for base in BASES)} | under noise |"
    yield f"|---|{'---|' * len(BASES)}---|"
    for choice in choices():
        ((kind, name),) = choice.items()
        cells = [*(_support(base, choice) for base in BASES), _support_under_noise(choice)]
        shown = name if isinstance(name, str) else name[0]
        what = "restitution_law" if kind == "restitution" else kind
        if set(cells) != {"yes"}:
            yield f"| {what} `{shown}` | {' | '.join(cells)} |"


def _support_under_noise(choice: dict[str, Any]) -> str:
    """Return the bases that support a choice under noise, and the noise that it excludes."""
    quiet = [base for base in BASES if not refusal(base, **choice)]
    pairs = [pair for pair in product(quiet, NOISE) if not refusal(pair[0], noise=pair[1:])]
    noisy = [pair for pair in pairs if not refusal(pair[0], **{"noise": pair[1:], **choice})]
    if not noisy:
        return "no"
    bases = [f"`{base}`" for base in quiet if base in dict(noisy)]
    excluded = {noise for _, noise in pairs} - {noise for _, noise in noisy}
    without = [f"not `{noise}`" for noise in sorted(excluded)]
    return ", ".join((*(bases if len(bases) < len(quiet) else []), *without)) or "yes"


def _support(base: str, choice: dict[str, Any]) -> str:
    """Return yes, no, or the restriction under which a base supports a choice."""
    if refusal(base, **choice):
        return "no"
    return "constant restitution" if choice.get("analysis") in OF_CONSTANT else "yes"


def choices() -> list[dict[str, Any]]:
    """Return each law, waveform, noise, measure and analysis, as a keyword of `refusal`."""
    choices: dict[str, Iterable[Any]] = {"law": LAWS, "restitution": RESTITUTION_LAWS}
    choices |= {"waveform": WAVEFORMS, "noise": [(kind,) for kind in NOISE]}
    choices |= {"measure": MEASURES, "analysis": ANALYSES}
    return [{kind: name} for kind, names in choices.items() for name in names]


# Tables by the names in their markers
TABLES: Final = {
    "keys of measure": "\n".join(_keys()),
    "variables": "\n".join(_variables()),
    "abilities": "\n".join(_abilities()),
}


def insert(text: str) -> str:
    """Replace each table that a page has markers for.

    Raises a ValueError if the page has no markers, or only the first of a pair.
    """
    marked = {name for name in TABLES if f"<!-- begin {name} -->" in text}
    if not marked:
        raise ValueError("there are no markers of tables")
    for name in marked:
        begin, end = f"<!-- begin {name} -->\n", f"\n<!-- end {name} -->"
        before, _, rest = text.partition(begin)
        _, found, after = rest.partition(end)
        if not found:
            raise ValueError(f"there is no {begin.strip()} with its end")
        text = before + begin + TABLES[name] + end + after
    return text


if __name__ == "__main__":
    for page in map(Path(__file__).parent.joinpath, PAGES):
        page.write_text(insert(page.read_text(encoding="utf-8")), encoding="utf-8")
