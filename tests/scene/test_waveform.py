"""The key ``waveform``: its values, and mistakes in them."""

import pytest

import vibrosweep as vs
from vibrosweep.errors import SpecError
from vibrosweep.scene.sweep import keyword_spec, parse_spec

TWO = "{ harmonics = [[1, 1.0, 0.0], [2, 0.4, 1.1]] }"


def test_file_and_keywords_give_the_same_waveform():
    text = f'title = "Two tones"\n[scene]\nwaveform = {TWO}\n'
    written = parse_spec(text).scene.waveform
    spoken = keyword_spec({"waveform": {"harmonics": [[2, 0.4, 1.1], [1, 1, 0]]}})
    assert written == spoken.scene.waveform
    assert written.text == TWO
    assert parse_spec(spoken.text).scene.waveform == written


def test_results_name_the_waveform(tmp_path):
    scene = {"waveform": {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}, "duration": 2.0}
    assert vs.simulate(**scene).waveform == TWO
    with vs.run({**scene, "record": {}}, tmp_path / "two.h5") as found:
        assert found.waveform == TWO
    assert vs.sweep(duration=1.0).waveform == "sine"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("square", 'must be "sine", "parabolic", or the harmonics'),
        ({"tones": [[1, 1.0, 0.0]]}, "or the harmonics"),
        ({"harmonics": []}, "is empty"),
        ({"harmonics": [[h, 1.0, 0.0] for h in range(1, 18)]}, "has 17 harmonics; at most 16"),
        ({"harmonics": [[0, 1.0, 0.0]]}, "mean velocity"),
        ({"harmonics": [[1.5, 1.0, 0.0]]}, "the motion has the period of the forcing"),
        ({"harmonics": [[17, 1.0, 0.0]]}, "from 1 to 16"),
        ({"harmonics": [[1, float("nan"), 0.0]]}, "the weight of harmonic 1 is nan"),
        ({"harmonics": [[1, 1.0, float("inf")]]}, "the phase in rad of harmonic 1 is inf"),
        ({"harmonics": [[1, 1.0]]}, "is not a list of number, weight and phase"),
        ({"harmonics": [[1, 1.0, 0.0], [1, 0.5, 0.0]]}, "gives a harmonic twice"),
        ({"harmonics": [[1, 0.0, 0.0]]}, "does not move"),
    ],
)
def test_a_mistake_gets_one_message(given, message):
    with pytest.raises(SpecError, match="waveform") as caught:
        keyword_spec({"waveform": given})
    assert len(caught.value.mistakes) == 1
    assert message in str(caught.value)
