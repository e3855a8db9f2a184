"""The record of every landing against the proved trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, repeat
from typing import Any, Final

from vibrosweep.model.measures import RECORD
from vibrosweep.proof.judgement import Judgement, judge
from vibrosweep.proof.reference.results import Impact, Trajectory
from vibrosweep.proof.sample import Sample

# Variables of the record share names with those of the sweep, but not dimensions.
RECORDED: Final = {f"record/{name}": variable for name, variable in RECORD.items()}


def judge_record(
    record: Sample,
    claims: Callable[[float], Mapping[str, float]],
    trajectories: Sequence[Trajectory],
) -> list[Judgement]:
    """Judge every number of a record; `claims` gives largest errors by the size of a number."""
    judged = []
    for particle, trajectory in enumerate(trajectories):
        stored = {name: values[0, particle].tolist() for name, values in record.stored.items()}
        counts = {"impact_count": len(trajectory.impacts), "status": int(trajectory.status)}
        for name, proved in counts.items():
            judged.append(judge(f"record/{name}", particle, stored[name], proved, 0.0))
        # the record must end after the last landing
        impacts = chain(trajectory.impacts, repeat(None))
        for n, impact in zip(range(len(stored["rested"])), impacts, strict=False):
            for name, proved in _landing(impact).items():
                number = float(stored[name][n])
                claim = claims(number)[name]
                found = judge(f"record/{name}", particle, number, proved, claim)
                if found.complaint:
                    found = replace(found, complaint=f"of landing {n + 1} {found.complaint}")
                if impact is not None or found.complaint:
                    judged.append(found)
    return judged


def _landing(impact: Impact | None) -> dict[str, Any]:
    """Return the numbers that a record must hold of a landing; None stands for NaN."""
    if impact is None:
        return {"landing_time": None, "liftoff_time": None, "rebound_velocity": None, "rested": 0}
    return {
        "landing_time": impact.landing_time,
        "liftoff_time": impact.liftoff_time,
        "rebound_velocity": impact.rebound_velocity,
        "rested": int(impact.rested),
    }
