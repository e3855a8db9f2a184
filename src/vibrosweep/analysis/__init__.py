"""Analyses of results and records: each takes a dataset and returns one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibrosweep.waiting import lazily

if TYPE_CHECKING:
    from vibrosweep.analysis.basins import capacity as capacity
    from vibrosweep.analysis.conditions import Condition as Condition
    from vibrosweep.analysis.datasets import require as require
    from vibrosweep.analysis.records import landing_phases as landing_phases
    from vibrosweep.analysis.records import landing_separations as landing_separations
    from vibrosweep.analysis.records import return_map as return_map
    from vibrosweep.analysis.separations import compare_separations as compare_separations
    from vibrosweep.analysis.separations import order_against_chance as order_against_chance
    from vibrosweep.analysis.separations import separation_against as separation_against
    from vibrosweep.analysis.separations import separation_distribution as separation_distribution
    from vibrosweep.analysis.separations import (
        separations_against_chance as separations_against_chance,
    )
    from vibrosweep.analysis.separations import share_against as share_against
    from vibrosweep.store.arranged import flat as flat

# Modules that define the public names
_HOMES: Final = {
    name: f"vibrosweep.{home}"
    for home, names in {
        "analysis.basins": "capacity",
        "analysis.conditions": "Condition",
        "analysis.datasets": "require",
        "analysis.records": "landing_phases landing_separations return_map",
        "analysis.separations": "compare_separations order_against_chance separation_against "
        "separation_distribution separations_against_chance share_against",
        "store.arranged": "flat",
    }.items()
    for name in names.split()
}
__all__ = [*_HOMES]
__getattr__ = lazily(__name__, _HOMES)


def __dir__() -> list[str]:
    return sorted(__all__)
