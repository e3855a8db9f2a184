"""Stability windows and conditions."""

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import xarray as xr
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.cases import each_of
from tests.scans import find_windows
from vibrosweep import theory, windows
from vibrosweep.analysis.conditions import FAILS, HOLDS, NAMED, UNDETERMINED, Condition, named
from vibrosweep.analysis.windows import (
    ENDS,
    NO_WINDOW,
    OPEN_ABOVE,
    OPEN_BELOW,
    UNDETERMINED_ABOVE,
    UNDETERMINED_BELOW,
    find_edges,
    summary,
    windows_of_row,
)
from vibrosweep.engine.measure import measure
from vibrosweep.errors import DataError, ParameterError, SpecError
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.measures import VARIABLES, Regime, Status
from vibrosweep.scene.sweep import keyword_spec

# Stability windows against closed forms, and against the engine on both sides of every edge.

MODES = (1, 2, 3, 4)
PI = Fraction("3.14159265358979323846264338327950288419716939937510582097494459")


@pytest.mark.parametrize("frequency", [1.0, 17.0])
def test_locked_windows_end_where_the_closed_forms_say(frequency):
    e = np.concatenate([np.linspace(0.3, 0.98, 18), [0.99]])
    # the scan knows nothing of the ends; its step is wider than the windows of small restitution
    scan = np.linspace(0.005, 15.0, 64) / frequency
    names = [f"locked({k})" for k in MODES]
    found = find_windows(
        keyword_spec({"duration": 2000.0, "frequency": frequency}).scene, e, scan, names, threads=2
    )
    assert (found["window_count"] == 1).all()
    for k, name in zip(MODES, names, strict=True):
        one = found.sel(condition=name, direction="launch").isel(window=0)
        assert one["A_min"].values == pytest.approx(theory.amplitude_min(k, e, frequency), rel=1e-8)
        assert one["A_max"].values == pytest.approx(theory.amplitude_max(k, e, frequency), rel=1e-8)
        for end in ("A_min", "A_max"):
            assert (one[f"{end}_bracket"] <= 1e-9 * one[end] * (1.0 + 1e-6)).all()


def test_gravity_and_the_reflect_law_give_the_same_locked_windows_of_positive_kicks():
    scene = keyword_spec({"duration": 2000.0, "gravity": 1.62, "rebound": "reflect"}).scene
    found = find_windows(scene, 0.8, np.linspace(0.01, 0.6, 30), ["locked(1)"]).isel(window=0)
    lower, upper = (end(1, 0.8, 1.0, 1.62) for end in (theory.amplitude_min, theory.amplitude_max))
    assert found["A_min"].item() == pytest.approx(lower, rel=1e-8)
    assert found["A_max"].item() == pytest.approx(upper, rel=1e-8)


@each_of(("base", "frequency"), [("high-bounce", 1.0), ("moving", 17.0)])
@each_of("forcing", ["base_velocity", "base_displacement", "base_acceleration"])
def test_any_forcing_can_be_scanned(forcing, base, frequency):
    e, omega = np.array([0.5, 0.8, 0.95]), 2.0 * np.pi * frequency
    scale = {"base_displacement": 1.0 / omega, "base_acceleration": omega / 9.81}.get(forcing, 1.0)
    scan = np.linspace(0.01, 4.0, 20) * scale / frequency
    scene = keyword_spec({"duration": 2000.0, "base": base, "frequency": frequency}).scene
    options = {"forcing": forcing, "tolerance": 1e-13}
    found = find_windows(scene, e, scan, ["locked(1)"], **options).squeeze()
    symbol, units = FORCINGS[forcing].symbol, FORCINGS[forcing].units
    assert found.attrs["forcing"] == forcing
    assert (found["window_count"] == 1).all()
    for name, end in (
        ("min", theory.amplitude_min(1, e, frequency)),
        ("max", theory.amplitude_max(1, e, frequency, base=base)),
    ):
        one = found[f"{symbol}_{name}"]
        assert one.attrs["units"] == units
        assert one.values == pytest.approx(end * scale / (1.0 + e), rel=1e-13)


def test_keywords_may_scan_the_acceleration_of_the_base():
    found = windows(restitution=0.8, base_acceleration=[0.1, 0.5, 2.0], base="moving").squeeze()
    end = theory.amplitude_min(1, 0.8) * 2.0 * np.pi / (1.8 * 9.81)
    assert float(found["Gamma_min"]) == pytest.approx(float(end), rel=1e-8)
    assert "amplitude" not in found.variables


def test_windows_of_landings_are_the_same_if_the_base_velocity_is_scanned():
    scene = keyword_spec(
        {"particles": 3, "duration": 3.0}
    ).scene  # orbits depend smoothly on the forcing
    scan = np.linspace(0.2, 3.0, 15)
    amplitude = find_windows(scene, [0.9], scan, ["separated"])
    velocity = find_windows(scene, [0.9], scan / 1.9, ["separated"], forcing="base_velocity")
    assert velocity["window_count"].item() == amplitude["window_count"].item() > 0
    for end in ("min", "max"):
        said, other = velocity[f"V0_{end}"].values, amplitude[f"A_{end}"].values
        np.testing.assert_allclose(1.9 * said, other, rtol=1e-8)


def exact_window(k, e, frequency, gravity, sign=1, base="high-bounce"):
    """Exact lower end of a locked window in m s-1, and the square of the upper one."""
    e, unit = Fraction(e), Fraction(gravity) / (2 * Fraction(frequency))
    need = abs(sign - e) * k * unit
    steepest = 1 + ((1 - e) / (1 + e)) ** 2 if base == "moving" else 1
    return need, need**2 + ((1 + sign * e) * steepest / PI * unit) ** 2


def holds_inside(end, bracket, square):
    """Return whether a bracket around an end holds the exact one, given by its square."""
    middle, half = Fraction(float(end)), Fraction(float(bracket)) / 2
    return (middle - half) ** 2 <= square <= (middle + half) ** 2


@given(
    off=st.floats(0.0, 8.0).map(lambda power: 10.0**-power),
    k=st.integers(1, 40),
    frequency=st.floats(0.1, 100.0),
    gravity=st.floats(1.0, 25.0),
    tolerance=st.floats(2.0, 14.0).map(lambda power: max(10.0**-power, 1e-14)),
    points=st.integers(2, 9),
    kind=st.sampled_from([("high-bounce", "rest"), ("high-bounce", "reflect"), ("moving", "rest")]),
)
def test_the_brackets_of_every_locked_window_hold_its_exact_ends(
    off, k, frequency, gravity, tolerance, points, kind
):
    e, (base, rebound) = 1.0 - off, kind
    # below, the windows of both orbits overlap, or the moving base is met before k periods are over
    assume(kind == ("high-bounce", "rest") or e > 0.05)
    signs = (1, -1) if rebound == "reflect" else (1,)
    exact = [exact_window(k, e, frequency, gravity, sign, base) for sign in signs]
    scan = np.linspace(0.7 * float(exact[0][0]), 1.3 * float(exact[-1][1]) ** 0.5, points)
    scene = keyword_spec(
        {
            "duration": 2000.0,
            "frequency": frequency,
            "gravity": gravity,
            "contact_time": 1e-6,
            "base": base,
            "rebound": rebound,
        }
    ).scene
    found = find_windows(scene, e, scan, [f"locked({k})"], tolerance=tolerance, threads=1)
    row = found.isel(condition=0, direction=0, restitution=0)
    count = int(row["window_count"])
    held = []
    for window in range(count):
        one = row.isel(window=window)
        for end in ("A_min", "A_max"):
            assert one[f"{end}_bracket"] <= tolerance * one[end] * (1.0 + 1e-2)
        held += [
            (lower, square)
            for lower, square in exact
            if holds_inside(one["A_min"], one["A_min_bracket"], lower**2)
            and holds_inside(one["A_max"], one["A_max_bracket"], square)
        ]
    assert len(held) == count
    for lower, square in exact:  # windows wider than the tolerance are found
        if float(1 - lower**2 / square) > 2.1 * tolerance:
            assert (lower, square) in held


def test_a_second_window_under_the_reflect_law_is_found_whatever_the_scan():
    for scan in (np.arange(0.05, 12.0, 0.05), np.array([0.1, 50.0])):
        row = find_windows(
            keyword_spec({"duration": 2000.0, "rebound": "reflect"}).scene, 0.9, scan, ["locked(1)"]
        ).squeeze()
        assert row["window_count"] == 2
        assert row["A_min"].values == pytest.approx([0.4905, 9.3195], rel=1e-8)
        assert row["A_max"].values == pytest.approx([3.0067668922, 9.3208084], rel=1e-7)


@each_of("points", [50, 400, 3000])
@each_of("rebound", ["rest", "reflect"])
def test_no_locked_orbit_attracts_without_loss_of_energy(points, rebound):
    scan = np.linspace(0.01, 14.5, points)
    found = find_windows(
        keyword_spec({"duration": 2000.0, "rebound": rebound}).scene,
        1.0,
        scan,
        ["locked(1)", "locked(2)"],
    )
    assert (found["window_count"] == 0).all()
    assert (found[ENDS.name] == NO_WINDOW).all()


@each_of(
    ("scan", "ends"),
    [
        ([0.1, 2.0, 4.0], 0),
        ([1.0, 2.0, 4.0], OPEN_BELOW),
        ([0.1, 2.0], OPEN_ABOVE),
        ([1.0, 2.0], OPEN_BELOW + OPEN_ABOVE),
        ([4.0, 5.0], NO_WINDOW),
    ],
)
def test_an_end_of_the_scan_is_no_end_of_a_window(scan, ends):
    found = find_windows(keyword_spec({"duration": 2000.0}).scene, [0.85, 0.9], scan, ["locked(1)"])
    one = found.isel(condition=0, direction=0, window=0)
    assert (one[ENDS.name] == ends).all()
    for name, is_open in (
        ("A_min", ends in (NO_WINDOW, OPEN_BELOW, OPEN_BELOW + OPEN_ABOVE)),
        ("A_max", ends in (NO_WINDOW, OPEN_ABOVE, OPEN_BELOW + OPEN_ABOVE)),
    ):
        assert (np.isnan(one[name]) == is_open).all()
        assert (np.isnan(one[f"{name}_bracket"]) == is_open).all()
    (line,) = summary(found)
    assert ("no window was found" in line) == (ends == NO_WINDOW)
    assert ("2 of 2 reach the end of the scan" in line) == (ends > 0)
    assert (found["widest"] == (-1 if ends == NO_WINDOW else 0)).all()
    meanings = found[ENDS.name].attrs["flag_meanings"].split()
    assert len(meanings) == len(found[ENDS.name].attrs["flag_values"]) == 10


def test_more_than_fits_into_memory_is_refused_with_a_remedy_that_exists():
    scan = np.linspace(0.1, 5.0, 10**6)
    with pytest.raises(ParameterError, match=r" GiB.*fewer") as caught:
        find_windows(
            keyword_spec({"duration": 2000.0}).scene,
            np.linspace(0.0, 1.0, 10**6),
            scan,
            ["locked(1)"],
        )
    assert "--chunk" not in str(caught.value)


def sides_of(found, condition, scene, workers):
    """Results of the engine just inside and outside of every edge, and at doubles next to these."""
    one = found.sel(condition=condition.name, direction="launch")
    e = np.broadcast_to(one["restitution"].values[:, np.newaxis], one["A_min"].shape)
    for end, inward in (("A_min", 1.0), ("A_max", -1.0)):
        edge, bracket = one[end].values, one[f"{end}_bracket"].values
        known = np.isfinite(bracket)
        for side in (1.0, -1.0):
            amplitude = edge[known] + side * inward * 0.5 * bracket[known]
            observation = scene.only(**condition.measures)
            near = (amplitude, np.nextafter(amplitude, 0.0), np.nextafter(amplitude, np.inf))
            parameters = [scene.parameters({"restitution": e[known], "amplitude": a}) for a in near]
            yield side, [measure(one, observation, workers) for one in parameters]


@each_of(
    ("name", "changes"),
    [
        ("ordered", {"duration": 800.0, "launch": [0.125, 0.3], "particles": 2}),
        ("periodic", {"duration": 300.0, "particles": 3}),
        ("separated", {"duration": 12.0, "particles": 6}),
        ("collision_free", {"duration": 12.0, "particles": 6}),
        ("regular", {"duration": 400.0, "particles": 3}),
    ],
)
def test_a_condition_holds_inside_every_edge_and_fails_outside(name, changes, workers):
    scene, condition = keyword_spec({"duration": 2000.0, **changes}).scene, named(name)
    e = np.array([0.85, 0.93, 0.96])
    found = find_windows(scene, e, np.linspace(0.3, 3.6, 25), [name], threads=2)
    tested = asked = 0
    for side, measured in sides_of(found, condition, scene, workers):
        holds = {
            "ordered": lambda m: m["locked_count"] == scene.particles,
            "periodic": lambda m: (
                m["unsettled_count"] + m["aperiodic_count"] + m["at_rest_count"] == 0
            ),
            "separated": lambda m: m["dt_min"] > scene.inputs["contact_time"],
            "collision_free": lambda m: m["collision_free"] == 1,
            "regular": lambda m: (
                (m["lyapunov_largest"] < 0.0) & (m["regime"] != Regime.UNSETTLED)
            ).all(axis=1),
        }[name]
        held = np.array([holds(one) for one in measured])
        # next to a bifurcation, rounding decides whether a recurrence is seen in time: no sure edge
        sure = (held == held[0]).all(axis=0)
        assert (held[0, sure] == (side > 0.0)).all()
        tested, asked = tested + np.count_nonzero(sure), asked + sure.size
    assert tested >= max(4, 0.5 * asked)
    widest = found["widest"].values.ravel()
    width = (found["A_max"].fillna(3.6) - found["A_min"].fillna(0.3)).values[0, 0]
    there = found["window_ends"].values[0, 0] >= 0
    for row in range(e.size):
        assert widest[row] == (np.argmax(width[row] * there[row]) if there[row].any() else -1)


def test_continuation_sees_the_hysteresis_of_the_locked_orbit():
    # a particle that rests in every period does so up to 2.26 m/s; one that is locked stays locked
    # down to the end of its window
    scene = keyword_spec({"duration": 20_000.0, "launch_velocity": 4.905, "launch": [0.473]}).scene
    axis = np.linspace(0.3, 2.9, 400)
    found = find_windows(scene, [0.9], axis, ["ordered"], continuation=True, tolerance=1e-6)
    up, down = (
        found.sel(direction=d, condition="ordered", restitution=0.9) for d in ("up", "down")
    )
    lower = float(theory.amplitude_min(1, 0.9))
    assert down["A_min"].values[0] == pytest.approx(lower, rel=2e-6)
    assert np.isnan(down["A_max"].values[0])
    assert np.isnan(down["A_max_bracket"].values[0])
    assert down["window_ends"].values[0] == OPEN_ABOVE
    assert up["A_min"].values[up["widest"].item()] > 2.0


def test_a_condition_of_ones_own():
    calm = Condition(
        "calm", lambda ds: (ds["rebound_height_max"] < 2.0).values, ("rebound_height_max",)
    )
    found = find_windows(
        keyword_spec({"duration": 12.0}).scene, [0.9], np.linspace(0.1, 4.0, 40), [calm]
    )
    assert found["condition"].values.tolist() == ["calm"]
    # a result stores the code of the condition
    assert calm.code in found.attrs["condition_code"]
    assert "< 2.0" in calm.code
    assert found["window_count"].item() >= 1


def test_a_condition_whose_code_cannot_be_stored_is_refused():
    builtin = Condition("builtin", len, ())
    with pytest.raises(ParameterError, match=r"^condition builtin: .* def "):
        _ = builtin.code
    # typed in a shell, so that there is no source
    functions = {}
    exec("def low(ds): return ds['rebound_height_max'] < LEVEL", {"LEVEL": 2.0}, functions)
    exec("def lower(ds): return ds['rebound_height_max'] < LEVEL", {"LEVEL": 1.0}, functions)
    low, lower = (Condition(name, one, ()) for name, one in functions.items())
    assert low.code.removeprefix("low") != lower.code.removeprefix("lower")


def test_a_function_that_gives_no_booleans_is_refused():
    wrong = Condition("wrong", lambda ds: ds["rebound_height_max"].values, ("rebound_height_max",))
    with pytest.raises(ParameterError, match=r"^condition wrong\b"):
        find_windows(keyword_spec({"duration": 12.0}).scene, [0.9], [1.0, 2.0], [wrong])


@each_of(
    ("given", "key"),
    [
        ({"amplitude": [1.0]}, "sample.amplitude"),
        ({"restitution": [1.1]}, "sample.restitution"),
        ({"conditions": []}, "windows.conditions"),
        ({"tolerance": 1e-20}, "windows.tolerance"),
        ({"frequency": [1.0, 2.0]}, "sample.frequency"),
    ],
)
def test_mistakes_are_named(given, key):
    with pytest.raises(SpecError) as caught:
        windows(**{"amplitude": [1.0, 2.0], "conditions": ["ordered"], **given})
    assert [mistake.key for mistake in caught.value.mistakes] == [key]


@pytest.mark.parametrize("name", ["orderly", "locked(0)"])
def test_an_unknown_condition_is_named(name):
    with pytest.raises(SpecError, match=f"condition '{re.escape(name)}' is not known"):
        windows(amplitude=[1.0, 2.0], conditions=[name])


def test_conditions_on_launches_cannot_be_continued():
    with pytest.raises(ParameterError, match="separated reads dt_min"):
        find_windows(
            keyword_spec({"duration": 12.0}).scene,
            [0.9],
            [1.0, 2.0],
            ["separated"],
            continuation=True,
        )


def test_an_unknown_variable_of_a_condition_is_refused():
    with pytest.raises(ParameterError, match="dtmin is not"):
        Condition("mine", lambda ds: ds["dtmin"] > 0, ("dtmin",))


@each_of("name", sorted(NAMED))
def test_a_condition_names_the_variables_that_a_dataset_lacks_and_their_key(name, paper):
    import xarray as xr

    condition = named(name)
    with xr.open_dataset(paper, engine="h5netcdf") as dataset:
        lacking = dataset.drop_vars(condition.variables, errors="ignore")
        with pytest.raises(DataError) as caught:
            condition.judge(lacking)
    for variable in condition.variables:
        assert variable in str(caught.value)
    key = next(iter(condition.measures))
    assert f"set {key} = true in the [measure] section" in str(caught.value)


def test_the_result_does_not_depend_on_the_number_of_threads():
    scene = keyword_spec({"particles": 4, "duration": 150.0}).scene
    arguments = scene, [0.8, 0.9], np.linspace(0.3, 3.5, 20), ["locked(1)", "periodic"]
    for continuation in (False, True):
        one, four = (find_windows(*arguments, continuation=continuation, threads=n) for n in (1, 4))
        assert one.identical(four)


def test_windows_hold_the_base_acceleration_and_how_times_were_given():
    scene = keyword_spec(
        {
            "duration_periods": 50.0,
            "transient_periods": 10.0,
            "frequency": 2.0,
        }
    ).scene
    found = find_windows(scene, [0.5, 0.9], [0.2, 1.0, 5.0], ["locked(1)"])
    e, a = found["restitution"], found["scan"]
    expected = 2.0 * np.pi * 2.0 * a / (1.0 + e) / 9.81
    np.testing.assert_allclose(
        found["base_acceleration"], expected.transpose("restitution", "scan")
    )
    assert found["duration"].item() == 25.0
    assert found["transient"].item() == 5.0
    given = {"base": "high-bounce", "forcing": "amplitude"}
    given |= {"duration_periods": 50.0, "transient_periods": 10.0}
    assert given.items() <= found.attrs.items()
    again = find_windows(
        replace(scene, duration=25.0).with_measures(transient=5.0),
        [0.5, 0.9],
        [0.2, 1.0, 5.0],
        ["locked(1)"],
    )
    for name in found.data_vars:
        assert found[name].equals(again[name])


def test_windows_under_a_law_of_restitution():
    """k - E(k) <= a <= sqrt((k - E(k))^2 + ((1 + q)/pi)^2), in units of g / 2 f."""
    speed, scan, loose = 0.4, list(np.linspace(0.05, 1.5, 4)), 1e-6
    found = windows(
        gravity=2.0, frequency=1.0, restitution=[0.8], amplitude=scan, tolerance=loose,
        restitution_law="plastic", restitution_speed=speed, conditions=["locked(2)"],
    )  # fmt: skip
    k, e = np.array([[2.0]]), found.restitution.values
    left = e * (k / speed) ** -0.25 * k
    ends = k - left, np.hypot(k - left, (1.0 + 0.75 * left / k) / np.pi)
    for name, known in zip(("A_min", "A_max"), ends, strict=True):
        one, width = (found[n].values[:, 0, :, 0] for n in (name, f"{name}_bracket"))
        assert (np.abs(one - known) <= 0.5 * width * (1.0 + 1e-6)).all()
        assert (width <= loose * one * (1.0 + 1e-6)).all()
    assert (found.window_count == 1).all()
    tone = {"waveform": {"harmonics": [[1, 1.0, 0.0]]}, "restitution": [0.8]}
    tone |= {"restitution_law": "plastic", "restitution_speed": speed, "gravity": 2.0}
    again = windows(**tone, amplitude=scan, conditions=["locked(2)"])
    for name, known in zip(("A_min", "A_max"), ends, strict=True):
        one, width = (again[n].values[:, 0, :, 0] for n in (name, f"{name}_bracket"))
        assert (np.abs(one - known) <= 0.5 * width + 4e-16).all()
        assert (width <= 1e-12 * one).all()


NOISY = {"restitution": 0.9, "kick_noise": 1e-3, "duration_periods": 60.0, "noise_replicas": 5}


def test_windows_under_noise_are_shares_of_replicas():
    """Weak noise keeps all of 10 particles locked between the ends without noise, none beyond."""
    low, high = (float(f(1, 0.9)) for f in (theory.amplitude_min, theory.amplitude_max))
    scan = [0.8 * low, 1.2 * low, 0.5 * (low + high), 0.9 * high, 1.3 * high]
    found = windows(NOISY | {"amplitude": scan, "particles": 2, "tolerance": 0.01})
    assert found.share.values.ravel().tolist() == [0.0, 1.0, 1.0, 1.0, 0.0]
    assert found["holds"].values.ravel().tolist() == [0, 1, 1, 1, 0]
    tail = 0.025**0.1  # Clopper and Pearson, none of 10 or all
    assert found.share_low.values.ravel() == pytest.approx([0.0, tail, tail, tail, 0.0])
    assert found.share_high.values.ravel() == pytest.approx([1 - tail, 1.0, 1.0, 1.0, 1 - tail])
    assert found.A_min.item() == pytest.approx(low, rel=0.05)
    assert 0.9 * high < found.A_max.item() < 1.3 * high
    assert found.attrs["noise_replicas"] == 5
    assert "noise_stream" not in found.variables


@each_of(
    ("given", "words"),
    [
        ({"continuation": True}, "continuation = True: looks for orbits that repeat"),
        ({"prove": True}, "prove = True: looks for orbits that repeat"),
        ({"conditions": ["ordered"]}, "conditions = 'ordered': looks for orbits that repeat"),
        ({"kick_noise": 0.0}, "noise_replicas = 5: has no meaning, since nothing is random"),
        ({"noise_replicas": 0}, "noise_replicas = 0.*at least 1"),
    ],
)
def test_requests_that_do_not_fit_noise_replicas_are_refused(given, words):
    with pytest.raises(SpecError, match=words):
        windows(NOISY | {"amplitude": [1.0, 2.0]} | given)


# Edges of codes that are known exactly: every one is bracketed, in either direction.

AXIS = np.linspace(0.0, 1.0, 21)


def between(*ends):
    """Code 1 between the first and the second end, the third and the fourth, and so on."""

    def evaluate(rows, at, states):
        return np.searchsorted(np.array(ends), at, side="right") % 2, states

    return evaluate


@given(st.lists(st.floats(0.01, 0.99), min_size=1, max_size=6, unique=True), st.booleans())
def test_every_edge_between_points_of_different_code_is_bracketed(ends, upward):
    ends = sorted(ends)
    codes, edges = find_edges(between(*ends), 1, AXIS, 1e-10, upward=upward)
    assert codes[0].tolist() == between(*ends)(None, AXIS, None)[0].tolist()
    assert edges.low.size == np.count_nonzero(np.diff(codes[0]))
    for low, high in zip(edges.low, edges.high, strict=True):
        assert 0.0 < high - low <= 1e-10 * high
        assert sum(low < end <= high for end in ends) % 2 == 1
    windows = windows_of_row(codes, edges, 0, {1})
    assert len(windows) == np.count_nonzero(np.diff(np.concatenate([[0], codes[0]])) > 0)


def test_all_windows_of_a_row_are_kept_and_an_end_of_the_scan_is_no_edge():
    codes, edges = find_edges(between(0.21, 0.43, 0.77), 1, AXIS, 1e-12)
    first, second = windows_of_row(codes, edges, 0, {1})
    assert first[:2] == pytest.approx((0.21, 0.43), rel=1e-11)
    assert max(first[2:4]) < 1e-12
    assert (first.below, first.above, second.below, second.above) == (0, 0, 0, None)
    assert second[0] == pytest.approx(0.77, rel=1e-11)
    assert np.isnan(second[1])
    assert np.isnan(second[3])
    outside = windows_of_row(codes, edges, 0, {0})
    assert [w[0] for w in outside] == pytest.approx([np.nan, 0.43], rel=1e-11, nan_ok=True)
    assert np.isnan(outside[0][2])
    (whole,) = windows_of_row(codes, edges, 0, {0, 1})
    assert np.isnan(whole[:4]).all()
    assert whole[4:] == (None, None)


def test_a_middle_code_narrower_than_the_scan_is_found():
    def evaluate(rows, at, states):
        return np.where(at < 0.5123, 0, np.where(at < 0.5124, 2, 1)), states

    codes, edges = find_edges(evaluate, 1, AXIS, 1e-9)
    assert 2 not in codes
    (window,) = windows_of_row(codes, edges, 0, {2})
    assert window[:2] == pytest.approx((0.5123, 0.5124), rel=1e-9)


def test_rows_are_bisected_together():
    calls = []

    def evaluate(rows, at, states):
        calls.append(at.size)
        return (at > 0.1 + 0.08 * rows).astype(np.int64), states

    _, edges = find_edges(evaluate, 10, AXIS, 1e-9)
    assert edges.row.tolist() == list(range(10))
    assert edges.low == pytest.approx(0.1 + 0.08 * np.arange(10), rel=1e-8)
    assert calls[0] == 210
    assert len(calls) < 40


@pytest.mark.parametrize(("upward", "end"), [(True, 0.7), (False, 0.3)])
def test_a_scan_that_goes_on_from_its_states_sees_hysteresis(upward, end):
    # a switch that turns on above 0.7, off below 0.3, and stays as it is between
    def evaluate(rows, at, states):
        on = np.where(at > 0.7, 1.0, np.where(at < 0.3, 0.0, states[:, 0]))
        return on.astype(np.int64), on[:, np.newaxis]

    start = np.array([[0.0 if upward else 1.0]])
    codes, edges = find_edges(evaluate, 1, AXIS, 1e-9, start=start, upward=upward)
    (window,) = windows_of_row(codes, edges, 0, {1})
    assert window[0] == pytest.approx(end, rel=1e-8)


# Conditions hold, fail or are undetermined, and ends next to undetermined points say so.

AT_REST, RESTING, LOCKED, UNSETTLED, APERIODIC = Regime
SCAN = np.linspace(0.2, 3.4, 30)


def held(particles=2, **values):
    """One realization with these measured values."""
    data = {
        name: (VARIABLES[name].dims, np.asarray([value], VARIABLES[name].dtype))
        for name, value in {"status": Status.COMPLETED, **values}.items()
    }
    return xr.Dataset(data, {"contact_time": ("realization", [1e-4])}, {"particles": particles})


@each_of(
    ("name", "measured", "code"),
    [
        ("ordered", {"regime": [LOCKED, LOCKED]}, HOLDS),
        ("ordered", {"regime": [LOCKED, RESTING]}, FAILS),
        ("ordered", {"regime": [LOCKED, UNSETTLED]}, UNDETERMINED),
        ("ordered", {"regime": [LOCKED, UNDETERMINED]}, UNDETERMINED),
        ("ordered", {"regime": [APERIODIC, UNSETTLED]}, FAILS),
        ("periodic", {"regime": [LOCKED, RESTING]}, HOLDS),
        ("periodic", {"regime": [RESTING, UNSETTLED]}, UNDETERMINED),
        ("periodic", {"regime": [AT_REST, UNSETTLED]}, FAILS),
        ("regular", {"regime": [LOCKED, RESTING], "lyapunov_largest": [-0.1, -np.inf]}, HOLDS),
        ("regular", {"regime": [LOCKED, APERIODIC], "lyapunov_largest": [-0.1, 0.3]}, FAILS),
        ("regular", {"regime": [UNSETTLED] * 2, "lyapunov_largest": [-0.1, -0.2]}, UNDETERMINED),
        ("regular", {"regime": [LOCKED] * 2, "lyapunov_largest": [-0.1, np.nan]}, UNDETERMINED),
        ("separated", {"dt_min": 2e-4, "base_shared": 0}, HOLDS),
        ("separated", {"dt_min": 1e-5, "base_shared": 1}, FAILS),
        ("separated", {"dt_min": np.nan, "base_shared": 0}, HOLDS),
        ("separated", {"dt_min": np.nan, "base_shared": UNDETERMINED}, UNDETERMINED),
        ("collision_free", {"collision_free": 1}, HOLDS),
        ("collision_free", {"collision_free": 0}, FAILS),
        ("collision_free", {"collision_free": UNDETERMINED}, UNDETERMINED),
    ],
)
def test_a_named_condition_has_three_codes(name, measured, code):
    assert named(name).judge(held(**measured)).tolist() == [code]


@pytest.mark.parametrize("name", ["separated", "collision_free"])
def test_one_particle_is_separated_and_free_of_collisions(name):
    lost = {"dt_min": np.nan, "base_shared": UNDETERMINED, "collision_free": UNDETERMINED}
    assert named(name).judge(held(1, **lost)).tolist() == [HOLDS]
    # it may land, never land, or be given up
    for changes in ({"duration": 12.0}, {"duration": 0.1}, {"duration": 12.0, "impact_budget": 6}):
        for base in ("high-bounce", "moving"):
            found = find_windows(
                keyword_spec({"duration": 2000.0, "base": base, **changes}).scene,
                [0.9],
                [0.5, 1.0, 3.0],
                [name],
            )
            assert found["window_count"].item() == 1
            assert found[ENDS.name].item() == OPEN_BELOW + OPEN_ABOVE


@pytest.mark.parametrize(
    ("measured", "code"),
    [
        ({"rebound_height_max": 1.0}, HOLDS),
        ({"rebound_height_max": 3.0}, FAILS),
        ({"rebound_height_max": np.nan}, UNDETERMINED),
        ({"rebound_height_max": 1.0, "status": Status.BUDGET_EXCEEDED}, UNDETERMINED),
    ],
    ids=str,
)
def test_booleans_of_ones_own_are_undetermined_where_nothing_is_known(measured, code):
    low = Condition("low", lambda ds: ds["rebound_height_max"] < 2.0, ("rebound_height_max",))
    assert low.judge(held(**measured)).tolist() == [code]
    flags = Condition("free", lambda ds: ds["collision_free"] == 0, ("collision_free",))
    assert flags.judge(held(collision_free=UNDETERMINED)).tolist() == [UNDETERMINED]


@each_of(
    ("name", "changes"),
    [
        ("ordered", {"duration": 60.0}),
        ("periodic", {"duration": 60.0, "base": "moving"}),
        ("regular", {"duration": 150.0}),
        ("collision_free", {"duration": 12.0, "launch": [0.0, 0.3], "impact_budget": 24}),
        ("separated", {"duration": 12.0, "base": "moving", "impact_budget": 18}),
    ],
)
def test_beyond_an_end_the_condition_fails_or_the_end_says_that_it_is_undetermined(
    name, changes, workers
):
    scene, condition = (
        keyword_spec({"duration": 2000.0, "particles": 2, **changes}).scene,
        named(name),
    )
    windows = find_windows(scene, [0.5, 0.95], SCAN, [name], tolerance=1e-6)
    found = windows.isel(condition=0, direction=0)
    observation = scene.only(**condition.measures)

    def codes(e, *amplitudes):
        parameters = scene.parameters(
            {"restitution": np.full(len(amplitudes), e), "amplitude": np.array(amplitudes)}
        )
        measured = measure(parameters, observation, workers)
        data = {n: (VARIABLES[n].dims, v) for n, v in measured.items()}
        times = {"contact_time": ("realization", parameters["contact_time"])}
        return condition.judge(xr.Dataset(data, times, {"particles": 2})).tolist()

    def around(e, amplitude):
        """Codes at an end of a bracket and at the doubles next to it."""
        return codes(e, *(np.nextafter(amplitude, to) for to in (0.0, amplitude, np.inf)))

    unknown = 0
    for i, e in enumerate(found["restitution"].values.tolist()):
        row = found.isel(restitution=i)
        expected = codes(e, *SCAN)
        assert row["holds"].values.tolist() == expected
        unknown += expected.count(UNDETERMINED)
        for j in range(int(row["window_count"])):
            one = row.isel(window=j)
            for end, sign, bit in (
                ("A_min", -1.0, UNDETERMINED_BELOW),
                ("A_max", 1.0, UNDETERMINED_ABOVE),
            ):
                edge, half = float(one[end]), 0.5 * float(one[f"{end}_bracket"])
                if np.isfinite(edge):
                    beyond = UNDETERMINED if int(one[ENDS.name]) & bit else FAILS
                    assert HOLDS in around(e, edge - sign * half)
                    assert beyond in around(e, edge + sign * half)
    assert unknown
    (line,) = summary(windows)
    assert f"undetermined at {unknown} of 60 points of the scan" in line
