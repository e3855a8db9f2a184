from __future__ import annotations

import numpy as np
import pytest

from vibrosweep import theory
from vibrosweep.analysis.records import return_points
from vibrosweep.errors import DataError
from vibrosweep.figures import return_map


def drawn_points(figure):
    """Coordinates of all points but those of the legend and of locked orbits."""
    lines = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    return np.concatenate([np.asarray(line.get_xydata()) for line in lines])


def locked_points(figure, marker):
    lines = [line for line in figure.axes[0].lines if line.get_marker() == marker]
    return np.concatenate([line.get_xydata() for line in lines]) if lines else np.empty((0, 2))


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
@pytest.mark.parametrize("amplitude", [0.0, 0.4, 1.2, 3.4])
def test_points_lie_in_the_strip(rebound, amplitude, make_record):
    record = make_record(np.arange(10) / 10, 30.0, rebound, amplitude=amplitude)
    v, after = drawn_points(return_map(record).figure).T
    assert np.all(np.abs(after - 0.9 * v) <= amplitude + 1e-12)


def test_all_particles_are_drawn_once(twenty):
    count = np.count_nonzero(np.isfinite(twenty.rebound_velocity.values))
    assert len(drawn_points(return_map(twenty).figure)) == count


def test_locked_orbits_are_the_closed_form(make_record):
    stable = return_map(make_record(duration=60.0)).figure
    np.testing.assert_allclose(locked_points(stable, "D"), [[4.905, 4.905]])
    assert len(locked_points(stable, "X")) == 0
    unstable = return_map(make_record(duration=60.0, amplitude=3.4)).figure
    assert len(locked_points(unstable, "D")) == 0
    speeds = theory.locked_velocity(np.arange(1, 1 + len(locked_points(unstable, "X"))))
    np.testing.assert_allclose(locked_points(unstable, "X")[:, 0], speeds)


def test_a_record_without_a_rebound_is_drawn_empty(make_record):
    figure = return_map(make_record(duration=0.1)).figure
    assert len(drawn_points(figure)) == 0
    figure.canvas.draw()


def test_a_missing_variable_is_named(twenty):
    with pytest.raises(DataError, match=r"return_map .*rebound_velocity"):
        return_map(twenty.drop_vars("rebound_velocity"))


def test_over_a_moving_base_the_strip_is_wider_and_windows_are_its_own(moving_record):
    # between the upper ends of both bases: A_max = 3.0068 and 3.0149 m/s at e = 0.9
    record = moving_record([0.43], amplitude=3.01, launch_velocity=4.905)
    names = [text.get_text() for text in return_map(record).get_legend().get_texts()]
    assert "locked, stable" in names
    assert any("A + 2 V_0" in name for name in names)
    still = record.assign_attrs(base="high-bounce")
    with pytest.raises(DataError, match="do not end on the base"):
        return_map(still)


def test_a_particle_that_lands_while_it_rises_is_in_view(moving_record):
    record = moving_record(np.arange(5) / 5, 20.0, amplitude=7.0, restitution=0.6, phase=0.4)
    before = return_points(record.isel(realization=0))[0]
    assert np.nanmin(before) < -1.0
    axes = return_map(record)
    assert axes.get_xlim()[0] < np.nanmin(before)
