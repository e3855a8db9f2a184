"""Datasets as users pass them, and the realizations of any result one after the other.

Operations of xarray keep the names of dimensions, but not their order; ``where`` turns integers and
flags into floats with NaN, and spreads scalars over the mask; ``concat`` keeps the attributes of
the first dataset.  Every analysis and figure reads its datasets through `arranged`.

A grid of parameters is stored with its axes as dimensions.  Code that works realization by
realization reads any result through `flat` or `read_rows`: the realizations of a grid are numbered
with its last axis varying fastest.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Hashable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import DataError
from vibrosweep.model.forcing import ACCELERATION, AMPLITUDE, INPUTS
from vibrosweep.model.measures import IMPACTS, RECORD, UNDETERMINED, VARIABLES, Variable
from vibrosweep.model.parameters import MASS_RATIO, OF_RESTITUTION, SPRUNG, STREAM
from vibrosweep.model.restitution_laws import CONSTANT, OUTSIDE, is_law, law_in
from vibrosweep.model.shapes import HARMONICS_NAME, Waveform, harmonics_of, name_in

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["read_rows", "row_count", "row_dims"]


REALIZATION: Final = "realization"
KNOWN: Final = {**IMPACTS, **VARIABLES, **RECORD}
TIMES: Final = ("duration", "transient")
PARAMETERS: Final = (*INPUTS, *TIMES, STREAM)
# All dimensions of results, in their order; the axes of a grid have the order of the inputs
ORDER: Final = (
    *("condition", "direction", REALIZATION, *INPUTS, "launch_time", "attractor"),
    *(
        "branch",
        "curve",
        "orbit",
        "point",
        "end",
        "event",
        "particle",
        "launch",
        "window",
        "scan",
        "sample",
        "multiplier",
    ),
    *("impact", "impacts", "periods", "output", "parameter", "part", "quantile", "cycle"),
)
PLACE: Final = {dim: place for place, dim in enumerate(ORDER)}
LAUNCHES: Final = frozenset({"launch_velocity", "launch_time"})
OF_ATTRACTORS: Final = ("regime", "cycle_periods", "cycle_rests")
ACCELERATING: Final = ("restitution", AMPLITUDE, ACCELERATION, "frequency", "gravity")
EXACT: Final = 1e-9  # relative; derived quantities agree to some units of rounding


def require_dataset(given: object) -> None:
    """Raise a DataError for anything but a dataset, such as the path of a result."""
    if not hasattr(given, "variables"):
        raise DataError(
            f"{type(given).__name__}: is not a dataset; give the result itself, opened as "
            f"vibrosweep.open_sweep(path) if it is a file"
        )


def require_datasets(given: object) -> None:
    """Raise a DataError for anything but a list of datasets, of which there is at least one."""
    if not isinstance(given, list | tuple) or not given:
        raise DataError(f"{type(given).__name__}: is not a list of datasets, or holds none")
    for one in given:
        require_dataset(one)


def arranged(dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset with the dims, the types and the missing values that this package writes.

    Dims get their usual order, and a realization or a particle that was chosen by its number a dim
    of its own again.  A missing integer or flag becomes `UNDETERMINED`, as in a realization that
    could not be computed.  Raises a DataError for attributes that contradict the variables.
    """
    require_dataset(dataset)
    found = _with_realizations(dataset)
    if _holds_rows(found) or "base" in found.attrs:
        _refuse_gaps(found)
        found = _unmasked(found)
        _refuse_contradictions(found)
    dims = [d for d in ORDER if d in found.dims]
    given = (
        [PLACE.get(str(dim), len(ORDER)) for dim in one.dims] for one in found.variables.values()
    )
    if all(places == sorted(places) for places in given):
        return found
    return found.transpose(*dims, ...)


def _holds_rows(dataset: xr.Dataset) -> bool:
    """Return whether this is the result of a sweep, or a record."""
    return "status" in dataset.variables or "landing_time" in dataset.variables


def _declared(name: object, dataset: xr.Dataset) -> Variable | None:
    """Return the declaration of a variable; that of a record if the dataset is one."""
    of_record = "landing_time" in dataset.variables and "landing" not in dataset.dims
    return (KNOWN if of_record else {**KNOWN, **VARIABLES}).get(str(name))


def _with_realizations(dataset: xr.Dataset) -> xr.Dataset:
    """Give a single realization its dim; a record also the dims of its particle and impact."""
    if not _holds_rows(dataset) or "landing" in dataset.dims:
        return dataset
    held = {REALIZATION} if any(dim in INPUTS for dim in dataset.dims) else set()
    held |= {str(dim) for dim in dataset.dims}
    record, lacking = "landing_time" in dataset.variables, {}
    for name, one in dataset.variables.items():
        declared, given = _declared(name, dataset), one.dims
        # a parameter that varies is a coordinate, and one that all realizations share is not
        if name == "launch_time" or (name in PARAMETERS and name not in dataset.coords):
            continue
        needed = declared.dims if record and declared else (REALIZATION,)
        dims = [d for d in needed if d not in given and d not in held]
        if dims:
            lacking[name] = _spread(one, (*dims, *given))
    if record and "launch_time" in dataset.coords and not dataset["launch_time"].dims:
        lacking["launch_time"] = _spread(dataset["launch_time"].variable, ("particle",))
    return dataset.assign(lacking) if lacking else dataset


def _spread(one: xr.Variable, dims: Sequence[Hashable]) -> Any:
    """Return a variable with further dims of length 1."""
    return one.set_dims(dims)  # type: ignore[no-untyped-call]


def _refuse_gaps(dataset: xr.Dataset) -> None:
    """Refuse realizations that have results, but not all of their parameters."""
    if "status" not in dataset.variables or "landing" in dataset.dims:
        return
    status = dataset["status"]
    computed = status.notnull() if status.dtype.kind == "f" else status == status
    names = [n for n in PARAMETERS if n in dataset.variables and n != STREAM]
    gaps = [n for n in names if bool((dataset[n].isnull() & computed).any())]
    if gaps:
        raise DataError(
            f"{', '.join(gaps)}: missing in realizations that have results; datasets that "
            f"differ in their parameters cannot be combined: give each of them alone"
        )


def _unmasked(dataset: xr.Dataset) -> xr.Dataset:
    """Undo what a mask does to types and scalars; what it hides is missing or undetermined."""
    found: dict[Any, Any] = {}
    for name in dataset.data_vars:
        one = dataset[name].variable
        if one.dtype.kind != "f":
            continue
        if name in PARAMETERS:
            if one.dims and "point" not in one.dims and (shared := _shared(one)) is not None:
                found[name] = ((), shared, one.attrs)
            continue
        if "attractor" in dataset.dims and name not in ("basin", "slot"):
            # what an attractor has is the same for all launches and, in part, all parameters
            apart = LAUNCHES | INPUTS.keys() if name in OF_ATTRACTORS else LAUNCHES
            spread = [dim for dim in one.dims if dim in apart]
            found[name] = one = one.max(spread, skipna=True, keep_attrs=True)
        declared = _declared(name, dataset)
        blank, kind = _integer(declared, one)
        if kind is None or (blank is None and bool(one.isnull().any())):
            continue
        values = np.where(np.isnan(one.values), blank or 0, one.values)
        found[name] = (one.dims, values.astype(kind), one.attrs)
    return dataset.assign(found) if found else dataset


def _shared(one: xr.Variable) -> float | None:
    """Return the value that a parameter has wherever it has one; None if values differ."""
    values = np.asarray(one.values)
    known = values[~np.isnan(values)]
    if not known.size:
        return float("nan")
    return float(known[0]) if (known == known[0]).all() else None


def _integer(declared: Variable | None, one: xr.Variable) -> tuple[float | None, Any]:
    """Return the placeholder and the type of a variable of integers; no type for floats."""
    if declared is not None:
        kind = np.dtype(declared.dtype)
        return (declared.blank, kind) if kind.kind == "i" else (None, None)
    if "flag_values" not in one.attrs:
        return None, None
    codes = np.atleast_1d(one.attrs["flag_values"])
    return (UNDETERMINED if UNDETERMINED in codes else None), codes.dtype


def _refuse_contradictions(dataset: xr.Dataset) -> None:
    """Refuse attributes that cannot belong to the variables, as after ``concat``."""
    held, attrs = dataset.variables, dataset.attrs
    wrong = []
    law, speeds = law_in(attrs), [name for name in OF_RESTITUTION if name in held]
    known = is_law(law) and law not in OUTSIDE
    if (law != CONSTANT) != bool(speeds) and (speeds or known):
        wrong.append("restitution_law")
    if "base" in attrs and MASS_RATIO in held and attrs["base"] != SPRUNG:
        wrong.append("base")
    if "restitution_law" in attrs:  # earlier versions lack it, and perhaps others
        wrong += [n for n in ("base", "rebound", "waveform", "forcing") if n not in attrs]
    wrong += [name for name in TIMES if not _agrees_in_periods(dataset, name)]
    if not _accelerates(dataset):
        wrong.append(f"waveform, {', '.join(ACCELERATING)}")
    if wrong:
        raise DataError(
            f"{', '.join(wrong)}: the attributes do not describe the variables; datasets that "
            f"differ in their attributes cannot be combined: give each of them alone"
        )


def _agrees_in_periods(dataset: xr.Dataset, name: str) -> bool:
    """Return whether a time has the number of forcing periods that an attribute states."""
    needed = (name, "frequency")
    if f"{name}_periods" not in dataset.attrs or not all(n in dataset.variables for n in needed):
        return True
    periods = float(dataset.attrs[f"{name}_periods"])
    off = abs(dataset[name] * dataset["frequency"] - periods)
    return not bool((off > EXACT * abs(periods)).any())


def _accelerates(dataset: xr.Dataset) -> bool:
    """Return whether the stated waveform turns the amplitudes into the accelerations."""
    needed = ACCELERATING
    if "waveform" not in dataset.attrs or not all(n in dataset.variables for n in needed):
        return True
    if "point" in dataset.dims:  # curves, whose points have their own parameters
        return True
    e, amplitude, acceleration, frequency, gravity = (dataset[name] for name in needed)
    given = acceleration * gravity * (1.0 + e)
    off = abs(given - _fall(dataset.attrs) * frequency * amplitude)
    return not bool((off > EXACT * abs(given)).any())


def _fall(attributes: Any) -> float:
    """Greatest downward acceleration of the waveform that attributes state."""
    name = name_in(attributes)
    if name != HARMONICS_NAME:
        return Waveform(name).fall
    value = tomllib.loads(f"waveform = {attributes['waveform']}")["waveform"]
    return harmonics_of(value[HARMONICS_NAME], ()).fall


# Characters that no text in a file can contain: a zero byte, and lone surrogates
UNSTORABLE: Final = re.compile("[\0\ud800-\udfff]")
# Rows of a grid that are read at once: one row takes as long as thousands
ROWS_AT_A_TIME: Final = 1 << 14
# Rows of a slice, where all rows of a file are needed, but not at once
ROWS_OF_A_SLICE: Final = 1 << 18

Box = tuple[slice, ...]


def along(dims: tuple[str, ...], axes: tuple[str, ...]) -> tuple[str, ...]:
    """Replace the dimension of realizations by the axes of their grid."""
    return tuple(d for dim in dims for d in (axes if dim == REALIZATION else (dim,)))


def flat(sweep: xr.Dataset) -> xr.Dataset:
    """Return the result of a sweep with its realizations along one dimension ``realization``.

    Parameters
    ----------
    sweep
        Result of a sweep.

    Returns
    -------
    xarray.Dataset
        The same result; a grid is stacked, so that its axes become coordinates.

    Raises
    ------
    DataError
        It is not a dataset, or its attributes contradict its variables.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> grid = vs.sweep(design="grid", restitution=[0.8, 0.9], amplitude=[1.0, 2.0, 3.0])
    >>> vs.analysis.flat(grid).sizes["realization"]
    6
    """
    sweep = arranged(sweep)
    axes_of = ([d for d in v.dims if d in INPUTS] for v in sweep.variables.values())
    longest = max(axes_of, key=len, default=[])
    axes = list(dict.fromkeys([*longest, *(d for d in sweep.sizes if d in INPUTS)]))
    if not axes:
        return sweep
    return sweep.stack({REALIZATION: axes}, create_index=False).transpose(REALIZATION, ...)


def row_dims(file: Any) -> tuple[str, ...]:
    """Return the dimensions of an open result file along which its realizations lie."""
    single = REALIZATION in file.dimensions
    return (REALIZATION,) if single else tuple(file.variables["status"].dimensions)


def row_count(file: Any) -> int:
    """Return the number of realizations in an open result file."""
    return math.prod(file.dimensions[dim].size for dim in row_dims(file))


def slices(rows: int) -> Iterator[slice]:
    """Yield slices that together cover a number of realizations, in order."""
    for start in range(0, rows, ROWS_OF_A_SLICE):
        yield slice(start, min(start + ROWS_OF_A_SLICE, rows))


def read_rows(file: Any, name: str, rows: slice | NDArray[np.int64]) -> NDArray[Any]:
    """Read some realizations of a variable of a file of h5netcdf, shape (realization, ...).

    The variable lies along realizations, or along some axes of their grid; `rows` is a slice
    without a step, or increasing indices.
    """
    variable, dims = file.variables[name], row_dims(file)
    if len(dims) == 1:
        return np.asarray(variable[rows])
    sizes = [file.dimensions[dim].size for dim in dims]
    total = math.prod(sizes)
    if variable.dimensions[: len(dims)] == dims:
        if isinstance(rows, slice):
            return _range(variable, sizes, *rows.indices(total)[:2])
        blocks = rows // ROWS_AT_A_TIME
        pieces = [_range(variable, sizes, 0, 0)]
        for block in np.unique(blocks).tolist():
            start = block * ROWS_AT_A_TIME
            found = _range(variable, sizes, start, min(start + ROWS_AT_A_TIME, total))
            pieces.append(found[rows[blocks == block] - start])
        return np.concatenate(pieces)
    flat_index = np.arange(total)[rows] if isinstance(rows, slice) else rows
    places = dict(zip(dims, np.unravel_index(flat_index, sizes), strict=True))
    index = [places[dim] for dim in variable.dimensions if dim in places]
    return np.asarray(variable[...][tuple(index)])


def _range(variable: Any, sizes: list[int], start: int, stop: int) -> NDArray[Any]:
    """Read a range of the realizations of a grid."""
    rest = variable.shape[len(sizes) :]
    pieces = [np.empty((0, *rest), variable.dtype)]
    pieces += [variable[box].reshape(-1, *rest) for box in boxes(sizes, start, stop)]
    return np.concatenate(pieces)


def boxes(sizes: list[int], start: int, stop: int) -> Iterator[Box]:
    """Cut elements start, ..., stop - 1 of an array, in the order of memory, into boxes."""
    inner = math.prod(sizes[1:])
    while start < stop:
        row, within = divmod(start, inner)
        rows = (stop - start) // inner
        if within or not rows:  # a part of one row
            end = min((row + 1) * inner, stop)
            for box in boxes(sizes[1:], within, end - row * inner):
                yield (slice(row, row + 1), *box)
        else:
            end = start + rows * inner
            yield (slice(row, row + rows), *(slice(0, size) for size in sizes[1:]))
        start = end
