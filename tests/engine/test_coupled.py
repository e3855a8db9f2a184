"""Particles on a base of finite mass, and theory of bases that move."""

import inspect
from dataclasses import dataclass, replace

import numpy as np
import pytest

import vibrosweep as vs
from one_slot import is_clear, pair_gaps, pattern_orbit
from tests.cases import each_of
from vibrosweep import simulate, theory
from vibrosweep.engine import coupled
from vibrosweep.engine.coupled import measure_coupled, standard_error
from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.bases.sprung import bounds, loaded, mount, side_at, velocity
from vibrosweep.kernels.coupled.events import EVENT, MODE, NOW, PARTICLE, let_pass, locate, system
from vibrosweep.kernels.coupled.joint_orbits import (
    BLOCKS,
    WAVES,
    _add_waves,
    advance_event,
    empty_joint,
    notes,
    propagate,
    settle_jointly,
)
from vibrosweep.kernels.coupled.realizations import Coupled, clear, landings, note, work_for
from vibrosweep.kernels.ordering import Listed
from vibrosweep.kernels.restitution import Constant
from vibrosweep.kernels.waveforms import Sine
from vibrosweep.model.forcing import completed, only_parameters
from vibrosweep.model.measures import MEASURES, Regime
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS, Periods, dimensionless, launches, mounts
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import keyword_spec
from vibrosweep.theory import sprung as coupled_theory
from vibrosweep.theory.sprung import CoupledBase, monodromy, spectral_radius, staggered

pytestmark = pytest.mark.usefixtures("plain_pieces")

# Particles on a base of finite mass: massless particles, conserved momentum, and measures.

LAUNCHES = (0.0, 0.125, 0.3, 0.55)
MOUNT = {"mass_ratio": 0.02, "mount_frequency": 0.37, "mount_damping": 0.05}


@each_of(
    ("restitution", "gamma"),
    [(0.9, 0.4), (0.85, 0.97), (0.5, 2.5), (0.0, 2.2), (0.3, 3.7), (1.0, 0.2)],
)
def test_without_mass_particles_do_not_act_on_each_other(restitution, gamma):
    scene = {"restitution": restitution, "base_acceleration": gamma, "launch_time": list(LAUNCHES)}
    scene["ordering"] = True
    alone = vs.simulate(base="moving", duration=6.0, **scene)
    mount = {"mass_ratio": 0.0, "mount_frequency": 0.6, "mount_damping": 0.1}
    coupled = vs.simulate(base="sprung", duration=6.0, **scene, **mount)
    assert np.array_equal(alone.impact_count, coupled.impact_count)
    assert np.array_equal(alone.rested, coupled.rested)
    ordered = [v.name for v in MEASURES["ordering"].variables]
    for name in ("landing_time", "liftoff_time", "rebound_velocity", *ordered):
        # orbits that are not chaotic over six periods
        np.testing.assert_allclose(coupled[name], alone[name], rtol=0.0, atol=1e-12)


def measured(observation, threads=1, **given):
    parameters = all_parameters({name: np.asarray(values) for name, values in given.items()})
    with Workers(threads) as workers:
        return measure_coupled(parameters, observation, workers)


def test_results_depend_neither_on_threads_nor_on_the_batch():
    rng = np.random.default_rng(3)
    given = {"restitution": rng.uniform(0.5, 0.95, 40), "amplitude": rng.uniform(0.5, 4.0, 40)}
    given |= {name: np.full(40, value) for name, value in MOUNT.items()}
    asked = Measures(separation=True, per_particle=True, ordering=True)
    scene = Scene(3, "staggered", 5.0, "rest", asked, base="sprung")
    whole = measured(scene, threads=2, **given)
    halves = [
        measured(scene, **{n: v[part] for n, v in given.items()})
        for part in (slice(0, 13), slice(13, 40))
    ]
    for name, values in whole.items():
        parts = np.concatenate([half[name] for half in halves])
        assert np.array_equal(values, parts, equal_nan=values.dtype.kind == "f"), name


def test_particles_at_rest_together_rest_for_good():
    scene = Scene(2, (0.0, 0.4), 60.0, "rest", Measures(ordering=True), base="sprung")
    given = {"restitution": [0.4], "amplitude": [0.4]} | {n: [v] for n, v in MOUNT.items()}
    found = measured(scene, **given)
    assert found["at_rest_count"] == 2
    assert found["status"] == 0


def test_a_realization_without_budget_or_finite_numbers_gets_a_status():
    scene = Scene(2, (0.0, 0.4), 60.0, "rest", Measures(impact_budget=6), base="sprung")
    mount = {n: [v] * 2 for n, v in MOUNT.items()}
    given = {"restitution": [0.9, 0.9], "amplitude": [1.2, 1e25]} | mount
    assert measured(scene, **given)["status"].tolist() == [1, 2]


def test_a_budget_of_just_the_landings_in_the_window_is_enough():
    """Flights that end after the window are followed to their landing, which is not counted."""
    scene = {"restitution": [0.9], "amplitude": [1.2]} | {n: [v] for n, v in MOUNT.items()}
    landed = vs.simulate(base="sprung", launch_time=[0.0, 0.4], duration=8.0, **scene)
    sixth, seventh = landed.landing_time.values[0, 0, 5:7]
    asked = Measures(per_particle=True, impact_budget=6)
    for end, status in ((0.5 * (sixth + seventh), 0), (seventh + 1e-3, 1)):
        watched = Scene(2, (0.0, 0.4), end, "rest", asked, base="sprung")
        found = measured(watched, **scene)
        assert found["particle_impact_count"].max() == 6
        assert found["status"] == status


def test_results_do_not_depend_on_the_initial_memory_for_impact_numbers(monkeypatch):
    given = {"restitution": np.array([0.3, 0.9]), "amplitude": np.array([3.0, 0.8])}
    given |= {name: np.full(2, value) for name, value in MOUNT.items()}
    asked = Measures(separation=True, per_particle=True, ordering=True)
    scene = Scene(3, (0.0, 2.0, 3.5), 8.0, "rest", asked, base="sprung")
    found = measured(scene, **given)
    asked_for = []

    def small(particles):
        asked_for.append(particles)
        return work_for(particles)._replace(landings=landings(particles, 1))

    monkeypatch.setattr(coupled, "work_for", small)
    again = measured(scene, **given)
    assert asked_for
    for name, values in found.items():
        assert values.tobytes() == again[name].tobytes(), name


def test_a_separation_of_equal_numbers_once_unknown_stays_unknown():
    memory = landings(2, 1)
    noted = clear(memory)
    for time, who in ((0.1, 0), (0.2, 0), (0.3, 1), (0.4, 1)):
        # the first landing of particle 1 meets a memory in which that of particle 0 is lost
        landing = Listed(0.0, time, 1e-4, float(who))
        noted = note(memory, noted, landing, False, Instant(0.0, 0.0))
    assert memory.numbered[1, 0] == 0.4
    assert np.isnan(noted.same)


def test_a_stiff_overdamped_mount_moves_nearly_as_its_foot():
    """The recoil decays in 1e-6 periods, which steps along a ride need not resolve."""
    scene = {
        "restitution": [0.0, 0.6],
        "base_acceleration": [1.5, 2.0],
        "launch_time": list(LAUNCHES),
    }
    mount = {"mass_ratio": 1e-3, "mount_frequency": 1e3, "mount_damping": 100.0}
    found = vs.simulate(base="sprung", duration=3.0, **scene, **mount)
    assert np.all(found.status == 0)
    foot = vs.simulate(base="moving", duration=3.0, **scene)
    first = {"impact": slice(0, 3)}
    np.testing.assert_allclose(
        found.landing_time.isel(first), foot.landing_time.isel(first), rtol=0.0, atol=0.01
    )


def test_a_mount_too_stiff_to_be_followed_is_given_up():
    """Steps along a ride resolve the free motion of the mount, which takes 1e-13 periods here."""
    found = vs.simulate(
        base="sprung",
        mass_ratio=1e-3,
        mount_frequency=1e9,
        mount_damping=1e3,
        restitution=0.0,
        launch_time=list(LAUNCHES),
        duration=3.0,
    )
    assert np.all(found.status != 0)


def test_no_landing_after_the_end_is_counted():
    # a landing 0.002 s after the end, found from a time before it
    found = vs.simulate(
        base="sprung",
        restitution=0.8471255169228993,
        amplitude=2.8406517595636323,
        phase=-0.17214200890901177,
        contact_time=0.01,
        mass_ratio=0.3868652278147594,
        mount_frequency=0.28496882145491936,
        mount_damping=1.0604476434834353,
        launch_time=[j / 10 for j in range(10)],
        duration=3.0,
    )
    assert float(found.landing_time.max()) <= 3.0


@pytest.mark.parametrize("mass_ratio", [0.0, 0.01])
def test_a_launch_that_lands_at_once_is_highest_where_it_begins(mass_ratio):
    """The base rises faster than the particle, and carries it from its launch on."""
    found = vs.sweep(
        base="sprung",
        mass_ratio=mass_ratio,
        mount_frequency=0.4,
        amplitude=0.1,
        restitution=0.0,
        launch_velocity=0.01,
        launch=[1.0 / 3.0],
        duration=3.0,
    )
    height = -0.1 / (2.0 * np.pi) * np.cos(2.0 * np.pi / 3.0)
    assert float(found.flight_height_max.squeeze()) == pytest.approx(height, rel=1e-12)


# Results of the engine over a base of finite mass, against `model.coupled_theory`.

E, GAMMA, NATURAL, DAMPING = 0.9, 0.6, 0.37, 0.05
UNIT = 9.81 / 2.0  # of speed, at 1 Hz: flights of one period


def followed(launch, k, duration, **changes):
    """Record of every landing; times in periods."""
    scene = {
        "base": "sprung",
        "restitution": E,
        "base_acceleration": GAMMA,
        "mass_ratio": 0.01,
        "mount_frequency": NATURAL,
        "mount_damping": DAMPING,
        "launch_velocity": k * UNIT,
        "launch_time": launch,
        "duration": duration,
    }
    return simulate(**scene | changes)


def landings_coupled_theory(launch, k, duration, **changes):
    """Times of landing; shape (realization, particle, impact)."""
    return followed(launch, k, duration, **changes)["landing_time"].values


def phase_of(k, mass_ratio=0.0):
    return float(coupled_theory.landing_phase(GAMMA, k, E, mass_ratio, NATURAL, DAMPING))


def last(times, count):
    """Last landings of each particle of one realization; shape (particle, count)."""
    return np.array([own[np.isfinite(own)][-count:] for own in times])


def locked_phases(base, k):
    """Phases of the last landings of those of eight launches that were locked to mode k.

    Orbits with rests are left out: with one rest per period they also land once per period.
    """
    turns = np.linspace(0.2, 0.5, 8)
    seen = followed(
        0.0,
        k,
        1000.0,
        restitution=base.restitution,
        base_acceleration=base.acceleration,
        mass_ratio=base.mass_ratio,
        mount_frequency=base.natural,
        mount_damping=base.damping,
        phase=2.0 * np.pi * turns,
        contact_time=1e-2,  # a particle that is not locked soon rests
    )
    found = []
    for i, turn in enumerate(turns):
        ends = last(seen["landing_time"].values[i], 20)[0]
        late = seen["landing_time"].values[i] > 980.0
        if (seen["rested"].values[i][late] == 1).any():
            continue
        if ends.size == 20 and ends[-1] > 990.0 and np.abs(np.diff(ends) - k).max() < 1e-9:
            found.append((ends[-1] + turn) % 1.0)
    return np.array(found)


@each_of(
    ("damping", "mass_ratio", "natural", "above", "restitution"),
    [
        (0.0, 0.05, 0.725, 1.3, 0.9),
        (0.0, 0.1, 0.631, 1.5, 0.9),
        (0.0, 0.2, 0.5, 1.2, 0.5),
        (0.0, 0.3, 0.532, 1.2, 0.5),
        (0.0, 0.5, 1.492, 1.05, 0.7),
        (0.05, 0.02, 3.782, 1.05, 0.5),
        (0.05, 0.5, 1.492, 1.5, 0.9),
        (0.2, 0.1, 1.818, 1.05, 0.7),
        (0.2, 0.5, 1.42, 1.3, 0.9),
        (1.5, 0.2, 0.887, 1.05, 0.5),
    ],
)
def test_a_particle_locks_where_and_when_the_closed_form_says(
    damping, mass_ratio, natural, above, restitution
):
    """Some of the launches lead to this stable orbit, others to an orbit with rests."""
    least = coupled_theory.locked_acceleration_min(1, restitution, mass_ratio, natural, damping)
    base = CoupledBase(restitution, above * float(least), mass_ratio, natural, damping)
    cycle = staggered(base, 1, [0])
    assert spectral_radius(cycle) < 0.985
    assert is_clear(cycle)
    found = locked_phases(base, 1)
    assert found.size > 0
    assert found == pytest.approx(np.full(found.shape, cycle.time[0]), abs=1e-8)
    assert locked_phases(base._replace(acceleration=0.99 * float(least)), 1).size == 0
    if damping == 0.0:
        alone = np.pi * (1.0 - restitution) / (1.0 + restitution)
        assert least == pytest.approx(alone * (1.0 + mass_ratio), rel=1e-12)


def exact_gaps(k, mass_ratio, rank):
    """Gaps of the two particles of a pattern on its exact orbit, sorted."""
    base = CoupledBase(E, GAMMA, mass_ratio, NATURAL, DAMPING)
    return pair_gaps(pattern_orbit(base, k, rank))


@pytest.mark.parametrize("k", [1, 2])
def test_two_particles_in_one_slot_keep_the_gaps_of_their_pattern(k):
    mass_ratio = np.array([1e-4, 1e-3, 1e-2])
    patterns = {"two": [[0, 1], [1, 0]], "three": [[1, 0], [0, 1], [1, 0]]}
    reached = set()
    for apart in (0.001, 0.0023, 0.01, 0.1):
        times = landings_coupled_theory(
            phase_of(k) + np.array([0.0, apart]), k, 600.0 * k, mass_ratio=mass_ratio
        )
        for mu, pair in zip(mass_ratio, times, strict=True):
            ends = last(pair, 6)
            gaps = np.sort(np.abs(ends[1] - ends[0]))
            for name, rank in patterns.items():
                exact = exact_gaps(k, mu, rank)
                if np.abs(gaps - np.repeat(exact, 6 // exact.size)).max() < 1e-10:
                    reached.add((mu, name))
            assert gaps[0] > k * mu  # never together
    assert {name for mu, name in reached if mu == 1e-3} == set(patterns)
    assert {mu for mu, _ in reached} == set(mass_ratio)


def test_reversing_gaps_are_those_of_first_order_for_small_masses():
    mass_ratio = np.array([1e-5, 1e-4, 1e-3])
    times = landings_coupled_theory(
        phase_of(1) + np.array([0.0, 1e-2]), 1, 600.0, mass_ratio=mass_ratio
    )
    for mu, pair in zip(mass_ratio, times, strict=True):
        ends = last(pair, 6)
        law = coupled_theory.reversing_separation(1, E, GAMMA, mu)
        gaps = ends[1] - ends[0]
        if np.ptp(np.abs(gaps)) < 1e-8:  # else the pattern of three
            assert np.abs(gaps) == pytest.approx(float(law), rel=4.0 * mu + 1e-6)


@pytest.mark.parametrize("natural", [0.37, 0.77])  # at 0.21 two pairs nearly coincide and beat
def test_staggered_particles_return_at_the_rate_of_the_spectral_radius(natural):
    cycle = staggered(CoupledBase(E, GAMMA, 0.01, natural, DAMPING), 2, [0, 1])
    times = landings_coupled_theory(
        cycle.time + np.array([0.0, 1e-3]), 2, 360.0, mount_frequency=natural
    )[0]
    ends = np.sort(times[np.isfinite(times)])
    off = np.abs(ends - (cycle.time[0] + np.rint(ends - cycle.time[0])))
    early, late = (off[(ends > t) & (ends < t + 30.0)].max() for t in (140.0, 320.0))
    # 15 landings of each show the envelope of a complex pair to 20 %, or 0.001 per period
    assert (late / early) ** (1.0 / 180.0) == pytest.approx(spectral_radius(cycle), abs=1e-3)


def test_staggered_particles_in_resonance_leave():
    cycle = staggered(CoupledBase(E, GAMMA, 0.01, 1.6, DAMPING), 2, [0, 1])
    assert spectral_radius(cycle) > 1.06
    times = landings_coupled_theory(
        cycle.time + np.array([0.0, 1e-3]), 2, 300.0, mount_frequency=1.6
    )[0]
    assert np.abs(np.diff(last(times, 10), axis=1) - 2.0).max() > 0.1


# The joint state on a base of finite mass: its Floquet map, exponents and recurrence.


@dataclass(frozen=True)
class Neighbours:
    """A state in which all particles fly, and the derivative of the motion that led to it."""

    height: np.ndarray  # of each particle above the base, in g / (2 f^2)
    speed: np.ndarray  # of each particle relative to the base, in g / (2 f)
    phase: float  # of the forcing, in turns
    deviation: tuple[float, float]  # of the base from its forced oscillation: height and velocity
    # Derivative by the initial heights and velocities of the particles and of the base, shape
    # (2 * particle + 2, 2 * particle + 2)
    matrix: np.ndarray
    landings: int  # during the motion


def carry(state, problem, mounts, i, periods, rode, deviations):
    """Advance a state, and deviations from it, by some forcing periods.

    Returns the number of landings, or -1 if the search for one was abandoned.  All particles of the
    state fly.  Before and after, the state holds heights and speeds relative to the base, the
    phase, the deviation of the base from its forced oscillation and, at `NOW.B`, the velocity of
    that deviation.  `rode` is scratch memory, a number for each particle.  Deviations have shape
    (2 * particle + 2, column): heights and velocities of the particles, height and velocity of the
    base.
    """
    fixed, now = mount(problem, mounts, i), state.now
    load = loaded(fixed, 0, side_at(fixed.waveform, now[NOW.X]))
    now[NOW.B] += load.slow * now[NOW.D]
    locate(state, load)
    now[NOW.HIGHEST], now[NOW.LIFT] = bounds(load, now[NOW.D], now[NOW.B]).height, np.inf
    begun, landings = now[NOW.X], 0
    while True:
        left = periods - now[NOW.N] - (now[NOW.X] - begun)
        event, load = advance_event(state, fixed, load, 0.0, left, rode, deviations)
        if event.kind == EVENT.LOST:
            return -1
        if event.kind <= EVENT.LOST:
            break
        landings += 0 if event.kind == EVENT.LIFT or event.kind == EVENT.CORNER else 1
    let_pass(state, load, left)
    now[NOW.B] = velocity(load, now[NOW.D], now[NOW.B])
    propagate(load, left, state.mode, deviations)
    for j in range(state.mode.size):
        if state.mode[j] == MODE.RIDING:
            state.particle[PARTICLE.HEIGHT, j] = state.particle[PARTICLE.SPEED, j] = 0.0
    return landings


def carry_on(parameters, begin, periods):
    """Carry a state on for some forcing periods; its matrix becomes that of the Floquet map."""
    problem = dimensionless(parameters, Periods(periods))
    state, matrix = system(begin.height.size), np.array(begin.matrix, order="F")
    state.mode[:] = MODE.FLYING
    state.particle[PARTICLE.HEIGHT], state.particle[PARTICLE.SPEED] = begin.height, begin.speed
    state.particle[PARTICLE.SCALE] = np.abs(begin.speed)
    state.now[NOW.X] = begin.phase
    state.now[NOW.D], state.now[NOW.B] = begin.deviation
    rode = np.zeros_like(state.mode)
    held = mounts(parameters, Constant(), Sine())
    landings = carry(state, problem, held, 0, periods, rode, matrix)
    assert landings >= 0
    return Neighbours(
        state.particle[PARTICLE.HEIGHT].copy(),
        state.particle[PARTICLE.SPEED].copy(),
        float(state.now[NOW.X]),
        (float(state.now[NOW.D]), float(state.now[NOW.B])),
        matrix,
        landings,
    )


def parameters_of(base):
    """Parameters of one realization at 1 Hz."""
    given = {name: np.array([PARAMETERS[name].default]) for name in PARAMETERS}
    del given["amplitude"]
    given["restitution"] = np.array([base.restitution])
    given["base_acceleration"] = np.array([base.acceleration])
    given |= {
        "mass_ratio": np.array([base.mass_ratio]),
        "mount_frequency": np.array([base.natural]),
        "mount_damping": np.array([base.damping]),
    }
    return only_parameters(completed(given))


def after_first_impact(cycle):
    """State of a cycle in closed form, just after its first impact."""
    base, time, particles = cycle.base, cycle.time, np.unique(cycle.particle).size
    d, v = cycle.deviation[0]
    v -= base.mass_ratio * base.exchange * cycle.approach[0]
    drive, speed, _ = base.drive(time[0])
    height, relative = np.empty(particles), np.empty(particles)
    for i in range(particles):
        own = np.flatnonzero(cycle.particle == i)
        last = own[0] if own[0] == 0 else own[-1]
        passed = time[0] - (time[last] - (0 if last == 0 else cycle.periods))
        left = base.drive(time[last])[0] + cycle.deviation[last][0]
        height[i] = left + cycle.speed[last] * passed - passed**2 - (drive + d)
        relative[i] = cycle.speed[last] - 2.0 * passed - (speed + v)
    phase = float(time[0] - np.rint(time[0]))
    identity = np.eye(2 * particles + 2)
    return Neighbours(height, relative, phase, (float(d), float(v)), identity, 0)


@pytest.mark.parametrize(
    ("natural", "printed"), [(0.21, 0.948), (0.37, 0.947), (0.77, 0.953), (1.60, 1.070)]
)
def test_floquet_map_of_staggered_particles(natural, printed):
    base = CoupledBase(0.9, 0.6, 0.01, natural, 0.05)
    cycle = staggered(base, 2, [0, 1])
    # a quarter of a period later, so that no impact falls on either end
    later = carry_on(parameters_of(base), after_first_impact(cycle), 0.25)
    begin = replace(later, matrix=np.eye(6))
    end = carry_on(parameters_of(base), begin, cycle.periods)
    assert end.landings == 2
    assert end.height == pytest.approx(begin.height, abs=1e-12)
    assert end.speed == pytest.approx(begin.speed, abs=1e-12)
    assert end.deviation == pytest.approx(begin.deviation, abs=1e-12)
    radius = max(abs(np.linalg.eigvals(end.matrix)))
    assert radius == pytest.approx(spectral_radius(cycle) ** cycle.periods, abs=1e-10)
    assert radius ** (1.0 / cycle.periods) == pytest.approx(printed, abs=5e-4)
    assert np.linalg.det(end.matrix) == pytest.approx(np.linalg.det(monodromy(cycle)), rel=1e-9)


@each_of("mass_ratio", [0.05, 0.2, 0.5])
@each_of("natural", [0.37, 1.6])
def test_a_locked_orbit_without_damping_exists_just_above_its_limit_even_if_unstable(
    mass_ratio, natural
):
    limit = np.pi * 0.1 / 1.9 * (1.0 + mass_ratio)
    base = CoupledBase(0.9, 1.001 * limit, mass_ratio, natural, 0.0)
    cycle = staggered(base, 1, [0])
    later = carry_on(parameters_of(base), after_first_impact(cycle), 0.25)
    end = carry_on(parameters_of(base), replace(later, matrix=np.eye(4)), 4.0)
    assert end.landings == 4
    growth = max(1.0, spectral_radius(cycle)) ** 4
    assert end.height == pytest.approx(later.height, abs=1e-12 * growth)
    assert end.deviation == pytest.approx(later.deviation, abs=1e-12 * growth)


def test_matrix_is_the_derivative_and_volume_contracts_as_theory_says():
    base = CoupledBase(0.7, 1.3, 0.05, 0.6, 0.1)
    parameters = parameters_of(base)
    begin = Neighbours(
        np.array([0.1, 0.35, 0.6]),
        np.array([0.5, -0.4, 0.2]),
        0.1,
        (0.01, -0.03),
        np.eye(8),
        0,
    )
    periods, step = 1.6, 1e-6
    end = carry_on(parameters, begin, periods)
    assert end.landings >= 4
    # absolute coordinates: heights and velocities of particles shift with those of the base
    change = np.eye(8)
    change[0:3, 6] = change[3:6, 7] = -1.0
    relative = change @ end.matrix @ np.linalg.inv(change)
    for column in range(8):
        sides = []
        for sign in (1.0, -1.0):
            z = np.concatenate([begin.height, begin.speed, begin.deviation])
            z[column] += sign * step
            one = carry_on(
                parameters,
                Neighbours(z[:3], z[3:6], begin.phase, (z[6], z[7]), np.eye(8), 0),
                periods,
            )
            assert one.landings == end.landings
            sides.append(np.concatenate([one.height, one.speed, one.deviation]))
        slope = (sides[0] - sides[1]) / (2.0 * step)
        np.testing.assert_allclose(relative[:, column], slope, rtol=1e-6, atol=1e-6)
    zeta, w0 = base.damping, 2.0 * np.pi * base.natural
    expected = base.restitution ** (2 * end.landings) * np.exp(-2.0 * zeta * w0 * periods)
    # from impact to impact, the volume changes by e^2 times a ratio of speeds of approach, which
    # cancels over an orbit; between two instants in flight, as here, by exactly e^2 per impact
    assert np.linalg.det(end.matrix) == pytest.approx(expected, rel=1e-10)


def settled(measures, duration, **given):
    parameters = all_parameters({name: np.array([v]) for name, v in given.items()})
    launch = (0.0, 0.45)
    with Workers(1) as workers:
        found = measure_coupled(
            parameters,
            Scene(2, launch, duration, "rest", measures, base="sprung"),
            workers,
        )
    return {name: values[0] for name, values in found.items()}


def test_a_locked_joint_state_recurs_and_its_neighbours_approach():
    found = settled(
        Measures(joint=True, transient=100.0),
        1500.0,
        restitution=0.7,
        amplitude=2.2,
        mass_ratio=0.01,
        mount_frequency=0.37,
        mount_damping=0.05,
    )
    assert found["joint_exponent"] + 3.0 * found["joint_exponent_error"] < 0.0
    if found["joint_cycle_impacts"] > 0:
        assert found["joint_regime"] in (1, 2)
        assert found["joint_recurrent_from"] < 1500.0


def test_rest_after_the_last_landing_that_the_budget_allows_is_seen():
    scene = {"restitution": 0.5, "amplitude": 0.1, "mass_ratio": 0.05}
    scene |= {"mount_frequency": 0.4, "mount_damping": 0.1}
    parameters = all_parameters({name: np.array([v]) for name, v in scene.items()})
    launch = launches((0.0, 0.3), 2, parameters["frequency"])
    batch = Coupled(dimensionless(parameters, 60.0), mounts(parameters, Constant(), Sine()), launch)

    def found(budget):
        out = empty_joint(1)
        settle_jointly(0, 1, batch, budget, notes(2), out)
        return out

    landings = int(found(10_000).landings[0])
    assert 0 < landings < 10_000
    assert found(landings).at_rest[0] == found(10_000).at_rest[0] == 1


@pytest.mark.parametrize(("walk", "ends"), [(1.0, 0.0), (0.0, 1.0), (0.03, 1.0)])
def test_standard_error_of_growth_that_adds_up_and_of_shifts_at_ends_of_blocks(walk, ends):
    rng, rows, events = np.random.default_rng(6), 1000, 2000
    turned = np.diff(rng.normal(0.0, ends, (rows, events + 1)), axis=1)
    growth = rng.normal(0.0, walk, (rows, events)) + turned
    waves, add = np.zeros((WAVES, rows)), inspect.unwrap(_add_waves)
    for k in range(events):
        add(growth[:, k], (k + 0.5) / events, waves)
    error = standard_error(growth.reshape(rows, BLOCKS, -1).sum(axis=2), waves.T)
    scatter = np.sqrt(events * walk**2 + 2.0 * ends**2)
    # slow waves of 2000 events hold (2 pi)^2 7.5 t^2 / 2000 = 0.15 t^2 of the ends' variance 2 t^2
    assert np.sqrt(np.mean(error**2)) == pytest.approx(scatter, rel=0.06)
    assert 0.6 < np.mean(abs(growth.sum(axis=1)) < error) < 0.74


@pytest.mark.parametrize(
    ("restitution", "gamma", "mass_ratio", "natural", "transient"),
    [
        pytest.param(0.85, 2.2, 0.05, 1.6, 40.0, id="irregular"),
        pytest.param(0.8, 0.7, 0.001, 1.6, 300.0, id="locked"),
    ],
)
def test_standard_error_is_the_scatter_over_launches(
    restitution, gamma, mass_ratio, natural, transient
):
    """For locked motion, the scatter of the blocks would overestimate the error 2.5 times."""
    rng, size = np.random.default_rng(1), 60
    given = {
        "restitution": restitution,
        "amplitude": gamma * 9.81 * (1.0 + restitution) / (2.0 * np.pi),
        "mass_ratio": mass_ratio,
        "mount_frequency": natural,
        "mount_damping": 0.05,
    }
    parameters = {name: np.full(size, value) for name, value in given.items()}
    parameters["launch_velocity"] = rng.uniform(2.0, 8.0, size)
    asked = Measures(joint=True, transient=transient)
    watched = Scene(3, (0.0, 0.33, 0.67), transient + 203.7, "rest", asked, base="sprung")
    with Workers(1) as workers:
        found = measure_coupled(all_parameters(parameters), watched, workers)
    exponent, error = found["joint_exponent"], found["joint_exponent_error"]
    middle = np.nanmedian(exponent)
    alike = abs(exponent - middle) < 0.3 * abs(middle)  # on one attractor
    ratio = np.sqrt(np.mean(error[alike] ** 2)) / exponent[alike].std()
    assert alike.sum() > 45
    assert 0.5 < ratio < 1.5


# Results of the engine over a moving base, against the closed forms of `vibrosweep.theory`.


def test_first_flights_after_a_rest_last_as_long_as_the_closed_form_says():
    gamma = np.concatenate([1.0 + np.geomspace(1e-4, 0.5, 40), np.linspace(1.6, 11.0, 60)])
    record = simulate(base="moving", restitution=0.0, base_acceleration=gamma, duration=14.0)
    landing, left, rested = (
        record[name].values[:, 0] for name in ("landing_time", "liftoff_time", "rested")
    )
    flights = np.where(rested[:, :-1] == 1, landing[:, 1:] - left[:, :-1], np.nan)
    exact = theory.liftoff_flight(gamma)[:, np.newaxis]
    seen = np.isfinite(flights)
    assert seen.any(axis=1).all()
    assert np.all(np.abs(flights - exact)[seen] < 1e-10)


def test_locked_orbits_contract_as_the_multipliers_say(workers):
    k, e, share = (v.ravel() for v in np.meshgrid((1, 2, 3), (0.2, 0.5, 0.7, 0.9), (0.1, 0.5, 0.9)))
    low, high = theory.amplitude_min(k, e), theory.amplitude_max(k, e, base="moving")
    amplitude = low + share * (high - low)
    phase = theory.locked_phase(k, e, amplitude)
    pair = theory.multipliers(k, e, amplitude, base="moving")
    for i in range(k.size):
        scene = keyword_spec(
            {
                "base": "moving",
                "restitution": e[i],
                "amplitude": amplitude[i],
                "launch": [phase[i] + 1e-3],
                "launch_velocity": float(theory.locked_velocity(k[i])),
                "duration_periods": float(theory.recognition_periods(e[i], k[i], "moving"))
                + 400.0 * k[i],
            }
        ).scene
        found = measure(scene.parameters({}), scene.only(lyapunov=True), workers)
        assert found["regime"].item() == Regime.LOCKED
        assert (found["cycle_impacts"].item(), found["cycle_periods"].item()) == (1, k[i])
        leading = np.log(np.abs(pair[i]).max())
        # multipliers that nearly coincide move by the root of a rounding
        apart = abs(np.subtract(*pair[i]))
        error = found["lyapunov_largest_error"].item() + min(1e-7, 1e-14 / apart)
        assert abs(found["lyapunov_largest"].item() - leading) <= error
        total = theory.exponent_sum(e[i], "moving")
        assert (
            abs(found["lyapunov_sum"].item() - total) <= found["lyapunov_sum_error"].item() + 1e-14
        )


def test_exponents_of_orbits_without_rests_sum_to_twice_the_logarithm(workers):
    rng = np.random.default_rng(5)
    e = rng.uniform(0.3, 0.98, 300)
    scene = keyword_spec(
        {"base": "moving", "particles": 2, "duration": 800.0, "phase": 0.3, "launch_velocity": 7.0}
    ).scene
    parameters = scene.parameters(
        {"restitution": e, "base_acceleration": rng.uniform(0.1, 3.0, e.size)}
    )
    found = measure(parameters, scene.only(lyapunov=True, regimes=True), workers)
    locked = found["regime"] == Regime.LOCKED
    apart = found["lyapunov_sum"] - theory.exponent_sum(e, "moving")[:, np.newaxis]
    assert locked.sum() > 100
    assert np.all(np.abs(apart[locked]) <= found["lyapunov_sum_error"][locked] + 1e-14)


def test_flights_keep_to_their_bounds():
    rng = np.random.default_rng(8)
    e, gamma = rng.uniform(0.0, 0.95, 200), rng.uniform(0.1, 8.0, 200)
    record = simulate(
        base="moving", restitution=e, base_acceleration=gamma, launch_time=[0.0, 0.4], duration=40.0
    )
    kick = gamma * (1.0 + e) / np.pi
    launched = np.full(e.size, 2.0 * 5.0 / 9.81)
    speed = record["rebound_velocity"].values * 2.0 / 9.81
    bound = theory.liftoff_speed_bound(launched, kick, e, "moving")
    assert np.all(np.nanmax(speed, axis=(1, 2), initial=0.0) <= bound * (1.0 + 1e-12))
    time = record["landing_time"].values[:, :, 1:] - record["liftoff_time"].values[:, :, :-1]
    longest = theory.flight_time_bound(launched, kick, e, "moving")
    assert np.all(np.nanmax(time, axis=(1, 2), initial=0.0) <= longest * (1.0 + 1e-12))
    assert np.nanmax(speed, axis=(1, 2), initial=0.0).max() > 0.5 * bound.min()
