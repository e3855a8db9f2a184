"""Registry of every variable that a dataset can hold: name, dims, type, unit, meaning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibrosweep.model.status import Regime, Status

__all__ = [
    "LYAPUNOV",
    "OF_REALIZATIONS",
    "PER_PARTICLE",
    "RECORD",
    "REGIMES",
    "RESERVED",
    "RESOLUTION",
    "SWEEP",
    "TRUST",
    "UNDETERMINED",
    "Variable",
]

UNDETERMINED: Final = -1
# Forcing periods.  A landing phase is rounded to 2**-54, and orbits that contract by 2**-12 or more
# per impact keep the error below this; a separation that is smaller may be all rounding.
RESOLUTION: Final = 2.0**-40
_UNDECIDED = ((UNDETERMINED, "undetermined"),)
_STATUS = tuple((int(s), s.meaning) for s in Status)


@dataclass(frozen=True)
class Variable:
    """One output variable.

    Attributes
    ----------
    name, dims, dtype, units, long_name
        As they stand in the dataset.
    flags
        (value, meaning) pairs of an integer variable that holds codes.
    key
        Key of a sweep file that has the variable measured; empty where it always is.
    comment
        What the long name leaves open.
    """

    name: str
    dims: tuple[str, ...]
    dtype: str
    units: str
    long_name: str
    flags: tuple[tuple[int, str], ...] = ()
    key: str = ""
    comment: str = ""

    @property
    def attributes(self) -> dict[str, Any]:
        """CF attributes."""
        attributes: dict[str, Any] = {"long_name": self.long_name}
        if self.flags:
            attributes["flag_values"] = np.array([f[0] for f in self.flags], dtype=self.dtype)
            attributes["flag_meanings"] = " ".join(f[1] for f in self.flags)
        else:
            attributes["units"] = self.units
        if self.comment:
            attributes["comment"] = self.comment
        return attributes


def _registry(*variables: Variable) -> Mapping[str, Variable]:
    return {v.name: v for v in variables}


_R = ("realization",)
_RP = ("realization", "particle")
_RPI = ("realization", "particle", "impact")
_SEPARATION = "measure.separation"
_TRUST = "measure.trust"
_BOUND = (
    "against the exact model; infinite where rounding may have changed a decision, NaN where the "
    "impact budget does not reach the end; on which side of the beginning of the window a landing "
    "falls is not judged"
)
_REGIMES = "measure.regimes"
_LYAPUNOV = "measure.lyapunov"
_WITHOUT = "0 where no recurrence was found"
_AFTER_LANDINGS = "flights that follow the landings in the window; NaN without any"

# Measured once per realization, over the landings in the window [transient, duration].
SWEEP: Final = _registry(
    Variable("impact_count", _R, "int64", "1", "landings of all particles"),
    Variable("rest_count", _R, "int64", "1", "landings after which the particle rested"),
    Variable("at_rest_count", _R, "int64", "1", "particles that came to rest for good"),
    Variable(
        "rebound_height_mean",
        _R,
        "float64",
        "m",
        "mean rebound height",
        comment=_AFTER_LANDINGS,
    ),
    Variable(
        "rebound_height_max",
        _R,
        "float64",
        "m",
        "maximum rebound height",
        comment=_AFTER_LANDINGS + "; the launch is left out",
    ),
    Variable(
        "flight_height_max",
        _R,
        "float64",
        "m",
        "maximum height of any flight",
        comment="the launch is counted where it falls into the window",
    ),
    Variable("flight_time_mean", _R, "float64", "s", "mean flight time", comment=_AFTER_LANDINGS),
    Variable(
        "dt_min",
        _R,
        "float64",
        "s",
        "smallest separation between landings of different particles",
        key=_SEPARATION,
        comment="NaN where no two particles land, or the impact budget does not reach the end",
    ),
    Variable(
        "dt_min_resolved",
        _R,
        "int8",
        "1",
        "dt_min is above the resolution of the arithmetic",
        flags=(*_UNDECIDED, (0, "below_resolution"), (1, "resolved")),
        key=_SEPARATION,
        comment=f"below {RESOLUTION:.1g} forcing periods, rounding alone can make two particles "
        "one: they approach each other without limit, or leave a rest together",
    ),
    Variable(
        "dt_min_same_index",
        _R,
        "float64",
        "s",
        "smallest separation between landings of different particles with equal impact number",
        key=_SEPARATION,
        comment="NaN where no two particles have a landing of the same number in the window",
    ),
    Variable(
        "base_shared",
        _R,
        "int8",
        "1",
        "two particles were on the base at once",
        flags=(*_UNDECIDED, (0, "never"), (1, "shared")),
        key=_SEPARATION,
        comment="each stay lasts from landing to lift-off, at least the contact time",
    ),
    Variable(
        "collision_free",
        _R,
        "int8",
        "1",
        "no two particles were ever on the base at once",
        flags=(*_UNDECIDED, (0, "collisions"), (1, "collision_free")),
        key=_SEPARATION,
    ),
    Variable(
        "landing_time_error",
        _R,
        "float64",
        "s",
        "bound of the error of every landing time",
        key=_TRUST,
        comment=_BOUND,
    ),
    Variable(
        "rebound_velocity_error",
        _R,
        "float64",
        "m s-1",
        "bound of the error of every rebound velocity",
        key=_TRUST,
        comment=_BOUND,
    ),
    *(
        Variable(
            f"{regime.meaning}_count",
            _R,
            "int64",
            "1",
            f"particles whose regime is {regime.meaning}",
            key=_REGIMES,
            comment=regime.sentence,
        )
        for regime in Regime
        if regime != Regime.AT_REST  # always counted
    ),
    Variable(
        "uncertain_cycle_count",
        _R,
        "int64",
        "1",
        "particles whose cycle rounding may have decided",
        key=_REGIMES,
        comment="see cycle_uncertain",
    ),
    Variable("status", _R, "int8", "1", "worst status of the particles", flags=_STATUS),
)

# The same for each particle, where a sweep file asks for it.
PER_PARTICLE: Final = _registry(
    *(
        Variable(
            f"particle_{v.name}",
            _RP,
            v.dtype,
            v.units,
            f"{v.long_name} of each particle",
            key="measure.per_particle",
            comment=v.comment,
        )
        for v in (
            SWEEP["rest_count"],
            SWEEP["rebound_height_mean"],
            SWEEP["rebound_height_max"],
            SWEEP["flight_time_mean"],
        )
    ),
    Variable(
        "particle_impact_count",
        _RP,
        "int64",
        "1",
        "landings of each particle",
        key="measure.per_particle",
    ),
    Variable(
        "particle_at_rest",
        _RP,
        "int8",
        "1",
        "the particle came to rest for good",
        flags=(*_UNDECIDED, (0, "bouncing"), (1, "at_rest")),
        key="measure.per_particle",
    ),
    Variable(
        "particle_status",
        _RP,
        "int8",
        "1",
        "status of the particle",
        flags=_STATUS,
        key="measure.per_particle",
    ),
)

# Up to where the landings of each particle are known.
TRUST: Final = _registry(
    Variable(
        "trusted_until",
        _RP,
        "float64",
        "s",
        "time up to which every landing is known to measure.tolerance",
        key=_TRUST,
        comment="the duration where all are; NaN where none is; no further than the impact budget "
        "reaches",
    ),
)

# What the orbit of each particle has become.
REGIMES: Final = _registry(
    Variable(
        "regime",
        _RP,
        "int8",
        "1",
        "regime of the particle's orbit",
        flags=(*_UNDECIDED, *((int(r), r.meaning) for r in Regime)),
        key=_REGIMES,
        comment="; ".join(f"{r.meaning}: {r.sentence}" for r in Regime),
    ),
    Variable(
        "cycle_impacts", _RP, "int64", "1", "impacts in a cycle", key=_REGIMES, comment=_WITHOUT
    ),
    Variable(
        "cycle_periods",
        _RP,
        "int64",
        "1",
        "forcing periods in a cycle",
        key=_REGIMES,
        comment=_WITHOUT,
    ),
    Variable("cycle_rests", _RP, "int64", "1", "rests in a cycle", key=_REGIMES, comment=_WITHOUT),
    Variable(
        "cycle_uncertain",
        _RP,
        "int8",
        "1",
        "rounding may have changed a decision along the cycle",
        flags=((UNDETERMINED, "no_cycle"), (0, "certain"), (1, "uncertain")),
        key=_REGIMES,
        comment="the bound of the error along the cycle reaches the distance of a landing from "
        "the threshold of rest: the exact model may have another cycle",
    ),
    Variable(
        "recurrent_from",
        _RP,
        "float64",
        "s",
        "time at which the orbit had entered its cycle at the latest",
        key=_REGIMES,
        comment="NaN where no recurrence was found",
    ),
)

# How fast neighbouring orbits part, and which particles share an orbit.
LYAPUNOV: Final = _registry(
    Variable(
        "lyapunov_largest",
        _RP,
        "float64",
        "1",
        "largest Lyapunov exponent per impact",
        key=_LYAPUNOV,
        comment="from the multipliers of the cycle, else the mean over the landings in the window; "
        "-inf where the orbit rests; NaN without landings in the window",
    ),
    Variable(
        "lyapunov_largest_error",
        _RP,
        "float64",
        "1",
        "standard error of the largest Lyapunov exponent",
        key=_LYAPUNOV,
        comment="from the means of blocks of impacts; of a cycle, its rounding error, infinite "
        "where the cycle is uncertain",
    ),
    Variable(
        "lyapunov_sum",
        _RP,
        "float64",
        "1",
        "sum of both Lyapunov exponents per impact",
        key=_LYAPUNOV,
        comment="the logarithm of the restitution, but -inf where the orbit rests; NaN without "
        "landings in the window",
    ),
    Variable(
        "lyapunov_sum_error",
        _RP,
        "float64",
        "1",
        "bound of the rounding error of the sum of both Lyapunov exponents",
        key=_LYAPUNOV,
        comment="infinite where the cycle is uncertain",
    ),
    Variable(
        "orbit",
        _RP,
        "int64",
        "1",
        "number of the particle's orbit within the realization",
        key=_LYAPUNOV,
        comment="-1 where no recurrence was found",
    ),
    Variable(
        "slot",
        _RP,
        "int64",
        "1",
        "which of the copies of its orbit, shifted by whole periods, the particle is on",
        key=_LYAPUNOV,
        comment="-1 where no recurrence was found",
    ),
    Variable(
        "lyapunov_max",
        _R,
        "float64",
        "1",
        "largest Lyapunov exponent per impact of any particle",
        key=_LYAPUNOV,
        comment="of the particles with landings in the window",
    ),
    Variable(
        "orbit_count", _R, "int64", "1", "distinct orbits that particles settled on", key=_LYAPUNOV
    ),
    Variable(
        "slot_count",
        _R,
        "int64",
        "1",
        "distinct slots, of all orbits, that particles occupy",
        key=_LYAPUNOV,
    ),
)

# Every landing, for small scenes.
RECORD: Final = _registry(
    Variable("landing_time", _RPI, "float64", "s", "time of landing"),
    Variable(
        "liftoff_time",
        _RPI,
        "float64",
        "s",
        "time of lift-off",
        comment="equal to the landing unless the particle rests; NaN where it rests for good",
    ),
    Variable(
        "rebound_velocity",
        _RPI,
        "float64",
        "m s-1",
        "speed at lift-off",
        comment="NaN where the particle rests for good",
    ),
    Variable(
        "rested",
        _RPI,
        "int8",
        "1",
        "the particle rested after the landing",
        flags=((0, "bounced"), (1, "rested")),
    ),
    Variable("impact_count", _RP, "int64", "1", "landings of the particle"),
    Variable("status", _RP, "int8", "1", "status of the particle", flags=_STATUS),
)

# What a realization has one number of, whatever asked for it
OF_REALIZATIONS: Final[Mapping[str, Variable]] = {
    name: variable for name, variable in {**SWEEP, **LYAPUNOV}.items() if variable.dims == _R
}

# Names of a result that no label of a table may take
RESERVED: Final = frozenset(
    {*SWEEP, *PER_PARTICLE, *REGIMES, *TRUST, *LYAPUNOV}
    | {"realization", "particle", "impact", "launch_time", "duration", "transient", "record"}
)
