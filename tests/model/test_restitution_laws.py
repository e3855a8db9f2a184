"""Laws of restitution of a scene: what is refused, and the public closed form."""

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.errors import ParameterError, SpecError, TableError
from vibrosweep.model.restitution_laws import RESTITUTION_LAWS, range_mistake
from vibrosweep.scene.sweep import keyword_spec, parse_spec

VISCOELASTIC = {"restitution_law": "viscoelastic", "restitution_speed": 1.0}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"restitution_law": "plastic"}, 'restitution_speed: is missing; restitution_law = "plas'),
        (
            {"restitution_speed": 1.0},
            "restitution_speed: belongs to a law that depends on the",
        ),
        ({"restitution_law": "plastic", "restitution_speed": 0.0}, "is out of range: the speed of"),
        ({"restitution_law": "plastic", "restitution_speed": -1.0}, "restitution_speed = -1.0"),
        ({"restitution_law": "elastic", "restitution_speed": 1.0}, 'must be "constant", "plastic"'),
        ({**VISCOELASTIC, "restitution": 0.45}, "restitution: 0.45 is out of range: with rest"),
        (
            {**VISCOELASTIC, "restitution": (0.3, 0.9), "realizations": 3},
            "restitution: 0.3 is out of range",
        ),
    ],
)
def test_one_clear_message_for_each_mistake(given, said):
    with pytest.raises(SpecError) as caught:
        keyword_spec(given)
    assert str(caught.value).count("restitution_speed: ") <= 1
    assert said in str(caught.value)


def test_arrays_and_tables_are_checked_too():
    with pytest.raises(ParameterError, match=r"restitution: 0\.3 "):
        vs.simulate(restitution=[0.8, 0.3], **VISCOELASTIC)
    table = {"restitution": [0.8, 0.2], "amplitude": [1.0, 1.0]}
    with pytest.raises(TableError, match=r"restitution: 0\.2 "):
        vs.sweep(design=table, duration=1.0, **VISCOELASTIC)
    with pytest.raises(TableError, match='"restitution_speed" is missing'):
        vs.sweep(design=table, duration=1.0, restitution_law="plastic")


def test_the_speed_of_a_law_may_be_a_column_or_sampled():
    table = {"restitution": [0.8, 0.9], "amplitude": [1.0, 1.0], "restitution_speed": [0.1, 10.0]}
    found = vs.sweep(design=table, duration=3.0, restitution_law="plastic")
    alone = vs.sweep(
        restitution=0.8,
        amplitude=1.0,
        restitution_law="plastic",
        restitution_speed=0.1,
        duration=3.0,
    )
    assert found.attrs["restitution_law"] == "plastic"
    assert found.rebound_height_max[0] == alone.rebound_height_max[0]
    below = vs.sweep(restitution=0.9, amplitude=1.0, duration=3.0)
    assert found.rebound_height_max[1] == below.rebound_height_max[0]


def test_a_record_may_have_another_law():
    spec = parse_spec("""
        title = "two laws"
        [scene]
        restitution_law = "plastic"
        restitution_speed = 0.5
        [record]
        restitution_law = "constant"
    """)
    assert spec.record.restitution_law == "constant"
    assert "restitution_speed" not in spec.record.inputs


def test_closed_form_of_the_ratio():
    at = vs.theory.restitution_at
    v = np.array([0.01, 0.1, 1.0, 10.0, 100.0])
    expected = [0.9128211014984023, 0.8666193534358562, 0.8, 0.7089391881188506, 0.5937733048132544]
    np.testing.assert_allclose(at(v, 0.8, "viscoelastic", 1.0), expected, rtol=4e-16)
    np.testing.assert_allclose(at([0.5, 16.0], 0.8, "plastic", 1.0), [0.8, 0.4], rtol=1e-15)
    assert at([1.0, 2.0], 0.8).tolist() == [0.8, 0.8]
    with pytest.raises(ParameterError, match=r"^law = "):
        at(1.0, 0.8, "elastic")
    with pytest.raises(ParameterError, match="restitution_speed: is missing"):
        at(1.0, 0.8, "plastic")
    assert not any(range_mistake(law, np.array([0.46])) for law in RESTITUTION_LAWS)


def test_the_return_map_holds_the_kick_of_a_law():
    record = vs.simulate(**VISCOELASTIC, restitution=0.8, launch_time=[0.0, 0.125])
    points = vs.analysis.return_map(record)
    assert float(abs(points.kick.where(points.rested == 0)).max()) <= 1.2 * (1.0 + 1e-12)
