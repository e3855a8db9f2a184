"""The tables of the README that follow from the registry of measures.

python checks/readme.py            tell whether the README holds them
python checks/readme.py --write    write them into the README
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from pathlib import Path

from vibrosweep.model.measures import MEASURE_OF, MEASURES, OPTIONS, VARIABLES, Measures, Variable

README = Path(__file__).parents[1] / "README.md"


def keys() -> str:
    """Rows of the keys of [measure], between those of the tables beside it."""
    rows = []
    for field in fields(Measures):
        if field.name in OPTIONS:
            option = OPTIONS[field.name]
            unit = "" if option.units == "1" else f", {option.units}"
            rows.append(f"| `{field.name}` | {option.meaning}{unit} | {field.default:g} |")
        else:
            measure = MEASURES[field.name]
            others = "".join(f"; includes `{key}`" for key in measure.requires)
            rows.append(f"| `{field.name}` | {measure.meaning}{others}; {measure.cost} | false |")
    return "\n".join(rows) + "\n"


def _row(variable: Variable) -> str:
    unit = "flag" if variable.flags else variable.units
    codes = ", ".join(f"{code} `{meaning}`" for code, meaning in variable.flags)
    words = "; ".join(text for text in (variable.long_name, variable.comment, codes) if text)
    key = MEASURE_OF.get(variable.name)
    asked = f"`{key}`" if key else "always"
    return f"| `{variable.name}` | {variable.dims[-1]} | {unit} | {asked} | {words} |"


def variables() -> str:
    """Rows of all variables that a sweep may measure."""
    return "\n".join(map(_row, VARIABLES.values())) + "\n"


KEYS = "| `[measure]` | what is measured | |\n"
TITLE = "| variable | of each | unit | key | meaning |\n|---|---|---|---|---|\n"


def written(text: str) -> str:
    """Return the README with the tables as they follow from the registry."""
    head, rest = text.split(KEYS)
    text = head + KEYS + keys() + rest[rest.index("| `[windows]`") :]
    head, rest = text.split(TITLE)
    return head + TITLE + variables() + rest[rest.index("\n\n") + 1 :]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", action="store_true")
    text = README.read_text(encoding="utf-8")
    if parser.parse_args().write:
        README.write_text(written(text), encoding="utf-8")
        return 0
    return int(written(text) != text)


if __name__ == "__main__":
    sys.exit(main())
