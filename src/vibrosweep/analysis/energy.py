"""The balance of kick and loss, Eq. 26."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from vibrosweep.analysis.records import Array, per_realization, variable
from vibrosweep.analysis.requirements import require
from vibrosweep.analysis.returns import return_points

__all__ = ["energy_balance"]

NEEDS: Final = (
    "landing_time",
    "rebound_velocity",
    "rested",
    "launch_velocity",
    "restitution",
    "amplitude",
    "frequency",
    "phase",
)


def energy_balance(
    record: xr.Dataset, *, since: float = 0.0, impacts: int | None = None
) -> xr.Dataset:
    """Mean kick against mean loss of every particle (Eq. 26).

    Each landing with speed v and kick U = A sin(2 pi f t + phi) is followed by v' = e v + U where
    the particle bounces.  Over n landings the mean kick therefore exceeds the mean loss
    (1 - e) v by exactly (v_last - v_first) / n: nothing over a cycle of a periodic orbit without
    rest.  A rest breaks the balance: the base takes up what v' = e v + U would have been.  The
    balance of energy is <v'^2 - v^2> = 0 over such a cycle.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    since
        Landings from this time on, in s, are taken.
    impacts
        The last so many landings of each particle only, for example those of a cycle.

    Returns
    -------
    xarray.Dataset
        Dims (realization, particle), m s-1 unless said: ``mean_kick``, ``mean_loss``, their
        difference ``balance``, its part ``end_effect`` = (v_last - v_first) / n and its part
        ``rest_effect``, the mean of v' - e v - U where the particle rested, with opposite sign;
        ``energy_balance`` = <v'^2 - v^2> / 2 (m2 s-2), ``balanced_impacts`` and ``rests``.

    Raises
    ------
    DataError
        The record lacks a variable.
    """
    require(record, "energy_balance", *NEEDS)
    one = [_balances(record, i, since, impacts) for i in range(record.sizes["realization"])]
    found = dict(zip(_NAMES, np.moveaxis(np.array(one), 1, 0), strict=True))
    dims = ("realization", "particle")
    return xr.Dataset(
        {
            "mean_kick": variable(dims, found["kick"], "mean kick", "m s-1"),
            "mean_loss": variable(dims, found["loss"], "mean loss (1 - e) v", "m s-1"),
            "balance": variable(dims, found["balance"], "mean kick less mean loss", "m s-1"),
            "end_effect": variable(
                dims, found["end"], "part of the balance from first and last speed", "m s-1"
            ),
            "rest_effect": variable(
                dims, found["rest"], "part of the balance that the base takes up at rests", "m s-1"
            ),
            "energy_balance": variable(
                dims, found["energy"], "mean gain of energy per mass and impact", "m2 s-2"
            ),
            "balanced_impacts": variable(dims, found["n"].astype(np.int64), "landings balanced"),
            "rests": variable(dims, found["rests"].astype(np.int64), "rests among them"),
        }
    )


_NAMES: Final = ("kick", "loss", "balance", "end", "rest", "energy", "n", "rests")


def _balances(record: xr.Dataset, realization: int, since: float, impacts: int | None) -> Array:
    """Shape (quantity, particle), in the order of `_NAMES`."""
    one = record.isel(realization=realization)
    e, amplitude, frequency, phase, speed = (
        float(per_realization(record, name)[realization])
        for name in ("restitution", "amplitude", "frequency", "phase", "launch_velocity")
    )
    time = one["landing_time"].values
    before, after, known = return_points(one["rebound_velocity"].values, speed)
    with np.errstate(invalid="ignore"):
        known &= time >= since
    if impacts is not None:
        known &= np.cumsum(known[:, ::-1], axis=1)[:, ::-1] <= impacts
    kick = amplitude * np.sin(2.0 * np.pi * frequency * time + phase)
    rested = (one["rested"].values == 1) & known
    unabsorbed = np.where(rested, after - e * before - kick, 0.0)
    count = known.sum(axis=1).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = [
            np.sum(np.where(known, values, 0.0), axis=1) / count
            for values in (
                kick,
                (1.0 - e) * before,
                kick - (1.0 - e) * before,
                after - before,
                -unabsorbed,
                (after**2 - before**2) / 2.0,
            )
        ]
    return np.stack([*mean, count, rested.sum(axis=1)])
