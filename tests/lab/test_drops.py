"""A ball on a floor: films and times of impacts, with all effects seen in real recordings."""

import json
import re
import tomllib
from dataclasses import replace
from unittest import mock

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from vibrosweep.cli import main
from vibrosweep.errors import ParameterError, TrackError
from vibrosweep.lab import (
    FloorExperiment,
    Recording,
    drops,
    film_drops,
    hear_drops,
    restitution,
    times_on_shaker,
)
from vibrosweep.lab.ballistics import drop_from_apex, flight_of, nominal_of
from vibrosweep.lab.lines import restitution_lines
from vibrosweep.model.restitution_laws import numbers_of
from vibrosweep.scene.sweep import keyword_spec

BALL = {"mass": 0.046, "diameter": 0.043}  # terminal speed 33 m/s


def off(found, truth):
    """Deviation of the restitution in standard errors."""
    return float(found["restitution"] - truth) / float(found["restitution_error"])


def clicks(times, name="clicks", rounding=0.0):
    return Recording(name, "", np.asarray(times), None, None, True, True, rounding, None)


@pytest.mark.parametrize("drag", [1.0 / 81.0, 0.0, -1e-3])
def test_flights_with_drag_are_those_of_the_equation_of_motion(drag):
    up, down, rise, fall = (float(x[0]) for x in flight_of(np.array([4.0]), 9.81, drag))

    def landed(t, x):
        return x[0] if t > 0.1 else 1.0

    landed.terminal = True
    run = solve_ivp(
        lambda t, x: [x[1], -9.81 * (1.0 + drag * x[1] * abs(x[1]))],
        *((0.0, 3.0), [0.0, up]),
        events=landed,
        rtol=1e-10,
        atol=1e-12,
    )
    assert run.t[-1] == pytest.approx(rise + fall, abs=1e-7)  # smaller drags count as 1e-7 / v^2
    assert -run.y[1, -1] == pytest.approx(down, abs=1e-6)
    assert drop_from_apex(np.array([-rise, fall]), 9.81, drag) == pytest.approx(16 / 19.62)
    assert nominal_of(np.array([rise + fall]), 9.81, drag) == pytest.approx(4.0)


def test_films_give_restitution_contact_time_and_drag_for_any_law_of_force():
    for contact in ("dashpot", "hertz"):
        setup = FloorExperiment(
            **{"contact": contact, "contact_time": 2e-3, "terminal_speed": 25.0},
            **{"scatter": 0.004, "hands": True, "bounces": 6},
        )
        found = restitution(film_drops(setup, 2, seed=4)[0])
        assert abs(off(found, 0.85)) < 3.0
        assert found.attrs["bounces"] == 12
        drag = found.sel(input="drag")
        assert abs(float(drag["input_value"]) - 25.0**-2) < 4 * float(drag["input_error"])
        assert 1e-3 < float(found.sel(input="contact")["input_value"]) < 3e-3
        assert found["drop_gravity"].values == pytest.approx(9.81, abs=0.01)


def test_restitution_needs_no_scale_and_scale_follows_from_gravity():
    setup = FloorExperiment(unit=5e-4, bounces=4, scatter=0.004)
    film = film_drops(setup, 2, seed=1)[0]
    found = restitution(film)
    assert abs(off(found, 0.85)) < 3.0
    assert not found.attrs["speed_known"]
    assert "scale from gravity: 0.0005" in found.attrs["remarks"]
    assert restitution(film, scale_from_gravity=True).attrs["speed_known"]


def test_a_soft_floor_is_not_taken_for_an_inclined_one():
    """Parabolas meet the deeper below it the faster the ball is, while the ball drifts sideways."""
    setup = FloorExperiment(restitution=0.6, contact_time=5e-3, bounces=3, noise=5e-5)
    film = film_drops(setup, 1, seed=3)[0][0]
    found = restitution([replace(film, horizontal=4e-3 * film.time)])
    assert "inclined" not in found.attrs["remarks"]
    assert abs(off(found, 0.6)) < 4.0


@pytest.mark.parametrize("unit", [1.0, 5e-4])
def test_restitution_needs_no_frame_rate(unit):
    """Drag and contact of films in frames are not pooled with those in seconds."""
    setup = FloorExperiment(unit=unit, bounces=5, scatter=0.004, contact_time=5e-4)
    timed = film_drops(setup, 2, seed=3)[0]
    films = [replace(f, time=np.rint(f.time * setup.frame_rate), rate_known=False) for f in timed]
    found, known = restitution(films), restitution(timed)
    assert abs(off(found, 0.85)) < 3.0
    assert float(found["restitution_error"]) < 3.0 * float(known["restitution_error"])
    assert found["input"].values.tolist() == ["none"]
    assert not found.attrs["speed_known"]


def test_a_film_without_a_bounce_gives_the_scale():
    time = np.arange(40) / 100.0
    film = Recording("throw", "", time, 100 * time - 300 * time**2, None, False, True, 0.0, None)
    with pytest.raises(TrackError, match=r"no bounce; scale from gravity: 0\.01635"):
        restitution([film])


def test_a_film_upside_down_names_the_option():
    film = film_drops(FloorExperiment(bounces=3))[0][0]
    turned = Recording("film", "", film.time, -film.height, None, True, True, 0.0, None)
    with pytest.raises(TrackError, match="--axis"):
        restitution([turned])


def test_a_film_over_a_shaken_base_is_refused_at_once():
    """Its flights do not become lower; a joint fit to hundreds of them takes a minute."""
    time, rng = np.arange(720) / 240.0, np.random.default_rng(2)
    speeds = rng.uniform(1.0, 1.6, 30)
    start = np.append(0.0, np.cumsum(2.0 * speeds / 9.81))
    flight = np.searchsorted(start, time, "right") - 1
    since = time - start[flight]
    height = speeds[flight] * since - 9.81 / 2.0 * since**2 + 1e-4 * rng.standard_normal(time.size)
    film = Recording("shaken", "", time, height, None, True, True, 0.0, None)
    with pytest.raises(TrackError, match=r"loses no energy over \d+ bounces.*lab impacts"):
        restitution([film])


def test_a_soft_inclined_floor_is_found_where_hands_hold_the_ball():
    """Where parabolas meet gives its slope roughly: 3.0 degrees for 3.44."""
    setup = FloorExperiment(
        **{"incline": 0.06, "restitution": 0.7, "contact_time": 4e-3, "scatter": 0.004},
        **{"hands": True, "bounces": 6},
    )
    found = restitution(film_drops(setup, 1, seed=3)[0])
    assert abs(off(found, 0.7)) < 3.0
    (degrees,) = re.findall(r"inclined by (\S+) degrees", found.attrs["remarks"])
    assert float(degrees) == pytest.approx(np.degrees(0.06), abs=0.2)


def test_bad_positions_and_a_long_rest_do_not_cut_flights():
    """A ball at rest in whole pixels has no noise, and one position in fifty is elsewhere."""
    rng, setup = np.random.default_rng(3), FloorExperiment(bounces=5, noise=2e-4, unit=1e-3)
    film = film_drops(setup, 1, seed=5)[0][0]
    height, step = np.rint(film.height), np.diff(film.time[:2])[0]
    bad = rng.random(height.size) < 0.02
    height[bad] += rng.uniform(-100.0, 100.0, bad.sum())
    rest = np.repeat(height[[0, -1]], 200)
    height = np.insert(rest, 200, height)
    film = replace(film, time=step * np.arange(height.size), height=height)
    found = restitution([film])
    assert found.attrs["bounces"] == 5
    assert abs(off(found, 0.85)) < 3.0


def test_times_separate_the_variance_components():
    setup = FloorExperiment(scatter=0.006, drop_scatter=0.006, terminal_speed=33.0)
    recordings, truth = hear_drops(setup, 16, seed=3)
    found = restitution(recordings, contact=5e-4, **BALL)
    assert abs(off(found, 0.85)) < 3.0
    happened = {
        "scatter": np.sqrt(np.mean([drop.restitution.var(ddof=1) for drop in truth])),
        "drop_scatter": np.std([drop.restitution.mean() for drop in truth], ddof=1),
    }
    for name, scatter in happened.items():
        low, high = found[f"{name}_quantile"].values[[0, 3]]
        assert low < scatter < high
    assert found.attrs["dependence"] == "constant"


def test_long_contacts_are_found_from_times_for_any_law_of_force():
    """The last flights of a few ms show a sign error of the contact time."""
    for contact in ("dashpot", "hertz"):
        setup = FloorExperiment(restitution=0.65, bounces=8, contact_time=4e-3, contact=contact)
        found = restitution(hear_drops(setup, 4, seed=2)[0])
        assert abs(off(found, 0.65)) < 3.0
        length = found.sel(input="contact")
        assert abs(float(length["input_value"]) - 4.5e-3) < 3 * float(length["input_error"]) + 5e-4


def test_an_inclined_floor_is_found_from_x_and_y():
    for incline in (0.15, -0.3):
        setup = FloorExperiment(incline=incline, scatter=0.003, bounces=4)
        found = restitution(film_drops(setup, 1, seed=3)[0])
        assert abs(off(found, 0.85)) < 3.0
        (degrees,) = re.findall(r"inclined by (\S+) degrees", found.attrs["remarks"])
        assert float(degrees) == pytest.approx(abs(np.degrees(incline)), abs=0.05)
        assert found["drop_gravity"].values == pytest.approx(9.81 * np.cos(incline), abs=0.01)


def test_a_drop_left_out_agrees_with_the_prediction_of_the_others():
    setup = FloorExperiment(scatter=0.006, drop_scatter=0.004, contact_time=5e-4)
    recordings = hear_drops(setup, 8, seed=6)[0]
    every, within = restitution(recordings, contact=5e-4), 0
    for k in range(4):
        others = restitution([*recordings[:k], *recordings[k + 1 :]], contact=5e-4)
        error = np.hypot(others["prediction_error"], every["drop_restitution_error"][k])
        apart = every["drop_restitution"][k] - others["restitution"]
        within += abs(float(apart)) < 2.0 * float(error)
    assert within >= 3


def test_groups_named_in_files_are_measured_separately():
    setup = FloorExperiment(scatter=0.003, contact_time=5e-4)
    recordings = [replace(one, group="ab"[k % 2]) for k, one in enumerate(hear_drops(setup, 4)[0])]
    found = restitution(recordings, contact=5e-4)
    assert found["group"].values.tolist() == ["a", "b"]
    assert found["group_restitution"].values == pytest.approx(0.85, abs=0.01)
    assert "a: 0.8" in "\n".join(restitution_lines(found))


def test_missed_and_false_clicks_are_found():
    times = hear_drops(FloorExperiment(), 1, seed=5)[0][0].time
    spoilt = np.sort(np.append(np.delete(times, 4), [times[1] + 0.1]))
    found = restitution([clicks(spoilt), clicks(times)], contact=5e-4)
    assert "1 missed and 1 false of 9 clicks" in found.attrs["remarks"]
    assert abs(off(found, 0.85)) < 3.5


def test_clicks_are_told_apart_by_the_flights_of_all_drops():
    """Echoes in short lists change most ratios of intervals; a missed click joins two flights."""
    flights = 0.6 * 0.55 ** np.arange(4)
    times = np.append(0.0, np.cumsum(flights))
    lists = [np.sort(np.append(times, times[1] + 0.08)) for _ in range(3)]
    found = restitution([*map(clicks, lists), clicks(np.delete(times, 1)[:3])], contact=1e-6)
    assert float(found["restitution"]) == pytest.approx(0.55, abs=1e-3)
    assert found.attrs["bounces"] == 9


@pytest.mark.parametrize("wrong", [0.01, 100.0])
def test_a_drop_height_in_another_unit_is_refused(wrong):
    lists = hear_drops(FloorExperiment(height=0.8), 2, seed=3)[0]
    with pytest.raises(ParameterError, match=r"fit a fall from about 0\.(79|8|81) m; give it in m"):
        restitution(lists, drop_height=0.8 * wrong)
    assert abs(off(restitution(lists, drop_height=0.8), 0.85)) < 3.5


def test_a_list_of_clicks_that_are_mostly_false_is_left_out():
    rng = np.random.default_rng(4)
    true = hear_drops(FloorExperiment(restitution=0.7), 2, seed=3)[0]
    noise = replace(clicks(np.sort(rng.uniform(0.0, 2.0, 12))), name="noise")
    found = restitution([*true, noise])
    assert "noise" not in found["drop"].values
    assert "too many to tell impacts apart: left out" in found.attrs["remarks"]


def test_a_film_that_contradicts_gravity_says_that_a_unit_is_wrong():
    film = film_drops(FloorExperiment(bounces=3), seed=1)[0][0]
    assert "correct the unit" not in restitution([film]).attrs["remarks"]
    for wrong in (replace(film, time=8.0 * film.time), replace(film, height=1e-3 * film.height)):
        assert "times gravity, so that its unit" in restitution([wrong]).attrs["remarks"]
        free = restitution([wrong], scale_from_gravity=True)
        assert "correct the unit" not in free.attrs["remarks"]


def test_a_part_in_which_nothing_was_recorded_is_refused():
    film = film_drops(FloorExperiment(bounces=3), seed=1)[0][0]
    for part in ({"begin": 100.0}, {"begin": 2.0, "end": 1.0}, {"end": -1.0}):
        with pytest.raises(TrackError, match=r"nothing was recorded from .* last from 0\.0"):
            restitution([film], **part)


def test_times_without_their_unit_are_refused_where_no_ball_flies_for_so_long():
    lists = hear_drops(FloorExperiment(), 1, seed=3)[0]
    with pytest.raises(TrackError, match=r"if the times are in ms, write their unit"):
        restitution([clicks(1e3 * lists[0].time)])


def test_groups_of_other_balls_do_not_change_the_reading_of_clicks():
    slow = np.append(0.0, np.cumsum(0.6 * 0.55 ** np.arange(4)))
    fast = np.append(0.0, np.cumsum(0.6 * 0.9 ** np.arange(12)))
    spoilt = np.sort(np.append(np.delete(slow, 2), 0.7))
    of_slow = [replace(clicks(one), group="slow") for one in (slow, spoilt)]
    of_fast = [replace(clicks(fast), group="fast") for _ in range(3)]
    both, alone = (restitution(some, contact=1e-6) for some in (of_fast + of_slow, of_slow))
    slow_group = both.sel(group="slow")
    assert float(slow_group["group_restitution"]) == pytest.approx(float(alone["restitution"]))


def test_times_determine_no_law_and_one_bounce_no_scatter():
    falling = FloorExperiment(slope=-0.02, scatter=0.003, contact_time=5e-4)
    found = restitution(hear_drops(falling, 6, seed=2)[0], contact=5e-4)
    assert found.attrs["dependence"] == "falls"
    assert not found.sizes["law"]
    one = restitution([clicks([0.0, 0.8, 1.48])], contact=5e-4)
    assert float(one["restitution"]) == pytest.approx(0.85, abs=1e-3)
    assert np.isnan(one["scatter"])
    assert "not determined by so few bounces" in "\n".join(restitution_lines(one))
    # the drop height adds the first fall
    fallen = restitution([clicks([0.0, 0.7])], contact=5e-4, drop_height=0.8)
    assert float(fallen["restitution"]) == pytest.approx(0.866, abs=1e-3)


def test_a_camera_that_drifts_moves_neither_restitution_nor_contact():
    """By mm per second; with a constant level the contact times would be biased."""
    drift = -2e-3
    setup = FloorExperiment(restitution=0.8, contact_time=1e-3, noise=1e-4)
    films = [
        replace(film, height=film.height + drift * film.time)
        for film in film_drops(setup, 2, seed=12)[0]
    ]
    found = restitution(films)
    assert float(found["restitution"]) == pytest.approx(
        0.8, abs=3.0 * float(found["restitution_error"])
    )
    contact = found.sel(input="contact")
    off = float(contact["input_value"]) - 1e-3
    assert abs(off) < 3.0 * float(contact["input_error"])


def test_the_grid_of_components_resolves_them_however_many_bounces():
    """Doubling the nodes changes errors by at most 5 %, and upper limits by at most a fifth."""
    rng, rows = np.random.default_rng(5), []
    for n in (6, 6, 30, 30):
        clicks = np.diff(np.eye(n + 1), axis=0)
        timing = clicks @ clicks.T
        value = 0.8 + 0.006 * rng.standard_normal(n) + clicks @ rng.normal(0.0, 2e-3, n + 1)
        rows.append((value, np.ones((n, 1)), np.zeros((n, n)), timing, np.ones(n)))
    for few in (rows[:2], rows):
        grids = []
        for nodes in (drops.NODES, 2 * drops.NODES):
            with mock.patch.object(drops, "NODES", nodes):
                grids.append(
                    drops.fit_components(drops.stack(few), np.zeros(1), (True, True, True))
                )
        for which in range(3):
            near, fine = (grid.component_quantile(which, 0.95) for grid in grids)
            assert near == pytest.approx(fine, rel=0.2)
        sizes = [float(grid.moments()[1][0, 0]) ** 0.5 for grid in grids]
        assert sizes[0] == pytest.approx(sizes[1], rel=0.05)


def test_the_laws_that_fit_a_film_are_listed():
    setup = FloorExperiment(
        restitution_law="viscoelastic", restitution=0.8, scatter=0.003, bounces=6
    )
    found = restitution(film_drops(setup, 3, seed=6)[0])
    assert "viscoelastic" in found["law"].values
    assert "constant" not in found["law"].values


def test_a_line_that_fits_is_stated_as_points_of_a_sweep():
    setup = FloorExperiment(slope=-0.03, scatter=0.001, bounces=6)
    found = restitution(film_drops(setup, 4, seed=1)[0])
    assert found["law"].values.tolist() == ["line"]
    (line,) = (line for line in restitution_lines(found) if "fit equally" in line)
    keys = line.partition(": ")[2].replace(", restitution_points", "\nrestitution_points")
    scene = keyword_spec(tomllib.loads(keys)).scene
    for v, e in numbers_of(scene.restitution_law):
        assert e == pytest.approx(0.85 - 0.03 * (v - 1.0), abs=2e-3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"mass": 0.05}, "diameter: is missing"),
        ({"contact": -1.0}, "contact"),
        ({"contact": (2, 1)}, "contact"),
    ],
)
def test_inputs_are_checked(given, message):
    with pytest.raises(ParameterError, match=message):
        restitution([clicks([0.0, 0.8, 1.48])], **given)


@pytest.mark.parametrize("recordings", ["clicks.csv", 5, None, [5], {}])
def test_what_is_no_recording_is_refused(recordings):
    for measure in (restitution, times_on_shaker):
        with pytest.raises(TrackError, match=r"^recordings = .*: must be a list that read_recor"):
            measure(recordings)
    one = clicks([0.0, 0.8, 1.48])
    assert restitution(one, contact=5e-4).equals(restitution([one], contact=5e-4))


def test_the_command_measures_draws_and_prints_json(tmp_path, capsys):
    film = film_drops(FloorExperiment(bounces=4, scatter=0.004), 1, seed=3)[0][0]
    path = tmp_path / "film.csv"
    pd.DataFrame({"time": film.time, "height": film.height}).to_csv(path, index=False)
    words = ["lab", "restitution", str(path), "--contact", "0.0002:0.001"]
    result = ["-o", str(tmp_path / "out.h5"), "--figures", str(tmp_path / "figures")]
    assert main([*words, *result]) == 0
    assert "restitution 0.8" in capsys.readouterr().out
    names = {p.name for p in (tmp_path / "figures").iterdir()}
    assert {"lab_restitution.png", "lab_drop_film.png"} <= names
    assert main(["info", str(tmp_path / "out.h5")]) == 0
    assert "restitution 0.8" in capsys.readouterr().out
    assert main([*words, "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["bounces"] == 4
    assert numbers["drop_scatter"] is None
