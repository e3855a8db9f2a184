"""Orbits along a parameter and curves of their bifurcations, against closed forms."""

import math
from collections import Counter

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import vibrosweep as vs
from orbit_branches import judge
from tests.scenes import TWO_TONES
from vibrosweep.analysis.continuation import LOST
from vibrosweep.analysis.orbits import line_summary, summary
from vibrosweep.errors import DataError, ParameterError, SpecError
from vibrosweep.figures import orbit_boundaries, orbit_branches, parameter_plane, periodic_orbits
from vibrosweep.figures.style import for_file

SADDLE_NODE, DOUBLING, GRAZING, YIELDING, AT_LANDING = 0, 1, 2, 6, 7
TOUCHES = 3  # of ends
GRAVITY, FREQUENCY = 9.81, 1.0
BASES = ("high-bounce", "moving")


def ends_of_mode(k, e, base):
    """A_min and A_max of the mode k, in m/s at 1 Hz."""
    born = (1.0 - e) * k
    if base == "moving":
        ratio = (1.0 + e * e) / (1.0 + e)
        last = math.hypot(born, 2.0 * ratio / math.pi)
    else:
        last = math.hypot(born, (1.0 + e) / math.pi)
    return born * GRAVITY / 2.0, last * GRAVITY / 2.0


def met(found, branch, kind):
    one = found.isel(branch=branch)
    return one.bifurcation_amplitude.values[one.bifurcation.values == kind]


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("e", [0.3, 0.99])
def test_one_impact_is_born_and_doubles_where_the_closed_forms_say(base, e):
    found = vs.branches(restitution=e, amplitude=[0.01, 20.0, 60.0], periods=3, base=base)
    modes = found.cycle_periods.values.tolist()
    assert sorted(modes) == [1, 2, 3]
    for branch, k in enumerate(modes):
        born, last = ends_of_mode(k, e, base)
        assert met(found, branch, SADDLE_NODE) == pytest.approx([born], abs=1e-12)
        assert met(found, branch, DOUBLING) == pytest.approx([last], abs=1e-12)


@pytest.mark.parametrize(
    ("base", "ratios"),
    [
        ("high-bounce", [6.30, 5.09, 4.673, 4.664]),
        ("moving", [4.73, 4.63, 4.651, 4.664]),
    ],
)
def test_the_cascade_accumulates_with_the_ratio_of_feigenbaum(base, ratios):
    found = vs.branches(restitution=0.5, amplitude=[2.3, 5.0], base=base, doublings=5)
    chain = [0]
    while np.any(found.parent.values == chain[-1]):
        chain.append(int(np.flatnonzero(found.parent.values == chain[-1])[0]))
    assert found.cycle_impacts.values[chain].tolist() == [1, 2, 4, 8, 16, 32]
    steps = np.diff([met(found, branch, DOUBLING)[0] for branch in chain])
    assert steps[:-1] / steps[1:] == pytest.approx(ratios, abs=6e-3)
    assert steps[-2] / steps[-1] == pytest.approx(4.6692, abs=0.01)


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("e", [0.5, 0.8])
def test_two_impacts_are_born_at_saddle_nodes(base, e):
    """For 2 impacts in 1 and in 3 periods: both orbits of the fold exist beyond it only."""
    found = vs.branches(
        restitution=e, amplitude=[0.5, 3.0, 5.0, 8.0], impacts=2, periods=3, base=base
    )
    for q in (1, 3):
        own = (found.cycle_impacts == 2) & (found.cycle_periods == q)
        born = [a for i in np.flatnonzero(own.values) for a in met(found, i, SADDLE_NODE)]
        assert born
        for at in born:
            count = [
                vs.orbits(restitution=e, amplitude=at * share, impacts=2, periods=q, base=base)
                for share in (1.0 - 1e-5, 1.0 + 1e-5)
            ]
            number = [int(((o.cycle_impacts == 2) & (o.cycle_periods == q)).sum()) for o in count]
            assert number[1] - number[0] == 2


@pytest.mark.weekly
def test_a_mode_under_two_tones_ends_in_a_fold_and_begins_again_before_it():
    """Orbits of one impact are roots of a w(x) = 1 - e: 0.1688 to 0.2855, and 0.2852 to 0.6657."""
    kicks = np.array([0.12, 0.25, 0.29, 0.9])
    found = vs.branches(restitution=0.85, amplitude=kicks * GRAVITY / 2.0, waveform=TWO_TONES)
    assert found.sizes["branch"] == 1  # it goes round both folds
    folds, (last,) = (
        [a * 2.0 / GRAVITY for a in met(found, 0, k)] for k in (SADDLE_NODE, DOUBLING)
    )
    assert sorted(folds) == pytest.approx([0.1688, 0.2852, 0.2855], abs=5e-5)
    assert last == pytest.approx(0.6657, abs=5e-5)
    for a in folds:  # at a fold w is stationary in the phase, and a w = 1 - e
        x = np.linspace(0.0, 1.0, 200_001)
        w = np.sin(2 * np.pi * x) + 0.4 * np.sin(4 * np.pi * x + 1.1)
        tops = w[1:-1][(np.diff(w)[:-1] > 0) != (np.diff(w)[1:] > 0)]
        assert np.abs(tops - 0.15 / a).min() < 1e-8


def test_orbits_are_followed_under_a_law_of_restitution_and_marked_where_they_yield():
    """On the map 1 - e(v) = a sin, and q = dE/dv takes the place of e in the multipliers."""
    law = {"restitution_law": "plastic", "restitution_speed": 4.0}
    found = vs.branches(restitution=0.9, amplitude=[0.5, 1.5, 8.0], doublings=1, **law)
    v = GRAVITY / 2.0
    left = float(vs.theory.restitution_at(v, 0.9, "plastic", 4.0)) * v
    assert met(found, 0, SADDLE_NODE) == pytest.approx([v - left], abs=1e-12)
    last = math.hypot(v - left, (v + 0.75 * left) / math.pi)
    assert met(found, 0, DOUBLING) == pytest.approx([last], abs=1e-12)
    (event,) = np.flatnonzero(found.bifurcation[1] == YIELDING)
    first, second = found.bifurcation_phase.values[1, event, :2]
    shorter = 1.0 - abs(second - first - np.rint(second - first))  # of two flights in two periods
    assert shorter * v == pytest.approx(4.0, abs=1e-9)


def test_a_branch_goes_round_its_fold_and_states_why_it_ends():
    found = vs.branches(restitution=0.5, amplitude=[1.0, 5.0], base="moving", impacts=2)
    one = found.isel(branch=0)
    values = one.amplitude.dropna("point").values
    least = int(np.argmin(values))
    assert 0 < least < values.size - 1
    assert values[0] == pytest.approx(5.0) == values[-1]
    touching = found.isel(branch=int(np.flatnonzero(found.cycle_impacts.values == 2)[-1]))
    assert 3 in touching.ends.values  # touches the base
    assert GRAZING in touching.bifurcation.values
    assert ((touching.admissible.dropna("point") != 0) | (touching.stable == -1)).sum() > 0


def test_one_admissible_orbit_appears_or_vanishes_at_a_graze():
    found = vs.branches(restitution=0.5, amplitude=[1.0, 5.0], base="moving", impacts=2)
    for branch in range(found.sizes["branch"]):
        for at in met(found, branch, GRAZING):
            p = int(found.cycle_impacts[branch])
            q = int(found.cycle_periods[branch])
            inside = vs.orbits(restitution=0.5, amplitude=at * (1 + 1e-6), base="moving", impacts=p)
            outside = vs.orbits(
                restitution=0.5, amplitude=at * (1 - 1e-6), base="moving", impacts=p
            )
            taken = [
                int(((o.cycle_impacts == p) & (o.cycle_periods == q) & (o.admissible == 1)).sum())
                for o in (outside, inside)
            ]
            assert abs(taken[1] - taken[0]) == 1


@pytest.mark.parametrize("name", ["base_velocity", "base_displacement", "base_acceleration"])
def test_other_forcings_bifurcate_at_the_same_amplitude(name):
    """The restitution is followed at a fixed forcing, and the amplitude changes with it."""
    scale = {
        "base_velocity": 2.0 * math.pi * FREQUENCY / GRAVITY,
        "base_displacement": (2.0 * math.pi * FREQUENCY) ** 2 / GRAVITY,
        "base_acceleration": 1.0,
    }[name]
    found = vs.branches(restitution=[0.05, 0.99], base="moving", **{name: 1.1 / scale})
    one = found.isel(branch=0)
    for e in one.bifurcation_restitution.values[one.bifurcation.values == DOUBLING]:
        gamma = math.hypot(math.pi * (1.0 - e) / (1.0 + e), 2.0 * (1.0 + e * e) / (1.0 + e) ** 2)
        assert gamma == pytest.approx(1.1, abs=1e-12)
    assert (one.bifurcation == DOUBLING).sum() >= 1


@pytest.mark.parametrize("base", BASES)
def test_boundaries_are_the_closed_forms_at_every_point(base):
    found = vs.boundaries(restitution=[0.4, 0.9], amplitude=[0.01, 8.0], base=base, periods=2)
    found = found.isel(curve=found.bifurcation.values != GRAZING)
    assert found.sizes["curve"] == 4
    for i in range(4):
        one = found.isel(curve=i).dropna("point", subset=["restitution"])
        k, kind = int(one.cycle_periods), int(one.bifurcation)
        e, a = one.restitution.values, one.amplitude.values
        expected = [ends_of_mode(k, value, base)[kind] for value in e]
        assert a == pytest.approx(expected, abs=1e-12)
        assert e.min() == pytest.approx(0.4)
        assert e.max() == pytest.approx(0.9)
        assert (one.admissible == 1).all()


@pytest.mark.parametrize("base", BASES)
def test_events_do_not_depend_on_the_range_and_each_orbit_is_on_one_branch(base):
    """And each doubling has its child, each event is inside, no branch is lost."""
    failures, total = [], Counter()
    for i in range(5):
        total += judge({"base": base}, np.random.default_rng([3, i]), lambda *w: failures.append(w))
    assert failures == []
    assert min(total[name] for name in ("events", "doublings", "orbits")) > 10


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("e", [0.5, 0.9])
def test_a_range_that_ends_exactly_at_a_doubling_lists_it_once_and_the_orbit_born_there(base, e):
    _, last = ends_of_mode(1, e, base)
    for values in ([last, 1.1 * last], [0.9 * last, last]):
        found = vs.branches(restitution=e, amplitude=values, base=base, doublings=1)
        doubling = [a for i in range(found.sizes["branch"]) for a in met(found, i, DOUBLING)]
        assert [a for a in doubling if abs(a - last) < 1e-9] == pytest.approx([last], abs=1e-11)
        (child,) = np.flatnonzero(found.parent.values >= 0)
        assert found.cycle_impacts[child] == 2


@pytest.mark.weekly
@pytest.mark.parametrize(
    ("e", "doublings"),
    [(0.745, [0.67907361, 0.69245687]), (0.75, [0.677630766, 0.687127381])],
)
def test_neighbouring_doublings_are_found_once_each(e, doublings):
    """Two within one step are no change of sign, and each is a root inside its own bracket."""
    kicks = np.array([0.4, 0.7])
    found = vs.branches(
        restitution=e, amplitude=kicks * GRAVITY / 2.0, impacts=2, waveform=TWO_TONES
    )
    at = [a for i in np.flatnonzero(found.cycle_impacts == 2) for a in met(found, i, DOUBLING)]
    assert sorted(at) == pytest.approx(np.array(doublings) * GRAVITY / 2.0, abs=5e-8)


@pytest.mark.parametrize(
    "scene",
    [
        {"base": "moving", "restitution": 0.5},
        pytest.param({"waveform": TWO_TONES, "restitution": 0.75}, marks=pytest.mark.weekly),
    ],
)
def test_a_branch_stays_on_its_line_however_long_the_first_steps_are(scene, monkeypatch):
    """A step that would lead to another orbit, or over two events, is made shorter."""
    given_ = {**scene, "amplitude": [1.0, 3.0, 4.2], "impacts": 2}
    expected = vs.branches(**given_)
    monkeypatch.setattr("vibrosweep.analysis.continuation.FIRST_STEP", 0.3)
    monkeypatch.setattr("vibrosweep.analysis.continuation.LONGEST_STEP", 0.5)
    found = vs.branches(**given_)
    assert found.sizes["point"] < expected.sizes["point"]
    for name in ("ends", "bifurcation", "bifurcation_amplitude", "bifurcation_phase"):
        np.testing.assert_allclose(found[name], expected[name], atol=1e-9)


def test_a_landing_that_just_grazes_ends_its_branch_where_the_longer_flight_ends():
    """The orbit (2, 1) meets (1, 1) there, whose flight touches the base; both are events."""
    kicks = np.array([0.6, 0.85, 1.12]) * GRAVITY / 2.0
    restitutions = [0.29, 0.31094152683871745, 0.33]
    for e in restitutions:
        found = vs.branches(restitution=e, amplitude=kicks, base="moving", impacts=2)
        assert LOST not in found.ends.values
        long, short = (int(np.flatnonzero(found.cycle_impacts == p)[-1]) for p in (1, 2))
        assert TOUCHES in found.ends.values[short]
        (at,) = met(found, short, AT_LANDING)
        assert met(found, long, GRAZING) == pytest.approx([at], abs=1e-9)
        if e == restitutions[1]:
            assert at * 2.0 / GRAVITY == pytest.approx(1.07065069, abs=1e-8)
    curves = vs.boundaries(restitution=restitutions, amplitude=kicks, base="moving", impacts=2)
    one = curves.isel(curve=int(np.flatnonzero(curves.bifurcation == AT_LANDING)[0]))
    k = int(np.nanargmin(np.abs(one.restitution.values - restitutions[1])))
    assert float(one.amplitude[k]) * 2.0 / GRAVITY == pytest.approx(1.07065069, abs=1e-8)


def test_an_orbit_that_cannot_be_followed_is_listed(monkeypatch):
    """No branch is dropped: one from which no step leads on has one point, and is lost."""
    monkeypatch.setattr("vibrosweep.analysis.continuation.STRAIGHT_AT_KINK", 2.0)
    found = vs.branches(restitution=0.5, amplitude=[3.3, 3.6])
    assert found.sizes["branch"] > 0
    assert (found.ends == LOST).all()
    assert "lost" in "".join(line_summary(found))


def test_a_branch_that_spends_its_points_is_reported():
    found = vs.branches(restitution=0.5, amplitude=[1.0, 5.0], points=10)
    assert 5 in found.ends.values
    assert "points spent" in "".join(line_summary(found))


def test_no_orbit_gives_no_branch():
    found = vs.branches(restitution=0.5, amplitude=[0.01, 0.02])
    assert found.sizes["branch"] == 0
    assert list(line_summary(found)) == ["no orbit was found"]
    assert for_file(orbit_branches, found).axes


def test_bad_input_is_refused_with_its_range():
    grid = {"amplitude": [1.0, 5.0]}
    for asked, message in (
        ({"impacts": 13}, "impacts = 13:"),
        ({"doublings": 7}, "doublings = 7:"),
        ({"points": 3}, "points = 3:"),
        ({"impacts": 4, "doublings": 5}, "lower one"),
    ):
        with pytest.raises(ParameterError, match=message):
            vs.branches(**grid, **asked)
    with pytest.raises(ParameterError, match="two values or more"):
        vs.branches(amplitude=[1.0])
    with pytest.raises(SpecError, match="branches need"):
        vs.branches(amplitude=[1.0, 2.0], frequency=[1.0, 2.0])
    with pytest.raises(SpecError, match="boundaries need"):
        vs.boundaries(amplitude=[1.0, 2.0])


def seen(axes):
    """Number of lines that are drawn, without those of the legend alone."""
    return sum(len(line.get_xdata()) > 0 for line in axes.lines)


def test_figures_show_branches_and_curves_alone_and_over_a_sweep():
    branches = vs.branches(restitution=0.5, amplitude=[1.0, 5.0], doublings=2, base="moving")
    axes = orbit_branches(branches, ax=Figure().add_subplot())
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"1 impact / 1 period", "stable", "unstable"} <= set(names)
    curves = vs.boundaries(restitution=[0.8, 0.9], base_displacement=[0.03, 0.3])
    velocity = 2.0 * np.pi * curves.base_displacement
    xr.testing.assert_allclose(curves.amplitude, (1.0 + curves.restitution) * velocity)
    # the plane has the amplitude as an axis
    plane = vs.sweep(restitution=[0.8, 0.85, 0.9], base_displacement=[0.03, 0.1, 0.3])
    before = seen(parameter_plane(plane, ax=Figure().add_subplot()))
    drawn = orbit_boundaries(curves, sweep=plane, ax=Figure().add_subplot())
    assert seen(drawn) == before + 2 * curves.sizes["curve"]
    named = [text.get_text() for text in drawn.get_legend().get_texts()]
    assert sorted(named) == ["1 impact / 1 period", "period doubling", "saddle-node"]
    alone = orbit_boundaries(curves, ax=Figure().add_subplot())
    assert seen(alone) == 2 * curves.sizes["curve"]


# Orbits as a user asks for them: dims, units, codes, refusals, figures.

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


def test_bad_requests_for_orbits_are_refused_with_their_range():
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
