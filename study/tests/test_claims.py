"""Every claim is computed: known numbers, verdicts that follow the physics, and their page."""

import html
import math
import re

import numpy as np
import pytest
import xarray as xr

from study import (
    claims_on_attraction,
    claims_on_chance,
    claims_on_heights,
    claims_on_laboratory,
    claims_on_order,
    claims_on_scheme,
    claims_on_transients,
    claims_on_windows,
    claims_page,
    collect,
    slots,
)
from study.bases import FIXED, HIGH_BOUNCE, MOVING, SPRUNG
from study.claims_page import in_words
from study.disturbances import DRIVE, LAW, OWN, WAVEFORM, disturbances, orbit, refusal
from study.report import as_json
from study.samples import ANY_PHASE, FIRST, MOUNT, Plan
from study.tests.test_claims_page import Reader
from study.verdict import ANY_BASE, Claim, Verdict
from vibrosweep import simulate, theory


def evidence(outcome, base=HIGH_BOUNCE):
    return next(one for one in outcome.evidence if one.base == base)


def value(found, words):
    """The one number of the evidence whose description contains the words."""
    numbers = {one.what: one.value.value for one in found.numbers if words in one.what}
    assert len(numbers) == 1, numbers
    return next(iter(numbers.values()))


def reading(found, words):
    return next(one for one in (*found.readings, *found.conditions) if words in one.name)


def test_all_claims_are_there_with_their_words(claims):
    keys = [claim.key for claim in claims]
    assert keys == list(collect.TESTS) == list(collect.texts()["claims"])
    for claim in claims:
        assert claim.sentence
        assert claim.method
        assert claim.reason
        assert claim.outcome.evidence
        for one in claim.outcome.evidence:
            assert all(each.checks for each in (*one.readings, *one.conditions))


def test_the_page_is_well_formed_and_needs_nothing_else(shown):
    checker = Reader()
    checker.feed(shown)
    assert checker.open == []
    assert len(set(checker.ids)) == len(checker.ids)
    assert all(source.startswith("data:image/svg+xml;base64,") for source in checker.sources)
    assert {link.removeprefix("#") for link in checker.links} == set(checker.ids)
    assert not re.search(r"url\(|@import|<script|<link", shown)
    assert "$" not in re.sub(r'src="[^"]*"', "", shown)


def test_the_page_shows_every_verdict_reading_and_figure(claims, shown):
    table = shown.split("<tbody>")[1].split("</tbody>")[0].split("</tr>")
    for claim, row in zip(claims_page.in_order(claims), table, strict=False):
        section = shown.split(f'id="claim-{claim.key}"')[1].split("</section>")[0]
        verdicts = [one.verdict.value for one in claim.outcome.evidence]
        assert re.findall(r'class="badge \w+">([^<]*)<', row) == verdicts
        assert re.findall(r'class="badge \w+">([^<]*)<', section) == verdicts
        readings = [r for one in claim.outcome.evidence for r in (*one.readings, *one.conditions)]
        marks = [claims_page.MARKS[reading.passed][1] for reading in readings]
        assert re.findall(r'class="mark \w+">([^<]*)<', section) == marks
        assert section.count("<figure") == len(claim.outcome.pictures)


def test_every_claim_of_motion_is_asked_of_the_moving_base_too(outcomes):
    bases = {key: {one.base for one in outcome.evidence} for key, outcome in outcomes.items()}
    without = {key for key, found in bases.items() if found not in ({*FIXED}, {ANY_BASE})}
    # the study's scheme, its prediction, and a film of what it predicts
    assert without == {"12", "13", "27"}


def test_every_caption_states_the_scene(outcomes):
    """Restitution, amplitude, frequency, number of particles, base and law."""
    for outcome in outcomes.values():
        for picture in outcome.pictures:
            text = " " + picture.caption.replace("(", " ").replace(",", " ")
            for words in ((" e ", " e."), (" A ",), (" f ",), ("N = ",), (" law",)):
                assert any(one in text for one in words), (picture.name, words)
            assert any(one in text for one in ("study's equations", "base")), picture.name


@pytest.mark.parametrize("base", FIXED)
def test_a_locked_orbit_gains_at_an_impact_what_it_loses_there(base):
    """Mode 1 on the map: (1 - e) (2 v)^2 / 2 (1 + e), with v = g / 2 f; both agree on any base."""
    record = simulate(
        launch_time=float(theory.locked_phase(1, 0.9, 1.2)),
        launch_velocity=float(theory.locked_velocity(1)),
        duration=400.0,
        base=base,
    )
    record = record.assign(landing_time=record["landing_time"].where(record["landing_time"] > 300))
    injected, lost = claims_on_transients.energies(record, 0.0)[:, 0]
    assert injected == pytest.approx(lost, rel=1e-9)
    if base == HIGH_BOUNCE:
        assert lost == pytest.approx(0.1 * 2.0 * 4.905**2 / 1.9, rel=1e-9)


def test_irregular_particles_neither_repel_nor_attract_each_other():
    """The mean z is 1 within its interval, from the phases found, on a base that moves."""
    plan = Plan(threads=2, seeds=4, realizations=200)
    there = FIRST.over(amplitude=(4.0, 12.0), phase=ANY_PHASE)
    found = claims_on_chance._irregular(plan, MOVING, there, 5)
    z = claims_on_chance._mean(found, "dt_min_over_chance")
    assert z.cases > 150
    assert z.low < 1.0 < z.high


def test_particles_rest_the_later_the_shorter_the_contact_under_reflect():
    """In proportion to 1 / tau_c; under the law `rest` the contact time hardly matters."""
    times = [claims_on_windows._time_to_rest(Plan(2), "reflect", tau) for tau in (1e-4, 1e-5)]
    assert times[1] / times[0] == pytest.approx(10.0, rel=0.3)
    assert claims_on_windows._time_to_rest(Plan(2), "rest", 1e-4) < 100.0


@pytest.mark.parametrize("base", FIXED)
def test_closed_forms_are_met(outcomes, base):
    rest = theory.unforced_rest_time(5.0, 0.9, 1e-4)
    assert value(evidence(outcomes["1"], base), "time until rest at e") == float(rest)
    modulus = float(np.abs(theory.multipliers(1, 0.9, 1.2, base=base)).max())
    found = evidence(outcomes["6"], base)
    assert value(found, "decay per impact at Table 1") == pytest.approx(modulus, rel=1e-4)
    assert value(found, "judge rightly") == 1.0
    assert reading(found, "as printed").passed is False
    # a separation falls from half a period to tau_c by the modulus per impact, once a period
    closing = math.log(0.5 / 1e-4) / -math.log(modulus)
    found = evidence(outcomes["10"], base)
    assert value(found, "a slot closes") == pytest.approx(closing, rel=1e-5)
    assert reading(evidence(outcomes["5"], base), "close to the locked").passed is True
    assert reading(evidence(outcomes["7"], base), "locked on mode 1").passed is True
    assert reading(evidence(outcomes["2"], base), "over whole cycles").passed is True


def test_a_condition_states_the_heights_that_it_needs():
    condition = claims_on_order.in_own_slots(HIGH_BOUNCE, (), 20)
    assert "490 m high for N = 20" in condition.name  # g N^2 / 8 f^2
    assert "12 km for 100" in condition.name
    assert not condition.usable


def test_weak_excitation_ends_only_on_a_base_that_moves(outcomes):
    """The map lifts a particle off in every period; a table below 1 g never does."""
    for base, share in ((HIGH_BOUNCE, 0.0), (MOVING, 1.0)):
        found = reading(evidence(outcomes["15"], base), "rest for good")
        assert {one.value.value for one in found.checks} == {share}


def test_the_scheme_is_of_first_order_unless_landings_are_located(outcomes):
    found = evidence(outcomes["12"])
    assert value(found, "order of convergence") == pytest.approx(1.0, abs=0.1)
    assert reading(found, "located").checks[0].value.value < 1e-10


def test_table_1_is_not_the_laboratory(outcomes):
    """Stroke 2 A / (1 + e) / 2 pi f; the window of an eccentric motor moves as 1 / f."""
    stroke = outcomes["28"].evidence[0].readings[1].checks[0]
    assert stroke.value.value == pytest.approx(2e3 * 1.2 / 1.9 / (2.0 * math.pi))
    window = evidence(outcomes["30"]).readings[0].checks[0]
    expected = theory.amplitude_max(1, 0.9) / theory.amplitude_min(1, 0.9)
    assert window.value.value == pytest.approx(float(expected))
    assert window.bound == pytest.approx((35.0 / 8.0) ** 2)


def test_the_return_map_has_fixed_points_at_table_1(outcomes):
    for base in FIXED:
        assert evidence(outcomes["26"], base).verdict is Verdict.FAILS


def test_what_tables_2_and_3_contradict(outcomes):
    assert outcomes["22"].evidence[0].verdict is Verdict.FAILS
    least = outcomes["22"].evidence[0].readings[0].checks[0].value.value
    assert least == pytest.approx(7.7 * math.pi * 0.8**3 / 6.0)
    fifty = outcomes["21"].evidence[0].readings[0].checks[0]
    assert fifty.value.value == 3.0  # 50 balls in 24 grooves


def test_heights_hardly_depend_on_a_narrow_range(monkeypatch):
    narrow = claims_on_heights.FIRST.__class__(
        "narrow", {"restitution": (0.9, 0.901), "amplitude": (1.2, 1.2)}
    )
    monkeypatch.setattr(claims_on_heights, "settings_of", lambda base: (narrow,))
    changes = claims_on_heights._changes(
        Plan(seeds=2, realizations=40),
        HIGH_BOUNCE,
        narrow,
        claims_on_heights.MANY,
        "the first 200 s left out",
    )
    assert max(map(abs, changes)) < 1e-4  # not 0: settling, by sqrt(e) per impact, takes longer


def test_order_is_not_granted_where_a_population_cannot_be_judged(monkeypatch):
    """Two populations in order, of which the second does not land: its share is not known."""
    own = [slots.own_slots(5, HIGH_BOUNCE, Plan())] * 2
    shares = iter((0.0, math.nan))
    monkeypatch.setattr(
        claims_on_order,
        "order_of_landings",
        lambda record: xr.Dataset({"sequence_change_fraction": ("realization", [next(shares)])}),
    )
    assert claims_on_order._in_order(own, HIGH_BOUNCE)[0].passed is None


def test_a_coarse_step_fails_even_on_a_locked_orbit(monkeypatch):
    steps = (4e-2, 2e-2)
    for name, changed in (("STEPS", steps), ("SHOWN", steps), ("STEP", steps[0])):
        monkeypatch.setattr(claims_on_scheme, name, changed)
    found = claims_on_scheme.step_of_one_millisecond(Plan()).evidence[0]
    assert reading(found, "stable locked orbit").passed is False


def test_synchronous_particles_draw_apart_on_a_base_that_recoils(monkeypatch):
    found = claims_on_attraction.synchronous(Plan(seeds=2, realizations=8), SPRUNG)
    drawn_apart = [one.value.value for one in found.readings[0].checks]
    assert np.nanmin(drawn_apart) == 1.0
    gap = theory.sprung.reversing_separation(1, 0.9, 0.6, MOUNT["mass_ratio"])
    assert value(found, "two particles in one slot") == float(gap)


@pytest.mark.parametrize("base", FIXED)
@pytest.mark.parametrize(("restitution", "periods"), [(0.9, 1), (0.98, 20)])
def test_the_orbit_of_a_sine_is_the_closed_form(base, restitution, periods):
    found = orbit(base, restitution, periods, {})
    ends = (end(periods, restitution, base=base) for end in ENDS)
    assert found.amplitude == pytest.approx(float(np.mean(list(ends))), rel=1e-4)
    phase = float(theory.locked_phase(periods, restitution, found.amplitude))
    assert found.phase == pytest.approx(phase, abs=1e-9)


def test_orbits_of_other_waveforms_and_laws_lie_where_the_model_says():
    """Parabolic: from a = (1 - e) k to (1 + e) / 2; plastic: as the page of the laws says."""
    unit = float(theory.locked_velocity(1))
    found = orbit(HIGH_BOUNCE, 0.7, 1, {"waveform": "parabolic"})
    assert found.amplitude == pytest.approx(unit * 0.5 * (0.3 + 0.85), rel=1e-4)
    speed = {"restitution_law": "plastic", "restitution_speed": 0.5 * unit}
    amplitude = 1.9 * unit * 0.6 / math.pi  # Gamma = 0.6
    assert orbit(MOVING, 0.9, 1, speed, amplitude).phase == pytest.approx(0.3476165567904, abs=1e-9)


ENDS = (theory.amplitude_min, theory.amplitude_max)


def test_what_a_base_cannot_do_is_said_in_the_words_of_the_package(outcomes, shown):
    assert disturbances(0.9, 1.2, 1).keys() == {*OWN, DRIVE, WAVEFORM, LAW}
    why = refusal(MOVING, {"drive_noise": 0.05})
    assert "would jump" in why
    for key in ("31", "32", "33", "34"):
        level, moving = (evidence(outcomes[key], base) for base in FIXED)
        assert level.not_computed == ()
        assert why in moving.not_computed
        assert not any(DRIVE in one.name for one in moving.readings)
    assert f"Not computed: {html.escape(in_words(why))}" in shown


def test_which_noise_separates_particles_of_one_slot(outcomes):
    """Noise drawn for each impact does; noise of the drive pushes both particles alike."""
    found = evidence(outcomes["34"])
    assert reading(found, OWN[1]).checks[0].value.value == 1.0
    assert reading(found, DRIVE).checks[0].value.value == 0.0


def test_the_same_whatever_the_number_of_threads(claims):
    again = [
        Claim(
            **(
                vars(one)
                | {"outcome": collect.TESTS[one.key](Plan(1, seeds=3, realizations=8, bases=FIXED))}
            )
        )
        for one in claims
        if one.key in ("3", "15", "19")
    ]
    first = [one for one in claims if one.key in ("3", "15", "19")]
    assert as_json(again, {}) == as_json(first, {})


def experiment(errors, spread=0.0, seeds=20):
    """Virtual experiments of some imperfections at N = 1 and 20; errors of shape (trial, case)."""
    dims = ("seed", "trial", "procedure", "reading", "case")
    off = np.where(np.arange(seeds) % 2, spread, -spread)
    each = np.asarray(errors, np.float64)[:, np.newaxis, np.newaxis] + np.multiply.outer(
        off, np.ones((len(errors), 1, 1, 2))
    )
    trials = [f"imperfection {i}" for i in range(len(errors))]
    return xr.Dataset(
        {**{f"{q}_error": (dims, each) for q in ("height", "period")}, "compared": 1.0},
        coords={
            "imperfection": ("trial", trials),
            "size": ("trial", [1.0] * len(trials)),
            "units": ("trial", ["1"] * len(trials)),
            "procedure": ["sign_change"],
            "reading": ["worst"],
        },
    )


@pytest.mark.parametrize(
    ("study", "verdict"),
    [
        (experiment([[1.0, 7.9], [3.0, 7.0]]), Verdict.HOLDS),
        (experiment([[1.0, 7.9], [3.0, 3.0]]), Verdict.CONDITIONAL),  # below 8 %, without growth
        (experiment([[1.0, 7.9], [1.0, 9.0]]), Verdict.UNDECIDED),
        (experiment([[1.0, 9.0], [9.0, 2.0]]), Verdict.FAILS),
        (experiment([[1.0, 7.9]], spread=2.0), Verdict.UNDECIDED),
        (experiment([[1.0, 7.9]], seeds=1), Verdict.UNDECIDED),
        (experiment([[1.0, 7.9], [3.0, math.nan]]), Verdict.UNDECIDED),
    ],
)
def test_the_virtual_experiments_decide_claim_13(study, verdict):
    assert claims_on_laboratory.judged(study).verdict is verdict


def test_imperfections_with_which_table_4_is_met_are_counted():
    study = experiment([[1.0, 5.0], [1.0, 9.0], [3.0, 3.0], [1.0, math.nan]])
    met = next(n for n in claims_on_laboratory.judged(study).numbers if "is met" in n.what)
    assert (met.value.low, met.value.high) == (1.0, 2.0)
