"""Records without empty places, and the way back to a rectangle."""

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.errors import DataError

SCENES = {
    "one": {},
    "map": {"amplitude": [0.3, 1.2, 3.0], "launch_time": [0.0, 0.4, 11.9], "duration": 12.0},
    "moving": {"base": "moving", "base_acceleration": [0.5, 3.0], "particles": 2, "duration": 9.0},
    "sprung": {"base": "sprung", "mass_ratio": [0.01, 0.1], "mount_frequency": 3.0, "particles": 2},
    "none": {"launch_time": 11.9, "duration": 12.0},
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_a_ragged_record_is_the_rectangle_without_its_empty_places(scene):
    full, ragged = vs.simulate(**scene), vs.simulate(**scene, ragged=True)
    assert ragged.sizes["landing"] == full.impact_count.sum()
    assert ragged.impact_count.attrs["sample_dimension"] == "landing"
    assert np.array_equal(ragged.impact_count, full.impact_count.values.ravel())
    again = vs.rectangle(ragged)
    full.attrs.pop("notes", None)
    assert again.identical(full)


def test_a_rectangle_says_how_much_of_it_is_empty():
    half = vs.simulate(launch_time=[0.0, 6.0], duration=12.0)
    assert "notes" not in half.attrs
    found = vs.simulate(launch_time=[0.0, 11.0, 11.0, 11.0], duration=12.0)
    empty = 1.0 - float(found.impact_count.sum()) / (4 * found.sizes["impact"])
    assert empty > 0.5
    assert found.attrs["notes"].startswith(f"{empty:.0%} of the ")


def test_what_takes_rectangles_says_so():
    ragged = vs.simulate(ragged=True)
    for take in (vs.analysis.landing_phases, vs.figures.return_map):
        with pytest.raises(DataError, match=r"vibrosweep.rectangle\(record\)"):
            take(ragged)
    with pytest.raises(DataError, match=r"simulate\(\.\.\., ragged=True\)"):
        vs.rectangle(vs.simulate())
