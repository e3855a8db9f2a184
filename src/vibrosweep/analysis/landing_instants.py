"""Phase of the forcing at each landing of a record, and time since another particle's landing."""

from __future__ import annotations

import numpy as np
import xarray as xr

from vibrosweep.analysis.records import table
from vibrosweep.analysis.requirements import require
from vibrosweep.store.arranged import arranged

__all__ = ["landing_phases", "landing_separations"]


def landing_phases(record: xr.Dataset, *, realization: int = 0) -> xr.Dataset:
    """Phase of the forcing at every landing of one realization.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Its position in the record.

    Returns
    -------
    xarray.Dataset
        Dim ``landing``, particle by particle: ``landing_time`` (s), ``phase`` (turns, from 0 to
        1) and ``particle``.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> phases = vs.analysis.landing_phases(vs.simulate()).phase
    >>> bool(((phases >= 0.0) & (phases < 1.0)).all())
    True
    """
    record = arranged(record)
    require(record, "landing_phases", "landing_time", "frequency", "phase")
    one = record.isel(realization=realization)
    time = one["landing_time"].values
    landed = np.isfinite(time)
    particle, time = np.nonzero(landed)[0], time[landed]
    turns = float(one["frequency"]) * time + float(one["phase"]) / (2.0 * np.pi)
    return table(
        "landing",
        landing_time=(time, "time of landing", "s"),
        phase=(turns % 1.0, "phase of landing in turns"),
        particle=(particle, "particle"),
    )


def landing_separations(record: xr.Dataset, *, realization: int = 0) -> xr.Dataset:
    """Time from each landing to the next one, where that is a landing of another particle.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Its position in the record.

    Returns
    -------
    xarray.Dataset
        Dim ``landing``, in the order of time: ``separation`` (s), whose smallest value is
        ``dt_min``; ``landing_time`` (s) and ``particle`` of the later landing,
        ``previous_particle`` of the earlier.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.analysis.landing_separations(vs.simulate(launch_time=[0.0, 0.125]))
    >>> bool((found.particle != found.previous_particle).all())
    True
    """
    record = arranged(record)
    require(record, "landing_separations", "landing_time")
    time = record["landing_time"].isel(realization=realization).values
    landed = np.isfinite(time)
    particle, time = np.nonzero(landed)[0], time[landed]
    order = np.argsort(time, kind="stable")
    particle, time = particle[order], time[order]
    other = particle[1:] != particle[:-1]
    return table(
        "landing",
        separation=(np.diff(time)[other], "time since another particle landed", "s"),
        landing_time=(time[1:][other], "time of landing", "s"),
        particle=(particle[1:][other], "particle"),
        previous_particle=(particle[:-1][other], "particle that landed before"),
    )
