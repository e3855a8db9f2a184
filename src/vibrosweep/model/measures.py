"""The registry of measures: key in a sweep file, variables, required measures and cost of each.

Everything that names a measure derives from it: the keys of [measure], the fields of a scene
(`vibrosweep.model.observables.Measures`), the variables of a result, placeholders for values that
could not be computed, the judgements of `vibrosweep verify`, reserved names, and tables in the
docs.  The codes of status and regime are stored as data: a bad realization never ends a sweep.
Records without padding are contiguous ragged arrays of the CF conventions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.restitution_laws import LEAST_VISCOELASTIC

# Least number of landings in the window for a Lyapunov exponent
LANDINGS_OF_AN_EXPONENT: Final = 64


class _Code(IntEnum):
    """A code that a dataset holds, with a sentence that explains it."""

    sentence: str

    # The default is for type checkers, which take Status(1) for a call of this function.
    def __new__(cls, code: int, sentence: str = "") -> Self:
        member = int.__new__(cls, code)
        member._value_, member.sentence = code, sentence
        return member

    @property
    def meaning(self) -> str:
        """Name of the code, as in the ``flag_meanings`` of a dataset."""
        return self.name.lower()


class Status(_Code):
    """Status of the computation of one particle, or the worst status in a realization.

    Attributes
    ----------
    sentence
        Description and advice, in one sentence.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sweep(duration=12.0)
    >>> vs.Status(found.status.item()).sentence
    'The trajectory is known up to the end of the observation.'
    """

    COMPLETED = 0, "The trajectory is known up to the end of the observation."
    BUDGET_EXCEEDED = (
        1,
        "The impact budget ran out: measures cover only the landings found; raise "
        "measure.impact_budget, or shorten scene.duration.",
    )
    NON_FINITE = (
        2,
        "A value became infinite or undefined: the parameters are too extreme for double "
        "precision, whatever the impact budget; lower the forcing or the launch velocity, or take "
        "a mount further from resonance.",
    )
    REFUSED = (
        3,
        "A time is more than 2^51 forcing periods, or the particles land 2^53 times or more, which "
        "cannot be counted exactly; or the amplitude is above 1e30 m s-1, or the mass ratio above "
        "1000; no value is given, and counts are -1: lower the frequency, the forcing or the mass "
        "ratio, take fewer particles, or shorten scene.duration.",
    )


class Regime(_Code):
    """Regime of a particle's orbit at the end of the observation.

    Attributes
    ----------
    sentence
        Meaning of the regime, in one sentence.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sweep(launch=[0.432982], duration=4000.0, regimes=True)
    >>> vs.Regime(found.regime.item()).meaning
    'locked'
    """

    AT_REST = 0, "The particle came to rest for good."
    RESTING = 1, "The orbit repeats exactly and rests at least once in its cycle."
    LOCKED = 2, "The orbit repeats exactly and never rests."
    UNSETTLED = (
        3,
        "No exact repetition was found, but it is not ruled out: the orbit may still be settling; "
        "observe for longer.",
    )
    APERIODIC = (
        4,
        f"No exact repetition was found, and the largest Lyapunov exponent, over "
        f"{LANDINGS_OF_AN_EXPONENT} landings or more, exceeds zero by three standard errors.",
    )


UNDETERMINED: Final = -1
OF_EACH: Final = ", of each particle"  # end of the long name of a statistic of each particle
TRANSIENT_PERIODS: Final = "transient_periods"
# Forcing periods.  A landing phase is rounded to 2**-54, and orbits that contract by 2**-12 or more
# per impact keep the error below the resolution; a smaller separation may be rounding alone.
RESOLUTION: Final = 2.0**-40


@dataclass(frozen=True)
class Variable:
    """One output variable."""

    name: str  # this and the next four as in the dataset
    dims: tuple[str, ...]
    dtype: str
    units: str
    long_name: str
    # (value, meaning) pairs of an integer variable that holds codes
    flags: tuple[tuple[int, str], ...] = ()
    comment: str = ""  # details beyond the long name
    judged: str = "measure"  # its judge in `verify`: a key of `vibrosweep.proof.verifying.JUDGES`
    # True if it is undetermined, or NaN, exactly where the impact budget was too small
    open_by_budget: bool = False
    # Name of a variable that is 0 where no cycle was found, if this one has no value there either
    cycle: str = ""
    per: str = ""  # reference of a rate without unit, such as "impact"

    @property
    def blank(self) -> float:
        """Value for a realization that was not computed: NaN, undetermined, or its status."""
        if np.dtype(self.dtype).kind == "f":
            return math.nan
        codes = [code for code, _ in self.flags]
        return Status.REFUSED if codes and UNDETERMINED not in codes else UNDETERMINED

    @property
    def attributes(self) -> dict[str, Any]:
        """CF attributes."""
        attributes: dict[str, Any] = {"long_name": self.long_name}
        if self.flags:
            attributes["flag_values"] = np.array([f[0] for f in self.flags], dtype=self.dtype)
            attributes["flag_meanings"] = " ".join(f[1] for f in self.flags)
        else:
            attributes["units"] = self.units
        if self.per:
            attributes["per"] = self.per
        if self.comment:
            attributes["comment"] = self.comment
        return attributes

    @property
    def label(self) -> str:
        """Name, with the unit of its numbers."""
        unit = f"per {self.per}" if self.per else "" if self.units == "1" else self.units
        return f"{self.name} ({unit})" if unit else self.name


@dataclass(frozen=True)
class Measure:
    """A key of [measure] and its variables."""

    meaning: str  # description in a few words
    cost: str  # approximate time per landing that it adds, over short and long observations
    variables: tuple[Variable, ...]  # variables of the result
    requires: tuple[str, ...] = ()  # keys of other measures that are taken with it
    # True if it requires particles that a base of finite mass couples, False if it requires
    # independent particles, None if it works for both
    coupled: bool | None = None


@dataclass(frozen=True)
class Option:
    """A number in [measure]."""

    meaning: str  # description in a few words
    units: str
    allowed: str  # the range in words
    accepts: Callable[[float], bool]  # the range as a function of a finite number


_R = ("realization",)
_RP = ("realization", "particle")
_RPI = ("realization", "particle", "impact")
_UNDECIDED = ((UNDETERMINED, "undetermined"),)
_STATUS = tuple((int(s), s.meaning) for s in Status)
_AFTER = "of the flights that follow the landings in the window; NaN if there are none"
_APEX = "greatest heights above the mean level of the base, v^2 / 2g in the high-bounce limit,"
_WITHOUT = "0 where no recurrence was found"
_NO_ORBIT = "-1 where no recurrence was found"
_BOUND = (
    "relative to the exact model; infinite where rounding may have changed a decision, NaN where "
    "the impact budget ran out; whether a landing falls before or after the beginning of the "
    "window is not judged"
)


# A variable has one number for each realization, unless `more` gives other `dims`.
def _real(name: str, units: str, long_name: str, comment: str = "", **more: Any) -> Variable:
    dims = more.pop("dims", _R)
    return Variable(name, dims, "float64", units, long_name, comment=comment, **more)


def _exponent(name: str, long_name: str, comment: str, **more: Any) -> Variable:
    return _real(name, "1", long_name, comment, per="impact", **more)


def _count(name: str, long_name: str, comment: str = "", **more: Any) -> Variable:
    dims = more.pop("dims", _R)
    return Variable(name, dims, "int64", "1", long_name, comment=comment, **more)


def _code(
    name: str, long_name: str, flags: tuple[tuple[int, str], ...], comment: str = "", **more: Any
) -> Variable:
    return Variable(name, more.pop("dims", _R), "int8", "1", long_name, flags, comment, **more)


def _measure(meaning: str, cost: str, *variables: Variable, **more: Any) -> Measure:
    return Measure(meaning, cost, variables, **more)


def _by_name(*variables: Variable) -> Mapping[str, Variable]:
    return {variable.name: variable for variable in variables}


# Statistics of the landings in the window, [transient, duration], of all particles or of each
_STATISTICS: Final = (
    _count("impact_count", "landings", judged="total"),
    _count("rest_count", "landings after which the particle rested", judged="total"),
    _real("rebound_height_mean", "m", "mean rebound height", f"{_APEX} {_AFTER}"),
    _real(
        "rebound_height_max",
        "m",
        "maximum rebound height",
        f"{_APEX} {_AFTER}; the launch is left out",
        judged="greatest",
    ),
    _real("flight_time_mean", "s", "mean flight time", f"from lift-off to landing, {_AFTER}"),
)

ALWAYS: Final = (
    *_STATISTICS,
    _count(
        "at_rest_count",
        "particles that came to rest for good",
        "over a base of finite mass: only if its motion at the end shows that it lifts none of "
        "them",
        judged="total",
    ),
    _real(
        "flight_height_max", "m", "maximum height of any flight", "launches in the window included"
    ),
    _code(
        "status",
        "worst status of the particles",
        _STATUS,
        " ".join(f"{s.meaning}: {s.sentence}" for s in Status),
        judged="greatest",
    ),
)


MEASURES: Final[Mapping[str, Measure]] = {
    "separation": _measure(
        "time between landings of different particles, and whether two were on the base at once",
        "10 ns over 12 periods, 2 ns over 1000",
        _real(
            "dt_min",
            "s",
            "smallest separation",
            "between landings of different particles; NaN if there are no two of them, or where "
            "the impact budget ran out",
        ),
        _code(
            "dt_min_resolved",
            "dt_min is above the resolution of the arithmetic",
            (*_UNDECIDED, (0, "below_resolution"), (1, "resolved")),
            f"below {RESOLUTION:.1g} forcing periods, rounding alone can merge two particles",
            judged="resolved",
        ),
        _real(
            "dt_min_same_index",
            "s",
            "smallest separation between landings of different particles with equal impact number",
            "numbered from the launch; NaN if the window has no two of them",
        ),
        _code(
            "base_shared",
            "two particles were on the base at once",
            (*_UNDECIDED, (0, "never"), (1, "shared")),
            "at some instant of the window; a stay lasts from landing to lift-off, at least the "
            "contact time, and may begin before the window",
            open_by_budget=True,
        ),
        _code(
            "collision_free",
            "no two particles were ever on the base at once",
            (*_UNDECIDED, (0, "collisions"), (1, "collision_free")),
            judged="negation",
        ),
    ),
    "per_particle": _measure(
        "the same statistics of each particle",
        "3 ns over 12 periods, next to nothing over 1000; disk",
        *(
            replace(
                v,
                name=f"particle_{v.name}",
                dims=_RP,
                long_name=v.long_name + OF_EACH,
                judged="measure",
            )
            for v in _STATISTICS
        ),
        _code(
            "particle_at_rest",
            "the particle came to rest for good",
            (*_UNDECIDED, (0, "bouncing"), (1, "at_rest")),
            dims=_RP,
        ),
        _code("particle_status", "status of the particle", _STATUS, dims=_RP),
    ),
    "regimes": _measure(
        "regime and cycle of the orbit of each particle",
        "20 ns over 12 periods, 2 ns over 1000",
        *(
            _count(
                f"{regime.meaning}_count",
                f"particles whose regime is {regime.meaning}",
                regime.sentence,
                judged="regime_count",
            )
            for regime in Regime
            if regime != Regime.AT_REST  # always counted
        ),
        _count(
            "uncertain_cycle_count",
            "particles whose cycle may be due to rounding",
            "see cycle_uncertain",
            judged="uncertain_count",
        ),
        _code(
            "regime",
            "regime of the particle's orbit",
            (*_UNDECIDED, *((int(r), r.meaning) for r in Regime)),
            " ".join(f"{r.meaning}: {r.sentence}" for r in Regime),
            dims=_RP,
            judged="regime",
        ),
        *(
            _count(
                f"cycle_{name}",
                words,
                _WITHOUT,
                dims=_RP,
                judged="cycle",
                cycle="cycle_impacts",
            )
            for name, words in (
                ("impacts", "impacts in a cycle"),
                ("periods", "forcing periods in a cycle"),
                ("rests", "rests in a cycle"),
            )
        ),
        _code(
            "cycle_uncertain",
            "rounding may have changed a decision along the cycle",
            ((UNDETERMINED, "no_cycle"), (0, "certain"), (1, "uncertain")),
            "the error bound of an impact reaches the threshold of rest or a graze: the exact "
            "model may have another cycle",
            dims=_RP,
            judged="uncertain",
        ),
        _real(
            "recurrent_from",
            "s",
            "time by which the orbit had entered its cycle",
            "if the cycle has a rest, the first lift-off from rest; NaN where no recurrence was "
            "found",
            dims=_RP,
            judged="recurrent_from",
        ),
        coupled=False,
    ),
    "lyapunov": _measure(
        "Lyapunov exponents, distinct orbits and slots",
        "50 ns over 12 periods, 3 ns over 1000",
        _exponent(
            "lyapunov_max",
            "largest Lyapunov exponent per impact",
            "over all particles for which it is defined",
            judged="exponent_max",
        ),
        _count("orbit_count", "distinct orbits on which particles settled", judged="orbit_count"),
        _count(
            "slot_count",
            "slots that particles occupy",
            "slots of all orbits, each counted once",
            judged="slot_count",
        ),
        _exponent(
            "lyapunov_largest",
            "largest Lyapunov exponent per impact",
            "from the multipliers of the cycle, else the mean over the landings in the window; "
            "-inf where the regime is resting or at_rest; NaN if there are no landings, and where "
            "the window has a rest but no cycle is known, so that a mean over particles is one "
            "over motion that does not rest",
            dims=_RP,
            judged="exponent",
        ),
        _exponent(
            "lyapunov_largest_error",
            "standard error of the largest Lyapunov exponent per impact",
            "from the means of blocks of impacts; of a cycle, its rounding error, infinite where "
            "the cycle is uncertain",
            dims=_RP,
            judged="exponent_error",
        ),
        _exponent(
            "lyapunov_sum",
            "sum of both Lyapunov exponents per impact",
            "the logarithm of the restitution, over a moving base twice that; -inf and NaN as for "
            "lyapunov_largest",
            dims=_RP,
            judged="exponent_sum",
        ),
        _exponent(
            "lyapunov_sum_error",
            "bound on the rounding error of the sum of both Lyapunov exponents per impact",
            "infinite where the cycle is uncertain",
            dims=_RP,
            judged="exponent_sum_error",
        ),
        _count(
            "orbit",
            "number of the particle's orbit within the realization",
            _NO_ORBIT,
            dims=_RP,
            judged="orbit",
        ),
        _count(
            "slot",
            "slot of the particle: copy of its orbit, shifted by whole periods",
            _NO_ORBIT,
            dims=_RP,
            judged="slot",
        ),
        coupled=False,
        requires=("regimes",),  # the exponents of a cycle are those of its multipliers
    ),
    "trust": _measure(
        "bounds on the errors of landings",
        "40 ns over 12 periods, 30 ns over 1000",
        _real(
            "landing_time_error",
            "s",
            "bound on the error of every landing time",
            _BOUND,
            judged="bound",
            open_by_budget=True,
        ),
        _real(
            "rebound_velocity_error",
            "m s-1",
            "bound on the error of every rebound velocity",
            _BOUND,
            judged="bound",
        ),
        _real(
            "trusted_until",
            "s",
            "time up to which the error of every landing is at most measure.tolerance",
            "the duration if this holds for all landings, NaN if for none; it ends where the "
            "impact budget does",
            dims=_RP,
            judged="trusted_until",
        ),
        coupled=False,
    ),
    "ordering": _measure(
        "order of the landings; always measured over a base of finite mass",
        "25 ns over 12 periods, 17 ns over 1000; nothing over a base of finite mass",
        *(
            _real(
                f"order_{name}",
                "1",
                f"order parameter of the last landings at {words} forcing frequency",
                "absolute value of the mean of exp(2 pi i F t), F that frequency, over the last "
                "landing of each particle; 1: all at one phase; NaN where none has landed, or "
                "where the landings exceed the impact budget",
            )
            for name, words in (
                ("1", "the"),
                ("2", "twice the"),
                ("3", "three times the"),
                ("half", "half the"),
                ("third", "a third of the"),
            )
        ),
        _real(
            "gap_median",
            "s",
            "median time between neighbouring landings of different particles in the last period",
            "NaN if there are no two such landings or more than 4096, or where the landings exceed "
            "the impact budget",
        ),
        _real(
            "gap_min",
            "s",
            "shortest time between neighbouring landings of different particles in the last period",
            "NaN as for gap_median",
        ),
        _count(
            "order_changes",
            "landings out of turn",
            "of another particle than the one whose last landing was longest ago; particles that "
            "land at one instant do so in the order of their numbers; -1 where the landings exceed "
            "the impact budget",
        ),
    ),
    "undecided": _measure(
        "decisions that rounding may have changed over a base of finite mass; always measured "
        "there",
        "nothing",
        _count(
            "undecided_count",
            "decisions that rounding may have changed",
            "between bouncing and sticking, or landing and passing, where the difference is below "
            "1e-12 of the speed of lift-off",
            judged="recomputed",
        ),
        coupled=True,
    ),
    "joint": _measure(
        "orbit on which the joint state of all particles and a base of finite mass settles",
        "as much as the landings themselves",
        _code(
            "joint_regime",
            "regime of the joint state",
            (*_UNDECIDED, *((int(r), r.meaning) for r in Regime)),
            "as for a particle, but of the state of all particles and the base; see regime",
            judged="recomputed",
        ),
        *(
            _count(
                f"joint_cycle_{name}",
                f"{words} in a cycle of the joint state",
                comment,
                judged="recomputed",
                cycle="joint_cycle_impacts",
            )
            for name, words, comment in (
                (
                    "impacts",
                    "impacts of all particles",
                    f"the shortest cycle whose rounds differ by rounding only; {_WITHOUT}",
                ),
                ("periods", "forcing periods", _WITHOUT),
                ("rests", "rests", _WITHOUT),
            )
        ),
        _real(
            "joint_recurrent_from",
            "s",
            "time by which the joint state had entered its cycle",
            "NaN where no recurrence was found",
            judged="recomputed",
        ),
        _real(
            "joint_exponent",
            "1",
            "largest Lyapunov exponent of the joint state per forcing period",
            "mean over the window; NaN if a sixteenth of it has no event",
            judged="recomputed",
            per="period",
        ),
        _real(
            "joint_exponent_error",
            "1",
            "standard error of the largest Lyapunov exponent of the joint state per forcing period",
            "from slow oscillations of the growth rate and the scatter of sixteenths of the window",
            judged="recomputed",
            per="period",
        ),
        coupled=True,
    ),
    "impact_speed": _measure(
        "greatest speed of impact, and whether the law of restitution holds there; always measured "
        'with restitution_law = "viscoelastic"',
        "0.1 ns over 12 periods, next to nothing over 1000",
        _real(
            "impact_speed_max",
            "m s-1",
            "greatest speed of impact",
            "relative to the base, of the landings in the window; NaN if there are none",
        ),
        _code(
            "law_in_range",
            "every impact is within the range of the law of restitution",
            (*_UNDECIDED, (0, "outside"), (1, "inside")),
            "of the landings in the window: outside where the viscoelastic law gives "
            f"e(v) < {LEAST_VISCOELASTIC:g}; other laws hold at any speed",
            judged="in_range",
        ),
    ),
}
OPTIONS: Final[Mapping[str, Option]] = {
    "transient": Option(
        "beginning of the window that measures cover",
        "s",
        "a number, finite and at least 0 s",
        lambda time: time >= 0.0,
    ),
    "tolerance": Option(
        "error of a landing time up to which it is trusted",
        "s",
        "a number, finite and above 0 s",
        lambda error: error > 0.0,
    ),
    "impact_budget": Option(
        "impacts after which a particle is abandoned, rounded up to a multiple of 6",
        "1",
        "a whole number of impacts per particle, at least 1 and at most 2**62",
        lambda number: 1 <= number <= 2**62,
    ),
    TRANSIENT_PERIODS: Option(
        "the same in forcing periods, instead of `transient`",
        "1",
        "a number of forcing periods, finite and at least 0",
        lambda number: number >= 0.0,
    ),
}

# Every variable that a sweep may measure
VARIABLES: Final = _by_name(*ALWAYS, *(v for m in MEASURES.values() for v in m.variables))
# Key of each variable that is not always measured
MEASURE_OF: Final[Mapping[str, str]] = {
    v.name: key for key, measure in MEASURES.items() for v in measure.variables
}
# Variables with one number for each realization
OF_REALIZATIONS: Final[Mapping[str, Variable]] = {
    name: variable for name, variable in VARIABLES.items() if variable.dims == _R
}


def known(name: str, held: Mapping[Any, Any]) -> NDArray[np.bool_]:
    """Return where a variable holds a value, not a placeholder.

    A placeholder is NaN, `UNDETERMINED`, or 0 for a cycle that was not found.  `held` is a dataset,
    or arrays by name, of a sweep.  In other variables, such as a label of a table, only NaN is a
    placeholder.
    """
    values, variable = np.asarray(held[name]), VARIABLES.get(name)
    if values.dtype.kind == "f":
        return np.asarray(~np.isnan(values))
    if variable is None:
        return np.ones(values.shape, np.bool_)
    if variable.cycle in held:
        return np.asarray((values != UNDETERMINED) & (np.asarray(held[variable.cycle]) > 0))
    return np.asarray(values != UNDETERMINED)


# Variables of a record
RECORD: Final = _by_name(
    _real("landing_time", "s", "time of landing", dims=_RPI),
    _real(
        "liftoff_time",
        "s",
        "time of lift-off",
        "equal to the landing time unless the particle rests, and then perhaps after the end "
        "of the observation; NaN if it rests for good, or until more than a forcing period past "
        "the end",
        dims=_RPI,
    ),
    _real(
        "rebound_velocity",
        "m s-1",
        "velocity at lift-off, upwards",
        "absolute, not relative to the base; negative if the particle leaves a falling base "
        "downwards; NaN where the time of lift-off is NaN",
        dims=_RPI,
    ),
    _code(
        "rested",
        "the particle rested after the landing",
        ((0, "bounced"), (1, "rested")),
        dims=_RPI,
    ),
    _count("impact_count", "landings of the particle", dims=_RP),
    _code("status", "status of the particle", _STATUS, dims=_RP),
)

# Further variables of each landing in results of `simulate`
IMPACTS: Final = _by_name(
    _real(
        "impact_phase",
        "1",
        "phase of the forcing at landing, turns",
        "-1/2 to 1/2, 0 where the velocity of the base rises through zero; computed from the "
        "landing time and its rounding",
        dims=_RPI,
    ),
    _real(
        "arrival_speed",
        "m s-1",
        "velocity of arrival, downwards",
        "absolute, not relative to the base; negative if the base hits a rising particle",
        dims=_RPI,
    ),
)

# Names in a result that a label of a table may not take
RESERVED: Final = frozenset(
    {*VARIABLES}
    | {"realization", "particle", "impact", "launch_time", "duration", "transient", "record"}
    | {"noise_stream"}
    | {"identity", "base", "forcing", "duration_periods", TRANSIENT_PERIODS}
)


IN_FILE: Final = "record"  # the group of a result file that holds a record
LANDING: Final = "landing"
SAMPLES: Final = "sample_dimension"
# Dims of a rectangle, and the dims of a ragged record that replace them
RAGGED_DIMS: Final[Mapping[tuple[str, ...], tuple[str, ...]]] = {
    RECORD["landing_time"].dims: (LANDING,),
    RECORD["impact_count"].dims: ("trajectory",),
}
# Variables that identify trajectories, with their meaning
OF_TRAJECTORIES: Final[Mapping[str, str]] = {
    "realization_index": "position of the realization",
    "particle_index": "number of the particle",
}
MOST_WASTED: Final = 2.0  # places per landing

Column = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]  # dims, values, attributes


def ragged_columns(
    found: Mapping[str, NDArray[Any]],
    variables: Mapping[str, Variable],
    particles: int,
    prefix: str = "",
) -> dict[str, Column]:
    """Return the columns of a ragged record, with all landings in one list.

    An attribute of the counts names the dimension of landings, with `prefix` before it.
    """
    places = np.divmod(np.arange(found["impact_count"].size), particles)
    of_trajectories = RAGGED_DIMS[RECORD["impact_count"].dims]
    columns: dict[str, Column] = {
        name: (of_trajectories, place, {"long_name": text, "units": "1"})
        for (name, text), place in zip(OF_TRAJECTORIES.items(), places, strict=True)
    }
    for name, variable in variables.items():
        dims, attributes = RAGGED_DIMS.get(variable.dims, variable.dims), {**variable.attributes}
        if name == "impact_count":
            attributes[SAMPLES] = f"{prefix}{LANDING}"
        columns[name] = dims, found[name].ravel(), attributes
    return columns


def counts_agree(count: NDArray[np.int64], *of_landings: NDArray[Any]) -> bool:
    """Return whether ragged arrays hold as many landings as the counts of trajectories say."""
    total = int(count.sum())
    return bool((count >= 0).all()) and all(values.shape == (total,) for values in of_landings)


def padded(values: NDArray[Any], count: NDArray[np.int64]) -> NDArray[Any]:
    """Return a ragged array as a padded rectangle of shape (trajectory, impact)."""
    filled = np.arange(count.max(initial=0)) < count[:, np.newaxis]
    rectangle = np.full(filled.shape, np.nan if values.dtype.kind == "f" else 0, values.dtype)
    rectangle[filled] = values
    return rectangle


def wasted(count: NDArray[np.int64], remedy: str) -> str:
    """Return a remark if more than half of the places of a rectangle are empty, else ""."""
    places, landings = count.size * int(count.max(initial=0)), int(count.sum())
    if places <= MOST_WASTED * landings:
        return ""
    return (
        f"{1.0 - landings / places:.0%} of the {places} places are empty, because particles land "
        f"{landings / count.size:.3g} times on average but up to {count.max()} times: {remedy} "
        f"leaves them out"
    )
