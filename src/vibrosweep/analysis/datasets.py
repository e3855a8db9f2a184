"""Tools of analyses of datasets: required variables, values per realization, bins, CF variables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, count
from vibrosweep.mistakes import cut, nearest
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import MEASURE_OF, RECORD, RESERVED, VARIABLES, Status
from vibrosweep.store.arranged import require_dataset

CONFIDENCE: Final = 0.95


def require(dataset: xr.Dataset, analysis: str, *names: str, source: str = "") -> None:
    """Raise a DataError unless a dataset holds the variables that an analysis needs.

    Parameters
    ----------
    dataset
        Dataset that the analysis takes.
    analysis
        Name of the analysis, as the user calls it.
    names
        Variables and coordinates that the analysis needs.
    source
        The function whose result the analysis takes, unless it takes a sweep or a record.

    Returns
    -------
    None

    Raises
    ------
    DataError
        The dataset lacks one; the message names all that it lacks and how to get each.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> vs.analysis.require(vs.simulate(), "echo", "landing_time")
    """
    require_dataset(dataset)
    if wrong := "" if source else refused_ragged(dataset):
        raise DataError(f"{analysis} {wrong}")
    require_names(analysis, names)
    absent = [name for name in names if name not in dataset.variables]
    if absent and source:
        raise DataError(
            f"{analysis} takes the result of {source}, and the dataset lacks {', '.join(absent)}"
        )
    if absent:
        wanted = "; ".join(f"{name} ({remedy(name)})" for name in absent)
        noun = "variables" if len(absent) > 1 else "variable"
        raise DataError(f"{analysis} needs {noun} that the dataset lacks: {wanted}")


def require_names(analysis: str, names: Iterable[object]) -> None:
    """Raise a DataError for anything but a text in place of the name of a variable."""
    for name in names:
        if not isinstance(name, str):
            raise DataError(f"{analysis}: {cut(repr(name))} is not the name of a variable")


def refused_ragged(dataset: xr.Dataset) -> str:
    """Return the remedy for a ragged record, which only `vibrosweep.rectangle` takes, or "".

    Raises a DataError unless it is given a dataset.
    """
    require_dataset(dataset)
    ragged = "landing" in dataset.dims
    return "takes no ragged record: give it vibrosweep.rectangle(record)" if ragged else ""


def differing(parameter: str) -> str:
    """Return words on a need for realizations that differ in a parameter, and how to get them."""
    return (
        f"realizations that differ in {parameter}: sample it, for example {parameter} = [low, "
        f"high], in the [sample] section of the sweep file"
    )


def remedy(name: str) -> str:
    """Return the way to get a variable that a dataset lacks."""
    if name in MEASURE_OF:
        return f"set {MEASURE_OF[name]} = true in the [measure] section of the sweep file"
    if name == "launch_time" or name in RECORD.keys() - VARIABLES.keys():
        return "use the result of simulate(), or add a [record] section to the sweep file"
    if name in VARIABLES or name in RESERVED or name in INPUTS:
        return "the dataset is not the complete result of a sweep; run the sweep again"
    guess = nearest(str(name), VARIABLES)
    return "no variable has that name" + (f'; did you mean "{guess}"?' if guess else "")


def per_realization(dataset: xr.Dataset, name: str) -> Array:
    """Return the values of a variable or parameter, one per realization, even if all are equal.

    Raises a DataError for a variable with several numbers per realization.
    """
    one = dataset[name]
    if one.dims not in ((), ("realization",)) or one.dtype.kind not in "iufb":
        particle = ", or a particle, as sweep.isel(particle=0)" if "particle" in one.dims else ""
        raise DataError(
            f"{name} holds {one.dtype} along {', '.join(map(str, one.dims)) or 'nothing'}: choose "
            f"a variable with one number for each realization{particle}"
        )
    values = np.asarray(one.values, dtype=np.float64)
    return np.broadcast_to(values, (dataset.sizes["realization"],))


def completed(sweep: xr.Dataset) -> NDArray[np.bool_]:
    """Return for each realization whether all its particles were simulated to the end."""
    if "status" not in sweep.variables:
        return np.ones(sweep.sizes["realization"], np.bool_)
    return np.asarray(per_realization(sweep, "status") == Status.COMPLETED)


def variable(
    dims: Sequence[str], values: object, long_name: str, units: str = "1", **attributes: object
) -> xr.Variable:
    """Return a variable with its CF attributes."""
    return xr.Variable(dims, values, {"long_name": long_name, "units": units, **attributes})


def table(dim: str, **columns: tuple[Any, ...]) -> xr.Dataset:
    """Return a dataset along one dim, each column with values, a long name and, if any, units."""
    return xr.Dataset({name: variable(dim, *column) for name, column in columns.items()})


def equal_parts(
    sweep: xr.Dataset, parameter: str, bins: int, analysis: str
) -> tuple[list[NDArray[np.bool_]], dict[str, xr.Variable]]:
    """Bins of a parameter that hold equally many realizations: the members of each, and its ends.

    A parameter that takes no more values than there are bins has one for each value.  The ends are
    coordinates along the dim ``part``.  Raises a DataError that names the `analysis` if the
    parameter is the same everywhere.  Realizations without results, as behind a mask, belong to no
    bin.
    """
    bins, values = count("bins", bins), per_realization(sweep, parameter)
    held = np.isfinite(values)
    if "status" in sweep.variables:
        held &= sweep["status"].values != Status.REFUSED
    own = np.unique(values[held])
    if own.size < 2:
        raise DataError(f"{analysis} needs {differing(parameter)}")
    low = high = own
    if own.size > bins:
        edges = np.unique(np.quantile(values[held], np.linspace(0.0, 1.0, bins + 1)))
        low, high = edges[:-1], edges[1:]
    part = np.clip(np.searchsorted(low, values, side="right") - 1, 0, low.size - 1)
    units = str(sweep[parameter].attrs.get("units", "1"))
    ends = {
        f"{parameter}_low": variable("part", low, f"lower end, {parameter}", units),
        f"{parameter}_high": variable("part", high, f"upper end, {parameter}", units),
    }
    return [held & (part == i) for i in range(low.size)], ends


def shares(held: Array, tried: Array) -> tuple[Array, Array, Array]:
    """Shares of trials, and the ends of their 95 % intervals (Clopper & Pearson 1934).

    NaN where there is no trial.
    """
    from scipy.stats import beta  # slow to import

    missed = tried - held
    with np.errstate(invalid="ignore"):
        share = held / tried
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = np.where(held > 0.0, beta.ppf(tail, held, missed + 1.0), 0.0)
    high = np.where(missed > 0.0, beta.ppf(1.0 - tail, held + 1.0, missed), 1.0)
    share, low, high = np.where(tried > 0.0, (share, low, high), np.nan)
    return share, low, high


def share_interval(counts: NDArray[np.int64], total: int) -> dict[str, Array]:
    """Return the ends ``low`` and ``high`` of the 95 % intervals of shares of a total."""
    from scipy.stats import binomtest

    intervals = [
        binomtest(int(count), total).proportion_ci(CONFIDENCE, method="wilson")
        for count in counts.ravel()
    ]
    return {
        side: np.array([getattr(interval, side) for interval in intervals]).reshape(counts.shape)
        for side in ("low", "high")
    }
