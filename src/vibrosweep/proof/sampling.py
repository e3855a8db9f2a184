"""Read realizations of a finished dataset; reject files that no sweep can have written."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.abilities import refusal
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import MEASURE_OF, RECORD, VARIABLES, Variable
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
)
from vibrosweep.model.ragged_arrays import counts_agree, padded
from vibrosweep.model.restitution_laws import CONSTANT, RESTITUTION_LAWS, law_in
from vibrosweep.model.times import Periods, Time, amount
from vibrosweep.proof.coordinates import (
    RECORD_COORDINATES,
    SWEEP_COORDINATES,
    Expected,
    expected,
    judge_axes,
)
from vibrosweep.proof.judgement import Judgement
from vibrosweep.proof.sample import Sample
from vibrosweep.runs.driver import count
from vibrosweep.runs.result import identity_in
from vibrosweep.scene.scene import Scene, stored
from vibrosweep.store.provenance import provenance
from vibrosweep.store.reading import result_file
from vibrosweep.store.rows import read_rows, row_count, row_dims

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
            if group.attrs["rebound"] not in LAWS_OF.get(base, ()) or law not in RESTITUTION_LAWS:
                raise _unsound(path, ["rebound, restitution_law or base"])
            noise = [name for name in NOISE if name in group.variables]
            if wrong := refusal(base, analysis="verify", noise=noise):
                raise DataError(f"{path}: the proof {wrong}")
        sample = _drawn(path, file, size, seed, observables)
        record = _record(file, sample) if "record" in file.groups else None
        setting, axes = expected(path, file, sample.rows), list(judge_axes(path))
    _require_sound(path, sample, VARIABLES)
    if record is not None:
        _require_sound(path, record, RECORD)
    return sample, record, setting, axes


def _drawn(
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
