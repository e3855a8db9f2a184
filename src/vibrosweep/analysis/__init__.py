"""Analyses of results and records: each takes a dataset and returns one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibrosweep.lazy import lazily

if TYPE_CHECKING:
    from vibrosweep.analysis.basins import capacity
    from vibrosweep.analysis.conditions import Condition
    from vibrosweep.analysis.datasets import require
    from vibrosweep.analysis.records import landing_phases, landing_separations, return_map
    from vibrosweep.analysis.separations import (
        compare_separations,
        order_against_chance,
        separation_against,
        separation_distribution,
        separations_against_chance,
        share_against,
    )
    from vibrosweep.store.arranged import flat

__all__ = [
    "Condition",
    "capacity",
    "compare_separations",
    "flat",
    "landing_phases",
    "landing_separations",
    "order_against_chance",
    "require",
    "return_map",
    "separation_against",
    "separation_distribution",
    "separations_against_chance",
    "share_against",
]

_HOMES: Final = {
    "capacity": "vibrosweep.analysis.basins",
    **dict.fromkeys(
        ("order_against_chance", "separations_against_chance"), "vibrosweep.analysis.separations"
    ),
    "Condition": "vibrosweep.analysis.conditions",
    "flat": "vibrosweep.store.arranged",
    **dict.fromkeys(("landing_phases", "landing_separations"), "vibrosweep.analysis.records"),
    "require": "vibrosweep.analysis.datasets",
    "return_map": "vibrosweep.analysis.records",
    **dict.fromkeys(
        ("compare_separations", "separation_against", "separation_distribution", "share_against"),
        "vibrosweep.analysis.separations",
    ),
}
_REPLACED: Final = {
    "Scene": "vibrosweep.windows, bifurcation and basins take its keywords themselves",
    "find_windows": "call vibrosweep.windows, with the keywords of a scene",
}
__getattr__ = lazily(__name__, _HOMES, _REPLACED)


def __dir__() -> list[str]:
    return sorted(__all__)
