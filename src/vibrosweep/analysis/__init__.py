"""Analyses of results and records: each takes a dataset and returns one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibrosweep.lazy import lazily

if TYPE_CHECKING:
    from vibrosweep.analysis.basins import capacity
    from vibrosweep.analysis.conditions import Condition
    from vibrosweep.analysis.datasets import require
    from vibrosweep.analysis.decay import slot_decay
    from vibrosweep.analysis.energy import energy_balance
    from vibrosweep.analysis.equal_heights import crossings
    from vibrosweep.analysis.heights import heights_against_restitution
    from vibrosweep.analysis.meetings import first_shared_base
    from vibrosweep.analysis.order import order_of_landings
    from vibrosweep.analysis.preservation import separation_changes
    from vibrosweep.analysis.records import landing_phases, landing_separations, return_map
    from vibrosweep.analysis.separations import (
        compare_separations,
        order_against_chance,
        separation_against,
        separation_distribution,
        separations_against_chance,
    )
    from vibrosweep.store.rows import flat

__all__ = [
    "Condition",
    "capacity",
    "compare_separations",
    "crossings",
    "energy_balance",
    "first_shared_base",
    "flat",
    "heights_against_restitution",
    "landing_phases",
    "landing_separations",
    "order_against_chance",
    "order_of_landings",
    "require",
    "return_map",
    "separation_against",
    "separation_changes",
    "separation_distribution",
    "separations_against_chance",
    "slot_decay",
]

_HOMES: Final = {
    "capacity": "vibrosweep.analysis.basins",
    **dict.fromkeys(
        ("order_against_chance", "separations_against_chance"), "vibrosweep.analysis.separations"
    ),
    "Condition": "vibrosweep.analysis.conditions",
    "slot_decay": "vibrosweep.analysis.decay",
    "energy_balance": "vibrosweep.analysis.energy",
    "crossings": "vibrosweep.analysis.equal_heights",
    "flat": "vibrosweep.store.rows",
    **dict.fromkeys(("landing_phases", "landing_separations"), "vibrosweep.analysis.records"),
    "heights_against_restitution": "vibrosweep.analysis.heights",
    "first_shared_base": "vibrosweep.analysis.meetings",
    "order_of_landings": "vibrosweep.analysis.order",
    "separation_changes": "vibrosweep.analysis.preservation",
    "require": "vibrosweep.analysis.datasets",
    "return_map": "vibrosweep.analysis.records",
    **dict.fromkeys(
        ("compare_separations", "separation_against", "separation_distribution"),
        "vibrosweep.analysis.separations",
    ),
}
_REPLACED: Final = {
    "Scene": "vibrosweep.windows, bifurcation and basins take its keywords themselves",
    "find_windows": "call vibrosweep.windows, with the keywords of a scene",
}
__getattr__ = lazily(__name__, _HOMES, _REPLACED)
