"""Laws that every recorded landing obeys, and scenes at the limits of what can be launched."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.cases import each_of
from vibrosweep import simulate, theory
from vibrosweep.engine import landings
from vibrosweep.engine.measure import measure
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.advance import LOOK_AFTER
from vibrosweep.model.measures import Status

LAWS = ["rest", "reflect"]
# gravity 2 and frequency 1: speeds are flight times, and halves and quarters stay exact
DYADIC = {"gravity": 2.0, "frequency": 1.0}
SCENES = st.fixed_dictionaries(
    {
        "restitution": st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 1.0)),
        "amplitude": st.one_of(st.just(0.0), st.floats(1e-6, 5.0)),
        "frequency": st.floats(0.3, 8.0),
        "phase": st.floats(-10.0, 10.0),
        "gravity": st.floats(1.0, 25.0),
        "launch_velocity": st.floats(0.0, 8.0),
        "contact_time": st.floats(1e-4, 0.2),
        "launch_time": st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=4),
        "rebound": st.sampled_from(LAWS),
    }
)


def only(found):
    """The landings of the only particle, as arrays."""
    one = found[{"realization": 0, "particle": 0}]
    names = ("landing_time", "liftoff_time", "rebound_velocity", "rested")
    return tuple(one[name].values for name in names)


@settings(max_examples=60)
@given(scene=SCENES)
def test_invariants_of_every_landing(scene):
    found = simulate(duration=6.0, impact_budget=400, **scene)
    e, amplitude, v0 = (found[n].item() for n in ("restitution", "amplitude", "launch_velocity"))
    g, tau = found.gravity.item(), found.contact_time.item()
    threshold = g * tau / 2.0
    fastest = max(float(theory.flight_time_bound(v0, amplitude, e)), threshold)
    for p, launch in enumerate(scene["launch_time"]):
        count = int(found.impact_count[0, p])
        land, leave, speed, rested = (v[:count] for v in only(found.isel(particle=[p])))
        assert np.isnan(found.landing_time.values[0, p, count:]).all()
        rounding = 8.0 * np.spacing(np.max(np.abs(land), initial=abs(launch) + 1.0))
        assert np.all(land <= 6.0 + rounding)
        assert np.all(np.diff(land) > 0.0)
        # a flight of speed v lasts 2 v / g
        start, arrival = np.append(launch, leave[:-1]), np.append(v0, speed[:-1])
        assert np.all(np.abs(land - start - 2.0 * arrival / g) <= rounding + 1e-15 * arrival)
        bounced = rested == 0
        assert np.array_equal(land[bounced], leave[bounced])
        gained = np.abs(speed - e * arrival)[bounced]
        lost = np.abs(speed + e * arrival)[bounced]  # turned back
        rounded = 1e-15 * (speed + arrival + amplitude)[bounced]
        kicked = np.minimum(gained, lost) if scene["rebound"] == "reflect" else gained
        assert np.all(kicked <= amplitude + rounded)
        assert np.all(speed[bounced] > threshold * (1.0 - 1e-15))
        lifted = ~bounced & ~np.isnan(leave)
        assert np.all(leave[lifted] >= land[lifted] - rounding)
        assert speed[lifted] == pytest.approx(threshold, rel=1e-15)
        assert np.all(speed[~np.isnan(speed)] <= fastest * (1.0 + 1e-14))
        finished = np.flatnonzero(np.isnan(leave))
        assert finished.size == 0 or finished.tolist() == [count - 1]


@settings(max_examples=40)
@given(scene=SCENES, length=st.integers(-3, 3), time=st.integers(-3, 3))
def test_scales_of_length_and_time_do_not_matter(scene, length, time):
    # powers of two, so that equal dimensionless problems are equal bit for bit
    x, t = 2.0**length, 2.0**time
    scaled = scene | {
        "amplitude": scene["amplitude"] * x / t,
        "frequency": scene["frequency"] / t,
        "gravity": scene["gravity"] * x / t**2,
        "launch_velocity": scene["launch_velocity"] * x / t,
        "contact_time": scene["contact_time"] * t,
        "launch_time": [launch * t for launch in scene["launch_time"]],
    }
    one = simulate(duration=4.0, impact_budget=200, **scene)
    other = simulate(duration=4.0 * t, impact_budget=200, **scaled)
    assert np.array_equal(other.landing_time, one.landing_time * t, equal_nan=True)
    assert np.array_equal(other.liftoff_time, one.liftoff_time * t, equal_nan=True)
    assert np.array_equal(other.rebound_velocity, one.rebound_velocity * x / t, equal_nan=True)


def test_equal_dimensionless_problems_have_one_orbit():
    # a stable orbit, so that the roundings of the parameters do not grow
    orbits = []
    for f, g in ((0.3, 9.81), (1.0, 1.62), (7.7, 24.8)):
        unit = g / (2.0 * f)
        found = simulate(
            frequency=f,
            gravity=g,
            restitution=0.9,
            amplitude=0.24 * unit,
            launch_velocity=1.03 * unit,
            launch_time=0.42 / f,
            contact_time=1e-4 / f,
            duration=100.5 / f,
        )
        assert not found.rested.any()
        orbits.append(found.rebound_velocity.values[0, 0] / unit)
    assert orbits[1] == pytest.approx(orbits[0], rel=1e-13)
    assert orbits[2] == pytest.approx(orbits[0], rel=1e-13)


@settings(max_examples=40)
@given(
    scene=SCENES,
    periods=st.integers(-(10**9), 10**9),
    exponent=st.integers(-1, 3),
)
def test_a_launch_whole_periods_later_is_the_same_orbit(scene, periods, exponent):
    frequency = 2.0**exponent
    launch = round(scene["launch_time"][0] * 256) / 256  # exact after any shift
    shift = periods / frequency
    here = scene | {"frequency": frequency, "launch_time": launch}
    there = here | {"launch_time": launch + shift}
    # the last landings are left out: the two ends are rounded differently
    one = simulate(duration=launch + 5.0, impact_budget=200, **here) if launch > -5.0 else None
    if one is None or launch + shift + 5.0 <= 0.0:
        return
    other = simulate(duration=launch + shift + 5.0, impact_budget=200, **there)
    a, b = only(one), only(other)
    n = min(a[0].size, b[0].size)
    assert abs(a[0].size - b[0].size) <= 1
    assert np.array_equal(a[2][:n], b[2][:n], equal_nan=True)
    assert np.array_equal(a[3][:n], b[3][:n])
    assert np.all(np.abs(b[0][:n] - a[0][:n] - shift) <= 2.0 * np.spacing(abs(shift) + 20.0))


@pytest.mark.parametrize("rebound", LAWS)
def test_a_billion_periods_cost_no_digit(rebound):
    frequency, seconds = 1.25, 8e8  # 1e9 periods exactly
    scene = {"frequency": frequency, "phase": 0.4, "rebound": rebound}
    early, late = (
        simulate(launch_time=start + 0.125, duration=start + 40.0, **scene)
        for start in (0.0, seconds)
    )
    a, b = only(early), only(late)
    assert a[0].size == b[0].size > 30
    assert np.array_equal(a[2], b[2], equal_nan=True)
    assert np.array_equal(a[3], b[3])
    # a time of 8e8 s is kept to 1.2e-7 s
    assert np.all(np.abs(b[0] - seconds - a[0]) <= np.spacing(seconds))


@each_of("rebound", LAWS)
@each_of("e", [0.0, 0.5, 0.9, 0.97])
def test_unforced_decay(e, rebound):
    scene = {"restitution": e, "amplitude": 0.0, "contact_time": 1e-3, "rebound": rebound}
    found = simulate(duration=400.0, launch_time=-1.0, **scene)
    land, leave, speed, rested = only(found)
    first = 10.0 / 9.81
    count = int(theory.unforced_rest_impact(first, e, 1e-3))
    assert land.size == count
    n = np.arange(1, count + 1)
    # e^n is rounded n times
    assert speed[:-1] == pytest.approx(5.0 * e ** n[:-1], rel=1e-16 * (count + 4))
    flown = first * (n if e == 1.0 else (1.0 - e**n) / (1.0 - e))
    assert land + 1.0 == pytest.approx(flown, rel=1e-14)
    assert land[-1] + 1.0 == pytest.approx(theory.unforced_rest_time(5.0, e, 1e-3), rel=1e-14)
    assert rested.tolist() == [0] * (count - 1) + [1]
    assert math.isnan(leave[-1])
    assert math.isnan(speed[-1])
    assert found.status.item() == Status.COMPLETED


def test_an_elastic_particle_without_excitation_bounces_for_ever():
    land, leave, speed, rested = only(
        simulate(restitution=1.0, amplitude=0.0, launch_velocity=1.0, duration=1e4, **DYADIC)
    )
    assert np.array_equal(land, np.arange(1.0, 10_001.0))
    assert np.array_equal(leave, land)
    assert np.all(speed == 1.0)
    assert not rested.any()


def test_without_restitution_every_flight_is_the_kick_alone():
    land, _, speed, rested = only(simulate(restitution=0.0, amplitude=3.0, duration=30.0))
    bounced = rested == 0
    kick = 3.0 * np.sin(2.0 * np.pi * land[bounced])
    assert speed[bounced] == pytest.approx(kick, abs=1e-12)
    assert bounced.any()
    assert rested.any()


@pytest.mark.parametrize("rebound", LAWS)
def test_a_launch_at_rest_lands_at_once(rebound):
    # the first landing is the launch; where the kick is positive, it alone gives the rebound speed
    found = simulate(
        launch_velocity=0.0,
        launch_time=[0.25, 0.75],
        amplitude=0.5,
        restitution=0.5,
        duration=2.0,
        rebound=rebound,
        **DYADIC,
    )
    assert found.landing_time.values[0, :, 0].tolist() == [0.25, 0.75]
    assert found.rebound_velocity.values[0, 0, 0] == 0.5
    assert found.rested.values[0, :, 0].tolist() == [0, int(rebound == "rest")]
    lifted = found.liftoff_time.values[0, 1, 0]
    assert lifted == (0.75 if rebound == "reflect" else pytest.approx(1.0, abs=1e-4))


def test_a_launch_at_rest_without_excitation_stays():
    found = simulate(launch_velocity=0.0, amplitude=0.0, launch_time=1.5)
    land, leave, _, rested = only(found)
    assert land.tolist() == [1.5]
    assert math.isnan(leave[0])
    assert rested.tolist() == [1]


@each_of("rebound", LAWS)
@each_of("amplitude", [0.0, 0.125, 0.25])
def test_a_kick_not_above_the_threshold_never_lifts_again(amplitude, rebound):
    # v_rest = g tau / 2 = 0.25: an equal kick does not rise through it
    found = simulate(
        amplitude=amplitude,
        contact_time=0.25,
        restitution=0.5,
        launch_time=[0.0, 0.3],
        duration=50.0,
        rebound=rebound,
        **DYADIC,
    )
    last = found.impact_count.values[0] - 1
    for p in range(2):
        assert found.rested.values[0, p].sum() == 1
        assert found.rested.values[0, p, last[p]] == 1
        assert np.isnan(found.liftoff_time.values[0, p, last[p]])
        assert np.isnan(found.rebound_velocity.values[0, p, last[p]])
        assert not np.isnan(found.landing_time.values[0, p, last[p]])


def test_a_kick_above_the_threshold_lifts_again():
    amplitude = np.nextafter(0.25, 1.0)
    found = simulate(
        amplitude=amplitude, contact_time=0.25, restitution=0.5, duration=60.0, **DYADIC
    )
    land, leave, _, rested = only(found)
    assert rested.sum() > 10
    assert not np.isnan(leave).any()
    # the kick lifts where it is strongest
    assert leave[rested == 1] % 1.0 == pytest.approx(0.25, abs=1e-7)
    assert np.all(np.diff(land) > 0.0)


@pytest.mark.parametrize("rebound", LAWS)
def test_a_landing_at_the_end_counts(rebound):
    scene = {"restitution": 1.0, "amplitude": 0.0, "launch_velocity": 0.75, "rebound": rebound}
    for end in (0.75, 1.5, 7.5):
        found = simulate(duration=end, **scene, **DYADIC)
        assert only(found)[0][-1] == end
        assert found.impact_count.item() == end / 0.75
        just_before = simulate(duration=np.nextafter(end, 0.0), **scene, **DYADIC)
        assert just_before.impact_count.item() == end / 0.75 - 1


@pytest.mark.parametrize("changes", [{"duration": 1.0}, {"launch_time": 13.0}, {"gravity": 1e-6}])
def test_nothing_lands_before_the_first_flight_ends(changes):
    found = simulate(**changes)
    assert found.sizes == {"realization": 1, "particle": 1, "impact": 0}
    assert found.impact_count.item() == 0
    assert found.status.item() == Status.COMPLETED


def test_some_particles_land_and_others_do_not():
    found = simulate(launch_time=[20.0, 0.0, 11.5], duration=12.0)
    assert found.impact_count.values[0].tolist()[::2] == [0, 0]
    assert np.isnan(found.landing_time.values[0, ::2]).all()
    assert not found.rested.values[0, ::2].any()


@pytest.mark.parametrize("budget", [1, 8, 9, 1000])
def test_a_budget_ends_a_decay_without_end(budget):
    # decays over 1e12 impacts, of 4e-7 s at first
    found = simulate(
        restitution=1.0 - 1e-12,
        amplitude=0.0,
        launch_velocity=2e-6,
        contact_time=1e-9,
        launch_time=[0.0, 100.0],
        impact_budget=budget,
    )
    given_up = -(-budget // LOOK_AFTER) * LOOK_AFTER
    assert found.status.values.tolist() == [[Status.BUDGET_EXCEEDED, Status.COMPLETED]]
    assert found.impact_count.values.tolist() == [[given_up, 0]]
    assert found.sizes["impact"] == given_up


def test_a_budget_spent_at_the_last_landing_is_not_exceeded():
    budget = 2 * LOOK_AFTER  # impacts, one each second
    scene = {"restitution": 1.0, "amplitude": 0.0, "launch_velocity": 1.0, "impact_budget": budget}
    for late, status in ((0.5, Status.COMPLETED), (1.0, Status.BUDGET_EXCEEDED)):
        found = simulate(duration=budget + late, **scene, **DYADIC)
        assert found.status.item() == status
        assert found.impact_count.item() == budget


def test_a_flight_whose_square_overflows_gets_a_status(parameters, observe, record, workers):
    """Parameters within their ranges cannot reach it; a record holds no squares."""
    scene = parameters(launch_velocity=0.0, amplitude=1e200, **DYADIC), observe(launch=[0.25])
    assert record(*scene)["rebound_velocity"].item() == 1e200
    assert measure(*scene, workers)["status"].item() == Status.NON_FINITE


def test_a_record_that_would_not_fit_into_memory_is_refused(memory):
    memory(2000)
    with pytest.raises(ParameterError, match=r"1 trajectories with \d+ or more .* shorten"):
        simulate()


@pytest.mark.parametrize("ragged", [False, True])
def test_a_record_is_refused_by_the_bytes_of_its_form(memory, observe, parameters, workers, ragged):
    """Not one byte earlier, even if one particle has most of the landings."""
    scene, given = observe(launch=[0.0, 11.0, 11.0, 11.0]).recorded(), parameters()
    count = landings.record_landings(given, scene, workers)["impact_count"]
    places = count.sum() if ragged else count.size * count.max()
    apart = landings.BYTES_PER_REALIZATION + 4 * landings.BYTES_PER_TRAJECTORY
    for each in (landings.BYTES_PER_LANDING, landings.BYTES_IN_MEMORY):
        form, needed = landings.Form(ragged, each), 2 * int(apart + each * places)
        memory(needed)
        found = landings.record_landings(given, scene, workers, form)
        assert np.array_equal(found["impact_count"], count)
        memory(needed - 2)
        with pytest.raises(ParameterError, match="4 trajectories"):
            landings.record_landings(given, scene, workers, form)


def test_a_record_is_refused_before_room_for_it_is_taken(memory):
    """However few its landings are."""
    memory(1 << 26)
    tracemalloc.start()
    try:
        for given in ({"launch_time": np.zeros(1000)}, {}):
            amplitude = np.linspace(0.1, 1.0, 1000 if given else 1_000_000)
            before = tracemalloc.get_traced_memory()[0]
            tracemalloc.reset_peak()
            with pytest.raises(ParameterError, match=r"000 trajectories with 0 or more landings"):
                simulate(amplitude=amplitude, duration=1e-9, **given)
            assert tracemalloc.get_traced_memory()[1] - before < 1 << 25
    finally:
        tracemalloc.stop()
