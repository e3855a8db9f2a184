"""Observables in `verify`: combinations, estimates, and functions other than those of the file."""

import math

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.proof.measures import Rounded
from vibrosweep.proof.reference.arithmetic import arb

SPRUNG = {"mass_ratio": 0.05, "mount_frequency": 4.0, "mount_damping": 0.1, "duration": 4.0}
BASES = {"high-bounce": {}, "moving": {}, "sprung": SPRUNG}
SWEEP = {
    "restitution": [0.6, 0.8],
    "amplitude": [1.2, 3.0],
    "duration": 6.0,
    "transient": 2.0,
    "particles": 3,
}


def lost(landing):
    return landing.arrival**2 - landing.rebound * landing.rebound


def root(landing):
    return math.sqrt(landing.arrival)


def late(landing):
    return 1.0 if landing.phase > 0.1 else 0.0


def arrival(landing):
    return landing.arrival


def rests(landing):
    return landing.rests


OBSERVABLES = [
    vs.Observable("lost", lost, "sum of squares lost", "m2 s-2", landings="sum"),
    vs.Observable("root", root, "least root", landings="min"),
    vs.Observable("late", late, "late landings", landings="sum", particles="max"),
    vs.Observable("fastest", arrival, "fastest arrival", "m s-1", landings="max", particles="each"),
    vs.Observable("rests_seen", rests, "rests", landings="sum"),
]


def computed(path, observables, **more):
    vs.run(SWEEP | more, path, observables=observables).close()
    return path


@pytest.mark.parametrize("base", BASES)
def test_every_field_and_combination_over_every_base(base, tmp_path):
    path = computed(tmp_path / "out.h5", OBSERVABLES, base=base, **BASES[base])
    report = vs.verify(path, observables=OBSERVABLES)
    assert report.passed
    compared = report.variables()
    for one in OBSERVABLES:
        assert len(compared[one.name].errors) == (12 if one.particles == "each" else 4)
        assert max(compared[one.name].claims) < 1e-3
    assert [*report.estimated] == ["root"]


def test_some_observables_can_be_left_out(tmp_path):
    path = computed(tmp_path / "out.h5", OBSERVABLES)
    report = vs.verify(path, observables=OBSERVABLES[:1])
    assert report.passed
    assert {*report.not_compared()} == {one.name for one in OBSERVABLES[1:]}


def test_no_landing_has_no_maximum_and_a_sum_of_zero(tmp_path):
    path = computed(tmp_path / "out.h5", OBSERVABLES, duration=0.5, transient=0.0)
    with vs.open_sweep(path) as found:
        assert np.isnan(found.root).all()
        assert (found.lost == 0.0).all()
    assert vs.verify(path, observables=OBSERVABLES).passed


def test_another_function_than_that_of_the_file_is_refused(tmp_path):
    path = computed(tmp_path / "out.h5", OBSERVABLES[3:])
    other = vs.Observable("fastest", root, "root", "m s-1", landings="max", particles="each")
    for wrong in (other, OBSERVABLES[0]):
        with pytest.raises(vs.errors.DataError, match=wrong.name):
            vs.verify(path, observables=[wrong])


def test_a_function_that_changes_totals_is_refused(tmp_path):
    def count(totals, landing):
        totals[0] += landing.rests

    one = vs.Observable("counted", count, "rests")
    path = computed(tmp_path / "out.h5", [one])
    assert "counted" in vs.verify(path).not_compared()
    with pytest.raises(vs.errors.ParameterError, match="counted"):
        vs.verify(path, observables=[one])


def test_a_ball_contains_the_result_in_doubles():
    def formula(a, b, c):
        return (a * b - c) ** 3 / (1.5 + abs(b)) - 2 * a / c + max(a, b, 0.1) - (-c if a < b else c)

    for numbers in np.random.default_rng(0).uniform(-1.0, 1.0, (1000, 3)):
        found = formula(*(Rounded(arb(x)) for x in numbers.tolist()))
        assert found.ball.contains(arb(formula(*numbers.tolist())))
        assert found.ball.rad() < 1e-9
