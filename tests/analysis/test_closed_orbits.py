"""Orbits as a user asks for them: dims, units, codes, refusals, figures."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import vibrosweep as vs
from vibrosweep.analysis.orbits import summary
from vibrosweep.errors import DataError, ParameterError, SpecError
from vibrosweep.figures import periodic_orbits

FEW = {"impacts": 2, "periods": 2}


@pytest.fixture(scope="module")
def plane():
    return vs.orbits(restitution=[0.5, 0.9], amplitude=[0.1, 1.2, 3.1], **FEW)


def test_axes_of_a_grid_are_dims(plane):
    assert plane.stable.dims == ("restitution", "amplitude", "orbit")
    assert plane.impact_phase.dims[-2:] == ("orbit", "impact")
    assert (
        plane.orbit_count.values.tolist() == (plane.cycle_impacts > 0).sum("orbit").values.tolist()
    )
    assert int(plane.orbit_count[0, 0]) == 0
    one = plane.sel(restitution=0.9, amplitude=1.2).dropna(
        "orbit", how="all", subset=["impact_phase"]
    )
    alone = vs.orbits(restitution=0.9, amplitude=1.2, **FEW)
    assert one.impact_phase.values.tolist()[0][0] == alone.impact_phase.values.tolist()[0][0]


def test_flights_and_speeds_are_in_physical_units(plane):
    """Flight times of an orbit add up to its periods, and on the map each is 2 v / g."""
    period = 1.0 / plane.frequency
    total = plane.flight_time.sum("impact")
    assert np.allclose(total, plane.cycle_periods * period)
    assert np.allclose(
        (plane.rebound_velocity * 2.0 / plane.gravity - plane.flight_time).fillna(0.0), 0.0
    )


def test_an_orbit_attracts_if_its_multipliers_are_within_the_unit_circle(plane):
    modulus = np.hypot(plane.multiplier_real, plane.multiplier_imaginary)
    present = plane.cycle_impacts > 0
    assert bool(
        ((plane.stable == 1) == (modulus.max("multiplier") < 1.0)).where(present, True).all()
    )
    product = (plane.multiplier_real.prod("multiplier")).where(modulus.isel(multiplier=0) > 0)
    real = plane.multiplier_imaginary.isel(multiplier=0) == 0.0
    expected = plane.restitution**plane.cycle_impacts
    assert np.allclose(product.where(real & present, 0.0), expected.where(real & present, 0.0))


def test_a_stable_orbit_attracts_launches_on_it():
    """Its phases and speeds are those of the cycle that a particle settles on."""
    found = vs.orbits(amplitude=1.2, **FEW)
    one = found.isel(orbit=int(np.argmax(found.stable.values)), impact=0)
    record = vs.simulate(
        amplitude=1.2,
        launch_time=float(one.impact_phase) + 1.0,
        launch_velocity=float(one.rebound_velocity) + 1e-3,
        duration=800.0,
    )
    last = record.rebound_velocity.isel(realization=0, particle=0).dropna("impact").values[-1]
    assert last == pytest.approx(float(one.rebound_velocity), abs=1e-9)


def test_the_balance_is_unknown_where_no_count_decides_it():
    assert (vs.orbits(base="moving", impacts=1, periods=1).balanced == -1).all()
    assert (vs.orbits(restitution=1.0, impacts=1, periods=1).balanced == -1).all()
    assert (vs.orbits(impacts=1, periods=1).balanced == 1).all()


def test_results_do_not_depend_on_threads_nor_on_the_other_points(plane):
    again = vs.orbits(restitution=[0.5, 0.9], amplitude=[0.1, 1.2, 3.1], threads=1, **FEW)
    assert plane.equals(again)


def test_more_orbits_than_the_first_room_holds_are_found(monkeypatch):
    module = "vibrosweep.analysis.orbits"
    whole = vs.orbits(amplitude=[1.2, 3.1], **FEW)
    monkeypatch.setattr(f"{module}.CAPACITY", 1)
    monkeypatch.setattr(f"{module}.PIECE", 1)
    assert whole.equals(vs.orbits(amplitude=[1.2, 3.1], **FEW))


def test_draws_of_ranges_have_realizations():
    found = vs.orbits(amplitude=(0.5, 3.0), realizations=4, **FEW)
    assert found.stable.dims == ("realization", "orbit")
    assert found.amplitude.dims == ("realization",)


def test_bad_input_is_refused_with_its_range():
    with pytest.raises(ParameterError, match="impacts = 99:"):
        vs.orbits(impacts=99)
    with pytest.raises(ParameterError, match="periods = 0:"):
        vs.orbits(periods=0)
    with pytest.raises(SpecError, match="restitution"):
        vs.orbits(restitution=2.0)
    with pytest.raises(ParameterError, match="couples them"):
        vs.orbits(base="sprung", mass_ratio=0.1, mount_frequency=2.0)


def test_the_summary_counts_and_judges(plane):
    lines = list(summary(plane))
    assert lines[0].startswith("1 impact / 1 period")
    assert "equal in number unless orbits are missing, differ in 0 of 24 searches" in lines[-1]
    nothing = vs.orbits(amplitude=[1e-6], impacts=1, periods=1)  # too weak a kick for any orbit
    assert len(list(summary(nothing))) == 1


def test_figures_show_one_point_a_line_and_a_plane(plane):
    line = plane.isel(restitution=1)
    basins = vs.basins(launch_velocity=[3.0, 4.0, 5.0], particles=4, duration=2000.0)
    axes = Figure().add_subplot()
    for orbits, over in (
        (plane, None),
        (line, None),
        (line.isel(amplitude=1), None),
        (line.isel(amplitude=1), basins),
    ):
        assert periodic_orbits(orbits, basins=over, ax=axes) is axes
    with pytest.raises(DataError, match=r"choose with \.isel\(\) along amplitude"):
        periodic_orbits(line, basins=basins)
