"""Orbits and slots that particles share, against the times at which they land."""

import numpy as np
import pytest

from vibrosweep.sweep.attractors import NO_ORBIT
from vibrosweep.sweep.engine import measure
from vibrosweep.variables import LYAPUNOV

LATE = 12_000.0


def late_landings(found, particle):
    times = found["landing_time"][0, particle]
    return times[times > LATE - 30.0]


@pytest.mark.parametrize(("e", "amplitude"), [(0.98, 3.4), (0.9, 1.2), (0.8, 2.9)])
def test_particles_share_orbit_and_slot_if_and_only_if_they_land_together_for_ever(
    e, amplitude, parameters, observe, record, workers
):
    scene = parameters(restitution=e, amplitude=amplitude)
    observation = observe(duration=LATE, lyapunov=True, separation=False)
    found = measure(scene, observation, workers)
    landings = record(scene, observation)
    orbit, slot = found["orbit"][0], found["slot"][0]
    assert (orbit != NO_ORBIT).all()
    pairs = set(zip(orbit.tolist(), slot.tolist(), strict=True))
    assert found["slot_count"].item() == len(pairs) > 1
    assert found["orbit_count"].item() == len({o for o, _ in pairs})
    for i in range(20):
        for j in range(i):
            own, other = late_landings(landings, i), late_landings(landings, j)
            together = own.size == other.size and np.allclose(own, other, rtol=0, atol=1e-8)
            assert together == (orbit[i] == orbit[j] and slot[i] == slot[j]), (i, j)


def test_all_variables_are_measured_with_their_shapes(parameters, observe, workers):
    scene = parameters(amplitude=np.linspace(0.0, 3.5, 6))
    found = measure(scene, observe(lyapunov=True, separation=False), workers)
    sizes = {"realization": 6, "particle": 20}
    for name, variable in LYAPUNOV.items():
        assert found[name].shape == tuple(sizes[d] for d in variable.dims), name
        assert found[name].dtype == variable.dtype, name


def test_the_result_does_not_depend_on_how_the_batch_is_cut(parameters, observe, workers):
    scene = parameters(amplitude=np.linspace(0.5, 3.5, 200), restitution=0.95)
    observation = observe(lyapunov=True, separation=False, duration=60.0)
    whole = measure(scene, observation, workers)
    half = measure({n: v[100:] for n, v in scene.items()}, observation, workers)
    for name in LYAPUNOV:
        assert np.array_equal(whole[name][100:], half[name], equal_nan=True), name


def test_an_orbit_without_landings_in_the_window_has_no_exponent(parameters, observe, workers):
    found = measure(parameters(launch_velocity=60.0), observe(lyapunov=True), workers)
    assert np.isnan(found["lyapunov_largest"]).all()
    assert np.isnan(found["lyapunov_max"]).all()
    assert found["chaotic_count"].item() == 0
