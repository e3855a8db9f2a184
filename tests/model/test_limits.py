"""Words for effects that are not modelled or have another key get an answer, not a list of keys."""

from pathlib import Path

import pytest

import vibrosweep as vs
from vibrosweep.model.forcing import ANSWERS
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.sweep import parse_spec

PAGE = Path(__file__).parents[2] / "docs" / "limits.md"


def test_no_word_with_an_answer_is_a_key():
    assert ANSWERS.keys().isdisjoint(
        {*SECTIONS, *(key for keys in SECTIONS.values() for key in keys)}
    )


@pytest.mark.parametrize(
    ("word", "answer"),
    [
        ("noise", "restitution_noise, kick_noise or drive_noise"),
        ("sigma", "restitution_noise, kick_noise or drive_noise"),
        ("law", "rebound says what"),
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
