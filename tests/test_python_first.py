"""First questions of a new user, each in at most five lines of Python."""

import numpy as np
import pandas as pd
import pytest

import vibrosweep as vs
from vibrosweep.model.forcing import INPUTS


def test_a_random_sweep():
    found = vs.sweep(restitution=(0.80, 0.98), amplitude=(0.2, 3.5), realizations=200, seed=1)
    tallest = found.rebound_height_max.max().item()
    assert dict(found.sizes)["realization"] == 200
    assert tallest > found.rebound_height_mean.max().item() > 0.0


def test_windows_of_a_locked_orbit_beside_their_closed_form():
    e = np.linspace(0.5, 0.95, 10)
    found = vs.windows(restitution=e, amplitude=np.linspace(0.1, 5.0, 50), conditions=["locked(1)"])
    window = found.isel(condition=0, direction=0, window=0)
    closed = {"A_min": vs.theory.amplitude_min(1, e), "A_max": vs.theory.amplitude_max(1, e)}
    for end, values in closed.items():
        assert (abs(window[end] - values) <= window[f"{end}_bracket"]).all()


def test_a_bifurcation_diagram_as_a_table(tmp_path):
    found = vs.bifurcation(amplitude=np.linspace(1.2, 1.6, 5), launch=[0.125], duration=3000.0)
    found.rebound_velocity.to_series().dropna().to_csv(tmp_path / "diagram.csv")
    table = pd.read_csv(tmp_path / "diagram.csv")
    locked = table[table.direction == "up"]
    assert len(locked) == 5 * 64
    assert np.allclose(locked.rebound_velocity, vs.theory.locked_velocity(1), rtol=1e-12)


def test_basins():
    found = vs.basins(launch_velocity=np.linspace(3.0, 6.0, 8), particles=8, duration=2000.0)
    share = (found.basin == 0).mean().item()
    assert share == found.fraction[0].item()


def test_sobol_indices():
    found = vs.sobol(restitution=(0.8, 0.98), amplitude=(0.2, 3.5), realizations=256)
    total = found.total_order.sel(output="rebound_height_max")
    assert total.sel(parameter="amplitude") > 0.2
    assert (found.first_order <= found.total_order + 0.1).all()


def test_a_grid_in_the_units_of_a_shaker():
    e, gamma = np.linspace(0.3, 0.95, 60), np.linspace(0.5, 5.0, 60)
    asks = {"frequency": 17.0, "duration_periods": 200, "base": "moving"}
    found = vs.sweep(restitution=e, base_acceleration=gamma, **asks)
    mesh = found.flight_time_mean.plot()
    assert mesh.axes.get_title() == ""
    assert mesh.get_array().shape == (60, 60)
    assert found.flight_time_mean.dims == ("restitution", "base_acceleration")
    mesh.figure.clear()


def test_a_table_of_own_pairs():
    e, a = np.random.default_rng(1).uniform([[0.5], [0.3]], [[0.95], [3.0]], (2, 50))
    pairs = pd.DataFrame({"restitution": e, "amplitude": a, "ball": ["steel", "glass"] * 25})
    found = vs.sweep(design=pairs, particles=2)
    heights = found.rebound_height_max.groupby("ball").mean()
    assert sorted(heights["ball"].values) == ["glass", "steel"]
    assert found.restitution.values.tolist() == e.tolist()
    assert found["ball"].values.tolist() == pairs["ball"].tolist()


def test_plots_of_a_record_are_headed_by_what_was_chosen(tmp_path):
    alone = vs.simulate(launch_time=[0.0, 0.125])
    vs.run({"record": {"launch": [0.0, 0.125]}}, tmp_path / "out.h5").close()
    with vs.open_record(tmp_path / "out.h5") as kept:
        for found in (alone, kept):
            (line,) = found.rebound_velocity.isel(realization=0, particle=1).plot()
            assert line.axes.get_title() == "launch_time = 0.125 [s]"
            line.figure.clear()
            assert found.amplitude.dims == found.duration.dims == ()


@pytest.mark.parametrize("parameter", [*INPUTS.values()], ids=lambda parameter: parameter.name)
def test_labels_of_axes_fit_into_one_line(parameter):
    """Matplotlib would cut off a label that xarray breaks into two lines."""
    assert len(f"{parameter.long_name} [{parameter.units}]") <= 30
