"""Realizations drawn from a finished dataset, with what its sweep file says about them.

`read_sample` rejects files that no sweep can have written.  The coordinates are compared with the
sweep file that the dataset holds, and the arrays of the axes with what is written there.  Where
motion is random, normal deviates are drawn as the kernels draw them; for the reference they are
exact.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.engine.landings import launch_times
from vibrosweep.errors import DataError, ParameterError, SpecError, TableError, count
from vibrosweep.kernels.noise import (
    LARGEST,
    OF_DRIVE,
    OF_KICK,
    Word,
    draw,
    key_of,
)
from vibrosweep.kernels.noise import (
    OF_RESTITUTION as OF_SLIP,
)
from vibrosweep.model.forcing import INPUTS, inputs_of
from vibrosweep.model.measures import (
    MEASURE_OF,
    OF_TRAJECTORIES,
    RECORD,
    VARIABLES,
    Variable,
    counts_agree,
    padded,
)
from vibrosweep.model.observables import Observable
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    LAWS_OF,
    MOUNT,
    NOISE,
    OF_RESTITUTION,
    PARAMETERS,
    SPRUNG,
    STAGGERED,
    STREAM,
    Periods,
    Time,
    amount,
)
from vibrosweep.model.restitution_laws import CONSTANT, is_law, law_in
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.motion import Deviates
from vibrosweep.proof.reference.trajectories import REFERENCE_OF, Reference
from vibrosweep.proof.report import Judgement
from vibrosweep.runs.result import identity_in
from vibrosweep.scene.design import Realizations, chosen, open_design
from vibrosweep.scene.scene import Scene, stored
from vibrosweep.scene.sweep import Sweep, parse_spec
from vibrosweep.store.arranged import read_rows, row_count, row_dims
from vibrosweep.store.reading import result_file
from vibrosweep.store.writing import NO_VARIABLE, provenance

BLOCK: Final = 512  # deviates that are drawn at a time


def deviates_of(seed: int, stream: float, particle: int) -> Deviates:
    """Return the deviates of a particle in a stream."""

    @cache
    def block(purpose: Word, index: int) -> Array:
        found, of_particle = np.empty(BLOCK), 0.0 if purpose == OF_DRIVE else float(particle)
        draw(key_of(seed), stream, of_particle, float(index * BLOCK), purpose, found)
        return found

    def of(purpose: Word, number: int) -> float:
        index, place = divmod(number, BLOCK)
        return float(block(purpose, index)[place])

    return Deviates(
        of_impact=lambda number: (of(OF_SLIP, number), of(OF_KICK, number)),
        of_period=lambda number: of(OF_DRIVE, number),
        largest=LARGEST,
    )


@dataclass(frozen=True)
class ExactRealization:
    """One realization of a scene, with exact times."""

    scene: Scene
    # All of `vibrosweep.model.parameters.PARAMETERS`, and those of OF_RESTITUTION and MOUNT that
    # the law of restitution and the base need
    parameters: Mapping[str, float]
    stream: float | None = None  # of random numbers; None where nothing is random

    @cached_property
    def launch_times(self) -> tuple[Fraction, ...]:
        """Launch times in s; a staggered particle j is launched at j / (particles frequency)."""
        if not isinstance(self.scene.launch, str):
            return tuple(map(Fraction, self.scene.launch))
        particles = self.scene.particles
        return tuple(j * self._period / particles for j in range(particles))

    @property
    def transient(self) -> float | Fraction:
        """Beginning of the window in s; a `Fraction` where it was given in forcing periods."""
        return self._seconds(self.scene.measures.transient)

    @property
    def duration(self) -> float | Fraction:
        """End of the window in s; a `Fraction` where it was given in forcing periods."""
        return self._seconds(self.scene.duration)

    @property
    def launch_rounding(self) -> float:
        """Rounding error in s of the comparison of a launch with the edges of the window."""
        end = float(self.duration)
        if isinstance(self.scene.launch, str):
            return 2.0**-51 * (end + float(self._period))
        times = (self.scene.measures.transient, self.scene.duration)
        return 2.0**-51 * end if any(isinstance(time, Periods) for time in times) else 0.0

    @property
    def laws(self) -> Laws:
        """Laws of an impact, and the shape of the motion."""
        return Laws(self.scene.rebound, self.scene.restitution_law, self.scene.waveform)

    @property
    def deviates(self) -> Callable[[int], Deviates] | None:
        """Deviates of each particle; None where nothing is random."""
        if self.stream is None:
            return None
        return partial(deviates_of, self.scene.noise_seed, self.stream)

    @property
    def coupled(self) -> bool:
        """True if the base couples the particles."""
        return self.scene.base == SPRUNG

    @property
    def reference(self) -> Reference:
        """Reference of a base over which particles are independent."""
        return REFERENCE_OF[self.scene.base]

    @property
    def _period(self) -> Fraction:
        return 1 / Fraction(self.parameters["frequency"])

    def _seconds(self, time: Time) -> float | Fraction:
        return Fraction(time.number) * self._period if isinstance(time, Periods) else time

    @cached_property
    def liftoff_error(self) -> float:
        """Largest error in turns of a lift-off after a rest that is computed in doubles."""
        return self.reference.liftoff_error(self.parameters, self.laws)

    @cached_property
    def velocity(self) -> float:
        """Velocity in m s-1 of a sine at least as fast, high and steep as the base's motion."""
        return self.reference.velocity(self.parameters, self.laws)


@dataclass(frozen=True)
class Sample:
    """Realizations drawn from a dataset; its record of every landing is a sample of one."""

    total: int  # number of realizations in the dataset
    rows: NDArray[np.int64]  # indices of those drawn, in increasing order
    parameters: Mapping[str, Array]  # as of a `ExactRealization`, each of shape (row,)
    scene: Scene
    current: bool  # True if this version and git revision computed the dataset
    stored: Mapping[str, NDArray[Any]]  # the dataset's measured variables, each of shape (row, ...)
    # Coordinates of the dataset: numbers, arrays over the particles, or sampled ones, (row,)
    coordinates: Mapping[str, NDArray[Any]]
    others: Mapping[str, str]  # reasons why other variables cannot be compared, by name
    # Observables that are compared, with their values in the rows
    observables: Mapping[Observable, NDArray[Any]]

    def realization(self, row: int) -> ExactRealization:
        """Return the realization of one of the rows."""
        parameters = {name: float(values[row]) for name, values in self.parameters.items()}
        stream = parameters.pop(STREAM, None)
        return ExactRealization(self.scene, parameters, stream)


SWEEP_COORDINATES: Final = (*INPUTS, STREAM, "launch_time", "duration", "transient")
RECORD_COORDINATES: Final = (*INPUTS, "launch_time", "duration", *OF_TRAJECTORIES)
# designs drawn by another library, whose versions may differ
DRAWN_BY_SCIPY: Final = ("latin", "sobol")
# Dimensions whose variables only number them, and the mark of a dimension without a variable
NUMBERED: Final = ("realization", "particle", "impact")
MARK: Final = NO_VARIABLE.partition("%")[0]


@dataclass(frozen=True)
class Expected:
    """Coordinates that the sweep file in a dataset specifies."""

    # Coordinates of all realizations: numbers, or arrays over the particles; the names of those of
    # the record begin with ``record/``
    shared: Mapping[str, Any]
    # Sampled parameters of the rows drawn, each of shape (row,)
    sampled: Mapping[str, NDArray[np.float64]]
    unknown: Mapping[str, str]  # reasons why other coordinates are not known, by name


def expected(path: Path, file: Any, rows: NDArray[np.int64]) -> Expected:
    """Return the coordinates of some increasing rows according to the dataset's sweep file.

    A table with a relative path is looked for beside the dataset.
    """
    names = [*SWEEP_COORDINATES, *(f"record/{name}" for name in RECORD_COORDINATES)]
    try:
        spec = parse_spec(str(file.attrs["sweep_file"]), path)
    except (KeyError, SpecError):
        reason = "the dataset holds no sweep file that this version reads"
        return Expected({}, {}, dict.fromkeys(names, reason))
    shared: dict[str, Any] = {}
    if spec.record is not None:
        record = spec.record
        known = {name: values[0] for name, values in record.timed({}).items()}
        frequency = record.inputs["frequency"]
        known["launch_time"] = launch_times(record.launch, record.particles, frequency)
        known["realization_index"] = np.zeros(record.particles)
        known["particle_index"] = np.arange(record.particles)
        shared = {f"record/{name}": value for name, value in known.items()}
    drawn, reason = _drawn_again(spec, identity_in(file), rows)
    found, varied = spec.scene.timed(drawn, rows.size), spec.scene.varying(drawn)
    shared |= {name: values[0] for name, values in found.items() if name not in varied}
    if spec.scene.launch != STAGGERED or "frequency" in shared:
        frequency = float(shared.get("frequency", 1.0))
        shared["launch_time"] = launch_times(spec.scene.launch, spec.scene.particles, frequency)
    if reason:
        unknown = [name for name in SWEEP_COORDINATES if name not in shared]
        return Expected(shared, {}, dict.fromkeys(unknown, reason))
    return Expected(shared, {name: found[name] for name in varied}, {})


def _drawn_again(
    spec: Sweep, identity: str, rows: NDArray[np.int64]
) -> tuple[dict[str, NDArray[np.float64]], str]:
    """Sampled parameters of the rows; NaN, and the reason, where they cannot be known."""
    design = _design(spec, identity)
    if isinstance(design, str):
        # a table decides which parameters are sampled
        every = inputs_of(spec.scene.given, spec.scene.base)
        names, reason = tuple(every if spec.design.name == "table" else spec.design.sampled), design
    elif np.any(rows >= design.realizations):
        reason = f"the sweep file specifies {design.realizations} realizations"
        names = design.sampled
    else:
        return chosen(design, rows.tolist()).take(0, rows.size), ""
    return {name: np.full(rows.size, np.nan) for name in names}, reason


def _design(spec: Sweep, identity: str) -> Realizations | str:
    """Open the design again, or return the reason why it cannot be compared."""
    if spec.design.name in DRAWN_BY_SCIPY:
        drawn = json.loads(identity or "{}").get("scipy", version("scipy"))
        if drawn != version("scipy"):
            return f"drawn by scipy {drawn}, this is {version('scipy')}"
    if isinstance(spec.design.table, Path):
        if not spec.design.table.is_file():
            return f"there is no table {spec.design.table}"
        contents = spec.design.table.read_bytes()
        if hashlib.blake2b(contents, digest_size=8).hexdigest() not in identity:
            return f"the table {spec.design.table} is not the one that was used"
    try:
        return open_design(spec)
    except (SpecError, TableError) as error:
        return f"the design cannot be opened again: {error}"


def judge_axes(path: Path) -> Iterator[Judgement]:
    """Judge the axes of a file and of its record: variables, and arrays that must hold zeros.

    A dimension of netCDF-4 without a variable is an HDF5 array that is never written, and so reads
    as zeros.  A program that saves a dataset again may turn it into a variable that numbers
    realizations, particles or impacts.
    """
    with h5py.File(path) as file:
        for place in ("", "record"):
            group = file.get(place or "/")
            # links may lead out of the file, or in circles
            named = [
                n for n in group or () if isinstance(group.get(n, getlink=True), h5py.HardLink)
            ]
            for name in named:
                axis = group[name]
                if isinstance(axis, h5py.Dataset) and axis.ndim == 1:
                    yield from _judged_axis(f"{place}/{name}".lstrip("/"), axis)


def _judged_axis(name: str, axis: h5py.Dataset) -> Iterator[Judgement]:
    mark = axis.attrs.get("NAME", b"")
    mark = mark.decode(errors="replace") if isinstance(mark, bytes) else str(mark)
    variable = not mark.startswith(MARK)
    if (variable and name.rpartition("/")[2] not in NUMBERED) or axis.dtype.kind not in "iuf":
        return
    values = np.asarray(axis[...])
    right = np.arange(values.size) if variable else np.zeros(values.size)
    wrong = np.flatnonzero(values != right)
    if wrong.size:
        at, value = int(wrong[0]), float(values[wrong[0]])
        complaint = f"is {value!r} at {at}, where a file of vibrosweep has {right[at]:g}"
        yield Judgement(name, None, math.inf, 0.0, None, complaint)
    elif variable:
        yield Judgement(name, None, 0.0, 0.0)


OF_OBSERVABLES: Final = "measure.observables"
UNKNOWN: Final = "a label of the table, or a variable that this version does not know"
OF_TOTALS: Final = "it is an observable whose function changes totals, which is not compared"
OF_LANDINGS: Final = (
    "it is an observable, whose function the file does not hold: give it in Python, as in "
    "vs.verify(path, observables=[{}])"
)


def read_sample(
    path: Path, size: int, seed: int, observables: Sequence[Observable] = ()
) -> tuple[Sample, Sample | None, Expected, list[Judgement]]:
    """Draw realizations without replacement; all if there are no more than `size`.

    The second sample is the dataset's record of every landing, if it holds one; then come the
    coordinates that its sweep file specifies, and judgements of the axes.  Raises a ParameterError
    for a size or a seed that cannot be used, and a DataError if there is no such file, if it is not
    a result that can be read, or if it was computed with other observables.
    """
    size, seed = count("sample", size), count("seed", seed, 0)
    with result_file(path) as file:
        for group in (file, *(file.groups[name] for name in file.groups if name == "record")):
            base, law = str(group.attrs.get("base", HIGH_BOUNCE)), law_in(group.attrs)
            if group.attrs["rebound"] not in LAWS_OF.get(base, ()) or not is_law(law):
                raise _unsound(path, ["rebound, restitution_law or base"])
            noise = [name for name in NOISE if name in group.variables]
            if wrong := refusal(base, analysis="verify", noise=noise):
                raise DataError(f"{path}: the proof {wrong}")
        sample = _sample(path, file, size, seed, observables)
        record = _record(file, sample) if "record" in file.groups else None
        setting, axes = expected(path, file, sample.rows), list(judge_axes(path))
    _require_sound(path, sample, VARIABLES)
    if record is not None:
        _require_sound(path, record, RECORD)
    return sample, record, setting, axes


def _sample(
    path: Path, file: Any, size: int, seed: int, observables: Sequence[Observable]
) -> Sample:
    identity = json.loads(identity_in(file) or "{}")
    _require_same(path, file, identity, observables)
    total = row_count(file)
    rows = np.arange(total)
    chosen: slice | NDArray[np.int64] = slice(None)
    if size < total:
        chosen = rows = np.sort(np.random.default_rng(seed).choice(total, size, replace=False))
    here = provenance(threads=1)
    known = (*VARIABLES, *SWEEP_COORDINATES, *(observable.name for observable in observables))
    names = [n for n in VARIABLES if n in file.variables]
    scene, coordinates = _scene(file, file.attrs), _coordinates(file, chosen)
    return Sample(
        total=total,
        rows=rows,
        parameters={n: np.full(rows.size, coordinates[n], float) for n in _taken(file, scene)},
        scene=scene,
        current=all(file.attrs.get(name) == here.get(name) for name in ("source", "git_revision")),
        stored={name: read_rows(file, name, chosen) for name in names},
        coordinates=coordinates,
        others=_others(file, known, identity),
        observables={one: read_rows(file, one.name, chosen) for one in observables},
    )


def _coordinates(file: Any, chosen: slice | NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    """Coordinates in a file; those that lie along realizations at the chosen rows only."""
    dims = row_dims(file)
    return {
        name: variable[...]
        if set(variable.dimensions).isdisjoint(dims)
        else read_rows(file, name, chosen)
        for name, variable in file.variables.items()
        if name in SWEEP_COORDINATES
    }


def _others(file: Any, known: tuple[str, ...], identity: Mapping[str, str]) -> dict[str, str]:
    """Reasons why variables that are not known cannot be compared."""

    def why(name: str) -> str:
        if f"{OF_OBSERVABLES}.{name}.landings" in identity:
            return OF_LANDINGS.format(name)
        return OF_TOTALS if f"{OF_OBSERVABLES}.{name}.code" in identity else UNKNOWN

    return {name: why(name) for name in file.variables if name not in known}


def _require_same(
    path: Path, file: Any, identity: Mapping[str, str], observables: Sequence[Observable]
) -> None:
    """Raise for an observable with which the file was not computed."""
    for one in observables:
        if not one.landings:
            raise ParameterError(
                f"observable {one.name!r}: its function changes totals; verify compares only what "
                f'a function of one landing gives, as with landings="sum"'
            )
        for key in ("code", "landings", "particles", "units"):
            held = identity.get(f"{OF_OBSERVABLES}.{one.name}.{key}")
            if held != getattr(one, key) or one.name not in file.variables:
                raise DataError(
                    f"{path}: was not computed with observable {one.name!r}: its {key} is "
                    f"{getattr(one, key)}, but {held or 'missing'} in the file"
                )


def _taken(file: Any, scene: Scene) -> tuple[str, ...]:
    """Names of the parameters of a scene, and of its noise."""
    of_law = () if scene.restitution_law == CONSTANT else (*OF_RESTITUTION,)
    random = [name for name in (*NOISE, STREAM) if name in file.variables]
    return (*PARAMETERS, *of_law, *(MOUNT if scene.base == SPRUNG else ()), *random)


def _record(file: Any, sample: Sample) -> Sample:
    """Return the recorded realization, all of whose landings count."""
    group, rows = file.groups["record"], np.zeros(1, np.int64)
    shared = {
        "particles": math.prod(group.variables["impact_count"].shape),
        "impact_budget": sample.scene.measures.impact_budget,
    }
    scene = _scene(group, {**group.attrs, **shared})
    values = {n: np.atleast_1d(group.variables[n][...]) for n in _taken(group, scene)}
    return Sample(
        total=1,
        rows=rows,
        parameters={STREAM: np.zeros(1)} | values if values.keys() & NOISE else values,
        scene=scene,
        current=sample.current,
        stored=_rectangles({name: group.variables[name][...] for name in RECORD}),
        # in the record of a grid, a parameter that is an axis has one value along `realization`
        coordinates={
            n: np.asarray(v[0] if n in INPUTS and v.shape else v[...])
            for n, v in group.variables.items()
            if n in RECORD_COORDINATES
        },
        others=_others(group, (*RECORD, *RECORD_COORDINATES), {}),
        observables={},
    )


def _rectangles(stored: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Pad the arrays of a ragged record to rectangles, if their lengths agree."""
    count = stored["impact_count"]
    of_landings = [name for name, one in RECORD.items() if one.dims != RECORD["impact_count"].dims]
    if count.ndim != 1 or not counts_agree(count, *(stored[name] for name in of_landings)):
        return stored
    full = {name: padded(stored[name], count) for name in of_landings}
    return {name: values[np.newaxis] for name, values in (stored | full).items()}


def _scene(file: Any, attributes: Mapping[str, Any]) -> Scene:
    launch: str | tuple[float, ...] = STAGGERED
    if attributes["launch"] != STAGGERED:
        launch = tuple(file.variables["launch_time"][...].tolist())
    seen = Scene(
        particles=int(attributes["particles"]),
        launch=launch,
        duration=_time(file, attributes, "duration"),
        rebound=str(attributes["rebound"]),
        base=str(attributes.get("base", HIGH_BOUNCE)),
        waveform=stored(attributes),
        restitution_law=law_in(attributes),
        noise_seed=int(attributes.get("noise_seed", 0)),
    ).recorded(int(attributes["impact_budget"]))
    if "transient" not in file.variables:
        return seen
    return seen.with_measures(
        transient=_time(file, attributes, "transient"),
        tolerance=float(attributes.get("tolerance", math.inf)),
    )


def _time(file: Any, attributes: Mapping[str, Any], name: str) -> Time:
    """Duration or transient as it was given: in forcing periods if an attribute says so."""
    periods = attributes.get(f"{name}_periods")
    return float(file.variables[name][()]) if periods is None else Periods(float(periods))


def _require_sound(path: Path, sample: Sample, registry: Mapping[str, Variable]) -> None:
    """Raise for data that no sweep can have written, before a kernel takes them."""
    scene, known = sample.scene, {**PARAMETERS, **OF_RESTITUTION, **MOUNT, **NOISE}
    given = {n: v for n, v in sample.parameters.items() if n in known}
    bad = [n for n, v in given.items() if not np.all(known[n].accepts(v))]
    times = () if isinstance(scene.launch, str) else scene.launch
    if math.isnan(amount(scene.measures.transient)) or not all(
        math.isfinite(time) for time in (amount(scene.duration), *times)
    ):
        bad.append("transient, duration or launch_time")
    if scene.particles < 1 or (times and len(times) != scene.particles):
        bad.append("particles")
    shapes = {"realization": sample.rows.size, "particle": scene.particles}
    for name, variable in registry.items():
        if name not in sample.stored:
            bad += [] if name in MEASURE_OF else [name]
        elif not _fits(sample.stored[name].shape, tuple(shapes.get(d) for d in variable.dims)):
            bad.append(name)
    for one, values in sample.observables.items():
        if not _fits(values.shape, tuple(shapes.get(d) for d in one.variable.dims)):
            bad.append(one.name)
    if bad:
        raise _unsound(path, bad)


def _unsound(path: Path, bad: list[str]) -> DataError:
    return DataError(
        f"{path}: {', '.join(bad)}: is not what vibrosweep run writes; compute it again"
    )


def _fits(shape: tuple[int, ...], sizes: tuple[int | None, ...]) -> bool:
    """Return whether a shape has the sizes that are known."""
    known = zip(shape, sizes, strict=False)
    return len(shape) == len(sizes) and all(size in (None, length) for length, size in known)
