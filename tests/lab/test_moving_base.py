"""Recordings over a moving base: the favoured base, and its motion."""

import math
import re

import numpy as np
import pandas as pd
import pytest

from vibrosweep.errors import TrackError
from vibrosweep.lab.ballistics import Input
from vibrosweep.lab.base_fit import Contacts, Inputs, Oscillation, find_contacts, fit_base
from vibrosweep.lab.estimation import estimate
from vibrosweep.lab.experiment import LABORATORY, Camera, Experiment, Variation
from vibrosweep.lab.fitting import Setup, fit_tracks
from vibrosweep.lab.flights import Fits, meet
from vibrosweep.lab.impacts import BOUNCED, STAYED, find_impacts, impacts_of
from vibrosweep.lab.lines import impact_lines, impact_numbers
from vibrosweep.lab.paths import compress
from vibrosweep.lab.traces import make_trace, read_trace
from vibrosweep.lab.trials import perform_trials

G, FREQUENCY = LABORATORY["gravity"], LABORATORY["frequency"]
OMEGA = 2.0 * math.pi * FREQUENCY
PHASE = 0.7


def film(gamma, restitution, base="moving", transient=0.0, **changes):
    """A recording of three particles for three seconds, at 240 frames per second and 1 pixel."""
    scene = {
        **LABORATORY,
        "restitution": restitution,
        "amplitude": (1.0 + restitution) * gamma * G / OMEGA,
        "phase": PHASE,
    }
    plan = {"particles": 3, "repeats": 1, "transient": transient, **changes}
    plan["duration"] = transient + plan.pop("length", 3.0)
    return perform_trials(Experiment(**scene, base=base, **plan))[0]


@pytest.fixture(scope="module")
def chattering():
    """Gamma 3, where particles chatter and rest on the base."""
    return film(3.0, 0.5, variation=Variation(level_spread=5e-4))


@pytest.fixture(scope="module")
def fitted(chattering):
    return fit_tracks(chattering.tracks, G, Setup(frequency=FREQUENCY))


@pytest.fixture(scope="module")
def found(chattering, fitted):
    return impacts_of(chattering.tracks, fitted, G, "fit")


@pytest.mark.parametrize(
    ("gamma", "base", "favoured"), [(0.4, "moving", "moving"), (1.5, "high-bounce", "level")]
)
def test_the_landings_favour_the_true_base(gamma, base, favoured):
    tracks = film(gamma, 0.9, base, length=2.0).tracks
    fitted = fit_tracks(tracks, G, Setup(frequency=FREQUENCY))
    assert fitted.favoured_base == favoured
    assert (fitted.flights.base_fit is None) == (favoured == "level")


def test_a_locked_orbit_favours_neither_base():
    tracks = film(0.4, 0.9, transient=20.0).tracks
    fitted = fit_tracks(tracks, G, Setup(frequency=FREQUENCY))
    assert fitted.favoured_base == "undetermined"
    with pytest.raises(TrackError, match="do not determine how the base moves"):
        fit_tracks(tracks, G, Setup(frequency=FREQUENCY, motion="moving"))


def test_restitution_and_motion_of_the_base_within_their_errors(chattering, found):
    """Five standard errors, each below a per cent: chance failures are negligible."""
    one = estimate(found, frequency=FREQUENCY)
    truth = {"restitution": 0.5, "amplitude": 1.5 * 3.0 * G / OMEGA, "phase": PHASE}
    for name, value in truth.items():
        own = one.sel(parameter=name)
        assert abs(float(own["estimate"]) - value) < 5.0 * float(own["error"])
        assert float(own["error"]) < 0.01 * value
    size, gamma = 3.0 * G / OMEGA**2, 3.0
    for name, value in (("base_displacement", size), ("base_acceleration", gamma)):
        error = float(one[f"{name}_error"])
        assert abs(float(one[name]) - value) < 5.0 * error
        assert error < 0.01 * value
    off = found["level"].values - chattering.level
    assert (np.abs(off) < 5e-5).all()


def test_stays_on_the_base_are_no_flights_and_landings_are_finer_than_a_frame(chattering, found):
    record = chattering.record
    assert record.rested.sum() > 20
    assert (found["quality"].values == STAYED).sum() > 10
    off, error = [], []
    for p in range(3):
        quality = found["quality"].values[p]
        lands = record.landing_time[p]
        rests = (record.rested[p] == 1) & np.isfinite(record.liftoff_time[p])
        begin = found["liftoff_time"].values[p]
        middle = begin + found["flight_time"].values[p] / 2.0
        middle = middle[np.isfinite(middle)][:, np.newaxis]
        rides = (middle > lands[rests]) & (middle < record.liftoff_time[p][rests])
        assert not rides.any()
        when = found["landing_time"].values[p, quality == BOUNCED]
        error.append(found["landing_time_error"].values[p, quality == BOUNCED])
        off.append(np.abs(when[:, np.newaxis] - lands[np.isfinite(lands)]).min(axis=1))
    off, error = np.concatenate(off), np.concatenate(error)
    assert off.size > 60
    assert np.sqrt(np.mean(off**2)) * 240.0 < 0.1
    # 68 %, within three standard deviations of this share
    assert 0.5 < np.mean(off < error) < 0.86


def test_a_wrong_scale_is_corrected_by_gravity():
    """Displacement and velocities of the base are corrected, too."""
    trial = film(1.5, 0.7, camera=Camera(scale_error=-0.1), particles=2, length=2.0)
    found = find_impacts(trial.tracks, frequency=FREQUENCY)
    assert found.attrs["scale_off"] == 1
    one = estimate(found, frequency=FREQUENCY)
    off = float(one["base_acceleration"]) - 1.5
    assert abs(off) < 5.0 * float(one["base_acceleration_error"])
    speed = float(one.sel(parameter="amplitude")["estimate"]) / 1.7
    # gravity is seen to a per cent in these tracks
    assert speed == pytest.approx(1.5 * G / OMEGA, rel=0.01)
    for p in range(2):
        lands, true = found["landing_time"].values[p], trial.record.landing_time[p]
        place = np.abs(lands[:, np.newaxis] - true[np.isfinite(true)]).argmin(axis=1)
        ratio = found["impact_speed"].values[p] / trial.record.rebound_velocity[p, place]
        assert np.nanmedian(ratio) == pytest.approx(1.0, abs=0.01)


def test_contacts_too_few_for_a_fit_are_refused(fitted):
    contacts = find_contacts(fitted.samples, G).contacts
    with pytest.raises(TrackError, match="do not determine how the base moves"):
        fit_base(contacts.earliest(2), FREQUENCY, free=False, moves=True)


def test_an_unknown_frequency_is_found():
    """Not one of its multiples, which also fit the few phases after a transient."""
    one = estimate(find_impacts(film(3.0, 0.5, transient=2.0, particles=2, length=2.0).tracks))
    own = one.sel(parameter="frequency")
    assert abs(float(own["estimate"]) - FREQUENCY) < 5.0 * float(own["error"])
    assert float(own["error"]) < 0.01


def test_the_report_states_the_motion_of_the_base(found):
    text = "\n".join(impact_lines(found))
    assert "the base moves: displacement 1.8" in text
    assert re.search(r"restitution 0\.(499|500|501)\d* ± 0\.00", text)
    numbers, one = impact_numbers(found), estimate(found)
    for name in ("restitution", "amplitude", "phase"):
        own = one.sel(parameter=name, other=name)
        assert numbers[name] == float(own["estimate"])
        assert numbers[f"{name}_error"] == float(own["error"])
    for name in ("base_displacement", "base_acceleration", "contact"):
        assert numbers[name] == float(one[name])
        assert numbers[f"{name}_error"] == float(one[f"{name}_error"])
    assert numbers["frequency_used"] == FREQUENCY
    assert numbers["landings"] == int(found["impact_count"].sum())
    assert numbers["base_motion"] == "moving"


def test_a_trace_of_the_base_determines_what_a_locked_orbit_does_not(tmp_path):
    tracks = film(0.4, 0.9, transient=20.0, length=2.0).tracks
    time = tracks["time"].values
    rng = np.random.default_rng(1)
    size = 0.4 * G / OMEGA**2
    height = -size * np.cos(OMEGA * time + PHASE) + 1e-5 * rng.standard_normal(time.size)
    path = tmp_path / "base.csv"
    pd.DataFrame({"time": time, "height": height}).to_csv(path, index=False)
    found = find_impacts(tracks, trace=read_trace(path), contact=1e-6)
    one = estimate(found)
    own = one.sel(parameter="restitution")
    assert abs(float(own["estimate"]) - 0.9) < 5.0 * float(own["error"])
    assert float(own["error"]) < 0.01


@pytest.mark.parametrize("quantity", ["height", "acceleration"])
def test_traces_within_their_errors(quantity):
    """The mean square deviation of S, C and f in standard errors over 15 traces is 1 +- 0.37."""
    rng = np.random.default_rng(0)
    time = 3.0 + np.arange(400) / 400.0
    truth = np.array([0.03 * math.cos(PHASE), 0.03 * math.sin(PHASE), FREQUENCY])
    clean = -0.03 / OMEGA * np.cos(OMEGA * time + PHASE)
    clean = clean if quantity == "height" else -(OMEGA**2) * clean
    noise = 0.05 * np.ptp(clean)
    off = []
    for _ in range(15):
        trace = make_trace(time, 0.2 + clean + noise * rng.standard_normal(time.size), quantity)
        off.append((trace.values - truth) / np.sqrt(np.diag(trace.covariance)))
    np.testing.assert_allclose(np.mean(np.square(off), axis=0), 1.3, atol=1.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "there is no such file"),
        ("time,speed\n0,1\n", 'has no column of time and "height or acceleration"'),
        ("time,height\n0,1\n1,2\n", "at least 20 finite values"),
        ("time,height\n" + "".join(f"{k},{k**3 % 53}\n" for k in range(50)), "a sine leaves"),
    ],
)
def test_files_without_a_trace_are_refused(text, message, tmp_path):
    path = tmp_path / "base.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(TrackError, match=message):
        read_trace(path)


# --- Contacts that last, and scatter of the restitution ---

NOISE, FRAMES, HALF = 1e-4, 20.0, 0.04
TRUTH = np.array([0.7, 0.12, 0.09])  # e, S and C
ANY = Input(0.0, 5e-3)  # s
BASE = Oscillation(np.array([*TRUTH[1:], 20.0]))


def bounces(lasting, scatter, number=200):
    """Bounces at random phases between flights known with noise."""
    rng = np.random.default_rng(7)
    lands = np.sort(rng.uniform(0.0, 20.0, number))
    leaves, towards = lands.copy(), rng.uniform(0.2, 0.8, number)
    away = (TRUTH[0] + scatter * rng.standard_normal(number)) * towards
    for k in range(number if lasting else 0):

        def push(since, k=k):
            down = G + BASE.motion(lands[k : k + 1] + lasting * since)[2][0]
            return down * lasting / towards[k]

        run = compress(away[k] / towards[k], "dashpot", push)
        leaves[k] += lasting * run.t[-1]
        away[k] = -towards[k] * run.y[1, -1]
    flights = []
    for time, speed, way in (
        (lands, BASE.velocity(lands) - towards, -1.0),
        (leaves, BASE.velocity(leaves) + away, 1.0),
    ):
        since = -way * HALF  # from the middle of the flight to its end on the base
        slope = speed + G * since
        level = BASE.height(time) - since * (slope - 0.5 * G * since)
        spread = FRAMES * (2.0 * HALF) ** 2 / 12.0
        level += NOISE / np.sqrt(FRAMES) * rng.standard_normal(number)
        slope += NOISE / np.sqrt(spread) * rng.standard_normal(number)
        same = np.ones(number)
        flights.append(
            Fits(FRAMES * same, time - since, spread * same, level, slope, 18.0 * NOISE**2 * same)
        )
    before, after = flights
    met = meet(before, after, lands, G)
    arrival = before.slope - G * (met.time - before.centre)
    owner, linked = np.zeros(number, np.intp), np.zeros(number, bool)
    departure = arrival + met.closing
    return Contacts(
        before, after, owner, linked, met.time, met.height, arrival, departure, NOISE, G
    )


@pytest.mark.parametrize(("lasting", "scatter"), [(0.0, 0.0), (5e-4, 0.003), (2e-3, 0.012)])
def test_contact_and_scatter_are_found_and_bias_nothing(lasting, scatter):
    """Four standard errors, and the upper limit of the scatter: chance failures are negligible."""
    inputs = Inputs(Input(G), contact=ANY)
    found = fit_base(bounces(lasting, scatter), 20.0, free=False, moves=True, inputs=inputs)
    error = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.values[:3] - TRUTH) < 4.0 * error[:3]).all()
    assert abs(found.values[-1] - lasting) < 4.0 * error[-1]
    assert error[-1] < 1e-4
    assert scatter <= found.scatter_limit < 1.3 * scatter + 2e-3
    assert found.problem.scatter == pytest.approx(scatter, abs=0.2 * scatter + 1e-3)
    assert found.used.mean() > 0.95


# Films of long contacts: frames inside contacts bias the acceleration of the first stretches, by
# seven errors in the first film; the flights of the second then met above the base
LONG = [
    ({"frequency": 27.0, "restitution": 0.61, "base_acceleration": 1.9}, 500.0, 2.7e-5),
    ({"frequency": 18.0, "restitution": 0.85, "base_acceleration": 4.0}, 300.0, 6e-5),
]


@pytest.mark.parametrize(("motion", "rate", "pixel"), LONG)
@pytest.mark.parametrize("contact", ["dashpot", "hertz"])
def test_films_of_long_contacts_give_their_motion_and_scale(motion, rate, pixel, contact):
    variation = Variation(scatter=0.005, contact_time=2.2e-3, contact=contact)
    camera = Camera(rate, pixel=pixel, scale_error=0.003)
    times = {"transient": 1.0, "duration": 6.0, "particles": 2, "repeats": 1, "seed": 3}
    plan = Experiment(**motion, **times, base="moving", camera=camera, variation=variation)
    tracks = perform_trials(plan)[0].tracks
    found = find_impacts(tracks, motion="moving", gravity=(9.76, 9.86), contact=(2e-4, 5e-3))
    off = found.attrs["apparent_gravity"] - 1.003 * G
    assert abs(off) < 4.0 * found.attrs["apparent_gravity_error"]
    one = estimate(found)
    for name in ("frequency", "restitution"):
        own = one.sel(parameter=name)
        assert abs(own["estimate"] - motion[name]) < 4.0 * own["error"]
    off = float(one["base_acceleration"]) - motion["base_acceleration"]
    assert abs(off) < 4.0 * float(one["base_acceleration_error"])


@pytest.mark.parametrize("contact_time", [0.0, 1.5e-3])
def test_landing_times_in_air_within_their_errors(contact_time):
    """Within two on average; parabolas without drag meet 0.1 ms, sixty errors, too early."""
    speed, diameter = 15.0, 0.02
    mass = 0.47 * 1.2 * math.pi * diameter**2 * speed**2 / (8.0 * 9.81)
    contact = {"contact_time": contact_time} if contact_time else {}
    motion = {"frequency": 14.0, "restitution": 0.85, "base_acceleration": 3.5}
    times = {"transient": 1.0, "duration": 6.0, "particles": 2, "repeats": 1, "seed": 3}
    variation = Variation(terminal_speed=speed, **contact)
    camera = Camera(500.0, pixel=5e-5)
    run = perform_trials(
        Experiment(**motion, **times, base="moving", camera=camera, variation=variation)
    )[0]
    prior = (2e-4, 5e-3) if contact_time else None
    found = find_impacts(run.tracks, motion="moving", contact=prior, mass=mass, diameter=diameter)
    for name in ("landing_time", "liftoff_time"):
        bounced = (found["quality"] == BOUNCED).values
        time, error = (found[n].values[bounced] for n in (name, f"{name}_error"))
        owner, true = np.nonzero(bounced)[0], getattr(run.record, name)
        off = [np.nanmin(np.abs(true[p] - t)) for p, t in zip(owner, time, strict=True)]
        assert np.sqrt(np.mean((off / error) ** 2)) < 2.0
