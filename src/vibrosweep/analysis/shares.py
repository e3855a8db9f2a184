"""Share of realizations, or of replicas under noise, against a parameter."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from vibrosweep.analysis.datasets import (
    completed,
    equal_parts,
    per_realization,
    require,
    shares,
    table,
)
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.mistakes import quoted
from vibrosweep.model.measures import Regime, known
from vibrosweep.store.arranged import flat, require_dataset

__all__ = ["share_against"]

FREE: Final = "collision_free"
OF_SWEEPS: Final = (FREE, *(regime.meaning for regime in Regime))


def share_against(result: xr.Dataset, parameter: str, *, of: str, bins: int = 10) -> xr.Dataset:
    """Share of what a sweep, or a search for windows under noise, finds, against a parameter.

    Parameters
    ----------
    result
        Result of a sweep, or of `vibrosweep.windows` under noise, at one restitution.
    parameter
        Name of a parameter that differs between realizations, such as ``"amplitude"``; of windows,
        the scanned forcing.
    of
        Of a sweep ``"collision_free"``, for realizations in which no two particles share the base,
        or a regime, for particles: ``"at_rest"``, ``"resting"``, ``"locked"``, ``"aperiodic"`` or
        ``"unsettled"``.  Of windows under noise, one of their conditions.
    bins
        Number of bins that hold equally many realizations; a parameter that takes no more values
        has one for each value.  Windows have one for each point of their scan.

    Returns
    -------
    xarray.Dataset
        Dim ``part``: ``share`` with the ends ``share_low`` and ``share_high`` of its 95 % interval
        (Clopper & Pearson 1934), NaN where nothing is known, with coordinates ``{parameter}_low``
        and ``{parameter}_high``, the ends of the bin.  A realization counts as one trial, however
        many particles it has, and counts only if it is known in full.

    Raises
    ------
    DataError
        The result lacks a variable, or the parameter is the same in all realizations.
    ParameterError
        `of` names nothing that the result knows.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import share_against
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, regimes=True, duration=1000.0)
    >>> share_against(sweep, "amplitude", of="locked", bins=5).share.dims
    ('part',)
    """
    require_dataset(result)
    if "scan" in result.dims:
        return _of_windows(result, parameter, of)
    _require_one_of(of, OF_SWEEPS)
    sweep, name = flat(result), of if of == FREE else f"{of}_count"
    require(sweep, "share_against", name, parameter)
    parts, ends = equal_parts(sweep, parameter, bins, "share_against")
    particles = 1.0
    if of != FREE:
        if "particles" not in sweep.attrs:
            raise DataError("share_against needs the number of particles, which the result lacks")
        particles = float(sweep.attrs["particles"])
    decided = known(name, sweep) & completed(sweep)
    held = np.where(decided, per_realization(sweep, name) / particles, 0.0)
    found = shares(*(np.array([v[p].sum() for p in parts]) for v in (held, 1.0 * decided)))
    return _table(found, of).assign_coords(ends)


def _of_windows(windows: xr.Dataset, parameter: str, of: str) -> xr.Dataset:
    """Shares of replicas at the points of a scan."""
    names = ("share", "share_low", "share_high")
    if "share" not in windows:
        raise DataError("share_against takes windows under noise, and there are no shares in these")
    _require_one_of(of, tuple(map(str, np.atleast_1d(windows["condition"].values))))
    if parameter != windows.attrs["forcing"]:
        raise ParameterError(f"parameter = {parameter}: must be {windows.attrs['forcing']}")
    one = windows[[*names]]
    if "condition" in one.dims:
        one = one.sel(condition=of)
    if one.sizes["scan"] != one["share"].size:
        raise DataError(
            "share_against takes one restitution: choose it, as found.isel(restitution=0)"
        )
    scan = one["scan"].variable
    ends = {f"{parameter}_{end}": ("part", scan.values, scan.attrs) for end in ("low", "high")}
    values = [one[name].values.ravel() for name in names]
    return _table((values[0], values[1], values[2]), of).assign_coords(ends)


def _require_one_of(of: str, names: tuple[str, ...]) -> None:
    if of not in names:
        raise ParameterError(f"of = {of!r}: must be {quoted(names)}")


def _table(found: tuple[Array, Array, Array], of: str) -> xr.Dataset:
    words = f"share, {of.replace('_', ' ')}"
    return table(
        "part",
        share=(found[0], words),
        share_low=(found[1], f"lower end of the 95 % interval, {words}"),
        share_high=(found[2], f"upper end of the 95 % interval, {words}"),
    ).assign_attrs(of=of)
