"""A shaken base from times of impacts alone."""

import numpy as np
import pandas as pd
import pytest

import vibrosweep as vs
from vibrosweep.cli import main
from vibrosweep.errors import ParameterError, TrackError
from vibrosweep.lab import Recording, restitution, times_on_shaker
from vibrosweep.lab.lines import restitution_lines
from vibrosweep.lab.shaken_times import Triples

SHAKEN = {"frequency": 20.0, "restitution": 0.8, "phase": 0.7, "base": "moving"}
GAMMA = 2.0 * np.pi * 20.0 * 0.35 / 1.8 / 9.81


def clicks(times):
    return Recording("clicks", "", np.asarray(times), None, None, True, True, 0.0, None)


@pytest.fixture(scope="module")
def landed():
    """Times of impacts at Gamma = 2.5."""
    found = vs.simulate(**SHAKEN, amplitude=0.35, launch_velocity=0.6, duration=10.0)
    times = found["landing_time"].values.ravel()
    return times[np.isfinite(times)]


def deviations(found, frequency=True):
    truth = {"restitution": 0.8, "base_acceleration": GAMMA, "phase": 0.7}
    truth |= {"frequency": 20.0} if frequency else {}
    return [(float(found[k]) - v) / float(found[f"{k}_error"]) for k, v in truth.items()]


def test_times_give_restitution_frequency_acceleration_and_phase(landed):
    noise = 1e-4 * np.random.default_rng(1).standard_normal(landed.size)
    found = times_on_shaker([clicks((landed + noise)[3:43])])
    assert int(found["determined"])
    assert max(map(abs, deviations(found))) < 3.5
    assert float(found["restitution_error"]) < 0.01
    assert any("Hz, acceleration" in line for line in restitution_lines(found))


def test_the_clock_of_the_times_may_start_in_1970(landed):
    noise = 1e-4 * np.random.default_rng(1).standard_normal(landed.size)
    begin = 1_764_194_400.0
    near = times_on_shaker([clicks((landed + noise)[3:43] + 40.0)], frequency=20.0)
    far = times_on_shaker([clicks((landed + noise)[3:43] + begin)], frequency=20.0)
    assert far.attrs["origin"] == np.floor(begin + landed[3])
    turned = float(far["phase"]) - 40.0 * np.pi * (
        far.attrs["origin"] - begin - near.attrs["origin"] + 40.0
    )
    off = (turned - float(near["phase"]) + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(off) < 1e-3
    assert float(far["phase_error"]) == pytest.approx(float(near["phase_error"]), rel=1e-2)
    found = times_on_shaker([clicks((landed + noise)[3:43] + begin)])
    assert float(found["phase_error"]) < 0.1
    assert f"rad at t = {found.attrs['origin']:.0f} s" in "\n".join(restitution_lines(found))


def test_restitution_on_a_floor_warns_of_a_shaken_base(landed):
    locked = np.arange(40) * 0.05
    for times, shakes in (
        (landed[3:43], True),
        (locked, True),
        (1.0 - 0.9 ** np.arange(20), False),
    ):
        noise = 1e-4 * np.random.default_rng(1).standard_normal(times.size)
        found = restitution([clicks(times + noise)])
        assert ("a base that shakes" in found.attrs["remarks"]) == shakes


def test_the_times_of_a_floor_give_a_remark(landed):
    noise = 1e-4 * np.random.default_rng(1).standard_normal(20)
    for times, rests in ((1.0 - 0.8 ** np.arange(20), True), (landed[3:23], False)):
        found = times_on_shaker([clicks(times + noise)], frequency=20.0)
        assert ("use vibrosweep lab restitution" in found.attrs["remarks"]) == rests


def test_missed_and_false_clicks_are_left_out(landed):
    noise = 2e-5 * np.random.default_rng(2).standard_normal(landed.size)
    times = (landed + noise)[3:63]
    spoilt = np.sort(np.append(np.delete(times, 20), times[40] + 0.01))
    found = times_on_shaker([clicks(spoilt)], frequency=20.0)
    assert max(map(abs, deviations(found, frequency=False))) < 4.0
    assert "left out" in found.attrs["remarks"]


def test_a_locked_orbit_determines_one_relation_which_is_reported():
    times = np.arange(40) * 0.05 + 1e-5 * np.random.default_rng(3).standard_normal(40)
    try:
        text = times_on_shaker([clicks(times)], frequency=20.0).attrs["warning"]
    except TrackError as error:
        text = str(error)
    assert "fix only one relation" in text
    assert "0.2453 m/s" in text  # g T / 2


def test_random_times_are_not_an_orbit():
    with pytest.raises(TrackError):
        times_on_shaker([clicks(np.cumsum(np.random.default_rng(4).uniform(0.02, 0.2, 40)))],
                        frequency_range=(15.0, 25.0))  # fmt: skip


@pytest.mark.parametrize(
    ("times", "how", "message"),
    [
        ([0.0, 1.0], {}, "at least 12"),
        (np.arange(40) * 0.05, {"frequency": -1.0}, "frequency"),
        (np.arange(40) * 0.05, {"frequency_range": (2.0, 1.0)}, "must rise"),
        (np.arange(40) * 0.05, {"contact": np.nan}, "contact"),
        (np.arange(40) * 0.05, {"gravity": 0.0}, "gravity"),
    ],
)
def test_invalid_input_is_refused(times, how, message):
    with pytest.raises((TrackError, ParameterError), match=message):
        times_on_shaker([clicks(times)], **how)


def test_the_command_reads_times(landed, tmp_path, capsys):
    path = tmp_path / "times.csv"
    pd.DataFrame({"time (s)": landed[3:43]}).to_csv(path, index=False)
    out = tmp_path / "out.h5"
    words = ["lab", "impacts", str(path), "--frequency", "20", "-o", str(out)]
    assert main(words) == 0
    assert "restitution 0.8" in capsys.readouterr().out
    assert main(["info", str(out)]) == 0
    assert "restitution 0.8" in capsys.readouterr().out


def test_derivatives_are_those_of_the_restitutions(landed):
    """By clicks and by S, C and f, for any contact."""
    times = landed[3:20] - landed[3]
    motion = np.array([0.1, 0.15, 20.0])
    triples = Triples(times, np.arange(1, times.size - 1), 9.81, 5e-4)
    by_clicks, by_motion = triples.derivatives(times, motion)
    step = 1e-6
    for k, column in ((-1, 0), (0, 1), (1, 2)):
        for bounce, click in enumerate(triples.middle + k):
            moved = step * (np.arange(times.size) == click)
            up, down = (triples.bounces(times + s * moved, motion)[0][bounce] for s in (1, -1))
            assert by_clicks[bounce, column] == pytest.approx((up - down) / (2 * step), rel=1e-3)
    for k in range(3):
        moved = step * (np.arange(3) == k)
        up, down = (triples.bounces(times, motion + s * moved)[0] for s in (1, -1))
        np.testing.assert_allclose(by_motion[:, k], (up - down) / (2 * step), rtol=1e-4, atol=1e-5)
