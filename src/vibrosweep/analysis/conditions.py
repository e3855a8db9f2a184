"""Conditions on a realization, each a function of measured variables."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.analysis.requirements import require
from vibrosweep.errors import ParameterError
from vibrosweep.model.measures import MEASURE_OF, VARIABLES

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NAMES", "Condition", "Locked", "named"]


@dataclass(frozen=True)
class Condition:
    """A condition on what was measured of a realization.

    Attributes
    ----------
    name
        Name in messages and files.
    holds
        Function from a dataset with dim ``realization`` to booleans, one per realization.  The
        dataset holds the variables named below, the physical parameters as coordinates, and the
        attribute ``particles``.
    variables
        The measured variables that `holds` reads.
    sentence
        What it means, in one sentence.

    Examples
    --------
    >>> from vibrosweep.analysis.conditions import Condition
    >>> from vibrosweep.analysis.scene import Scene
    >>> from vibrosweep.analysis.windows import find_windows
    >>> low = Condition("low", lambda ds: ds["rebound_height_max"] < 2.0, ("rebound_height_max",))
    >>> found = find_windows(Scene(duration=12.0), [0.9], [0.5, 1.0, 2.0, 3.0], [low])
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
    def measures(self) -> dict[str, bool]:
        """The measures that an observation must be asked for."""
        return {MEASURE_OF[name]: True for name in self.variables if name in MEASURE_OF}

    def judge(self, dataset: xr.Dataset) -> NDArray[np.bool_]:
        """Tell for each realization of a dataset whether the condition holds.

        Raises
        ------
        DataError
            The dataset lacks a variable that the condition reads.
        ParameterError
            The function does not give one boolean per realization.
        """
        require(dataset, f"condition {self.name}", *self.variables)
        held = np.asarray(self.holds(dataset))
        if held.dtype != np.bool_ or held.shape != (dataset.sizes["realization"],):
            raise ParameterError(
                f"condition {self.name}: its function gave {held.dtype} of shape {held.shape}; it "
                f"must give one boolean per realization"
            )
        return held


@dataclass(frozen=True)
class Locked:
    """The fixed orbit of k forcing periods exists and attracts, whether or not a launch meets it.

    It is found as a fixed point of the map, see `vibrosweep.kernels.fixed`: near the edge of its
    window convergence is too slow for a simulation.
    """

    k: int

    @property
    def name(self) -> str:
        """Name in messages and files."""
        return f"locked({self.k})"

    @property
    def sentence(self) -> str:
        """What it means, in one sentence."""
        return f"The locked orbit with one impact every {self.k} periods exists and attracts."


def _all_particles(*counts: str) -> Callable[[xr.Dataset], object]:
    def holds(dataset: xr.Dataset) -> object:
        return sum(dataset[name].values for name in counts) == dataset.attrs["particles"]

    return holds


NAMED: Final = {
    condition.name: condition
    for condition in (
        Condition(
            "ordered",
            _all_particles("locked_count"),
            ("locked_count",),
            "The orbits of all particles repeat without a rest.",
        ),
        Condition(
            "periodic",
            _all_particles("locked_count", "resting_count"),
            ("locked_count", "resting_count"),
            "The orbits of all particles repeat, with rests or without.",
        ),
        Condition(
            "separated",
            lambda dataset: (dataset["dt_min"] > dataset["contact_time"]).values,
            ("dt_min",),
            "No two landings in the window are closer than the contact time.",
        ),
        Condition(
            "collision_free",
            lambda dataset: dataset["collision_free"].values == 1,
            ("collision_free",),
            "No two particles are on the base at once in the window.",
        ),
        Condition(
            "regular",
            lambda dataset: dataset["lyapunov_max"].values < 0.0,
            ("lyapunov_max",),
            "The largest Lyapunov exponent of every particle is below zero.",
        ),
    )
}
NAMES: Final = ("locked(k)", *NAMED)


def named(name: str) -> Condition | Locked:
    """Return the condition of that name; a ParameterError where there is none."""
    mode = re.fullmatch(r"locked\(([1-9][0-9]{0,8})\)", name)
    if mode:
        return Locked(int(mode[1]))
    if name not in NAMED:
        raise ParameterError(
            f"condition {name!r} is not known; choose from {', '.join(NAMES)} with k = 1, 2, ..."
        )
    return NAMED[name]
