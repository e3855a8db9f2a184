"""Results of the engine over a base of finite mass, against `model.coupled_theory`."""

import numpy as np
import pytest

from one_slot import is_clear, pair_gaps, pattern_orbit
from vibrosweep import simulate
from vibrosweep.model import coupled_theory
from vibrosweep.model.coupled_theory import CoupledBase, spectral_radius, staggered

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


def landings(launch, k, duration, **changes):
    """Times of landing; shape (realization, particle, impact)."""
    return followed(launch, k, duration, **changes)["landing_time"].values


def phase_of(k, mass_ratio=0.0):
    return float(coupled_theory.landing_phase(GAMMA, k, E, mass_ratio, NATURAL, DAMPING))


def last(times, count):
    """Last landings of each particle of one realization; shape (particle, count)."""
    return np.array([own[np.isfinite(own)][-count:] for own in times])


def test_without_mass_the_base_is_the_moving_one():
    launch = [0.1, 0.4, 0.45, 0.7]
    light = landings(launch, 1, 60.0, mass_ratio=0.0)
    moving = simulate(
        base="moving",
        restitution=E,
        base_acceleration=GAMMA,
        launch_velocity=UNIT,
        launch_time=list(launch),
        duration=60.0,
    )["landing_time"].values
    for one, other in zip(light[0], moving[0], strict=True):
        n = np.count_nonzero(np.isfinite(other))
        assert np.count_nonzero(np.isfinite(one)) == n
        assert np.abs(one[:n] - other[:n]).max() < 1e-12 * 60.0


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


@pytest.mark.parametrize(
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
        times = landings(phase_of(k) + np.array([0.0, apart]), k, 600.0 * k, mass_ratio=mass_ratio)
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
    times = landings(phase_of(1) + np.array([0.0, 1e-2]), 1, 600.0, mass_ratio=mass_ratio)
    for mu, pair in zip(mass_ratio, times, strict=True):
        ends = last(pair, 6)
        law = coupled_theory.reversing_separation(1, E, GAMMA, mu)
        gaps = ends[1] - ends[0]
        if np.ptp(np.abs(gaps)) < 1e-8:  # else the pattern of three
            assert np.abs(gaps) == pytest.approx(float(law), rel=4.0 * mu + 1e-6)


@pytest.mark.parametrize("natural", [0.37, 0.77])  # at 0.21 two pairs nearly coincide and beat
def test_staggered_particles_return_at_the_rate_of_the_spectral_radius(natural):
    cycle = staggered(CoupledBase(E, GAMMA, 0.01, natural, DAMPING), 2, [0, 1])
    times = landings(cycle.time + np.array([0.0, 1e-3]), 2, 360.0, mount_frequency=natural)[0]
    ends = np.sort(times[np.isfinite(times)])
    off = np.abs(ends - (cycle.time[0] + np.rint(ends - cycle.time[0])))
    early, late = (off[(ends > t) & (ends < t + 30.0)].max() for t in (140.0, 320.0))
    # 15 landings of each show the envelope of a complex pair to 20 %, or 0.001 per period
    assert (late / early) ** (1.0 / 180.0) == pytest.approx(spectral_radius(cycle), abs=1e-3)


def test_staggered_particles_in_resonance_leave():
    cycle = staggered(CoupledBase(E, GAMMA, 0.01, 1.6, DAMPING), 2, [0, 1])
    assert spectral_radius(cycle) > 1.06
    times = landings(cycle.time + np.array([0.0, 1e-3]), 2, 300.0, mount_frequency=1.6)[0]
    assert np.abs(np.diff(last(times, 10), axis=1) - 2.0).max() > 0.1
