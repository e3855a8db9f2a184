"""The joint state on a base of finite mass: its Floquet map, exponents and recurrence."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from vibrosweep.engine.coupled import measure_coupled, standard_error
from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels._jit import uncounted
from vibrosweep.kernels.bases.sprung import bounds, loaded, mount, side_at, velocity
from vibrosweep.kernels.coupled.events import EVENT, MODE, NOW, PARTICLE, let_pass, locate, system
from vibrosweep.kernels.coupled.follow import Coupled
from vibrosweep.kernels.coupled.joint_orbits import (
    BLOCKS,
    WAVES,
    _add_waves,
    empty_joint,
    follow_event,
    notes,
    propagate,
    settle_jointly,
)
from vibrosweep.kernels.restitution import Constant
from vibrosweep.kernels.waveforms import Sine
from vibrosweep.model.coupled_theory import CoupledBase, monodromy, spectral_radius, staggered
from vibrosweep.model.forcing import completed, only_parameters
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS, Periods, dimensionless, launches, mounts
from vibrosweep.scene.scene import Scene


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


@uncounted
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
        event, load = follow_event(state, fixed, load, 0.0, left, rode, deviations)
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


@pytest.mark.parametrize("mass_ratio", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("natural", [0.37, 1.6])
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
    waves = np.zeros((rows, WAVES))
    for i in range(rows):
        for k, one in enumerate(growth[i]):
            _add_waves(one, (k + 0.5) / events, waves[i])
    error = standard_error(growth.reshape(rows, BLOCKS, -1).sum(axis=2), waves)
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
