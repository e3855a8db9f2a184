"""Results over a base of finite mass compared with the reference."""

import cmath
import math
from fractions import Fraction
from itertools import pairwise

import h5py
import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.cli import main
from vibrosweep.model.measures import RECORD
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import MOUNT
from vibrosweep.proof.claims import prove
from vibrosweep.proof.measures import prove_measures
from vibrosweep.proof.reference.sprung import coupled
from vibrosweep.proof.report import CHANGE, ProofState
from vibrosweep.proof.sampling import ExactRealization
from vibrosweep.proof.verifying import verify
from vibrosweep.scene.scene import Scene

# Coupled realizations: the order of proved landings, and the estimate of errors in doubles.

PARAMETERS = {
    "restitution": 0.6,
    "amplitude": 2.2,
    "frequency": 1.3,
    "phase": 0.4,
    "gravity": 9.81,
    "launch_velocity": 5.0,
    "contact_time": 5e-3,
    "mass_ratio": 0.05,
    "mount_frequency": 0.5,
    "mount_damping": 0.05,
}


def realization(launch_times=(0.0, 0.2, 0.45), duration=5.0, transient=0.0, **changes):
    scene = Scene(
        particles=len(launch_times),
        launch=launch_times,
        duration=duration,
        measures=Measures(transient=transient),
        base="sprung",
    )
    return ExactRealization(scene, PARAMETERS | changes)


def landings_of(trajectories):
    pairs = [(t, p) for p, one in enumerate(trajectories) for t in one.landing_time.tolist()]
    return sorted(pairs)


@pytest.mark.parametrize("transient", [0.0, 2.5])
def test_order_of_the_landings(transient):
    one = realization(transient=transient)
    trajectories, _ = prove(one, 1000)
    values = prove_measures(one, trajectories).values
    last = [t.landing_time[-1] for t in trajectories]
    for name, h in (("1", 1), ("2", 2), ("3", 3), ("half", 1 / 2), ("third", 1 / 3)):
        mean = sum(cmath.exp(2j * math.pi * h * 1.3 * t) for t in last) / 3
        assert float(values[f"order_{name}"]) == pytest.approx(abs(mean), rel=0.0, abs=1e-12)
    landings = landings_of(trajectories)
    begin = max(transient, 5.0 - 1 / 1.3)
    neighbours = pairwise(landings)
    gaps = [b[0] - a[0] for a, b in neighbours if a[1] != b[1] and b[0] >= begin]
    assert len(gaps) > 2
    assert float(values["gap_min"]) == pytest.approx(min(gaps), rel=0.0, abs=1e-14)
    assert float(values["gap_median"]) == pytest.approx(np.median(gaps), rel=0.0, abs=1e-14)
    changes = 0
    for n, (time, particle) in enumerate(landings):
        before = [p for _, p in landings[:n]]
        turns = {p: n - 1 - before[::-1].index(p) for p in before}
        first = min(turns, key=turns.get, default=particle)
        changes += particle in turns and first != particle and time >= transient
    assert values["order_changes"] == changes > 0


@pytest.mark.parametrize(("mass_ratio", "open_"), [(0.0, True), (0.05, False)])
def test_the_order_of_particles_that_land_together_again_is_not_claimed(mass_ratio, open_):
    """Rounding may part them later, unless their first landing makes their motions differ."""
    one = realization((0.0, 0.2, 0.2), mass_ratio=mass_ratio)
    trajectories, estimate = prove(one, 1000)
    claims = estimate.claims(one, prove_measures(one, trajectories))
    assert (claims["order_changes"] is None) == (claims["gap_median"] is None) == open_


def test_the_estimate_is_of_the_size_of_the_effect_of_a_small_change():
    one = realization()
    trajectories, estimate = prove(one, 1000)
    shifted = PARAMETERS | {"launch_velocity": 5.0 * (1.0 + CHANGE)}
    other = coupled(shifted, one.launch_times, one.duration, digits=30).particles
    moved = max(
        abs(float(a.landing_time - b.landing_time))
        for t, u in zip(trajectories, other, strict=True)
        for a, b in zip(t.impacts, u.impacts, strict=True)
    )
    assert moved / 10.0 < estimate.time < 1000.0 * moved
    assert estimate.velocity > 0.0
    assert estimate.height > 0.0
    again = prove(realization(duration=1.0), 1000)[1]
    assert again.time < estimate.time  # errors grow


@pytest.mark.parametrize(
    ("launches", "duration", "resting", "changes"),
    [
        pytest.param(
            (0.94, 2.0, 1.95, 5.28),
            6.0,
            4,
            {
                "restitution": 0.064,
                "amplitude": 4.3,
                "frequency": 0.15,
                "phase": -3.58,
                "gravity": 1.0,
                "launch_velocity": 1.82,
                "contact_time": 2e-5,
                "mount_frequency": 150.0,
            },
            id="a particle sticks while others fly",
        ),
        pytest.param(
            (0.0, 0.0, 0.0),
            0.5,
            0,
            {
                "restitution": 0.86,
                "amplitude": 0.0034,
                "frequency": 9.4,
                "phase": -0.08,
                "gravity": 15.3,
                "launch_velocity": 1.91,
                "contact_time": 3e-4,
                "mount_frequency": 9400.0,
            },
            id="landings at once that rounding parts",
        ),
    ],
)
def test_estimate_holds_where_a_recoil_decays_at_once(launches, duration, resting, changes):
    """The base has forgotten a recoil after 1e-7 periods."""
    stiff = {"mass_ratio": 1e-3, "mount_damping": 1e3}
    one = realization(launches, duration, **changes, **stiff)
    trajectories, estimate = prove(one, 100)
    found = vs.simulate(
        base="sprung", launch_time=list(launches), duration=duration, **one.parameters
    )
    assert found.rested.sum() == resting
    for p, proved in enumerate(trajectories):
        own = found.isel(realization=0, particle=p, impact=slice(len(proved.impacts)))
        assert int(own.impact_count) == len(proved.impacts)
        for name, claim in (
            ("landing_time", estimate.time),
            ("rebound_velocity", estimate.velocity),
        ):
            np.testing.assert_allclose(own[name], getattr(proved, name), rtol=0.0, atol=claim)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("side", [-1, 1])
def test_nothing_is_claimed_where_rounding_may_decide(number, side):
    """A landing next to the end of the observation, on either side, may count or not."""
    landing = prove(realization(duration=3.0), 1000)[0][0].impacts[number].landing_time
    near = Fraction(float(landing)) + side * Fraction(2.0**-50)
    assert prove(realization(duration=near), 1000)[1] is None
    assert prove(realization(duration=near + side * Fraction(1, 1000)), 1000)[1] is not None


def test_every_measure_has_a_claim():
    one = realization(transient=1.0)
    trajectories, estimate = prove(one, 1000)
    measured = prove_measures(one, trajectories)
    claims = estimate.claims(one, measured)
    assert claims.keys() == measured.values.keys()
    exact = {name for name, claim in claims.items() if claim == 0.0}
    assert exact >= {"impact_count", "particle_rest_count", "status", "order_changes"}
    rest = {name: claim for name, claim in claims.items() if name not in exact}
    assert all(claim is None or 0.0 < claim < 1e-6 for claim in rest.values())


# Results over a base of finite mass: a sound one passes, a changed one does not.

SPRUNG = """
title = "Coupled particles"
[scene]
base = "sprung"
particles = 3
launch = [0.0, 0.2, 0.2]
duration = 2.5
contact_time = 5e-3
mount_damping = 0.05
[sample]
realizations = 2
seed = 4
restitution = [0.3, 0.6]
amplitude = [2.0, 3.0]
mass_ratio = [0.0, 0.2]
mount_frequency = [0.3, 2.0]
[measure]
transient = 0.5
separation = true
per_particle = true
[record]
restitution = 0.6
amplitude = 2.2
mass_ratio = 0.05
mount_frequency = 0.37
duration = 1.5
"""


@pytest.fixture(scope="module")
def sprung(computed):
    return computed(SPRUNG)


def test_sound_dataset(sprung):
    report = verify(sprung)
    assert report.passed
    assert report.count(ProofState.COMPARED) == 2
    assert not report.not_compared()
    found = report.variables()
    assert {f"record/{name}" for name in RECORD} < set(found)
    assert not any(variable.undecided for variable in found.values())
    deviations = [o.deviation for o in report.outcomes if o.realization is not None]
    assert all(0.0 <= error < estimate for error, estimate in deviations)
    lines = list(report.lines())
    assert lines[1].startswith("no error bounds are proved for coupled particles")
    assert lines[2].startswith("largest error of a recomputed landing")
    assert lines[-1].startswith("passed")


CHANGES = {
    "impact_count": 1,
    "particle_rest_count": 1,
    "rebound_height_mean": 1e-3,
    "dt_min": 1e-3,
    "order_1": -1e-3,
    "gap_median": 1e-3,
    "order_changes": 1,
    "undecided_count": 1,
}


def test_changed_numbers_are_found(sprung, edited):
    with edited(sprung) as (path, file):
        for name, change in CHANGES.items():
            values = file[name][...]
            values[0] += change
            file[name][...] = values
    complaints = list(verify(path).complaints())
    for name in CHANGES:
        assert any(c.startswith("realization 0") and f": {name} is" in c for c in complaints), name


def test_changed_coordinates_of_the_mount_are_found(sprung, edited):
    with edited(sprung) as (path, file):
        for name in MOUNT:
            values = file[name]
            values[(1,) * values.ndim] *= 1 + 1e-6
            file["record"][name][()] *= 1 + 1e-6
    found = verify(path).variables()
    for name in MOUNT:
        varies = name != "mount_damping"
        assert found[name].outside == {"realization 1" if varies else "dataset"}, name
        assert found[f"record/{name}"].outside == {"record"}, name


def test_command_leaves_out_what_is_too_long(sprung, capsys):
    assert main(["verify", str(sprung), "--max-landings", "2"]) == 0
    assert "2 left out: too many landings" in capsys.readouterr().out


def test_landings_before_the_window_count_as_too_many(sprung):
    with h5py.File(sprung) as file:
        in_window = int(file["impact_count"][...].max())
    report = verify(sprung, max_landings=in_window)
    assert report.count(ProofState.TOO_LONG) > 0
    assert report.count(ProofState.TOO_LONG) + report.count(ProofState.COMPARED) == 2


def test_without_landings_no_error_of_a_landing_is_reported(computed):
    text = SPRUNG.replace("duration = 2.5", "duration = 1e-3").replace("transient = 0.5", "")
    text = text.replace("launch = [0.0, 0.2, 0.2]", "launch = [0.0, 0.0, 0.0]")
    report = verify(computed(text[: text.index("[record]")]))
    assert report.passed
    assert report.count(ProofState.COMPARED) == 2
    assert not any(line.startswith("largest error of a") for line in report.lines())
