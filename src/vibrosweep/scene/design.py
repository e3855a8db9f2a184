"""Designs: ranges or axes of the parameters that vary, how values are drawn, and given tables.

`DESIGNS` holds the designs that draw from ranges.  Each consists of a sequence of points in the
unit cube and a function that maps a coordinate to a value; `register_design` adds one.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, TableError
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.functions import parts
from vibrosweep.model.parameters import refuse_masked
from vibrosweep.store.arranged import REALIZATION, flat

if TYPE_CHECKING:
    import xarray as xr

# (start, stop) -> points start, ..., stop - 1 of the unit cube, shape (stop - start, parameters)
Rows = Callable[[int, int], Array]
# (realizations, parameters, seed) -> rows; a ValueError says what is allowed
Points = Callable[[int, int, int], Rows]
# (coordinates in [0, 1], low, high) -> values in [low, high]
Place = Callable[[Array, float, float], Array]

GRID: Final = "grid"
TABLE: Final = "table"
# A Latin hypercube permutes all rows at once: 160 MB, and four times that while it is drawn.
MAX_LATIN_VALUES: Final = 20_000_000
# Points are multiples of 2**-32 of the range; scipy cannot skip points of more bits (1.11 to 1.17).
_SOBOL_BITS: Final = 32


@dataclass(frozen=True)
class Range:
    """The range [low, high], low < high, from which a parameter is drawn, in its unit."""

    low: float
    high: float

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.low, self.high


@dataclass(frozen=True)
class GridAxis:
    """The distinct values that a parameter takes along an axis of a grid, in its unit."""

    values: tuple[float, ...]

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return min(self.values), max(self.values)


@dataclass(frozen=True)
class Design:
    """Choice of the realizations of a scene."""

    name: str = "uniform"  # a key of `DESIGNS`, ``"grid"`` or ``"table"``
    # Inputs that vary, in the order of `vibrosweep.model.forcing.INPUTS`: a `Range` where values
    # are drawn, a `GridAxis` under a grid; empty for a table, whose columns are known when it is
    # read
    sampled: Mapping[str, Range | GridAxis] = field(default_factory=dict)
    realizations: int | None = 1  # None for a table whose length the sweep does not state
    seed: int = 0
    table: Path | GivenTable | None = None  # the table, or its path; None for other designs
    # Columns of the table to use, parameters first and then labels; None for all
    columns: tuple[str, ...] | None = None

    @property
    def axes(self) -> dict[str, tuple[float, ...]]:
        """Values along the axes of a grid."""
        return {name: s.values for name, s in self.sampled.items() if isinstance(s, GridAxis)}

    @property
    def source(self) -> str:
        """Code of the functions that draw; empty for those of this package."""
        return DESIGNS[self.name].source if self.name in DESIGNS else ""


class Drawn(NamedTuple):
    """A design that draws values from ranges."""

    points: Points
    place: Place
    source: str = ""  # code of the functions; empty for those of this package


def linear(unit: Array, low: float, high: float) -> Array:
    """Place coordinates evenly in a range."""
    # clipped, because low + u (high - low) may round to just above high
    return np.minimum(low + unit * (high - low), high)


def _uniform(count: int, width: int, seed: int) -> Rows:
    def rows(start: int, stop: int) -> Array:
        # each float64 takes one step of the generator, so the steps of earlier rows can be skipped
        bits = np.random.PCG64(seed).advance(start * width)
        return np.random.Generator(bits).random((stop - start, width))

    return rows


def _sobol(count: int, width: int, seed: int) -> Rows:
    if count > 2**_SOBOL_BITS:
        raise ValueError(
            f"is more than the {2**_SOBOL_BITS} points of a Sobol' sequence; lower it, or use "
            f'design = "uniform"'
        )
    from scipy.stats import qmc

    engine = _seeded(qmc.Sobol, width, seed, bits=_SOBOL_BITS)
    lock = threading.Lock()

    def rows(start: int, stop: int) -> Array:
        found = [np.empty((0, width))]
        with lock:
            if start < engine.num_generated:
                engine.reset()
            if start > engine.num_generated:
                engine.fast_forward(start - engine.num_generated)
            elif start == 0 and stop > 0:
                # the first point separately: scipy warns of lost balance if the first draw is not a
                # power of two, which does not matter for a chunk
                found.append(engine.random(1))
            rest = stop - start - (len(found) - 1)
            if rest > 0:
                found.append(engine.random(rest))
        return np.concatenate(found)

    return rows


def _latin(count: int, width: int, seed: int) -> Rows:
    if count * width > MAX_LATIN_VALUES:
        raise ValueError(
            f"makes a Latin hypercube of {count * width} values, which must be held in memory; at "
            f"most {MAX_LATIN_VALUES} are allowed: lower it, or use "
            f'design = "sobol" or "uniform"'
        )
    from scipy.stats import qmc

    cube = _seeded(qmc.LatinHypercube, width, seed).random(count)
    return lambda start, stop: cube[start:stop]


def _seeded(engine: Callable[..., Any], width: int, seed: int, **options: int) -> Any:
    generator = np.random.default_rng(seed)
    try:
        return engine(width, rng=generator, **options)
    except TypeError:  # the keyword's name before scipy 1.15
        return engine(width, seed=generator, **options)


DESIGNS: Final[dict[str, Drawn]] = {
    "uniform": Drawn(_uniform, linear),
    "latin": Drawn(_latin, linear),
    "sobol": Drawn(_sobol, linear),
}


def begins_alike(name: str) -> bool:
    """Return whether a design begins with the same points, however many realizations it has."""
    return name in DESIGNS and DESIGNS[name].points in (_uniform, _sobol)


def register_design(name: str, place: Place, points: str | Points = "uniform") -> Place:
    """Register a design that draws realizations in its own way.

    Parameters
    ----------
    name
        Value of ``design`` that selects it.
    place
        ``place(unit, low, high)``, which turns coordinates, an array of numbers in [0, 1], into
        values in the range of a parameter.
    points
        Points of the unit cube: those of ``"uniform"``, ``"latin"``, ``"sobol"`` or another design,
        or a function ``points(realizations, parameters, seed)`` that returns a function
        ``rows(start, stop)`` of shape (stop - start, parameters).  A row must not depend on the
        slice in which it is requested.

    Returns
    -------
    function
        The same `place`.

    Raises
    ------
    ParameterError
        The name is taken, `points` is not the name of a design, or an argument has another type.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> def log_uniform(unit, low, high):
    ...     return low * (high / low) ** unit
    >>> registered = vs.register_design("log-uniform", log_uniform)
    >>> found = vs.sweep(amplitude=(0.01, 1.0), design="log-uniform", realizations=100)
    >>> bool(0.05 < found.amplitude.median() < 0.2)
    True
    """
    if not isinstance(name, str) or not name:
        raise ParameterError(f"name = {name!r}: must be the name of a design")
    if not callable(place):
        raise ParameterError(f"design {name!r}: place = {place!r} must be a function")
    if not isinstance(points, str) and not callable(points):
        raise ParameterError(
            f"design {name!r}: points = {points!r} must be the name of a design or a function"
        )
    functions = [place] if isinstance(points, str) else [place, points]
    code = "\n".join(text for one in functions for text in parts(one, f"design {name!r}"))  # type: ignore[arg-type]
    if name in (GRID, TABLE) or (name in DESIGNS and not DESIGNS[name].source):
        raise ParameterError(f"design {name!r}: this name is taken; choose another name")
    if isinstance(points, str) and points not in DESIGNS:
        raise ParameterError(f"points = {points!r}: must be one of {', '.join(DESIGNS)}")
    cube = DESIGNS[points].points if isinstance(points, str) else points
    DESIGNS[name] = Drawn(cube, place, code)
    return place


# Attributes of a label that are copied to the result
COPIED: Final = ("units", "long_name", "comment")


@dataclass(frozen=True)
class Label:
    """A column that is not a parameter, shape (realization,): numbers, or strings as objects."""

    values: NDArray[Any]
    attributes: Mapping[str, str] = field(default_factory=dict)
    dims: tuple[str, ...] = (REALIZATION,)


@dataclass(frozen=True)
class GivenTable:
    """A table in memory."""

    columns: Mapping[str, Label] = field(compare=False)  # as given, not yet checked
    digest: str  # of all names and values

    def __str__(self) -> str:
        return "the table in memory"

    @classmethod
    def from_table(cls, table: Any) -> GivenTable:
        """Take a pandas data frame, an xarray dataset or a mapping of columns.

        Raises a TableError for anything else, and a ParameterError for masked values.
        """
        if hasattr(table, "data_vars"):
            columns = columns_of(table)
        elif hasattr(table, "columns") and hasattr(table, "index"):
            columns = _of_frame(table)
        elif isinstance(table, Mapping):
            columns = {str(name): _of_values(str(name), v) for name, v in table.items()}
        else:
            raise TableError(
                f"design: an object of type {type(table).__name__} is not a table; give a "
                f"pandas.DataFrame, an xarray.Dataset or a dict of columns, or the path of a table"
            )
        return cls(columns, _digest(columns))


def columns_of(dataset: xr.Dataset) -> dict[str, Label]:
    """Return the columns of a dataset: parameters, and other variables along their dimension."""
    found = {str(name): variable for name, variable in flat(dataset).variables.items()}
    shared = next((v.dims for name, v in found.items() if name in INPUTS), None)
    return {
        name: Label(
            variable.to_numpy(),
            {key: str(variable.attrs[key]) for key in COPIED if key in variable.attrs},
            tuple(map(str, variable.dims)),
        )
        for name, variable in found.items()
        # the coordinate that numbers the realizations is not a column
        if name in INPUTS or (variable.dims == shared and name != REALIZATION)
    }


def _of_frame(frame: Any) -> dict[str, Label]:
    """Return the columns of a data frame, and its index if that has a name."""
    if any(name is not None for name in frame.index.names):
        frame = frame.reset_index()
    if not frame.columns.is_unique:
        twice = frame.columns[frame.columns.duplicated()][0]
        raise TableError(f'the table in memory: column "{twice}" appears twice; keep one')
    found = {}
    for name in frame.columns:
        values = frame[name].to_numpy()
        if values.dtype.kind not in "iuf":  # a missing text becomes an empty one
            values = frame[name].astype(object).where(frame[name].notna(), "").to_numpy()
        found[str(name)] = Label(values)
    return found


def _of_values(name: str, values: Any) -> Label:
    refuse_masked(name, values)
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise TableError(f'the table in memory: column "{name}" is not a list of values') from error
    dims = (REALIZATION, *(f"axis {k}" for k in range(1, array.ndim)))
    return Label(array, dims=dims[: array.ndim])


def _digest(columns: Mapping[str, Label]) -> str:
    digest = hashlib.blake2b(digest_size=8)
    for name, column in columns.items():
        values = column.values
        plain = values.tobytes() if values.dtype.kind in "iufb" else repr(values.tolist()).encode()
        about = (name, str(values.dtype), values.shape, sorted(column.attributes.items()))
        digest.update(repr(about).encode() + plain)
    return digest.hexdigest()
