"""Claims that follow from the bounds of a dataset, and judgements of numbers by these claims."""

import math
from dataclasses import replace
from fractions import Fraction

import pytest
from flint import arb

from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.observables import Measures
from vibrosweep.proof.claims import Bounds
from vibrosweep.proof.measures import ProvedMeasures
from vibrosweep.proof.reference.motion import EPS, Flight
from vibrosweep.proof.report import judge
from vibrosweep.proof.sampling import Realization
from vibrosweep.proof.verifying import JUDGES
from vibrosweep.scene.scene import Scene

SCENE = Realization(
    Scene(particles=2, duration=9.0, measures=Measures(transient=1.0)),
    parameters={
        "restitution": 0.9,
        "amplitude": 1.2,
        "frequency": 2.0,
        "phase": 0.0,
        "gravity": 10.0,
        "launch_velocity": 5.0,
        "contact_time": 1e-4,
    },
)
MEASURED = ProvedMeasures(
    values={
        "dt_min": arb("0.5"),
        "dt_min_same_index": None,
        "impact_speed_max": arb(4),
        "gap_min": arb("0.25"),
        "gap_median": None,
    },
    fastest=arb(4),
    flights=[Flight(arb("1.6"), arb("0.8"), arb("1.6"), None)],
    landed=[Flight(arb("1.6"), arb("0.8"), arb("1.6"), None)],
    longest=30,
    edge=arb("0.1"),
    launch_depth=Fraction(-1, 4),
    apart=arb("0.2"),
    last_period=arb("0.1"),
    overlap=arb("0.2"),
)
BOUNDS = Bounds(1e-6, 1e-5)


def test_claims_of_a_window_that_is_clear():
    found = BOUNDS.claims(SCENE, MEASURED)
    assert found["impact_count"] == found["status"] == found["base_shared"] == 0.0
    assert found["rebound_height_max"] == pytest.approx((2 * 4 * 1e-5 + 1e-10) / 20, rel=1e-6)
    assert found["flight_time_mean"] == pytest.approx(2 * 1e-5 / 10, rel=1e-6)
    assert found["dt_min"] == pytest.approx(2e-6, rel=1e-6)
    assert found["impact_speed_max"] == pytest.approx((1 + 2 * 1) * 1e-5, rel=1e-6)
    assert None not in found.values()


def test_every_variable_that_is_proved_has_a_claim():
    by_proof = JUDGES["measure"].by_proof
    proved = {v.name for v in VARIABLES.values() if JUDGES[v.judged].by_proof is by_proof}
    assert BOUNDS.claims(SCENE, MEASURED).keys() == proved


def test_claims_without_errors_are_roundings():
    found = Bounds(0.0, 0.0).claims(SCENE, MEASURED)
    assert found["rebound_height_mean"] == pytest.approx(42 * EPS * 25 / 20)
    assert found["flight_time_mean"] == pytest.approx(42 * EPS * 8 / 10)
    assert found["dt_min"] == pytest.approx(EPS * (1.0 + 1.0))


def test_nothing_is_claimed_of_a_window_whose_beginning_is_too_near_to_a_landing():
    found = BOUNDS.claims(SCENE, replace(MEASURED, edge=arb("5e-7")))
    unclaimed = {name for name, claim in found.items() if claim is None}
    assert {"impact_count", "rest_count", "dt_min", "rebound_height_max"} <= unclaimed
    assert not {"status", "at_rest_count", "base_shared"} & unclaimed


def test_landings_that_may_come_in_either_order_leave_turns_undecided():
    found = BOUNDS.claims(SCENE, replace(MEASURED, apart=arb("1e-6")))
    assert {n for n, claim in found.items() if claim is None} == {"order_changes", "gap_median"}


def test_gaps_are_undecided_where_a_landing_is_next_to_the_last_period():
    found = BOUNDS.claims(SCENE, replace(MEASURED, last_period=arb("5e-7")))
    assert {n for n, claim in found.items() if claim is None} == {"gap_min", "gap_median"}


@pytest.mark.parametrize("overlap", ["1e-6", "0", "-2e-6"])
def test_touching_stays_are_not_decided(overlap):
    found = BOUNDS.claims(SCENE, replace(MEASURED, overlap=arb(overlap)))
    assert {n for n, claim in found.items() if claim is None} == {"base_shared", "collision_free"}


@pytest.mark.parametrize("overlap", ["4e-6", "-4e-6", None])
def test_stays_farther_apart_than_their_errors_are_decided(overlap):
    near = replace(MEASURED, overlap=None if overlap is None else arb(overlap))
    assert BOUNDS.claims(SCENE, near)["base_shared"] == 0.0


def test_launch_on_the_edge_of_the_window():
    found = BOUNDS.claims(SCENE, replace(MEASURED, launch_depth=Fraction(1, 10**18)))
    assert {n for n, claim in found.items() if claim is None} == {"flight_height_max"}


def test_a_kick_that_barely_lifts_leaves_stays_undecided():
    weak = replace(SCENE, parameters=SCENE.parameters | {"amplitude": 5e-4 * (1 + 1e-15)})
    assert BOUNDS.claims(weak, MEASURED)["base_shared"] is None
    assert BOUNDS.record_claims(weak, 1.0)["liftoff_time"] == math.inf


@pytest.mark.parametrize(
    ("stored", "proved", "claim", "sound"),
    [
        (1.0, arb(1), 0.0, True),
        (1.0 + 1e-9, arb(1), 1e-8, True),
        (1.0 + 1e-9, arb(1), 1e-10, False),
        (1.0 + 1e-9, arb(1, "2e-9"), 0.0, True),  # the proof does not exclude it
        (math.nan, arb(1), 1.0, False),
        (math.inf, arb(1), 1.0, False),
        (math.nan, None, 0.0, True),
        (0.0, None, 1.0, False),
        (3.0, 3, 0.0, True),
        (4.0, 3, 0.0, False),
        (4.0, 3, None, True),
    ],
)
def test_judge(stored, proved, claim, sound):
    judgement = judge("dt_min", None, stored, proved, claim)
    assert (judgement.complaint == "") is sound


def test_digits():
    assert judge("dt_min", None, 2.0, arb(2), 2e-6).digits == pytest.approx(6.0)
    assert judge("dt_min", None, 2.0, arb(2, "1e-6"), 1e-6).digits == pytest.approx(6.0)
    assert judge("dt_min", None, 2e-9, arb("2e-9"), 1e-6).digits == 0.0
    assert judge("dt_min", None, 0.0, arb(0), 1e-6).digits is None
    assert judge("impact_count", None, 5.0, 5, 0.0).digits is None
