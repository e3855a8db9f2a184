"""Measure a batch of realizations: from arrays of parameters to arrays of variables.

Kernels follow a batch of dimensionless problems; then totals get their units.
A trajectory depends on its own problem only; results therefore depend neither on the number of
threads nor on how a sweep is cut into batches.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.errors import ParameterError, RunError
from vibrosweep.kernels.advance import Options, Share, advance, advance_uncached, memory_around
from vibrosweep.kernels.bases import fitted, lifts, lowest
from vibrosweep.kernels.cycles import CYCLE, Cycles, empty_rests
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.memory import require_written
from vibrosweep.kernels.noise import noise_of
from vibrosweep.kernels.ordering import Orders, empty_orders, empty_turns
from vibrosweep.kernels.record import KINDS_RECORDED, Recorder, Units
from vibrosweep.kernels.separation import (
    Separations,
    empty_separations,
    find_order,
    separate,
    workspace,
)
from vibrosweep.kernels.settle import GROWTH_SIZE, SAME_ORBIT, Orbits, Search, empty_orbits, settle
from vibrosweep.kernels.statistics import (
    IMPACT_SPEED,
    KINDS,
    UNCOUNTED,
    Kinds,
    Observer,
    Statistics,
    combine,
    compiled,
    empty_sums,
    scratch,
    statistic_of,
)
from vibrosweep.kernels.trust import empty_trust, trust
from vibrosweep.kernels.waveforms import motion
from vibrosweep.model.measures import RESOLUTION, UNDETERMINED, Regime, Status
from vibrosweep.model.observables import Observable
from vibrosweep.model.parameters import (
    SPRUNG,
    Dimensionless,
    Launches,
    Periods,
    Time,
    amount,
    dimensionless,
    in_periods,
    in_seconds,
    launches,
    representable,
)
from vibrosweep.model.restitution_laws import SPEED, fastest_in_range
from vibrosweep.model.shapes import Waveform
from vibrosweep.scene.scene import Scene

__all__ = ["measure", "measure_all"]


def measure(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Advance a batch of realizations and measure them.

    `parameters` holds every parameter of `vibrosweep.model.parameters.PARAMETERS`, and for a sprung
    base those of the mount, each of shape (realization,).  Returns arrays of this shape, or for
    measures per particle of shape (realization, particle), named as in `vibrosweep.model.measures`.
    Raises a ParameterError for more forcing periods than can be counted exactly, and a RunError if
    a variable is missing or incomplete.
    """
    if scene.base == SPRUNG:
        from vibrosweep.engine.coupled import measure_coupled  # slow to import: it declares kernels

        found = measure_coupled(parameters, scene, workers)
    else:
        found = _measure_apart(parameters, scene, workers)
    names = [variable.name for variable in scene.measures.variables]
    if missing := [name for name in names if name not in found]:
        raise RunError(
            f"{', '.join(missing)}: not computed over base = {scene.base}; this is a fault of "
            f"vibrosweep: please report it"
        )
    return {name: found[name] for name in names}


def _measure_apart(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Measure realizations whose particles do not act on each other."""
    measures, particles, frequency = scene.measures, scene.particles, parameters["frequency"]
    problem = dimensionless(parameters, scene.duration, measures.transient)
    launch = launches(scene.launch, particles, frequency)
    batch, cycles = batch_of(problem, launch, scene), None
    wanted = measures.regimes or (scene.skip and _longest(batch) > PERIODS_TO_RECUR)
    if wanted and problem.noise is None:  # random motion never recurs
        cycles = workers.cycles(frequency.size * particles)
    # in memory that the workers reuse for the next batch
    trajectories = statistics(batch, scene, workers, cycles)
    realizations = empty_sums(frequency.size, trajectories.kinds)
    workers.run(
        lambda first, last: combine(first, last, particles, trajectories, realizations),
        frequency.size,
        max(1, 2 * TRAJECTORIES_PER_TASK // particles),
        realizations,
    )
    ground = lowest(batch.base, problem)
    waveform = None if ground is None else scene.waveform
    heights = _launch_heights(parameters, problem, launch, waveform)
    of_base = lifts(batch.base, problem), ground
    measured = statistics_in_units(scene, parameters, realizations, trajectories, heights, *of_base)
    if measures.regimes:
        none = np.zeros((len(CYCLE), trajectories.status.size))
        found = none if cycles is None else cycles
        orbits = settled(batch, trajectories, found, scene, workers)
        measured |= orbit_variables(orbits, frequency)
    measured |= _in_time(batch, scene, realizations, cycles, parameters, workers)
    if measures.trust:
        measured |= _error_bounds(batch, scene, parameters, workers)
    return measured | observable_values(
        parameters,
        scene,
        trajectories,
        lambda observer: statistics(batch, scene, workers, observer=observer),
    )


def measure_all(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Measure a batch as `measure` does, also if some of its realizations cannot be computed.

    Their floats are NaN, their counts and flags undetermined, and their status gives the reason.
    """
    launch = () if isinstance(scene.launch, str) else scene.launch
    usable = representable(parameters, (scene.duration, scene.measures.transient, *launch))
    every = bool(usable.all())
    kept = parameters if every else {name: values[usable] for name, values in parameters.items()}
    found = measure(kept, scene, workers) if usable.any() else {}
    known = usable.copy()
    if found:  # landings are counted while they are found
        known[usable] = found["status"] != Status.REFUSED
    if known.all():
        return found
    sizes = {"realization": usable.size, "particle": scene.particles}
    sizes |= {along: len(values) for along, values in scene.measures.observable_dims.items()}
    all_found = {
        v.name: np.full([sizes[d] for d in v.dims], v.blank, v.dtype)
        for v in scene.measures.variables
    }
    for name, values in found.items():
        all_found[name][known] = values[known[usable]]
    return all_found


def _launch_heights(
    parameters: Mapping[str, Array],
    problem: Dimensionless,
    launch: Launches,
    waveform: Waveform | None,
) -> Array:
    """Return the heights in m that launches reach, shape (realization, particle).

    `waveform` is None in the high-bounce limit, where all launches of a realization reach the same
    height; the shape is then (realization, 1).
    """
    with np.errstate(over="ignore"):
        thrown = parameters["launch_velocity"] ** 2 / (2.0 * parameters["gravity"])
        if waveform is None:
            return np.asarray(thrown[:, np.newaxis])
        velocity, level = motion(waveform, launch.phase + problem.phase[:, np.newaxis])
        # for kick = (1 + e) a the base has the velocity a w in g / (2 f) and the height
        # (2 / pi) a 2 pi W in g / (8 f^2); it pushes a slower particle, which then does not fly
        scale = (2.0 / np.pi) * (problem.kick / (1.0 + problem.restitution))
        speed = 0.5 * np.pi * scale[:, np.newaxis] * velocity
        flies = problem.launch_flight[:, np.newaxis] >= speed
        base = (height_unit(parameters) * scale)[:, np.newaxis] * level
        return np.where(flies, thrown[:, np.newaxis] + base, base)


# Shorter orbits hardly ever repeat early enough for the detection of cycles to save time
PERIODS_TO_RECUR = 32.0


def batch_of(problem: Dimensionless, launch: Launches, scene: Scene) -> Batch:
    """Return realizations over the base of a scene, with their noise, as kernels take them."""
    noise = noise_of(problem.noise, scene.noise_seed)
    return Batch(base_of(*scene.mechanics, noise), problem, launch)


def statistics(
    batch: Batch,
    scene: Scene,
    workers: Workers,
    cycles: Cycles | None = None,
    observer: Observer | Recorder | None = None,
    more: Kinds = (),
) -> Statistics:
    """Return the statistics of every trajectory, ordered by realization, then by particle.

    The result is in memory that the workers reuse for the next batch.  If `cycles` is given, it is
    filled, and a trajectory is simulated only until it recurs.  An `observer` is called at every
    landing, and requires that `cycles` is None.  `more` names further statistics.
    """
    total = batch.problem.kick.size * scene.particles
    kernel, kinds = advance, (*KINDS, *kinds_of(scene), *more)
    if isinstance(observer, Recorder):
        kinds = KINDS_RECORDED
    elif observer is not None:
        kernel, kinds = advance_uncached, KINDS
    found = workers.statistics(total, kinds)
    window = 1 if scene.windowed else None  # None selects machine code without a window
    batch = batch._replace(base=fitted(batch.base, batch.problem))
    all_cycles, jump = int(scene.measures.regimes), int(scene.skip)
    options = Options(scene.budget, PERIODS_TO_RECUR, all_cycles, jump, observer)

    def begin() -> Callable[[int, int], None]:
        memory = memory_around(scratch(kinds))
        rests = None if cycles is None else empty_rests(found.kinds)
        lanes = 0

        def task(first: int, last: int) -> None:
            nonlocal lanes
            share = Share(first, last, lanes)
            lanes = kernel(share, batch, options, window, memory, found, cycles, rests)

        return task

    workers.stream(begin, total, _longest(batch))
    require_written(found, ("at_rest", "status"))  # written by the same function as the totals
    return found


def _longest(batch: Batch) -> float:
    """Return an upper bound of the duration of every trajectory, in forcing periods."""
    return float(np.max(batch.problem.end_count) - np.min(batch.launches.whole) + 2.0)


def settled(
    batch: Batch, found: Statistics, cycles: Cycles, scene: Scene, workers: Workers
) -> Orbits:
    """Return the orbit on which each trajectory settles, from its `statistics` and its cycle."""
    orbits = empty_orbits(found.status.size)
    search = Search(scene.budget, int(scene.measures.lyapunov))
    plain = found._replace(kinds=())  # the same machine code for any choice of statistics

    def task(first: int, last: int) -> None:
        settle(first, last, batch, plain, cycles, search, np.empty(GROWTH_SIZE), orbits)

    workers.run(task, found.status.size, TRAJECTORIES_PER_TASK // 64, orbits)
    return orbits


def _in_time(
    batch: Batch,
    scene: Scene,
    realizations: Statistics,
    cycles: Cycles | None,
    parameters: Mapping[str, Array],
    workers: Workers,
) -> Measured:
    """Measure separations and order, which need the landings of all particles in order of time."""
    measured: Measured = {}
    size, particles = realizations.status.size, scene.particles
    complete = realizations.status == Status.COMPLETED
    known = cycles if cycles is not None and scene.skip else workers.cycles(0)

    def run(kernel: Any, memory: Callable[[], Any], found: Any) -> None:
        # shared by all tasks, because it is costly to allocate
        idle = [memory() for _ in range(min(size, workers.threads))]

        def task(first: int, last: int) -> None:
            work = idle.pop()
            kernel(first, last, batch, complete, scene.budget, work, known, found)
            idle.append(work)

        workers.run(task, size, max(1, TRAJECTORIES_PER_TASK // (32 * particles)), found)

    if scene.measures.separation:
        separations = empty_separations(size)
        if particles > 1:
            run(separate, lambda: workspace(particles), separations)
        else:  # a single particle has no separations
            separations.gap[:] = separations.same[:] = np.nan
            separations.shared[:] = np.where(complete, 0, UNDETERMINED)
        measured |= separations_in_units(separations, parameters["frequency"])
    if scene.measures.ordering:
        order = empty_orders(size)
        run(find_order, lambda: (workspace(particles), empty_turns(particles)), order)
        measured |= order_in_units(order, parameters["frequency"])
    return measured


def _error_bounds(
    batch: Batch, scene: Scene, parameters: Mapping[str, Array], workers: Workers
) -> Measured:
    """Return bounds on the errors of landings, and the times up to which they are trusted."""
    frequency, particles = parameters["frequency"], scene.particles
    bounds, tolerance = (
        empty_trust(frequency.size * particles),
        scene.measures.tolerance * frequency,
    )

    def task(first: int, last: int) -> None:
        trust(first, last, batch, tolerance, scene.budget, bounds)

    workers.run(task, bounds.until.size, TRAJECTORIES_PER_TASK // 64, bounds)
    until = bounds.until.reshape(-1, particles) / frequency[:, np.newaxis]
    end = in_seconds(scene.duration, frequency)
    velocity = units_of(parameters).velocity
    return {
        "trusted_until": np.where(until == np.inf, end[:, np.newaxis], until),
        "landing_time_error": bounds.landing_error.reshape(-1, particles).max(axis=1) / frequency,
        "rebound_velocity_error": bounds.flight_error.reshape(-1, particles).max(axis=1) * velocity,
    }


Codes = NDArray[np.int64]

NO_ORBIT: Final = -1


def find_orbits(problem: Dimensionless, launch: Launches, scene: Scene, workers: Workers) -> Orbits:
    """Return the orbit on which each trajectory settles, ordered by realization, then by particle.

    Arrays have shape (realization * particle,), in dimensionless units.  The exponent of an orbit
    that is not a cycle is a mean over the window of the problem.  The scene must agree with the
    launches in the number of particles, and with the problem in whether a launch precedes the
    window.
    """
    scene = replace(scene.with_measures(lyapunov=True), skip=True)
    cycles = workers.cycles(problem.kick.size * scene.particles)
    batch = batch_of(problem, launch, scene)
    found = statistics(batch, scene, workers, cycles)
    return settled(batch, found, cycles, scene, workers)


def label_orbits(orbits: Orbits, realizations: int) -> Codes:
    """Number the distinct orbits of each realization, in the order of their first particles.

    Two cycles are the same orbit if their numbers of impacts, periods and rests agree and their
    representative states differ by less than `SAME_ORBIT`.  Shape (realization, particle);
    `NO_ORBIT` where no recurrence was found.
    """
    shape = (realizations, -1)
    codes = [v.reshape(shape) for v in (orbits.impacts, orbits.periods, orbits.rests)]
    phase, flight = orbits.phase.reshape(shape), orbits.flight.reshape(shape)
    labels = np.full(phase.shape, NO_ORBIT)
    pending = codes[0] > 0
    rows = np.arange(realizations)
    for number in range(phase.shape[1]):
        if not pending.any():
            break
        chosen = pending.argmax(axis=1)
        same = pending & (np.abs(flight - flight[rows, chosen][:, np.newaxis]) <= SAME_ORBIT)
        apart = phase - phase[rows, chosen][:, np.newaxis]
        same &= np.abs(apart - np.rint(apart)) <= SAME_ORBIT
        for code in codes:
            same &= code == code[rows, chosen][:, np.newaxis]
        labels[same] = number
        pending &= ~same
    return labels


def slots(orbits: Orbits) -> Codes:
    """Return the slot of each particle, one of the copies of its orbit; same shape as `orbits`.

    A cycle of q forcing periods exists in q copies, shifted by whole periods.  The slot is the
    period, modulo q, that contains the representative state of the cycle; `NO_ORBIT` where no
    recurrence was found.
    """
    found = orbits.impacts > 0
    slot = np.mod(orbits.whole, np.maximum(orbits.periods, 1))
    return np.where(found, slot, NO_ORBIT).astype(np.int64)


def slot_count(labels: Codes, slot: Codes) -> Codes:
    """Return how many distinct slots of all orbits the particles of each realization occupy."""
    pairs = np.sort(np.where(labels == NO_ORBIT, NO_ORBIT, labels * (slot.max() + 1) + slot))
    steps = np.diff(pairs, axis=1, prepend=NO_ORBIT) != 0
    return np.asarray(np.count_nonzero(steps, axis=1))


def orbit_variables(orbits: Orbits, frequency: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    """Return the variables of regimes and exponents, per particle and per realization.

    They are named as in `vibrosweep.model.measures`; the orbits are ordered by realization.
    """
    shape = (frequency.size, -1)
    labels, slot = label_orbits(orbits, frequency.size), slots(orbits).reshape(shape)
    largest, regime = orbits.largest.reshape(shape), orbits.regime.reshape(shape)
    uncertain = orbits.uncertain.reshape(shape)
    counts = {f"{r.meaning}_count": np.count_nonzero(regime == r, axis=1) for r in Regime}
    return {
        "regime": regime,
        "cycle_impacts": orbits.impacts.reshape(shape),
        "cycle_periods": orbits.periods.reshape(shape),
        "cycle_rests": orbits.rests.reshape(shape),
        "cycle_uncertain": uncertain,
        "recurrent_from": orbits.since.reshape(shape) / frequency[:, np.newaxis],
        **counts,
        "uncertain_cycle_count": np.count_nonzero(uncertain == 1, axis=1),
        "lyapunov_largest": largest,
        "lyapunov_largest_error": orbits.largest_error.reshape(shape),
        "lyapunov_sum": orbits.total.reshape(shape),
        "lyapunov_sum_error": orbits.total_error.reshape(shape),
        "orbit": labels,
        "slot": slot,
        "lyapunov_max": np.fmax.reduce(largest, axis=1),
        "orbit_count": labels.max(axis=1) + 1,
        "slot_count": slot_count(labels, slot),
    }


def kinds_of(scene: Scene) -> Kinds:
    """Return the optional statistics of a scene: speed of impact, and numbers of each landing."""
    measured = (IMPACT_SPEED,) if scene.measures.impact_speed else ()
    return (*measured, *(compiled(o) for o in scene.measures.observables if o.landings))


def observable_values(
    parameters: Mapping[str, Array],
    scene: Scene,
    found: Statistics | None,
    follow: Callable[[Observer], Statistics],
) -> dict[str, Array]:
    """Return the values of all observables of a scene by name, with the dims of their variables.

    An observable that gives a number for each landing is a statistic like those of the kernels, and
    is computed with them.  One that changes totals is computed separately, because every landing
    must be simulated for it: other measures can then still be added from cycles.

    `found` holds the statistics of trajectories.  For a function that changes totals, `follow`
    simulates all landings once more; it may overwrite `found`.  Raises a ParameterError with the
    error of such a function.
    """
    values = {}
    for observable in scene.measures.observables:
        if observable.landings and found is not None:
            totals = found.total(statistic_of(type(compiled(observable))).name).copy()
            values[observable.name] = _values(observable, parameters, found, totals)
    trajectories = parameters["frequency"].size * scene.particles
    for observable in scene.measures.observables:
        if not observable.landings:
            initial = float(observable.initial)
            totals = np.full((trajectories, observable.width), initial)
            function = compiled(observable)
            try:
                statistics = follow(Observer(function, totals, initial))
            except MemoryError:
                raise
            except Exception as error:
                raise ParameterError(
                    f"observable {observable.name!r}: its function raised "
                    f"{type(error).__name__}: {error}"
                ) from error
            values[observable.name] = _values(observable, parameters, statistics, totals)
    return values


def _values(
    observable: Observable, parameters: Mapping[str, Array], found: Statistics, totals: Array
) -> Array:
    """Return the values of an observable; NaN for trajectories that do not stay finite."""
    size = parameters["frequency"].size
    totals = totals.reshape(found.status.size, observable.width)
    totals[found.status == Status.NON_FINITE] = np.nan
    values = observable.combined(totals.reshape(size, -1, observable.width))
    scale: Any = observable.scale(parameters["frequency"], parameters["gravity"])
    return np.asarray(values * scale.reshape((size,) + (1,) * (values.ndim - 1)))


Measured = dict[str, NDArray[Any]]


def height_unit(parameters: Mapping[str, Array]) -> Array:
    """Return g / (8 f^2), the height in m of a flight that lasts one forcing period."""
    frequency = parameters["frequency"]
    return np.asarray(parameters["gravity"] / (8.0 * frequency * frequency))


def units_of(parameters: Mapping[str, Array]) -> Units:
    """Return f in Hz, and g / (2 f), the speed in m s-1 whose flight lasts one forcing period."""
    frequency = parameters["frequency"]
    return Units(frequency, parameters["gravity"] / (2.0 * frequency))


def statistics_in_units(
    scene: Scene,
    parameters: Mapping[str, Array],
    found: Statistics,
    of_each: Statistics | None,
    launch_heights: Array,
    lifts: NDArray[np.bool_] | None = None,
    lowest: Array | None = None,
) -> Measured:
    """Return statistics of realizations and of particles, as named in `vibrosweep.model.measures`.

    `found` and `of_each` are those of realizations and of trajectories.  Launches reach the heights
    given in m, of shape (realization, particle), or (realization, 1) where all reach the same.

    `lifts` says whether the base lifts a resting particle, which gives the number of flights; it is
    None if the kernels have counted flights.  The kernels measure heights from `lowest` below the
    mean level of the base.  In the high-bounce limit, where `lowest` is None, their totals hold
    square roots of the greatest heights.
    """
    measured = _physical(found, parameters, lifts, lowest)
    status = np.where(found.counted, found.status, np.int8(Status.REFUSED))
    measured |= {"at_rest_count": found.at_rest, "status": status}
    highest = measured["rebound_height_max"]
    reached = _highest_launches(scene, parameters["frequency"], launch_heights)
    measured["flight_height_max"] = np.fmax(highest, reached)
    if scene.measures.impact_speed:
        measured |= impact_speeds(found, parameters, scene.restitution_law)
    if scene.measures.per_particle and of_each is not None:
        measured |= _of_particles(of_each, parameters, scene.particles, lifts, lowest)
    return measured


def _of_particles(
    found: Statistics,
    parameters: Mapping[str, Array],
    particles: int,
    lifts: NDArray[np.bool_] | None,
    lowest: Array | None,
) -> Measured:
    """Return statistics of particles, shape (realization, particle)."""

    def repeated(values: Any) -> Any:
        return None if values is None else np.repeat(values, particles)

    units = {name: repeated(parameters[name]) for name in ("frequency", "gravity")}
    measured = _physical(found, units, repeated(lifts), repeated(lowest))
    measured |= {"at_rest": found.at_rest.astype(np.int8), "status": found.status}
    # copies, because the next batch overwrites the memory
    return {f"particle_{n}": v.reshape(-1, particles).copy() for n, v in measured.items()}


def _highest_launches(scene: Scene, frequency: Array, heights: Array) -> Array:
    """Return the greatest height of launches in the window; NaN where there is none."""
    launched = _launched_in_window(scene, frequency)
    if heights.shape[1] == 1:  # all launches reach the same height
        launched = np.any(launched, axis=1)[:, np.newaxis]
    reached = np.where(launched, heights, -np.inf).max(axis=1)
    return np.where(reached > -np.inf, reached, np.nan)


def impact_speeds(found: Statistics, parameters: Mapping[str, Array], law: str) -> Measured:
    """Return the greatest speeds of impact, and whether they are in the range of the law."""
    speed = found.total("impact_speed") * units_of(parameters).velocity
    lost = found.status == Status.NON_FINITE
    speed = np.where(lost | (found.landings == 0), np.nan, speed)
    with np.errstate(invalid="ignore"):
        outside = speed > fastest_in_range(law, parameters["restitution"], parameters.get(SPEED))
    decided = outside | (found.status == Status.COMPLETED)
    inside = np.where(decided, ~outside, UNDETERMINED)
    return {"impact_speed_max": speed, "law_in_range": inside.astype(np.int8)}


def separations_in_units(found: Separations, frequency: Array) -> Measured:
    """Return separations of realizations, by the names of `vibrosweep.model.measures`."""
    shared = found.shared
    resolved = np.where(np.isnan(found.gap), UNDETERMINED, found.gap > RESOLUTION)
    return {
        "dt_min": found.gap / frequency,
        "dt_min_resolved": resolved.astype(np.int8),
        "dt_min_same_index": found.same / frequency,
        "base_shared": shared,
        "collision_free": np.where(shared == UNDETERMINED, shared, 1 - shared).astype(np.int8),
    }


def order_in_units(found: Orders, frequency: Array) -> Measured:
    """Return the order of realizations, by the names of `vibrosweep.model.measures`."""
    names = ("order_1", "order_2", "order_3", "order_half", "order_third")
    return {
        **dict(zip(names, found.phases, strict=True)),
        "gap_median": found.gap_median / frequency,
        "gap_min": found.gap_least / frequency,
        "order_changes": found.changes,
    }


def _physical(
    found: Statistics,
    parameters: Mapping[str, Array],
    lifts: NDArray[np.bool_] | None,
    lowest: Array | None,
) -> Measured:
    unit, frequency = height_unit(parameters), parameters["frequency"]
    landings = found.landings
    rests = np.minimum(found.total("rests"), UNCOUNTED).astype(np.int64)
    # where the base lifts no resting particle, a rest is followed by no flight
    flights = found.total("flights") if lifts is None else landings - np.where(lifts, 0, rests)
    roots = lifts is not None and lowest is None
    ground = 0.0 if lowest is None else lowest
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        mean, largest = found.total("height_sum") / flights, found.total("height_max")
        of_flights = {
            "rebound_height_mean": unit * (mean - ground),
            "rebound_height_max": unit * (largest * largest if roots else largest - ground),
            "flight_time_mean": found.total("flight_sum") / flights / frequency,
        }
    # always the same NaN: the sign of 0 / 0 depends on the length of the batch
    known = {name: np.where(flights > 0, v, np.nan) for name, v in of_flights.items()}
    return {"impact_count": landings, "rest_count": rests, **known}


def _launched_in_window(scene: Scene, frequency: Array) -> NDArray[np.bool_]:
    """Return whether particles are launched in the window; shape (realization or 1, particle)."""
    frequency = frequency[:1] if np.all(frequency == frequency[:1]) else frequency
    begin, end = scene.measures.transient, scene.duration
    if isinstance(scene.launch, str):
        particles = scene.particles
        number = np.arange(particles, dtype=np.float64)
        first = _launches_until(begin, particles, frequency)[:, np.newaxis]
        last = _launches_until(end, particles, frequency)[:, np.newaxis]
        return np.asarray((first <= number) & (number <= last))
    times = np.asarray(scene.launch)[np.newaxis, :]
    if not isinstance(begin, Periods) and not isinstance(end, Periods):
        return np.asarray((begin <= times) & (times <= end))
    first, last = (in_periods(time, frequency)[:, np.newaxis] for time in (begin, end))
    periods = frequency[:, np.newaxis] * times
    return np.asarray((first <= periods) & (periods <= last))


def _launches_until(time: Time, particles: int, frequency: Array) -> Array:
    """Return a time in units of the interval between staggered launches."""
    per_time = particles * (np.ones_like(frequency) if isinstance(time, Periods) else frequency)
    return np.asarray(per_time * amount(time))
