"""Check that a dataset holds the variables that an analysis needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vibrosweep.errors import DataError
from vibrosweep.mistakes import nearest
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import MEASURE_OF, RECORD, RESERVED, VARIABLES
from vibrosweep.store.arranged import require_dataset

if TYPE_CHECKING:
    import xarray as xr


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
    if wrong := "" if source else refused_ragged(dataset):
        raise DataError(f"{analysis} {wrong}")
    absent = [name for name in names if name not in dataset.variables]
    if absent and source:
        raise DataError(
            f"{analysis} takes the result of {source}, and the dataset lacks {', '.join(absent)}"
        )
    if absent:
        wanted = "; ".join(f"{name} ({remedy(name)})" for name in absent)
        noun = "variables" if len(absent) > 1 else "variable"
        raise DataError(f"{analysis} needs {noun} that the dataset lacks: {wanted}")


def refused_ragged(dataset: xr.Dataset) -> str:
    """Return the remedy for a ragged record, which only `vibrosweep.rectangle` takes, or "".

    Raises a DataError unless it is given a dataset.
    """
    require_dataset(dataset)
    ragged = "landing" in dataset.dims
    return "takes no ragged record: give it vibrosweep.rectangle(record)" if ragged else ""


def differing(parameter: str) -> str:
    """Return words that ask for realizations that differ in a parameter, and how to get them."""
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
