"""Analyses of results and records: each takes a dataset and returns one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibrosweep.lazy import lazily

if TYPE_CHECKING:
    from vibrosweep.analysis.attractor_slots import capacity
    from vibrosweep.analysis.chance import order_against_chance, separations_against_chance
    from vibrosweep.analysis.conditions import Condition
    from vibrosweep.analysis.decay import slot_decay
    from vibrosweep.analysis.energy import energy_balance
    from vibrosweep.analysis.equal_heights import crossings
    from vibrosweep.analysis.heights import heights_against_restitution
    from vibrosweep.analysis.landing_instants import landing_phases, landing_separations
    from vibrosweep.analysis.meetings import first_shared_base
    from vibrosweep.analysis.order import order_of_landings
    from vibrosweep.analysis.preservation import separation_changes
    from vibrosweep.analysis.requirements import require
    from vibrosweep.analysis.returns import return_map
    from vibrosweep.analysis.separations import (
        compare_separations,
        separation_against,
        separation_distribution,
    )
    from vibrosweep.store.arranged import flat

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
    "capacity": "vibrosweep.analysis.attractor_slots",
    **dict.fromkeys(
        ("order_against_chance", "separations_against_chance"), "vibrosweep.analysis.chance"
    ),
    "Condition": "vibrosweep.analysis.conditions",
    "slot_decay": "vibrosweep.analysis.decay",
    "energy_balance": "vibrosweep.analysis.energy",
    "crossings": "vibrosweep.analysis.equal_heights",
    "flat": "vibrosweep.store.arranged",
    **dict.fromkeys(
        ("landing_phases", "landing_separations"), "vibrosweep.analysis.landing_instants"
    ),
    "heights_against_restitution": "vibrosweep.analysis.heights",
    "first_shared_base": "vibrosweep.analysis.meetings",
    "order_of_landings": "vibrosweep.analysis.order",
    "separation_changes": "vibrosweep.analysis.preservation",
    "require": "vibrosweep.analysis.requirements",
    "return_map": "vibrosweep.analysis.returns",
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


def __dir__() -> list[str]:
    return sorted(__all__)
