"""Bases whose motion is not a sine: films, traces, and the parameters found from both."""

import math
import tomllib

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from vibrosweep.cli import main
from vibrosweep.errors import TrackError
from vibrosweep.lab.compare import compare_tracks
from vibrosweep.lab.estimation import estimate
from vibrosweep.lab.experiment import LABORATORY, Experiment, oscillating_surface
from vibrosweep.lab.impacts import find_impacts
from vibrosweep.lab.lines import impact_lines
from vibrosweep.lab.recordings import read_tracks
from vibrosweep.lab.traces import (
    make_trace,
    names_of,
    polar,
    slopes_of_sizes,
    trace_of_mark,
    with_values,
)
from vibrosweep.lab.tracks import with_mark
from vibrosweep.lab.trials import perform_trials
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.scene.scene import stored

FREQUENCY = LABORATORY["frequency"]
TIME = np.arange(1500) / 500.0
TWO_TONES = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))
NUMBERS = {"frequency": FREQUENCY, "phase": 0.7, "amplitude": 0.17, "restitution": 0.7}
TRUTH = {**NUMBERS, "weight_2": 0.4, "phase_2": 1.1}


@pytest.fixture(scope="module")
def measured(film):
    """The trace of the base of the film."""
    noise = 1e-5 * np.random.default_rng(1).standard_normal(TIME.size)
    height = oscillating_surface(film[0].parameters, TWO_TONES).height(TIME)
    return make_trace(TIME, height + noise, "height")


@pytest.fixture(scope="module")
def film():
    """Two particles for two seconds over a base of two tones, with its experiment."""
    scene = {**LABORATORY, **NUMBERS, "base": "moving", "waveform": TWO_TONES.value}
    plan = Experiment(**scene, particles=2, repeats=1, transient=0.0, duration=2.0)
    return plan, perform_trials(plan)[0]


def trace(shape=TWO_TONES, noise=1e-5, quantity="height", seed=1):
    """Height (m) or acceleration (m s-2) of a base, sampled at 1000 Hz."""
    phase = FREQUENCY * TIME + NUMBERS["phase"] / (2.0 * math.pi)
    if quantity == "height":
        clean = 0.1 / FREQUENCY * shape.height(phase)
    else:
        clean = 0.1 * FREQUENCY * shape.slope(phase)
    return clean + noise * np.random.default_rng(seed).standard_normal(TIME.size)


def test_flights_of_a_film_begin_and_end_on_the_moving_base(film):
    plan, trial = film
    record, base = trial.record, oscillating_surface(plan.parameters, TWO_TONES)
    up, down = record.liftoff_time[:, :-1], record.landing_time[:, 1:]
    flown = np.isfinite(up) & np.isfinite(down)
    up, down, speed = up[flown], down[flown], record.rebound_velocity[:, :-1][flown]
    met = base.height(up) + (down - up) * (speed - plan.parameters["gravity"] / 2.0 * (down - up))
    assert up.size > 20
    np.testing.assert_allclose(met, base.height(down), atol=1e-12)
    step = 1e-6
    rise = (base.area(TIME + step) - base.area(TIME - step)) / (2.0 * step)
    np.testing.assert_allclose(base.height(TIME), rise, atol=1e-10)


def test_weights_phases_and_restitution_of_a_film_within_their_errors(film, measured):
    """Five standard errors: chance failures are negligible."""
    found = find_impacts(film[1].tracks, trace=measured)
    one = estimate(found)
    assert one["parameter"].values.tolist() == [
        *("restitution", "amplitude", "phase", "frequency", "weight_2", "phase_2")
    ]
    for name, value in TRUTH.items():
        own = one.sel(parameter=name)
        assert abs(float(own["estimate"]) - value) < 5.0 * float(own["error"])
        assert float(own["error"]) < 0.01 * value
    text = impact_lines(found)
    (line,) = [one for one in text if "in a sweep file: " in one]
    shape = tomllib.loads(line.split("file: ")[1])["waveform"]
    assert [tone[0] for tone in shape["harmonics"]] == [1, 2]
    assert shape["harmonics"][1][1:] == pytest.approx([0.4, 1.1], abs=0.02)
    rounded = Waveform("harmonics", tuple(map(tuple, shape["harmonics"])))
    assert rounded.fall == pytest.approx(stored(one.attrs).fall, rel=1e-4)


def test_a_recording_is_compared_with_the_base_of_its_trace(film, measured):
    """The parameters are estimated, and drawn within their errors."""
    plan, tracks = film[0], film[1].tracks.isel(particle=[0], frame=slice(0, 400))
    table = compare_tracks(tracks, trace=measured, contact_time=2.5e-5, draws=3, threads=1)
    assert stored(table.attrs).tones[1][1:] == pytest.approx((0.4, 1.1), abs=0.02)
    assert table.attrs["base_motion"] == table.attrs["favoured_base"] == "moving"
    gamma = TWO_TONES.fall * FREQUENCY * 0.1 / plan.parameters["gravity"]
    assert float(table["base_acceleration"][0]) == pytest.approx(gamma, rel=0.02)
    assert 0.0 < float(table["base_acceleration_error"][0]) < 0.02
    assert (table["error"].sel(reading="ensemble") < 2.0).all()


@pytest.fixture(scope="module")
def marked(film, tmp_path_factory):
    """A file with the tracks of the film and of a mark on the base."""
    tracks, path = film[1].tracks, tmp_path_factory.mktemp("marked") / "film.csv"
    time, rng = tracks["time"].values, np.random.default_rng(3)
    mark = oscillating_surface(film[0].parameters, TWO_TONES).height(time) - 0.02
    columns = [tracks["height"].values[:, 0], mark + 1e-4 * rng.standard_normal(time.size)]
    names = ["a", "table"]
    rows = [
        pd.DataFrame({"time": time, "particle": n, "height": y})
        for n, y in zip(names, columns, strict=True)
    ]
    pd.concat(rows).to_csv(path, index=False)
    return path


def test_a_mark_on_the_base_shows_its_harmonics(marked, tmp_path, capsys):
    out = str(tmp_path / "out.h5")
    assert main(["lab", "impacts", str(marked), "--base-track", "table", "-o", out]) == 0
    assert "harmonics of its velocity: 1 of weight 1; 2 of 0." in capsys.readouterr().out
    with xr.open_dataset(out) as found:
        assert found["particle"].values.tolist() == ["a"]
        one = estimate(found.load())
    for name, value in TRUTH.items():
        own = one.sel(parameter=name)
        assert abs(float(own["estimate"]) - value) < 5.0 * float(own["error"])
        assert float(own["error"]) < 0.1 * value


def test_a_mark_that_is_averaged_over_the_exposure_is_corrected(marked):
    """Each harmonic by x / sin x, where x is half its phase change over the exposure."""
    tracks = read_tracks(marked, base_track="table")
    one, other = (trace_of_mark(tracks, exposure).values for exposure in (0.0, 4e-3))
    assert one[2] == other[2]
    half = math.pi * one[2] * 4e-3 * np.array([1.0, 2.0]).repeat(2)
    np.testing.assert_allclose(np.delete(other / one, 2), half / np.sin(half), rtol=1e-12)


def test_impossible_marks_are_refused(measured, marked):
    with pytest.raises(TrackError, match="no particle is named plate, the mark on the base; has a"):
        read_tracks(marked, base_track="plate")
    tracks = read_tracks(marked, base_track="table")
    with pytest.raises(TrackError, match="nothing is tracked but a, the mark on the base"):
        with_mark(tracks.isel(particle=[0]), "a")
    with pytest.raises(TrackError, match="a trace and a mark on the base are given"):
        find_impacts(tracks, trace=measured)


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ({"motion": "level"}, "a trace requires a base that moves"),
        ({"base": 0.0}, "a height of the base requires a constant level"),
        ({"frequency": 40.0}, "given as 40 Hz, but the trace of the base repeats at 20"),
    ],
)
def test_settings_that_contradict_a_trace_are_refused(film, measured, known, message):
    with pytest.raises(TrackError, match=message):
        find_impacts(film[1].tracks, trace=measured, **known)


@pytest.mark.parametrize(
    ("tones", "numbers", "quantity"),
    [
        ([(1, 1.0, 0.0)], (1,), "acceleration"),
        ([(1, 0.4, 0.3), (2, 1.0, 1.1)], (2, 1), "height"),
        ([(2, 1.0, 0.0), (3, 0.6, 1.0)], (2, 1, 3), "acceleration"),
        ([(h, 1.0 / h, 0.2 * h) for h in range(1, 9)], tuple(range(1, 9)), "height"),
    ],
    ids=["sine", "strong second", "no first", "eight"],
)
def test_the_criterion_finds_as_many_harmonics_as_there_are(tones, numbers, quantity):
    shape = Waveform("harmonics", tuple(tones))
    clean = trace(shape, 0.0, quantity)
    noise = 1e-3 * np.ptp(clean)
    assert make_trace(TIME, trace(shape, noise, quantity), quantity).numbers == numbers


def test_heights_rounded_to_steps_that_repeat_have_no_harmonics():
    """Each period of 50 values is rounded equally, and harmonics could fit the rounding errors."""
    for shape, numbers in ((SINE, (1,)), (TWO_TONES, (1, 2))):
        assert make_trace(TIME, trace(shape, 0.0).round(5), "height").numbers == numbers


def test_traces_of_two_tones_within_their_errors():
    """The mean square deviation in standard errors over 12 traces is 1 +- 0.41 for each value."""
    values = np.array([0.1, 0.1, FREQUENCY, 0.04, 0.04])
    angles = np.array([0.7, 0.7 - math.pi / 2, 0.0, 2.5, 2.5 - math.pi / 2])
    truth, off = values * np.cos(angles), []
    for seed in range(12):
        one = make_trace(TIME[:400], trace(noise=3e-5, seed=seed)[:400], "height")
        assert one.numbers == (1, 2)
        off.append((one.values - truth) / np.sqrt(np.diag(one.covariance)))
    np.testing.assert_allclose(np.mean(np.square(off), axis=0), 1.3, atol=1.2)


def test_a_trace_that_is_mostly_noise_is_refused():
    rough = trace(noise=0.0) + 5e-4 * np.random.default_rng(2).standard_normal(TIME.size)
    with pytest.raises(TrackError, match=r"2 harmonics leave \d+ % of the variance of the height"):
        make_trace(TIME, rough, "height")


def test_weights_and_phases_by_their_derivatives():
    """The covariance of `polar` and the slopes of the base's sizes equal finite differences."""
    values = np.array([0.7, 0.03, -0.1, 20.0, 0.05, 0.02, -0.01, 0.04])
    numbers = (2, 1, 3)
    plain, spread, shape = polar(values, np.eye(8), numbers)
    slopes = np.zeros((8, 8))
    for k in range(8):
        up, down = (polar(values + s * np.eye(8)[k], np.eye(8), numbers)[0] for s in (1e-7, -1e-7))
        slopes[:, k] = (up - down) / 2e-7
    np.testing.assert_allclose(spread, slopes @ slopes.T, rtol=1e-5, atol=1e-7)
    of_sizes = slopes_of_sizes(shape, numbers)
    for k, name in enumerate(names_of(numbers)):
        up = with_values(shape, {name: plain[4 + k] + 1e-4})
        rise = np.log([shape.per_displacement / up.per_displacement, up.fall / shape.fall]) / 1e-4
        np.testing.assert_allclose(of_sizes[:, k], rise, atol=1e-3)


def test_a_trace_has_the_true_scale_where_that_of_the_film_is_off(film, measured):
    """The scale is off by 0.4 %, nine errors of the motion."""
    tracks = film[1].tracks.copy()
    tracks["height"] = 1.004 * tracks["height"]
    given = {"trace": measured, "gravity": (9.71, 9.91)}
    found = estimate(find_impacts(tracks, **given))
    for name, true in TRUTH.items():
        own = found.sel(parameter=name)
        assert abs(own["estimate"] - true) < 4.0 * own["error"], name
    assert found.sel(parameter="amplitude")["error"] < 5e-4 * TRUTH["amplitude"]
