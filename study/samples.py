"""Random samples for the claims: ranges, contact times, masses, seeds.

The study states none of them.  Ranges, contact times, the law of rebound and the base of finite
mass are choices of this package; a verdict must therefore be the same for all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from study.bases import BASES, HIGH_BOUNCE, SPRUNG
from vibrosweep import LANDINGS_OF_AN_EXPONENT, PARAMETERS, Regime, Status, simulate, sweep
from vibrosweep.errors import DataError

IMPACT_BUDGET: Final = 10_000_000
# Share of the realizations that is computed where every landing is analysed
FOLLOWED: Final = 0.1
TOGETHER: Final = 100  # realizations in a record
FEW: Final = 5  # particles
# Coupled particles cost a thousand times as much as others: an eighth of the realizations
SMALLER: Final = {base: 0.125 if base == SPRUNG else 1.0 for base in BASES}
TAU_C: Final = PARAMETERS["contact_time"].default
# Ranges of restitution (1) and amplitude (m s-1)
RANGES: Final = {"restitution": (0.80, 0.98), "amplitude": (0.2, 3.5)}
NEAR_TABLE_1: Final = {"restitution": (0.85, 0.95), "amplitude": (0.9, 1.5)}
WIDE: Final = {"restitution": (0.5, 0.99), "amplitude": (0.1, 6.0)}
ANY_PHASE: Final = (0.0, 2.0 * np.pi)  # rad: a launch at any phase of the forcing
LAWS: Final = ("rest", "reflect")
# Windows in which landings count, s
WINDOWS: Final = {
    "from the launch on": (0.0, 12.0),
    "the first 30 s left out": (30.0, 42.0),
}
# Particles of 4 g on a base of some kilograms, excited above the resonance of its mount
MOUNT: Final = {"mass_ratio": 0.003, "mount_frequency": 0.37, "mount_damping": 0.05}


@dataclass(frozen=True)
class Plan:
    """Numbers of samples that are computed."""

    threads: int = 1  # the result does not depend on it
    # first_seed, seeds: seeds are first_seed, first_seed + 1, ...; each stands for one random
    # sample
    first_seed: int = 0
    seeds: int = 20
    # Realizations in a sample over this package's ranges; other settings take a part of them
    realizations: int = 200
    bases: tuple[str, ...] = BASES  # bases on which claims are judged, if they concern them

    def random(self) -> list[np.random.Generator]:
        """A source of random numbers for each seed."""
        return [np.random.default_rng(self.first_seed + i) for i in range(self.seeds)]


@dataclass(frozen=True)
class Setting:
    """Conditions of a number: ranges from which samples are drawn, and constants."""

    name: str  # on the page
    # Ends of the ranges of restitution, amplitude (m s-1) and other drawn parameters
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # Law of rebound, contact time (s), parameters that are not drawn
    constants: Mapping[str, Any] = field(default_factory=dict)
    part: float = 0.25  # of the realizations of a plan
    null_model: str = ""  # the model of chance, if a number is compared with one

    def over(self, **ranges: tuple[float, float]) -> Setting:
        """Return the setting with further or other ranges."""
        return replace(self, ranges={**self.ranges, **ranges})

    def with_constants(self, **constants: Any) -> Setting:
        """Return the setting with further or other constants, which are not drawn."""
        ranges = {name: ends for name, ends in self.ranges.items() if name not in constants}
        return replace(self, ranges=ranges, constants={**self.constants, **constants})

    def against(self, null_model: str) -> Setting:
        """Return the setting with the model of chance with which a number is compared."""
        return replace(self, null_model=null_model)

    @property
    def law(self) -> str:
        """Law of rebound, which says what the map does with a negative speed."""
        return str(self.constants.get("rebound", LAWS[0]))

    def drawn(self, plan: Plan, *, scale: float = 1.0) -> dict[str, Any]:
        """Realizations of all seeds, one seed after the other, and the constants.

        `scale` reduces their number for long computations.
        """
        size = max(2, round(plan.realizations * self.part * scale))
        rows = [
            [random.uniform(*ends, size) for ends in self.ranges.values()]
            for random in plan.random()
        ]
        columns = np.concatenate(rows, axis=1)
        return dict(zip(self.ranges, columns, strict=True)) | {**self.constants}


FIRST: Final = Setting("e 0.80 to 0.98, A 0.2 to 3.5 m/s", RANGES, part=1.0)
WIDE_RANGE: Final = Setting("e 0.50 to 0.99, A 0.1 to 6 m/s", WIDE)
_OTHERS: Final = (
    Setting("e 0.85 to 0.95, A 0.9 to 1.5 m/s", NEAR_TABLE_1),
    WIDE_RANGE,
    Setting("contact time 0.03 ms", RANGES, {"contact_time": 3e-5}),
    Setting("contact time 0.3 ms", RANGES, {"contact_time": 3e-4}),
)
REFLECT: Final = Setting("law reflect", RANGES, {"rebound": "reflect"})
TABLE_1: Final = Setting("Table 1", constants={"restitution": 0.9, "amplitude": 1.2})
_MASSES: Final = tuple(
    Setting(f"particle of {mass:g} of the mass of the base", RANGES, {"mass_ratio": mass})
    for mass in (0.001, 0.01)
)


def settings_of(base: str) -> tuple[Setting, ...]:
    """The settings under which a claim is tested; this package's ranges first.

    They include the laws of rebound over the high-bounce base; a moving base has only one.
    """
    more = {HIGH_BOUNCE: (REFLECT,), SPRUNG: _MASSES}
    return (FIRST, *_OTHERS, *more.get(base, ()))


def single(setting: Setting) -> dict[str, Any]:
    """Parameters of the one realization of a setting that draws nothing, in the form of `drawn`."""
    return {
        name: np.array([value]) if name in TABLE_1.constants else value
        for name, value in setting.constants.items()
    }


def laws(base: str, setting: Setting = TABLE_1) -> tuple[Setting, ...]:
    """Return the setting under each law of rebound of a base."""
    if base != HIGH_BOUNCE:
        return (setting,)
    return tuple(
        replace(setting.with_constants(rebound=law), name=f"{setting.name}, law {law}")
        for law in LAWS
    )


def measured(plan: Plan, base: str, parameters: Mapping[str, Any], **keys: Any) -> xr.Dataset:
    """Measure realizations over a base, with further keys of `vibrosweep.sweep`.

    A physical parameter is a number, or an array of shape (realization,); a sprung base gets this
    package's mount unless `parameters` change it.  Raises a DataError if a realization did not
    complete, because claims are judged by all of them.
    """
    drawn, fixed = _split(base, parameters)
    found = sweep(
        design=drawn,
        base=base,
        impact_budget=IMPACT_BUDGET,
        threads=plan.threads,
        progress=False,
        **fixed,
        **keys,
    )
    if np.any(found["status"] != Status.COMPLETED):
        raise DataError(f"{base}: realizations of a sample did not complete")
    return found


def records(
    plan: Plan, base: str, parameters: Mapping[str, Any], **keys: Any
) -> Iterator[xr.Dataset]:
    """Yield records of every landing of drawn realizations, some at a time to save memory.

    Arguments as of `measured`, with further keys of `vibrosweep.simulate`.
    """
    drawn, fixed = _split(base, parameters)
    size = next(iter(drawn.values())).size
    for start in range(0, size, TOGETHER):
        some = {name: values[start : start + TOGETHER] for name, values in drawn.items()}
        yield simulate(**some, base=base, threads=plan.threads, **fixed, **keys)


def _split(base: str, parameters: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the parameters that differ between realizations, and the others, with the mount."""
    every = mount(base) | dict(parameters)
    drawn = {name: values for name, values in every.items() if np.ndim(values)}
    return drawn, {name: value for name, value in every.items() if name not in drawn}


def mount(base: str) -> dict[str, Any]:
    """The mount of this package's base of finite mass; nothing for other bases."""
    return dict(MOUNT) if base == SPRUNG else {}


def irregular(found: xr.Dataset) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Flag realizations with an aperiodic particle, and those in which this is known.

    Both have the shape (realization,).  It is unknown if no particle is aperiodic and one has not
    settled and has too few landings in the window for an exponent.  `found` holds regimes and
    per-particle results.
    """
    few = found["particle_impact_count"].values < LANDINGS_OF_AN_EXPONENT
    unknown = (found["regime"].values == Regime.UNSETTLED) & few
    aperiodic = found["aperiodic_count"].values > 0
    return aperiodic, aperiodic | ~unknown.any(axis=1)


def by_seed(plan: Plan, values: NDArray[Any]) -> NDArray[Any]:
    """Values of drawn realizations as (seed, realization, ...)."""
    return values.reshape(plan.seeds, -1, *values.shape[1:])
