"""Conditions on a realization, each a function of measured variables."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.analysis.requirements import require
from vibrosweep.errors import ParameterError
from vibrosweep.model.functions import digest_of, is_function, plain, source_of
from vibrosweep.model.measures import MEASURE_OF, UNDETERMINED, VARIABLES, Regime, Status, known
from vibrosweep.store.arranged import arranged

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["FAILS", "HOLDS", "NAMES", "UNDETERMINED", "Condition", "Locked", "named"]

Codes = NDArray[np.int64]

FAILS, HOLDS = 0, 1  # codes of a decided condition


@dataclass(frozen=True)
class Condition:
    """A condition on the measured variables of a realization.

    Attributes
    ----------
    name
        Name in messages and files.
    holds
        Function from a dataset with the dimension ``realization`` to booleans, one for each.  The
        dataset holds the variables named below, the physical parameters as coordinates, and the
        attribute ``particles``.  Where one of these variables has no value, or the realization did
        not complete, the condition is undetermined, whatever the function returns; a function that
        decides this itself returns codes instead: `HOLDS`, `FAILS` or `UNDETERMINED`.
    variables
        The measured variables that `holds` reads.
    sentence
        Meaning of the condition, in one sentence.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import Condition
    >>> low = Condition("low", lambda ds: ds["rebound_height_max"] < 2.0, ("rebound_height_max",))
    >>> found = vs.windows(restitution=0.9, amplitude=[0.5, 1.0, 2.0, 3.0], conditions=[low])
    >>> found.condition.values.tolist()
    ['low']
    """

    name: str
    holds: Callable[[xr.Dataset], object]
    variables: tuple[str, ...]
    sentence: str = ""

    def __post_init__(self) -> None:
        unknown = [name for name in self.variables if name not in VARIABLES]
        if unknown:
            raise ParameterError(
                f"condition {self.name}: {unknown[0]} is not a measured variable; choose from "
                f"{', '.join(VARIABLES)}"
            )

    @property
    def code(self) -> str:
        """Name, digest of what the function computes, and its source where Python has it.

        The digest is left out for a function that uses values that could change.  Raises a
        ParameterError for a function with neither digest nor source.
        """
        function: Any = plain(self.holds)
        try:
            digest = (
                digest_of([function], f"condition {self.name}") if is_function(function) else ""
            )
        except ParameterError:
            digest = ""
        source = source_of(function)
        if not (digest or source):
            raise ParameterError(
                f"condition {self.name}: its function has no source and uses values that may "
                f"change, so that a result cannot state it; write it with def in a file"
            )
        return f"{self.name}: {digest}\n{source}".rstrip()

    @property
    def measures(self) -> dict[str, bool]:
        """Keys of the measures that the condition needs."""
        return {MEASURE_OF[name]: True for name in self.variables if name in MEASURE_OF}

    def judge(self, dataset: xr.Dataset) -> Codes:
        """Code for each realization of a dataset: `HOLDS`, `FAILS` or `UNDETERMINED`.

        Raises
        ------
        DataError
            The dataset lacks a variable that the condition reads.
        ParameterError
            The function does not give one boolean per realization.
        """
        dataset = arranged(dataset)
        require(dataset, f"condition {self.name}", *self.variables)
        size, held = dataset.sizes["realization"], np.asarray(self.holds(dataset))
        coded = held.dtype.kind == "i" and np.isin(held, (FAILS, HOLDS, UNDETERMINED)).all()
        if not (held.dtype == np.bool_ or coded) or held.shape != (size,):
            raise ParameterError(
                f"condition {self.name}: its function gave {held.dtype} of shape {held.shape}; it "
                f"must give one boolean per realization"
            )
        if coded:
            return held.astype(np.int64)
        decided = np.ones(size, np.bool_)
        if "status" in dataset:
            decided = dataset["status"].values == Status.COMPLETED
        for name in self.variables:
            decided = decided & known(name, dataset).reshape(size, -1).all(axis=1)
        return np.where(decided, np.where(held, HOLDS, FAILS), UNDETERMINED)


@dataclass(frozen=True)
class Locked:
    """Condition that the fixed orbit of k forcing periods exists and attracts.

    It may hold even if no launch leads to the orbit.  The orbit is found as a fixed point of the
    map (`vibrosweep.kernels.fixed`): near the edge of its window, a simulation would converge too
    slowly.
    """

    k: int

    @property
    def name(self) -> str:
        """Name in messages and files."""
        return f"locked({self.k})"

    @property
    def sentence(self) -> str:
        """Meaning of the condition, in one sentence."""
        return f"The locked orbit with one impact every {self.k} periods exists and attracts."


def _of_particles(holds: NDArray[np.bool_], decided: NDArray[np.bool_]) -> Codes:
    """Code of a condition on all particles; both arrays have shape (realization, particle)."""
    fails = (decided & ~holds).any(axis=1)
    return np.where(fails, FAILS, np.where(decided.all(axis=1), HOLDS, UNDETERMINED))


def _settled(dataset: xr.Dataset) -> NDArray[np.bool_]:
    """Mark particles known to follow an orbit of their regime; (realization, particle)."""
    return np.asarray(known("regime", dataset) & (dataset["regime"].values != Regime.UNSETTLED))


def _in_regimes(*regimes: Regime) -> Callable[[xr.Dataset], object]:
    def holds(dataset: xr.Dataset) -> object:
        return _of_particles(np.isin(dataset["regime"].values, regimes), _settled(dataset))

    return holds


def _regular(dataset: xr.Dataset) -> object:
    decided = _settled(dataset) & known("lyapunov_largest", dataset)
    return _of_particles(dataset["lyapunov_largest"].values < 0.0, decided)


def _separated(dataset: xr.Dataset) -> object:
    """Codes of separation, which holds for a single particle, and if no two particles landed."""
    gap, followed = dataset["dt_min"].values, known("base_shared", dataset)
    holds = np.isnan(gap) | (gap > dataset["contact_time"].values)
    decided = ~np.isnan(gap) | followed | (dataset.attrs["particles"] == 1)
    return _of_particles(holds[:, np.newaxis], decided[:, np.newaxis])


def _collision_free(dataset: xr.Dataset) -> object:
    free = dataset["collision_free"].values
    return np.full_like(free, HOLDS) if dataset.attrs["particles"] == 1 else free


NAMED: Final = {
    condition.name: condition
    for condition in (
        Condition(
            "ordered",
            _in_regimes(Regime.LOCKED),
            ("regime",),
            "The orbits of all particles repeat without a rest.",
        ),
        Condition(
            "periodic",
            _in_regimes(Regime.LOCKED, Regime.RESTING),
            ("regime",),
            "The orbits of all particles repeat, with rests or without.",
        ),
        Condition(
            "separated",
            _separated,
            ("dt_min", "base_shared"),
            "No two landings of different particles are closer than the contact time.",
        ),
        Condition(
            "collision_free",
            _collision_free,
            ("collision_free",),
            "No two particles are on the base at once in the window.",
        ),
        Condition(
            "regular",
            _regular,
            ("regime", "lyapunov_largest"),
            "The largest Lyapunov exponent of every particle is below zero.",
        ),
    )
}
NAMES: Final = ("locked(k)", *NAMED)


def named(name: str) -> Condition | Locked:
    """Return the condition of that name; raise a ParameterError if there is none."""
    mode = re.fullmatch(r"locked\(([1-9][0-9]{0,8})\)", name)
    if mode:
        return Locked(int(mode[1]))
    if name not in NAMED:
        raise ParameterError(
            f"condition {name!r} is not known; choose from {', '.join(NAMES)} with k = 1, 2, ..."
        )
    return NAMED[name]
