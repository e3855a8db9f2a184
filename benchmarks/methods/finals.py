"""Last landings of fixed problems: stored references, the times that methods found, and errors.

A reference is the time of the last landing of a particle up to the end, as a decimal number with a
bound of its error, proved in ball arithmetic.
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

from flint import arb, ctx

from methods.scenes import Point, Scene
from methods.truth import BITS, trajectories
from vibrosweep.proof.sampling import deviates_of
from vibrosweep.store.writing import provenance, version

HERE = Path(__file__).parents[1]
REFERENCES = HERE / "references.csv"
FINALS = HERE / "finals.csv"
DECIMALS = 34  # significant digits

Row = dict[str, str]

# packages of a method besides Python and numpy; all other methods are compiled by numba
PACKAGES = {
    "SciPy solve_ivp": ("scipy",),
    "heyoka.py": ("heyoka",),
    "diffrax": ("diffrax", "optimistix", "jax", "jaxlib"),
}
COMPILED = ("numba", "llvmlite")


class Reference(NamedTuple):
    """One line of the stored file."""

    scene: str
    particle: int
    launch_time: float  # s
    landings: int  # up to the end
    last_landing: str  # s
    radius: str  # proved bound of its error, s
    bits: int  # of the proof's arithmetic
    deviates: str  # of the particle's impacts, where there is noise


def prove_references(scenes: Iterable[Scene]) -> Iterator[Reference]:
    """The last landing of each particle of each scene's sample."""
    for scene in scenes:
        for case, found in zip(scene.cases, trajectories(scene), strict=True):
            landings, last = len(found.impacts), found.impacts[-1].landing_time
            with ctx.workprec(BITS):
                text = last.mid().str(DECIMALS, radius=False)
                off = float((last - arb(text)).abs_upper())
            radius = f"1e{math.ceil(math.log10(off))}"
            drawn = deviates_of(0, 0.0, case.particle).of_impact
            noisy = range(landings if "kick_noise" in case.parameters else 0)
            deviates = " ".join(repr(drawn(n)[1]) for n in noisy)
            of = (scene.key, case.particle, case.launch, landings)
            yield Reference(*of, text, radius, found.precision_bits, deviates)


def write(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table with its heads."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def read(path: Path) -> list[Row]:
    """Rows of a table."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_references() -> dict[str, list[Reference]]:
    """The stored references by scene."""
    found = defaultdict(list)
    for row in read(REFERENCES):
        numbers = {name: int(row[name]) for name in ("particle", "landings", "bits")}
        kept = Reference(**row | numbers | {"launch_time": float(row["launch_time"])})
        found[kept.scene].append(kept)
    return found


def row_of(point: Point, sizes: Sequence[int]) -> Row:
    """Row of a measured point: settings, time, versions, and the last landings found."""
    known = provenance(point.threads)
    packages = ("numpy", *PACKAGES.get(point.method, ("vibrosweep", *COMPILED)))
    last = [
        times[size - 1] if len(times) >= size else math.nan
        for times, size in zip(point.times, sizes, strict=True)
    ]
    return {
        "scene": point.scene,
        "method": point.method,
        "setting": point.setting,
        "threads": str(point.threads),
        "precision": "binary64",
        "trajectories": str(point.trajectories),
        "impacts": str(point.impacts),
        "ns_per_impact": f"{point.ns_per_impact:.4g}",
        "note": point.note,
        "processor": str(known["cpu"]),
        "date": str(known["created"])[:10],
        "versions": ", ".join(
            [f"Python {known['python']}", *(f"{name} {version(name)}" for name in packages)]
        ),
        "finals": " ".join(repr(float(time)) for time in last),
    }


def keep(rows: list[Row], path: Path = FINALS) -> None:
    """Write rows, and keep stored ones of methods and scenes that were not measured again."""
    new = {(row["scene"], row["method"]) for row in rows}
    stored = read(path) if path.exists() else []
    old = [row for row in stored if (row["scene"], row["method"]) not in new]
    every = rows + old
    write(path, tuple(every[0]), (row.values() for row in every))


def error_of(row: Row, references: Sequence[Reference]) -> float:
    """Largest error of the last landings, s, in exact arithmetic; NaN where one is missing."""
    finals = [float(text) for text in row["finals"].split()]
    if not all(map(math.isfinite, finals)):
        return math.nan
    return max(
        float(abs(Fraction(found) - Fraction(Decimal(kept.last_landing))))
        for found, kept in zip(finals, references, strict=True)
    )
