"""Curves of bifurcations over the plane of the page."""

from dataclasses import replace

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.api.result_kinds import BOUNDARIES, WINDOWS
from vibrosweep.errors import DataError
from vibrosweep.explorer.points import of_result, with_borders
from vibrosweep.explorer.views import PlaneView
from vibrosweep.store.writing import save_result


@pytest.fixture(scope="module")
def curves():
    return vs.boundaries(restitution=[0.8, 0.9], amplitude=[0.5, 3.5])


@pytest.fixture
def plane(tmp_path):
    found = vs.sweep(restitution=[0.8, 0.9], amplitude=[0.5, 2.0, 3.5], particles=5)
    return of_result(found, tmp_path / "plane.h5", "sweep")


def test_curves_are_drawn_over_restitution_and_forcing_and_nothing_else(curves, plane, tmp_path):
    path = save_result(curves, tmp_path / "borders.h5", BOUNDARIES)
    view = PlaneView(with_borders(plane, path))
    view.x, view.y = "restitution", "amplitude"
    view.show()
    shown = view.borders.data
    assert sorted(shown["name"]) == [
        "1 impact / 1 period: period doubling",
        "1 impact / 1 period: saddle node",
    ]
    assert sorted(shown["dash"]) == ["dashed", "solid"]
    born = shown["name"].index("1 impact / 1 period: saddle node")
    e, a = shown["xs"][born], shown["ys"][born]
    known = np.isfinite(e)
    assert a[known] == pytest.approx(vs.theory.amplitude_min(1, e[known]), rel=1e-12)
    view.y = "rebound_height_max"
    view.show()
    assert not view.borders.data["xs"]


def test_curves_of_another_scene_are_refused(curves, plane, tmp_path):
    for name, wrong in (
        ("base", curves.assign_attrs(base="moving")),
        ("frequency", curves.assign(frequency=2.0)),
    ):
        path = save_result(wrong, tmp_path / f"{name}.h5", BOUNDARIES)
        with pytest.raises(DataError, match=f"its {name} is "):
            with_borders(plane, path)
    path = save_result(curves, tmp_path / "windows.h5", WINDOWS)
    with pytest.raises(DataError, match="vibrosweep boundaries"):
        with_borders(replace(plane), path)
