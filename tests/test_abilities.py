"""Every cell of the table of abilities is either refused with its sentence, or accepted."""

from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

import vibrosweep as vs
from docs.page_tables import choices
from tests.cases import each_of
from tests.scenes import KINDS_OF_NOISE
from together import LAWFUL, combinations, together
from vibrosweep.abilities import (
    ANALYSES,
    BASES,
    OF_CONSTANT,
    WITHOUT_MEANING,
    refusal,
)
from vibrosweep.errors import SpecError, VibrosweepError
from vibrosweep.explorer.points import open_points
from vibrosweep.kernels.restitution import REBOUND_OF
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.parameters import LAWS, LAWS_OF
from vibrosweep.model.restitution_laws import RESTITUTION_LAWS
from vibrosweep.model.shapes import WAVEFORMS
from vibrosweep.proof.verifying import verify
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import keyword_spec

CELLS = list(product(BASES, choices()))
MOUNT = {"mass_ratio": 0.1, "mount_frequency": 2.0}
AXES = {"amplitude": [1.0, 1.1], "restitution": 0.5, "duration": 3.0}
SHAPES = {name: name for name in WAVEFORMS} | {"harmonics": {"harmonics": [[1, 1.0, 0.0]]}}


def add_speed(totals, landing):
    totals[0] += landing.speed


def keys_of(asked):
    """Keywords that ask for a law, a waveform or a measure."""
    ((kind, name),) = asked.items()
    if kind == "restitution":
        return LAWFUL[name]
    if kind in ("measure", "noise"):
        return {name: True} if kind == "measure" else dict.fromkeys(name, 0.1)
    return {"rebound": name} if kind == "law" else {"waveform": SHAPES[name]}


def over(base, **keywords):
    return {"base": base, **(MOUNT if base == "sprung" else {}), **keywords}


def perform(base, analysis, **others):
    """Ask for an analysis with as little input as it takes."""
    if analysis == "orbits":
        return vs.orbits(over(base, **others), impacts=1, periods=1)
    if analysis in ("verify", "explore"):
        return look(base, analysis, **others)
    if analysis == "branches":
        return vs.branches(over(base, amplitude=[1.0, 1.1], **others))
    if analysis == "boundaries":
        return vs.boundaries(over(base, amplitude=[1.0, 1.1], restitution=[0.5, 0.6], **others))
    if analysis == "basins":
        return vs.basins(over(base, launch_velocity=[3.0], duration=3.0, **others))
    if analysis == "sobol":
        ranged = over(base, amplitude=(0.2, 3.5), realizations=4, **others)
        return vs.sobol(ranged) if others else keyword_spec(ranged)
    if analysis == "record":
        return keyword_spec(over(base, record={}, **others))
    if analysis == "observables":
        seen = vs.Observable("seen", add_speed, "sum of speeds")
        return keyword_spec(over(base, **others)).with_observables([seen])
    if analysis == "separations":
        return keyword_spec(over(base, separation=True, **others))
    if analysis in ("windows", "bifurcation"):
        return getattr(vs, analysis)(over(base, **AXES, **others))
    if analysis == "laboratory":
        return vs.lab.Experiment(**over(base, **others))
    variation = vs.lab.Variation(**{analysis: 0.1})
    mount = MOUNT if base == "sprung" else {}
    return vs.lab.Experiment(**mount, base=base, variation=variation, **others)


def look(base, analysis, **others):
    """Verify or explore the result of a small sweep."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "result.h5"
        vs.run(
            over(base, realizations=2, amplitude=(1.0, 2.0), duration=1.0, **others), path
        ).close()
        return verify(path) if analysis == "verify" else open_points(path)


@each_of(("base", "asked"), [c for c in CELLS if refusal(c[0], **c[1])])
def test_what_a_base_cannot_do_is_refused_with_its_sentence(base, asked):
    sentence = refusal(base, **asked)
    if "analysis" in asked:
        with pytest.raises(VibrosweepError) as caught:
            perform(base, asked["analysis"])
        assert str(caught.value).endswith(sentence)
        return
    with pytest.raises(SpecError) as listed:
        keyword_spec(over(base, **keys_of(asked)))
    assert sentence in [mistake.rule for mistake in listed.value.mistakes]


@each_of(("base", "asked"), [c for c in CELLS if not refusal(c[0], **c[1])])
def test_what_a_base_can_do_is_not_refused(base, asked):
    if asked.get("analysis") in (
        "windows",
        "bifurcation",
        "basins",
        "orbits",
        "branches",
        "boundaries",
    ):
        return  # their own tests compute them
    if "analysis" in asked:
        perform(base, asked["analysis"])
    else:
        assert keyword_spec(over(base, **keys_of(asked))).scene.base == base


NOISE = dict.fromkeys(KINDS_OF_NOISE, 0.1)


@each_of("analysis", ANALYSES)
def test_an_analysis_of_a_scene_with_noise_is_computed_or_refused(analysis):
    sentence = refusal("high-bounce", analysis=analysis, noise=NOISE)
    if not sentence:
        perform("high-bounce", analysis, **NOISE)
        return
    with pytest.raises(VibrosweepError) as caught:
        perform("high-bounce", analysis, **NOISE)
    assert str(caught.value).endswith(sentence)


@each_of("measure", [m for m in MEASURES if not MEASURES[m].coupled])
def test_a_measure_of_a_scene_with_noise_is_taken_or_refused(measure):
    sentence = refusal("high-bounce", measure=measure, noise=NOISE)
    if not sentence:
        keyword_spec({**NOISE, measure: True})
        return
    with pytest.raises(SpecError) as listed:
        keyword_spec({**NOISE, measure: True})
    assert sentence in [mistake.rule for mistake in listed.value.mistakes]


@pytest.mark.parametrize("analysis", OF_CONSTANT)
def test_analyses_for_constant_restitution_refuse_other_laws_with_their_sentence(analysis):
    with pytest.raises(VibrosweepError) as caught:
        perform("high-bounce", analysis, **LAWFUL["plastic"])
    sentence = refusal("high-bounce", analysis=analysis, restitution="plastic")
    assert str(caught.value).endswith(sentence)


@pytest.mark.parametrize("base", BASES)
def test_a_law_that_somebody_adds_is_refused_where_no_base_implements_it(base, monkeypatch):
    monkeypatch.setitem(REBOUND_OF, "softening", REBOUND_OF["rest"])
    assert "softening" not in LAWS_OF[base]
    assert 'rebound = "softening" is not implemented' in refusal(base, law="softening")
    with pytest.raises(vs.errors.ParameterError, match="softening"):
        Scene(base=base, rebound="softening")


@each_of("analysis", WITHOUT_MEANING)
def test_a_keyword_without_a_meaning_is_refused(analysis):
    given = dict.fromkeys(WITHOUT_MEANING[analysis], True)
    with pytest.raises(SpecError) as listed:
        getattr(vs, analysis)(amplitude=1.0, **given)
    told = {mistake.key for mistake in listed.value.mistakes}
    assert {key.rpartition(".")[2] for key in told} == given.keys()


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"restitution": [0.8, 0.9], "seed": 1}, "sample.seed"),
        ({"design": {"restitution": [0.8, 0.9]}, "seed": 1}, "sample.seed"),
        ({"noise_seed": 1}, "scene.noise_seed"),
        ({"tolerance": 1e-6}, "measure.tolerance"),
    ],
)
def test_a_key_that_needs_another_one_is_refused_without_it(given, key):
    with pytest.raises(SpecError) as listed:
        keyword_spec(given)
    assert [mistake.key for mistake in listed.value.mistakes] == [key]
    old = keyword_spec(
        {"sample": {"design": "grid", "restitution": [0.8, 0.9], "seed": 1}}
    )  # as results store it
    assert old.design.seed == 1


def test_every_analysis_can_be_had_over_some_base():
    assert all(set(ability.bases) <= set(BASES) and ability.bases for ability in ANALYSES.values())


def test_the_campaign_computes_every_base_law_and_waveform_with_noise_and_without():
    """`checks/together.py` compiles them all, which takes long."""
    for noisy in (False, True):
        found = [of for of, with_noise in combinations() if with_noise == noisy]
        bases, laws, kept, shapes = map(set, zip(*map(dict.values, found), strict=True))
        assert bases == set(BASES)
        assert laws == set(LAWS)
        assert kept == set(RESTITUTION_LAWS)
        assert shapes == set(WAVEFORMS)


def test_all_that_can_be_had_together_is_computed_and_proved(tmp_path):
    """One scene holds every pair of measures that its base allows."""
    names = ("high-bounce", "rest", "constant", "sine")
    of = dict(zip(("base", "rebound", "restitution_law", "waveform"), names, strict=True))
    assert (of, False) in list(combinations())
    assert together(tmp_path / "out.h5", of, noisy=False) == []
