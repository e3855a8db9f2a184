"""Laws of restitution with numbers of their own: keys, tables, messages, and what results hold."""

import tomllib

import numpy as np
import pytest

import vibrosweep as vs
from tests.cases import each_of
from tests.scenes import RIGID
from vibrosweep.errors import SpecError
from vibrosweep.model.restitution_laws import kinks_of, require_law, text_of
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import keyword_spec, parse_spec, read_spec
from vibrosweep.scene.traces import points_in

PAIRS = [[0.1, 0.95], [0.7, 0.92], [2.0, 0.85]]
POINTS = {"restitution_law": "points", "restitution_points": PAIRS}
POWER = {"restitution_law": "power", "restitution_exponent": 0.2, "restitution_speed": 0.3}
TABLE = "speed,restitution\n0.1,0.95\n0.7,0.92\n2.0,0.85\n"


def points(pairs):
    return {**POINTS, "restitution_points": pairs}


def power(exponent):
    return {**POWER, "restitution_exponent": exponent}


def lacking(key):
    return {name: value for name, value in POWER.items() if name != key}


def test_points_state_the_restitution_of_the_slowest_and_the_speed_of_the_fastest():
    found = vs.simulate(**POINTS, duration=1.5)
    assert found.restitution_law == "points([[0.1, 0.95], [0.7, 0.92], [2.0, 0.85]])"
    assert (found.restitution, found.restitution_speed) == (0.95, 2.0)
    given = vs.simulate(restitution=0.95, base_velocity=1.0, duration=1.5)
    moved = vs.simulate(**POINTS, base_velocity=1.0, duration=1.5)
    assert moved.amplitude == given.amplitude  # the kick has the restitution of the slowest
    speeds = found.arrival_speed.values.ravel()
    e = vs.theory.restitution_at(speeds, 0.5, found.restitution_law)
    np.testing.assert_array_equal(e, np.interp(speeds, *np.array(PAIRS).T))
    kick = found.amplitude.item() * np.sin(2.0 * np.pi * found.landing_time.values.ravel())
    after = found.rebound_velocity.values.ravel()
    np.testing.assert_allclose(after, e * speeds + kick, rtol=1e-12)


def test_the_text_of_a_law_is_an_argument_where_there_are_no_keys():
    assert vs.theory.restitution_at(1.6, 0.9, "power(0.25)", 0.1) == pytest.approx(0.45)
    with pytest.raises(vs.errors.ParameterError, match=r'restitution_exponent must be .*"power\('):
        vs.theory.restitution_at(1.6, 0.9, "power", 0.1)
    with pytest.raises(vs.errors.ParameterError, match="no numbers of its own"):
        require_law("law", "plastic(0.2)")


def test_kinks_are_where_the_slope_jumps():
    assert kinks_of("power(0.2)") == kinks_of("plastic") == [1.0]
    assert kinks_of("power(0)") == kinks_of("viscoelastic") == []
    flat = [[0.5, 0.875], [1.0, 0.875], [2.0, 0.75], [3.0, 0.625], [4.0, 0.625]]
    assert kinks_of(text_of("points", flat)) == [0.25, 0.75]  # none on a line through three points


def test_equal_points_are_a_constant_restitution_bit_for_bit():
    scene = {"amplitude": [0.4, 1.3, 2.9], "particles": 3, "duration": 9.0}
    constant = vs.sweep(**scene, restitution=0.8)
    level = vs.sweep(**scene, **points([[0.1, 0.8], [1.0, 0.8], [3.0, 0.8]]))
    for name in ("impact_count", "rebound_height_max", "rebound_height_mean"):
        np.testing.assert_array_equal(level[name], constant[name])


@each_of(
    ("given", "message"),
    [
        (
            {"restitution_law": "power", "restitution_speed": 1.0},
            "restitution_exponent: is missing",
        ),
        (
            {"restitution_law": "power", "restitution_exponent": 0.2},
            "restitution_speed: is missing",
        ),
        (
            {**POWER, "restitution_exponent": -0.2},
            "= -0.2: must be a number, at least 0 and below 1",
        ),
        (power(1.0), "at least 0 and below 1"),
        (power(float("nan")), "at least 0 and below 1"),
        ({"restitution_exponent": 0.2}, 'belongs to restitution_law = "power"; write that law'),
        ({"restitution_points": PAIRS}, 'belongs to restitution_law = "points"'),
        ({"restitution_law": "points"}, "restitution_points: is missing"),
        (points(PAIRS[:1]), "must be two or more points, each with its"),
        (points([[1, 2, 3], [4, 5, 6]]), "must be two or more points"),
        (points(PAIRS[::-1]), "point 2 is not faster .* sort the points"),
        (points([PAIRS[0]] * 2), "point 2 is not faster"),
        (
            {**POINTS, "restitution_points": [[1, 0.9], [2, 1.5]]},
            "point 2 is 1.5; it must be above",
        ),
        (
            {**POINTS, "restitution_points": [[1, 0.9], [2, 0.0]]},
            "point 2 is 0.0; it must be above",
        ),
        (
            {**POINTS, "restitution_points": [[1, np.nan], [2, 0.8]]},
            "of point 1 is nan; it must be",
        ),
        (
            {**POINTS, "restitution_points": [[-1, 0.9], [2, 0.8]]},
            "speed of point 1 is -1.*; it must",
        ),
        (points([[1, 0.9], [2, 0.95]]), "rises to 0.95 at point 2"),
        (points([[1, 0.9], [1.1, 0.5]]), "so steeply before point 2"),
        (points([[k, 0.9] for k in range(17)]), "at most 16 are allowed"),
        (points("gone.csv"), "gone.csv: there is no such file; check"),
        (points("points.txt"), "must end in .csv"),
        ({**POINTS, "restitution": 0.9}, "restitution = 0.9|restitution: follows from"),
        ({**POINTS, "restitution": [0.8, 0.9]}, "restitution: follows from restitution_points"),
        (
            {**POINTS, "restitution_speed": 1.0},
            "restitution_speed: follows from",
        ),
        ({"restitution_noise": 0.1, "restitution_noise_relative": 0.1}, "keep one of the two"),
    ],
)
def test_each_mistake_has_one_message_with_key_and_remedy(given, message):
    with pytest.raises(SpecError, match=message) as caught:
        keyword_spec(given)
    assert "mistakes" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("velocity,e\n0.1,0.95\n2.0,0.85\n", "must have one column speed .* found: velocity, e"),
        ("speed (m),restitution\n0.1,0.95\n2.0,0.85\n", "the unit 'm' of the speed is not known"),
        ("speed,restitution\n0.1,0.95\n2.0,\n", "restitution of point 2 is nan"),
        ("speed,restitution\n2.0,0.85\n0.1,0.95\n", "point 2 is not faster"),
        ("speed,restitution\n", "holds no table of numbers"),
    ],
)
def test_a_table_that_cannot_be_used_is_named(tmp_path, text, message):
    (tmp_path / "ball.csv").write_text(text)
    sweep = tmp_path / "sweep.toml"
    sweep.write_text(
        'title = "A ball"\n[scene]\nrestitution_law = "points"\nrestitution_points = "ball.csv"\n'
    )
    with pytest.raises(SpecError, match=message) as caught:
        read_spec(sweep)
    assert f'{sweep}: scene.restitution_points = "ball.csv": ' in str(caught.value)


def test_speeds_of_a_table_may_have_another_unit(tmp_path):
    (tmp_path / "ball.csv").write_text("e0;speed (cm/s);restitution\n1;10;0,95\n1;200;0,85\n")
    assert points_in(tmp_path / "ball.csv") == ((0.1, 0.95), (2.0, 0.85))


def test_a_run_goes_on_and_is_proved_without_its_table(tmp_path):
    table, sweep, out = (tmp_path / name for name in ("ball.csv", "sweep.toml", "out.h5"))
    table.write_text(TABLE)
    sweep.write_text(
        'title = "A ball"\n[scene]\nduration = 4.0\nrestitution_law = "points"\n'
        'restitution_points = "ball.csv"\n[sample]\ndesign = "grid"\namplitude = [0.5, 1.2, 2.0]\n'
        "[record]\namplitude = 1.2\n"
    )

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(read_spec(sweep), out, threads=1, chunk=1, advance=stop)
    spec = read_spec(sweep)
    table.unlink()
    assert parse_spec(spec.text).scene == spec.scene
    with vs.run(sweep, out) as found:
        assert tomllib.loads(found.sweep_file)["scene"]["restitution_points"] == PAIRS
        again = vs.simulate(found.isel(amplitude=1))
        assert again.impact_count.item() == found.impact_count.isel(amplitude=1).item()
    assert vs.verify(out).passed
    sweep.write_text(sweep.read_text().replace("2.0]", "2.5]"))
    with pytest.raises(SpecError, match="there is no such file"):
        vs.run(sweep, out)


def test_a_recorded_scene_may_have_another_law():
    sweep = {"amplitude": [0.5, 1.2], "duration": 2.0}
    plain = keyword_spec({**sweep, **POINTS, "record": {"amplitude": 1.0}})
    assert plain.record.restitution_law == plain.scene.restitution_law
    assert plain.record.inputs["restitution"] == 0.95
    constant = {"amplitude": 1.0, "restitution_law": "constant", "restitution": 0.8}
    other = keyword_spec({**sweep, **POINTS, "record": constant}).record
    assert (other.restitution_law, other.inputs["restitution"]) == ("constant", 0.8)
    assert "restitution_speed" not in other.inputs
    given = keyword_spec({**sweep, "restitution": 0.5, "record": {"amplitude": 1.0, **POINTS}})
    assert given.record.inputs["restitution"] == 0.95
    given = keyword_spec({**sweep, **POWER, "record": {"amplitude": 1.0, "restitution": 0.7}})
    assert given.record.restitution_law == "power(0.2)"
    for wrong, message in (({"restitution": 0.8}, "follows from"), ({"x": 0}, "x = 0: is not")):
        with pytest.raises(SpecError, match=message):
            keyword_spec({**sweep, **POINTS, "record": {"amplitude": 1.0, **wrong}})


def test_relative_noise_is_noise_in_units_of_the_restitution():
    scene = {"restitution": [0.5, 0.8], "amplitude": 1.3, "duration": 20.0}
    absolute = vs.sweep(
        design={"restitution": [0.5, 0.8], "restitution_noise": [0.01, 0.016]},
        amplitude=1.3,
        duration=20.0,
    )
    relative = vs.sweep(**scene, restitution_noise_relative=0.02)
    assert relative.restitution_noise_relative == 0.02
    for name in ("impact_count", "rebound_height_max", "rebound_height_mean"):
        np.testing.assert_array_equal(relative[name], absolute[name])


def test_relative_noise_is_proved(tmp_path):
    for base, mount in (
        ("high-bounce", {}),
        ("sprung", {"mass_ratio": 0.1, "mount_frequency": 0.4, **RIGID}),
    ):
        scene = {"base": base, "amplitude": (0.5, 2.0), "realizations": 3, "duration": 6.0, **mount}
        vs.run({**scene, "restitution_noise_relative": 0.05}, tmp_path / f"{base}.h5").close()
        assert vs.verify(tmp_path / f"{base}.h5").passed


def test_particles_of_an_experiment_share_their_points():
    spread = vs.lab.Variation(restitution_spread=0.01)
    with pytest.raises(vs.errors.ParameterError, match="share the points"):
        vs.lab.Experiment(**POINTS, particles=2, variation=spread)
