"""Parameters, forcing, mounts and times."""

import inspect
import itertools
import math
import types
from fractions import Fraction
from pathlib import Path

import numba
import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import example, given
from hypothesis import strategies as st

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.impact import KIND_OF
from vibrosweep.kernels.restitution import REBOUND_OF
from vibrosweep.model.forcing import (
    ANSWERS,
    FORCINGS,
    INPUTS,
    completed,
    differing,
    forcing_of,
    inputs_of,
    only_parameters,
    refuse_extreme,
)
from vibrosweep.model.functions import changes_its_arguments, parts
from vibrosweep.model.parameters import (
    BASES,
    HIGH_BOUNCE,
    LAWS,
    LAWS_OF,
    MASSES,
    MAX_PERIODS,
    MOUNT,
    MOVING,
    NOISE,
    OF_MOUNT,
    OF_RESTITUTION,
    PARAMETERS,
    SMALLEST,
    STAGGERED,
    Periods,
    dimensionless,
    in_periods,
    in_seconds,
    launches,
    mount_mistakes,
    mounts,
    precedes,
    reduced_turns,
    representable,
)
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.sweep import parse_spec

# Physical parameters, and the change to dimensionless form against exact arithmetic.


def turns_off(count, phase, exact):
    """Distance in turns between the sum of count and phase and the exact value."""
    return abs(Fraction(float(count)) + Fraction(float(phase)) - exact)


@given(phi=st.floats(-1e9, 1e9, allow_subnormal=False))
@example(phi=math.pi)
@example(phi=-math.pi)
@example(phi=1e9)
@example(phi=5e8 * math.pi)
def test_phase_in_turns_is_that_of_the_exact_radians(phi, parameters):
    turns = dimensionless(parameters(phase=phi), 12.0).phase[0]
    with ctx.workprec(200):
        exact = arb(phi) / (2 * arb.pi())
        off = abs(exact - arb(turns) - round(float(exact) - turns))
        # the last sum is below 1 and rounded, as is the reduced quotient
        assert off < 2.0**-53
    assert -0.5 <= turns <= 0.5


def test_table_1_in_dimensionless_form(parameters):
    problem = dimensionless(parameters(amplitude=1.2), 12.0)
    assert problem.kick[0] == pytest.approx(0.244648, abs=5e-7)
    assert problem.launch_flight[0] == pytest.approx(1.019368, abs=5e-7)
    assert problem.rest_flight[0] == 1e-4
    assert (problem.end_count[0], problem.end_phase[0]) == (12.0, 0.0)
    assert (problem.begin_count[0], problem.begin_phase[0]) == (0.0, 0.0)


def test_the_arrays_of_kernels_have_one_layout(parameters):
    """Kernels are compiled for each layout that they meet, which takes seconds."""
    given = parameters()
    columns = np.stack([np.repeat(values, 3) for values in given.values()], axis=1)
    strided = dict(zip(given, columns.T, strict=True))
    repeated = {name: np.broadcast_to(values[0], 3) for name, values in given.items()}
    for passed in (strided, repeated):
        problem = dimensionless(passed, Periods(2.0), 0.5)
        assert problem.noise is None
        for values in problem._replace(noise=problem.kick):
            assert values.shape == (3,)
            assert values.flags.c_contiguous
            assert values.flags.writeable


def test_dimensionless_form_is_that_of_exact_arithmetic(random_scenes):
    scenes = random_scenes(seed=1, size=300)
    problem = dimensionless(scenes, 12.0, transient=3.0)
    for i in range(300):
        p = {name: Fraction(float(values[i])) for name, values in scenes.items()}
        unit = 2 * p["frequency"] / p["gravity"]
        for found, exact, roundings in (
            (problem.kick[i], unit * p["amplitude"], 2),
            (problem.launch_flight[i], unit * p["launch_velocity"], 2),
            (problem.rest_flight[i], p["frequency"] * p["contact_time"], 1),
        ):
            assert abs(Fraction(float(found)) - exact) <= exact * roundings * Fraction(1, 2**52) / 2
        shared = Fraction(float(problem.phase[i]))
        for seconds, count, phase in (
            (3, problem.begin_count[i], problem.begin_phase[i]),
            (12, problem.end_count[i], problem.end_phase[i]),
        ):
            assert turns_off(count, phase, p["frequency"] * seconds + shared) <= Fraction(3, 2**54)
    assert np.array_equal(problem.restitution, scenes["restitution"])


def test_a_resting_particle_lifts_off_where_the_kick_rises_through_the_contact_time(random_scenes):
    problem = dimensionless(random_scenes(seed=2, size=300), 12.0)
    lifts = problem.kick > problem.rest_flight
    assert 0 < lifts.sum() < lifts.size
    x, a, r = problem.liftoff_phase[lifts], problem.kick[lifts], problem.rest_flight[lifts]
    assert np.all((x >= 0.0) & (x <= 0.25))
    assert np.all(np.abs(a * np.sin(2.0 * np.pi * x) - r) <= 1e-15 * a)
    assert np.all(problem.liftoff_phase[~lifts] == 0.0)


def test_an_endless_window_begins_before_every_landing(parameters):
    problem = dimensionless(parameters(), 12.0, transient=-math.inf)
    assert problem.begin_count[0] == -math.inf


@each_of("particles", [1, 2, 3, 7, 20])
def test_staggered_launches_share_one_period_evenly(particles):
    count, phase = launches(STAGGERED, particles, np.array([0.3, 7.0]))
    assert count.shape == phase.shape == (1, particles)
    exact = [Fraction(j, particles) for j in range(particles)]
    for j in range(particles):
        assert turns_off(count[0, j], phase[0, j], exact[j]) <= Fraction(1, 2**53)


def test_listed_launches_at_one_frequency_are_kept_once():
    found = launches((0.0, 0.3, -1.25), 3, np.array([2.0, 2.0]))
    assert found.whole.shape == (1, 3)
    assert np.array_equal(found.whole[0], [0, 1, -2])
    assert np.array_equal(found.phase[0], [0.0, 0.6 - 1.0, -0.5])


def test_listed_launches_follow_the_frequency():
    times, frequency = (0.0, 0.3, -1.25, 1e6), np.array([0.7, 2.0])
    found = launches(times, 4, frequency)
    for i in range(2):
        for j in range(4):
            exact = Fraction(float(frequency[i])) * Fraction(times[j])
            assert turns_off(found.whole[i, j], found.phase[i, j], exact) <= Fraction(1, 2**53)


def test_every_default_is_allowed():
    for parameter in PARAMETERS.values():
        assert parameter.accepts(parameter.default)


@each_of("name", PARAMETERS)
def test_a_range_is_kept_and_put_into_words(name):
    parameter = PARAMETERS[name]
    below = np.nextafter(parameter.low, -math.inf)
    above = np.nextafter(parameter.high, math.inf)
    assert not parameter.accepts([math.nan, math.inf, -math.inf, below, above]).any()
    assert parameter.accepts([parameter.low, parameter.high]).all()
    assert f"at least {parameter.low:g} and at most {parameter.high:g}" in parameter.allowed
    assert parameter.units == "1" or parameter.units in parameter.allowed


def test_no_corner_of_the_ranges_leaves_double_precision(parameters):
    """Neither inputs of kernels, nor squares of flights, nor units of results."""
    ends = [(p.low, p.high) for p in PARAMETERS.values()]
    corners = dict(zip(PARAMETERS, np.array(list(itertools.product(*ends))).T, strict=True))
    with np.errstate(all="raise"):
        problem = dimensionless(parameters(**corners), 1e-9)
        flights = np.stack([problem.kick, problem.launch_flight, problem.rest_flight])
        tiny = np.finfo(float).tiny
        some = flights[flights > 0.0]
        assert np.all(some**2 > tiny)
        # at e = 1 a flight grows by a kick at each of at most MAX_PERIODS landings
        period = corners["gravity"] / (8.0 * corners["frequency"] ** 2)
        assert np.all(period > tiny)
        assert np.isfinite((flights * MAX_PERIODS) ** 2 * MAX_PERIODS * period).all()


@pytest.mark.parametrize("time", [1e16, 1e302, 1e308, -1e308])
def test_times_beyond_counting_are_refused_without_a_warning(time, parameters):
    scene = parameters(frequency=[1e9, 1.0, SMALLEST])
    assert representable(scene, [time]).tolist() == [False, False, abs(time) < 1e40]
    with pytest.raises(ParameterError, match=r"^duration = "):
        dimensionless(scene, time)
    with pytest.raises(ParameterError, match=r"^launch time = "):
        launches((0.0, time), 2, scene["frequency"])


def test_periods_that_cannot_be_counted_are_refused(parameters):
    scene = parameters(frequency=[1.0, 4.0])
    assert dimensionless(scene, MAX_PERIODS / 4.0).end_count[1] == MAX_PERIODS
    with pytest.raises(ParameterError, match=r"^duration = 1e\+15 s is 4e\+15 forcing periods"):
        dimensionless(scene, 1e15)
    with pytest.raises(ParameterError, match=r"^transient = 1e\+15 s is 4e\+15 forcing periods"):
        dimensionless(scene, 12.0, transient=1e15)
    with pytest.raises(ParameterError, match=r"^launch time = 1e\+16 s is 1e\+16 forcing periods"):
        launches((0.0, -1e16), 2, np.array([1.0]))


def test_a_mount_is_expressed_in_units_of_the_forcing(parameters):
    given = {"mass_ratio": 0.004, "mount_frequency": 3.0, "mount_damping": 0.1}
    scene = parameters(frequency=[6.0, 12.0]) | {n: np.full(2, v) for n, v in given.items()}
    found = mounts(scene, None, None)
    assert np.array_equal(found.mass_ratio, [0.004, 0.004])
    assert np.array_equal(found.natural, [0.5, 0.25])
    assert np.array_equal(found.damping, [0.1, 0.1])
    assert tuple(MOUNT) == tuple(given)


# The four ways to give the forcing are one quantity.

TABLE_1 = {name: np.array([p.default]) for name, p in PARAMETERS.items()}
OTHERS = {name: values for name, values in TABLE_1.items() if name != "amplitude"}
VALUES = st.floats(1e-3, 1e3)


def test_the_base_of_table_1():
    found = completed(TABLE_1)
    assert found["base_acceleration"].item() == pytest.approx(
        2 * math.pi * 1.2 / (1.9 * 9.81), rel=1e-15
    )
    for name, value in (("base_velocity", 1.2 / 1.9), ("base_displacement", 0.6 / 1.9 / math.pi)):
        again = completed(OTHERS | {name: np.array([value])})
        assert again["amplitude"].item() == pytest.approx(1.2, rel=1e-15)


@given(e=st.floats(0.0, 1.0), f=VALUES, g=VALUES, v=VALUES)
def test_all_ways_lead_to_one_amplitude(e, f, g, v):
    omega = 2.0 * math.pi * f
    ways = {
        "amplitude": (1.0 + e) * v,
        "base_velocity": v,
        "base_displacement": v / omega,
        "base_acceleration": omega * v / g,
    }
    assert ways.keys() == FORCINGS.keys()
    own = OTHERS | {
        n: np.array([x])
        for n, x in zip(("restitution", "frequency", "gravity"), (e, f, g), strict=True)
    }
    for name, value in ways.items():
        found = completed(own | {name: np.array([value])})
        assert found[name].item() == value  # to the bit
        assert found["amplitude"].item() == pytest.approx(ways["amplitude"], rel=1e-15)
        assert found["base_acceleration"].item() == pytest.approx(
            ways["base_acceleration"], rel=2e-15
        )
        assert [*found] == [n for n in INPUTS if n in found]


@each_of("forcing", FORCINGS)
@each_of("varied", [name for name in INPUTS if name not in OF_MOUNT])
def test_only_quantities_that_follow_from_the_varied_input_differ(forcing, varied):
    if varied in FORCINGS and varied != forcing:
        return
    own = OTHERS | dict.fromkeys((*OF_RESTITUTION, *NOISE), np.array([0.4]))
    own |= {forcing: np.array([0.7])}
    one, other = completed(own), completed(own | {varied: np.array([0.5])})
    changed = {name for name in one if one[name] != other[name]}
    assert changed == {*differing([varied], forcing)}


@each_of("first", FORCINGS)
@each_of("second", FORCINGS)
def test_two_forcings_are_refused(first, second):
    if first == second:
        assert forcing_of(["phase", first]) == first
        return
    with pytest.raises(ParameterError) as caught:
        forcing_of([first, second])
    assert first in str(caught.value)
    assert second in str(caught.value)


def test_the_default_forcing_is_the_amplitude():
    assert forcing_of(["restitution"]) == "amplitude"


@pytest.mark.parametrize("forcing", FORCINGS)
def test_no_extreme_overflows_and_too_large_amplitudes_are_refused(forcing):
    ends = {n: (INPUTS[n].low, INPUTS[n].high) for n in (*PARAMETERS, forcing)}
    for which in np.ndindex(*(2,) * 4):
        names = ("restitution", "frequency", "gravity", forcing)
        own = OTHERS | {n: np.array([ends[n][k]]) for n, k in zip(names, which, strict=True)}
        found = completed(own)
        assert all(np.isfinite(values).all() for values in found.values())
        if PARAMETERS["amplitude"].accepts(found["amplitude"]).all():
            refuse_extreme(found, forcing, "constant")
        else:
            assert forcing in ("base_displacement", "base_acceleration")
            with pytest.raises(ParameterError, match=f"{forcing}: gives an amplitude"):
                refuse_extreme(found, forcing, "constant")


def test_the_laws_of_all_bases_are_those_of_the_kernels():
    assert set(KIND_OF) < set(BASES) == set(LAWS_OF)
    assert set(LAWS) == set(REBOUND_OF)


# Parameters of a base of finite mass, and quantities that follow from them.

OWN = {"mass_ratio": 0.004, "mount_frequency": 3.0, "mount_damping": 0.1}
WEIGHED = {"particle_mass": 0.004, "base_mass": 2.0, "mount_frequency": 3.0}


def arrays(**given):
    every = {name: p.default for name, p in PARAMETERS.items()} | given
    columns = np.broadcast_arrays(*(np.atleast_1d(np.float64(value)) for value in every.values()))
    return dict(zip(every, columns, strict=True))


def test_a_ratio_of_masses_and_a_frequency_are_enough():
    for given in (OWN, WEIGHED, OWN.keys() - {"mount_damping"}):
        assert mount_mistakes("sprung", {"amplitude", *given}) == {}


@each_of("base", [HIGH_BOUNCE, MOVING])
@each_of("name", OF_MOUNT)
def test_another_base_has_no_mount(base, name):
    assert mount_mistakes(base, {"amplitude"}) == {}
    assert 'write base = "sprung"' in mount_mistakes(base, [name])[name]


@each_of(
    ("given", "about"),
    [
        ([], {"mass_ratio", "mount_frequency"}),
        (["mass_ratio"], {"mount_frequency"}),
        (["mount_frequency", "mount_damping"], {"mass_ratio"}),
        (["mount_frequency", "base_mass"], {"particle_mass"}),
        (["mount_frequency", "particle_mass"], {"base_mass"}),
        (["mount_frequency", "particle_mass", "mass_ratio"], {"particle_mass"}),
        (["mount_frequency", "particle_mass", "base_mass", "mass_ratio"], {"particle_mass"}),
    ],
)
def test_each_missing_or_superfluous_input_is_named_once(given, about):
    assert mount_mistakes("sprung", given).keys() == about


def test_inputs_are_those_of_the_base():
    common = tuple(PARAMETERS)
    for base in (HIGH_BOUNCE, MOVING):
        assert inputs_of((), base) == common
    assert inputs_of(OWN, "sprung") == (*common, *MOUNT)
    assert inputs_of(WEIGHED, "sprung") == (*common, *MASSES, "mount_frequency", "mount_damping")


def test_masses_make_a_ratio_that_the_engine_is_given():
    found = completed(arrays(**WEIGHED, mount_damping=0.05))
    assert found["mass_ratio"].item() == 0.002
    assert [*found] == [name for name in INPUTS if name in found]
    assert [*only_parameters(found)] == [*PARAMETERS, *MOUNT]
    assert [*only_parameters(completed(arrays()))] == [*PARAMETERS]


@pytest.mark.parametrize("varied", [*MASSES])
def test_the_ratio_differs_with_either_mass(varied):
    assert differing([varied], "amplitude") == (varied, "mass_ratio")
    assert differing(["mass_ratio"], "amplitude") == ("mass_ratio",)
    assert differing(["mount_damping"], "amplitude") == ("mount_damping",)


def test_masses_of_too_large_a_ratio_are_refused_and_told_apart():
    masses = {"particle_mass": [1.0, 1.0, 1e30], "base_mass": [1e-3, 9e-4, 1e-30]}
    values = completed(arrays(**{**WEIGHED, **masses}))
    assert representable(values, ()).tolist() == [True, False, False]
    with pytest.raises(ParameterError, match="particle_mass and base_mass: give a mass_ratio of"):
        refuse_extreme(values, "amplitude", "constant")
    refuse_extreme({name: v[:1] for name, v in values.items()}, "amplitude", "constant")


# Times in forcing periods end where they should, in every realization.

PERIODS = st.floats(1e-3, 1e9)


def parameters(**changed):
    own = {name: np.array([p.default]) for name, p in PARAMETERS.items()}
    return own | {name: np.array([value]) for name, value in changed.items()}


@given(number=PERIODS, begin=PERIODS, phase=st.floats(-9.0, 9.0))
def test_at_one_hertz_periods_are_seconds_to_the_bit(number, begin, phase):
    own = parameters(phase=phase)
    one, other = (
        dimensionless(own, number, begin),
        dimensionless(own, Periods(number), Periods(begin)),
    )
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@given(number=PERIODS, frequency=st.floats(1e-3, 1e4))
def test_the_end_is_that_many_periods_at_any_frequency(number, frequency):
    found = dimensionless(parameters(frequency=frequency), Periods(number))
    assert Fraction(found.end_count.item()) + Fraction(found.end_phase.item()) == Fraction(number)


@given(number=PERIODS, frequency=st.floats(1e-3, 1e4))
def test_periods_and_seconds_are_one_time(number, frequency):
    f = np.array([frequency])
    seconds = in_seconds(Periods(number), f).item()
    assert in_periods(seconds, f).item() == pytest.approx(number, rel=1e-15)
    assert precedes(Periods(number), 1.001 * seconds, f)
    assert not precedes(1.001 * seconds, Periods(number), f)


def test_periods_are_counted_whatever_the_frequency():
    own = {n: np.repeat(v, 2) for n, v in parameters().items()} | {
        "frequency": np.array([1e-9, 1e9])
    }
    assert representable(own, [1e3, Periods(MAX_PERIODS)]).tolist() == [True, True]
    assert representable(own, [1e7, Periods(MAX_PERIODS)]).tolist() == [True, False]
    assert representable(own, [1e3, Periods(2.0 * MAX_PERIODS)]).tolist() == [False, False]


def test_an_amplitude_that_is_too_large_is_not_representable():
    assert not representable(parameters(amplitude=1e31), [1.0]).any()


# Turns of an angle that grows with time, against exact arithmetic.


@given(
    rate=st.floats(1e-3, 1e3),
    time=st.floats(-1e12, 1e12, allow_subnormal=False),
    offset=st.floats(-0.5, 0.5, allow_subnormal=False),
)
@example(rate=0.1, time=1e9 / 0.1, offset=0.0)
@example(rate=1.0, time=1e9, offset=-0.5)
@example(rate=3.0, time=2.5, offset=0.5)
def test_reduced_turns_keep_the_phase_of_any_time(rate, time, offset):
    count, phase = reduced_turns(rate, time, offset)
    exact = Fraction(rate) * Fraction(time) + Fraction(offset)
    assert float(count).is_integer()
    assert -0.5 <= phase <= 0.5
    # two sums below 1 are rounded: the error of the product itself is carried along
    assert turns_off(count, phase, exact) <= Fraction(3, 2**54)


@given(
    time=st.integers(-(2**60), 2**60).map(lambda n: n / 2**20),
    exponent=st.integers(-8, 8),
)
def test_reduced_turns_of_dyadic_numbers_are_exact(time, exponent):
    rate = 2.0**exponent
    count, phase = reduced_turns(rate, time, 0.0)
    assert turns_off(count, phase, Fraction(rate) * Fraction(time)) == 0


def test_reduced_turns_broadcast():
    count, phase = reduced_turns(np.array([[1.0], [2.0]]), np.array([0.25, 1.0, -1.75]), 0.0)
    assert np.array_equal(count, [[0, 1, -2], [0, 2, -4]])
    assert np.array_equal(phase, [[0.25, 0, 0.25], [0.5, 0, 0.5]])


# Words for effects that are not modelled or have another key get an answer, not a list of keys.

PAGE = Path(__file__).parents[2] / "docs" / "limits.md"


def test_no_word_with_an_answer_is_a_key():
    assert ANSWERS.keys().isdisjoint(
        {*SECTIONS, *(key for keys in SECTIONS.values() for key in keys)}
    )


@each_of(
    ("word", "answer"),
    [
        ("noise", "restitution_noise, kick_noise or drive_noise"),
        ("sigma", "restitution_noise, kick_noise or drive_noise"),
        ("law", "rebound sets what"),
        ("drag", "air has no drag"),
        ("tilt", "nothing is tilted"),
        ("spin", "do not rotate"),
        ("forcing2", "waveform"),
        ("ramp", "frequency and forcing are constant"),
    ],
)
def test_an_answer_in_a_file_and_in_python(word, answer):
    with pytest.raises(vs.errors.SpecError) as in_file:
        parse_spec(f'title = "x"\n[scene]\n{word} = 0.1\n')
    for call in (vs.sweep, vs.simulate):
        with pytest.raises(vs.errors.SpecError) as in_python:
            call(**{word: 0.1})
        for told in (str(in_file.value), str(in_python.value)):
            assert answer in told
            assert "Known" not in told


@pytest.mark.parametrize(
    ("word", "key"), [("acceleration", "base_acceleration"), ("f", "frequency"), ("A", "amplitude")]
)
def test_another_name_of_a_key_is_guessed(word, key):
    asked = rf'did you mean "{key}"\?$'  # and no list of keys
    with pytest.raises(vs.errors.SpecError, match=asked):
        parse_spec(f'title = "x"\n[scene]\n{word} = 0.1\n')
    with pytest.raises(vs.errors.SpecError, match=asked):
        vs.sweep(**{word: 0.1})


def test_a_keyword_of_another_function_says_so():
    with pytest.raises(vs.errors.SpecError, match=r"vibrosweep\.windows$"):
        vs.sweep(kick_noise=0.1, noise_replicas=3)
    with pytest.raises(vs.errors.SpecError, match=r"vibrosweep\.sweep$"):
        vs.simulate(restitution=0.9, realizations=3)


def test_the_page_names_what_is_not_modelled():
    page = PAGE.read_text("utf-8")
    for word in ("drag", "friction", "rotation", "tilt", "walls", "air", "ramps"):
        assert word in page


# Closed forms refuse physically impossible arguments.

IMPOSSIBLE = {
    "restitution": (-0.1, 1.1),
    "frequency": (0.0, -1.0),
    "gravity": (0.0, -9.81),
    "contact_time": (0.0,),
    "k": (0, -1),
    "turns": (),
}
FUNCTIONS = {n: f for n, f in vars(vs.theory).items() if n in vs.theory.__all__ and callable(f)}


def possible(function):
    values = {"restitution": 0.9, "acceleration": 2.0, "contact_time": 1e-4}
    chosen = ("base", "law", "waveform")  # by their names
    names = [n for n in inspect.signature(function).parameters if n not in chosen]
    return {name: values.get(name, 1.0) for name in names}


@each_of("name", FUNCTIONS)
def test_every_argument_has_its_range(name):
    given = possible(FUNCTIONS[name])
    FUNCTIONS[name](**given)
    for argument in given:
        for value in (*IMPOSSIBLE.get(argument, (-1.0,)), np.nan, np.inf):
            with pytest.raises(vs.errors.ParameterError, match=f"^{argument} = .*: must be at"):
                FUNCTIONS[name](**{**given, argument: value})


def test_the_first_value_outside_is_named():
    with pytest.raises(vs.errors.ParameterError, match=r"restitution = 1\.5:"):
        vs.theory.amplitude_min(1, [0.5, 1.5, np.nan])


@each_of("name", FUNCTIONS)
def test_the_error_of_a_wrong_call_names_the_function(name):
    with pytest.raises(TypeError, match=rf"^{name}\(\) got .*'colour'"):
        FUNCTIONS[name](**possible(FUNCTIONS[name]), colour=1)


# Fingerprints of functions, and the values that they may take from outside.

CALLS = "def f(t, x): t[0] += g()"
USES = "def f(t, x): t[0] += K"


def defined(text, **outside):
    """Define the function f of this text in a module with these globals."""
    names = dict(outside)
    exec(text, names)
    return names["f"]


def identified(function):
    return tuple(parts(function, "here"))


@each_of(
    ("before", "after"),
    [
        (USES, "def f(t, x): t[0] -= K"),
        ("def f(t, x): t[0] += 1.0", "def f(t, x): t[0] += 2.0"),
        ("def f(t, x): t[0] += x.phase", "def f(t, x): t[0] += x.arrival"),
        ("def f(t, x=1): pass", "def f(t, x=2): pass"),
        (f"def g(*, k=1): return k\n{CALLS}", f"def g(*, k=2): return k\n{CALLS}"),
        (f"def g(): return 1.0\n{CALLS}", f"def g(): return 2.0\n{CALLS}"),
        ("def f(t, x): t[:] = [i for i in t]", "def f(t, x): t[:] = [-i for i in t]"),
    ],
)
def test_a_function_that_does_something_else_has_another_fingerprint(before, after):
    texts = (before, f"# again\n\n{before}", after)
    first, same, other = (identified(defined(text, K=1.0)) for text in texts)
    assert first == same
    assert first != other


def test_values_from_outside_enter_the_fingerprint():
    values = (1, 1.0, 2.0, (1, 2), "a", math, np.float64(1), math.sin, np.sin, np.clip, float)
    values += (np.float32(1), np.int64(1), (1.0,), (np.float64(1),), ((np.float32(1),), 2))
    assert len({identified(defined(USES, K=k)) for k in values}) == len(values)

    def enclosed(k):
        def f(totals, landing):
            totals[0] += k

        return f

    assert identified(enclosed(1.0)) == identified(enclosed(1.0)) != identified(enclosed(2.0))


def test_functions_that_call_each_other_have_a_fingerprint():
    def pair(k):
        def even(n):
            return n == 0 or odd(n - 1)

        def odd(n):
            return n != 0 and even(n - k)

        return even

    assert identified(pair(1)) == identified(pair(1)) != identified(pair(2))
    assert identified(defined(CALLS, g=pair(1))) == identified(
        defined(CALLS, g=numba.njit(pair(1)))
    )


@each_of("value", [[1.0], np.ones(2), {"a": 1}, object(), (1.0, [2.0])])
def test_values_that_could_change_unnoticed_are_refused(value):
    with pytest.raises(ParameterError, match=r"here: .* uses K, of type "):
        identified(defined(USES, K=value))


def test_a_module_of_the_user_is_refused():
    with pytest.raises(ParameterError, match=r"uses K, of type module, .* settings import"):
        identified(defined(USES, K=types.ModuleType("settings")))


@pytest.mark.parametrize("expression", ["K.random.rand()", "K.random.default_rng().random()"])
def test_random_numbers_are_refused(expression):
    with pytest.raises(ParameterError, match="draws random numbers"):
        identified(defined(f"def f(t, x): t[0] += {expression}", K=np))
    for drawing in (np.random, np.random.rand, np.random.default_rng):
        with pytest.raises(ParameterError, match="uses K"):
            identified(defined("def f(t, x): t[0] += K()", K=drawing))


@each_of(
    ("body", "changes"),
    [
        ("t[0] = 1.0", True),
        ("t[:] = 1.0", True),
        ("t += 1.0", True),
        ("t.fill(1.0)", True),
        ("t = t + 1.0", False),
        ("return t[0]", False),
    ],
)
def test_whether_a_function_can_change_anything(body, changes):
    assert changes_its_arguments(defined(f"def f(t, x): {body}")) == changes
