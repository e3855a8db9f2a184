"""The balance of kick and loss, Eq. 26."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from vibrosweep.analysis.datasets import require, variable
from vibrosweep.analysis.records import (
    BaseMotion,
    arrival_speeds,
    base_motion,
    moves,
    require_scene,
    restitutions,
)
from vibrosweep.arrays import Array
from vibrosweep.scene.scene import stored
from vibrosweep.store.arranged import arranged

__all__ = ["energy_balance"]

NEEDS: Final = (
    "landing_time",
    "liftoff_time",
    "rebound_velocity",
    "rested",
    "launch_velocity",
    "restitution",
    "amplitude",
    "frequency",
    "phase",
    "gravity",
)


def energy_balance(
    record: xr.Dataset, *, since: float = 0.0, impacts: int | None = None
) -> xr.Dataset:
    """Mean kick and mean loss of every particle, which equation 26 of the study compares.

    Each landing with speed v and kick U = A sin(2 pi f t + phi), or A w of another waveform, is
    followed by v' = e v + U where the particle bounces.  Over n landings the mean kick therefore
    exceeds the mean loss (1 - e) v by exactly (v_last - v_first) / n, which vanishes over a cycle
    of a periodic orbit without rests.  A rest breaks the balance, since v' is then not e v + U.
    The balance of energy over such a cycle is <v'^2 - v^2> = 0.  Under a law of restitution e is
    the restitution of each impact, also in the kick over a moving base, which is (1 + e) times the
    velocity of the base.

    Over a moving base a flight ends at another height and with another speed than it began, so
    that speeds change in flight too.  Energy is conserved in flight: its changes at impacts and
    rests, with the potential energy at the height of the base, sum to zero over any cycle.  Each
    change is the work of the base less the dissipated energy, (1 - e^2) z^2 / 2 at an impact with
    the relative speed z, and z^2 / 2 where the particle comes to rest.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    since
        Landings from this time on, in s, are taken.
    impacts
        Number of last landings of each particle to take, for example those of a cycle.

    Returns
    -------
    xarray.Dataset
        Dims (realization, particle), in m s-1 unless stated: ``mean_kick``, ``mean_loss``, their
        difference ``balance`` and its parts: ``end_effect`` = (v_last - v_first) / n,
        ``flight_effect``, the speed lost in flights, and ``rest_effect``, minus the mean of
        v' - e v - U over rests; ``energy_balance``, the mean gain of energy per mass and impact
        (m2 s-2), <v'^2 - v^2> / 2 over the high-bounce base; ``balanced_impacts`` and ``rests``.
        Over a moving base also ``base_work`` and ``dissipated_energy``, whose difference is the
        gain.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import energy_balance
    >>> record = vs.simulate(launch_time=0.125, duration=500.0)
    >>> bool((abs(energy_balance(record, since=400.0).balance) < 1e-9).all())
    True
    """
    record = arranged(record)
    require_scene(record, "energy_balance")
    require(record, "energy_balance", *NEEDS)
    balances = [_balances(record, i, since, impacts) for i in range(record.sizes["realization"])]
    *means, count, rests = np.moveaxis(np.array(balances), 1, 0)
    dims = ("realization", "particle")
    named = zip(_MEANS.items(), means, strict=True)
    found = {name: variable(dims, values, *words) for (name, words), values in named}
    dissipated = found.pop("dissipated_energy")
    found["balanced_impacts"] = variable(dims, count.astype(np.int64), "landings balanced")
    found["rests"] = variable(dims, rests.astype(np.int64), "rests among them")
    if moves(record):
        work = found["energy_balance"].values + dissipated.values
        found["dissipated_energy"] = dissipated
        found["base_work"] = variable(
            dims, work, "mean work of the base per mass and impact", "m2 s-2"
        )
    return xr.Dataset(found)


# Means over landings, with long name and unit
_MEANS: Final = {
    "mean_kick": ("mean kick", "m s-1"),
    "mean_loss": ("mean loss (1 - e) v", "m s-1"),
    "balance": ("mean kick less mean loss", "m s-1"),
    "end_effect": ("part of the balance from first and last speed", "m s-1"),
    "flight_effect": ("part of the balance from speeds lost in flight", "m s-1"),
    "rest_effect": ("part of the balance that the base takes up at rests", "m s-1"),
    "energy_balance": ("mean gain of energy per mass and impact", "m2 s-2"),
    "dissipated_energy": ("mean dissipation per mass and impact", "m2 s-2"),
}


def _balances(record: xr.Dataset, realization: int, since: float, impacts: int | None) -> Array:
    """Return the means of `_MEANS`, numbers of landings and rests; shape (quantity, particle)."""
    one = record.isel(realization=realization)
    nominal, amplitude, frequency, phase, gravity = (
        float(one[name]) for name in ("restitution", "amplitude", "frequency", "phase", "gravity")
    )
    base = base_motion(one, "energy_balance")
    time, liftoff = one["landing_time"].values, one["liftoff_time"].values
    before, after = arrival_speeds(one, "energy_balance"), one["rebound_velocity"].values
    known = np.isfinite(before) & np.isfinite(after) & (time >= since)
    if impacts is not None:
        known &= np.cumsum(known[:, ::-1], axis=1)[:, ::-1] <= impacts
    relative = before + base.velocity(time)
    e = restitutions(one, np.nan_to_num(np.maximum(relative, 0.0)))
    kick = BaseMotion(amplitude, frequency, phase, waveform=stored(one.attrs)).velocity(time)
    if moves(record):  # the peak velocity of the base is A / (1 + e) with the nominal e
        kick = kick * ((1.0 + e) / (1.0 + nominal))
    rested = (one["rested"].values == 1) & known
    unabsorbed = np.where(rested, after - e * before - kick, 0.0)
    lost = np.zeros_like(before)
    lost[:, 1:] = np.where(known[:, :-1], after[:, :-1] - before[:, 1:], 0.0)
    gain = (after**2 - before**2) / 2.0
    gain += gravity * (base.height(liftoff) - base.height(time))
    kept = np.where(rested, 0.0, e)  # share of the relative speed
    dissipated = (1.0 - kept**2) * relative**2 / 2.0
    count = known.sum(axis=1).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = [
            np.sum(np.where(known, values, 0.0), axis=1) / count
            for values in (
                kick,
                (1.0 - e) * before,
                kick - (1.0 - e) * before,
                after - before - lost,
                lost,
                -unabsorbed,
                gain,
                dissipated,
            )
        ]
    return np.stack([*mean, count, rested.sum(axis=1)])
