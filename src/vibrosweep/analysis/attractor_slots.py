"""Number of particles that a base can keep separated: the slots of all attractors."""

from __future__ import annotations

import numpy as np
import xarray as xr

from vibrosweep.analysis.records import variable
from vibrosweep.analysis.requirements import require
from vibrosweep.errors import DataError
from vibrosweep.model.measures import Regime
from vibrosweep.store.arranged import arranged

__all__ = ["capacity"]


def capacity(basins: xr.Dataset) -> xr.Dataset:
    """Count the slots of all attractors that a dense set of launches leads to.

    An attractor that repeats after q forcing periods exists in q copies, shifted by whole periods.
    More particles than there are slots cannot stay separated, however they are launched.  An
    attractor that no launch leads to is not counted: the number is a lower bound that rises with
    the density of the launches.

    Parameters
    ----------
    basins
        Result of `vibrosweep.basins`.

    Returns
    -------
    xarray.Dataset
        ``capacity`` and its part ``capacity_without_rests`` (attractors on which no particle
        rests); ``unsettled_fraction`` of the launches, which found no recurrent orbit; dim
        ``attractor``: ``slots``, 0 for an index that is not a recurrent orbit.

    Raises
    ------
    DataError
        The dataset lacks a variable, or holds basins along a parameter.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import capacity
    >>> plane = vs.basins(launch_velocity=[3.0, 5.0, 10.0], particles=50, duration=2000.0)
    >>> int(capacity(plane).capacity)
    2
    """
    basins = arranged(basins)
    needed = ("regime", "cycle_periods", "cycle_rests", "fraction", "unsettled_fraction")
    require(basins, "capacity", *needed, source="basins")
    if basins["fraction"].dims != ("attractor",):
        raise DataError(
            f"capacity takes basins at one value of {basins.attrs['along']}: compute them with a "
            f"single value"
        )
    orbit = np.isin(basins["regime"].values, (Regime.LOCKED, Regime.RESTING))
    slots = np.where(orbit, basins["cycle_periods"].values, 0).astype(np.int64)
    without = basins["regime"].values == Regime.LOCKED
    return xr.Dataset(
        {
            "capacity": variable((), int(slots.sum()), "slots of all attractors found"),
            "capacity_without_rests": variable(
                (), int(slots[without].sum()), "slots of attractors on which no particle rests"
            ),
            "unsettled_fraction": variable(
                (),
                float(basins["fraction"].values[~orbit].sum() + basins["unsettled_fraction"]),
                "fraction of launches that found no recurrent orbit",
            ),
            "slots": variable(("attractor",), slots, "slots of the attractor"),
        }
    )
