"""Pictures of a record agree with `simulate`: true parabolas that end on the base."""

from pathlib import Path

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.explorer import pictures
from vibrosweep.explorer.points import of_result

LOCKED = {"restitution": 0.9, "amplitude": 1.2, "launch_time": [0.125]}


@pytest.fixture
def record(results, base):
    return of_result(results[base], Path("out.h5"), "sweep").choice(1).simulate()


def known(values):
    return np.sort(values[np.isfinite(values)])


def test_flights_begin_and_end_where_simulate_says(record):
    flights = pictures.heights(record).flights
    end = float(record.duration)
    begun = np.concatenate([record.launch_time.values, known(record.liftoff_time.values)])
    assert np.isin(flights["start"], begun).all()
    landed = known(record.landing_time.values)
    assert np.isin(flights["end"], np.append(landed, end)).all()
    assert np.isin(landed, flights["end"]).mean() > 0.9  # a flight without duration is not drawn
    speeds = np.append(known(record.rebound_velocity.values), float(record.launch_velocity))
    assert np.isin(flights["velocity"], speeds).all()


def test_flights_are_parabolas_that_end_on_the_base(record):
    found = pictures.heights(record)
    f, gravity = found.flights, float(record.gravity)
    middle = (f["y_start"] + 2.0 * f["cy"] + f["y_end"]) / 4.0  # of a quadratic Bezier curve
    half = (f["end"] - f["start"]) / 2.0
    height = f["y_start"] + f["velocity"] * half - gravity * half**2 / 2.0
    assert np.allclose(middle, height, rtol=0.0, atol=1e-12)
    assert np.allclose(f["cx"], f["start"] + half, rtol=0.0, atol=0.0)
    landed = f["end"] < float(record.duration)
    there = np.interp(f["end"][landed], found.base["time"], found.base["height"])
    # the base is drawn straight between its points
    step = np.diff(found.base["time"]).max() if record.attrs["base"] != "high-bounce" else 0.0
    bend = 9.81 * float(record.base_acceleration) * step**2
    assert np.all(np.abs(f["y_end"][landed] - there) < bend + 1e-9)


def test_stays_are_on_the_base():
    record = vs.simulate(
        restitution=0.5, base_acceleration=1.3, base="moving", launch_time=[0.0, 0.3]
    )
    stays = pictures.heights(record).stays
    rests = int(record.rested.sum())
    assert rests > 0
    # followed as finely as the base is drawn
    assert rests * pictures.OF_STAY <= stays["start"].size
    longest = 1.0 / pictures.SAMPLES + 1e-12
    assert np.max(stays["end"] - stays["start"]) <= longest
    landed = known(record.landing_time.values[record.rested.values == 1])
    assert np.isin(landed, stays["start"]).all()
    displacement = float(record.amplitude) / 1.5 / (2.0 * np.pi)
    for time, height in (("start", "y_start"), ("end", "y_end")):
        there = -displacement * np.cos(2.0 * np.pi * stays[time])
        assert np.allclose(stays[height], there, atol=1e-12)


def test_the_view_holds_all_flights(record):
    (begin, end), (bottom, top) = pictures.heights(record).span
    assert begin <= record.launch_time.values.min()
    assert end == float(record.duration)
    f = pictures.heights(record).flights
    highest = f["y_start"] + np.maximum(f["velocity"], 0.0) ** 2 / (2.0 * float(record.gravity))
    assert bottom <= f["y_start"].min()
    assert top <= highest.max(initial=0.0) + 1e-12


def test_landing_phases_converge_to_that_of_the_locked_orbit():
    record = vs.simulate(**LOCKED, duration=800.0)
    found = vs.analysis.landing_phases(record)
    assert np.array_equal(found["landing_time"], known(record.landing_time.values))
    assert found["phase"][-1] == pytest.approx(0.4329824002, abs=1e-9)


def test_a_locked_orbit_is_a_point_of_the_return_map():
    found = vs.analysis.return_map(vs.simulate(**LOCKED, duration=800.0))
    assert found["arrival_speed"][-1] == pytest.approx(4.905, abs=1e-9)
    assert found["next_arrival_speed"][-1] == pytest.approx(4.905, abs=1e-9)


def test_the_smallest_separation_is_that_of_the_sweep(results):
    swept = results["high-bounce"]
    points = of_result(swept, Path("out.h5"), "sweep")
    apart = np.flatnonzero(swept.dt_min.values > 0.0)
    for i in apart[:5]:
        record = points.choice(int(i)).simulate()
        gaps = vs.analysis.landing_separations(record)["separation"].values
        # times of some seconds are rounded to 1e-15 s
        assert gaps.min() == pytest.approx(float(swept.dt_min[i]), rel=1e-6, abs=1e-14)
    assert apart.size


def test_one_particle_has_no_separations():
    assert vs.analysis.landing_separations(vs.simulate(**LOCKED)).sizes["landing"] == 0
