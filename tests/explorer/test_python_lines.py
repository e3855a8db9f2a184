"""The lines that the page gives run, and draw what the page draws."""

import matplotlib as mpl
import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.explorer import words
from vibrosweep.explorer.points import open_points
from vibrosweep.explorer.words import TABLE, table


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


def executed(text):
    names = {}
    exec(text, names)
    return names


@pytest.mark.parametrize("picture", words.PICTURES)
def test_lines_of_motions_give_the_record_and_a_picture(points, picture, tmp_path):
    choice = points.choice(3)
    names = executed(words.motion_lines(choice, picture))
    assert names["record"].equals(choice.simulate())
    assert len(list(tmp_path.glob("*.png"))) == 1
    if picture == "separations":
        drawn = names["axes"].collections[0].get_offsets()
        assert np.array_equal(
            drawn[:, 1], vs.analysis.landing_separations(choice.simulate())["separation"]
        )


SPECS = {
    "random": "restitution = [0.8, 0.9]\nrealizations = 4\n",
    "grid": 'design = "grid"\nrestitution = [0.8, 0.9]\namplitude = [1.0, 2.0, 3.0]\n',
}


@pytest.mark.parametrize("kind", SPECS)
def test_lines_of_the_plane_and_of_a_table_run(kind, compute, tmp_path):
    path = compute(f"[scene]\nparticles = 2\n[sample]\n{SPECS[kind]}")
    points = open_points(path)
    names = executed(words.plane_lines(points, *points.axes, points.colour))
    drawn = names["axes"].collections[0].get_offsets()
    assert np.array_equal(drawn[:, 0], points.columns[points.axes[0]].values)
    assert (tmp_path / "plane.png").stat().st_size > 0
    (tmp_path / TABLE).write_text(table(points, np.array([1, 2])), encoding="utf-8")
    again = executed(words.table_lines(points, TABLE))["found"]
    assert np.array_equal(again.impact_count, points.columns["impact_count"].values[1:3])
