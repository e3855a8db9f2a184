"""Results compared with proved trajectories."""

import itertools
import math
import subprocess
import sys
from importlib.metadata import version

import h5py
import numpy as np
import pytest
from flint import arb

import vibrosweep as vs
from honest import random_spec
from tests.cases import each_of
from tests.general import everything_plain
from tests.scenes import OBSERVABLES, RIGID, root
from vibrosweep.cli import main
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.model.measures import MEASURE_OF, MEASURES, OF_TRAJECTORIES, RECORD, Regime, Status
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import NOISE, OF_MOUNT, OF_RESTITUTION, STREAM
from vibrosweep.proof.measures import Rounded, prove_measures
from vibrosweep.proof.reference.arithmetic import arb as arb_observed
from vibrosweep.proof.reference.motion import ProvedFlight, ProvedImpact, Trajectory
from vibrosweep.proof.report import ProofState
from vibrosweep.proof.sampling import (
    RECORD_COORDINATES,
    SWEEP_COORDINATES,
    VARIABLES,
    ExactRealization,
    read_sample,
)
from vibrosweep.proof.verifying import verify
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import parse_spec

# A sound dataset passes; whatever cannot be compared or read is reported.


def everything(path, **options):
    return verify(path, sample=10**9, **options)


def test_sound_dataset(claimed):
    report = everything(claimed)
    assert report.passed
    assert report.count(ProofState.COMPARED) == report.total == 3
    found = report.variables()
    recorded = (f"record/{name}" for name in (*RECORD, *RECORD_COORDINATES))
    elsewhere = (
        "base_velocity",
        "base_displacement",
        *OF_MOUNT,
        *NOISE,
        STREAM,
        *OF_RESTITUTION,
        *OF_TRAJECTORIES,
    )
    absent = {f"{at}{name}" for at in ("", "record/") for name in elsewhere}
    absent |= {name for name, key in MEASURE_OF.items() if MEASURES[key].coupled}
    assert set(found) == {*VARIABLES, *SWEEP_COORDINATES, *recorded} - absent == set(report.names)
    assert not report.not_compared()
    for name, variable in found.items():
        assert variable.errors, name
        assert not variable.outside
        assert not variable.undecided
        # the proof is about these very numbers, and its claims leave them digits
        assert not variable.digits or max(variable.digits) > 8.0
    lines = list(report.lines())
    assert lines[-1].startswith("passed")
    assert lines[-1].endswith(f" {len(found)} of {len(found)} variables")
    assert {line.split()[0] for line in lines} >= set(found)


def test_sound_dataset_without_bounds(bare):
    report = everything(bare)
    assert report.passed
    assert not report.claimed
    assert report.count(ProofState.COMPARED) == 5
    assert "landing_time_error" not in report.variables()
    assert any("computed again" in line for line in report.lines())


def test_sample_is_seeded_and_without_replacement(bare):
    def drawn(size, seed):
        return read_sample(bare, size, seed)[0].rows.tolist()

    assert drawn(2, 5) == drawn(2, 5)
    assert len({tuple(drawn(2, seed)) for seed in range(6)}) > 1
    assert all(drawn(4, seed) == sorted(set(drawn(4, seed))) for seed in range(3))
    assert drawn(5, 1) == drawn(6, 2) == list(range(5))
    outcomes = verify(bare, sample=2, seed=5).outcomes
    assert [outcome.realization for outcome in outcomes] == drawn(2, 5)


def test_too_long(claimed):
    report = everything(claimed, max_landings=200)
    assert report.passed
    assert 0 < report.count(ProofState.TOO_LONG) < 3
    assert report.count(ProofState.TOO_LONG) + report.count(ProofState.COMPARED) == 3
    assert any("--max-landings" in line for line in report.lines())


CHAOS = """
title = "An orbit that loses all digits"
[scene]
particles = 2
restitution = 0.9
amplitude = 4.0
duration = 1000.0
[measure]
trust = true
lyapunov = true
impact_budget = {budget}
"""


@pytest.mark.parametrize(
    ("budget", "state"), [(10**6, ProofState.NO_CLAIM), (40, ProofState.NOT_COMPLETED)]
)
def test_no_claim(computed, budget, state):
    report = everything(computed(CHAOS.format(budget=budget)))
    assert report.passed
    assert [outcome.state for outcome in report.outcomes] == [state]
    lines = list(report.lines())
    assert lines[-1].startswith("nothing was proved")
    left_out = report.not_compared()
    assert left_out.keys() >= {"rebound_height_mean", "lyapunov_largest", "slot"}
    assert set(left_out.values()) == {state.value}
    assert f"not compared: orbit: {state.value}" in lines


def test_derived_variables_are_compared_without_a_proof(computed, edited):
    with edited(computed(CHAOS.format(budget=10**6))) as (path, file):
        file["orbit_count"][0] += 1
    assert list(everything(path).lines())[-1].endswith("orbit_count")


def test_a_variable_that_no_registry_has_is_not_compared(claimed, edited):
    with edited(claimed) as (path, file):
        file["label"] = np.zeros(3)
        file["record/label"] = np.zeros(3)
    report = everything(path)
    assert report.passed
    assert set(report.not_compared()) == {"label", "record/label"}
    assert "a label of the table, or a variable" in report.not_compared()["label"]
    known = len(report.names) - 2
    assert list(report.lines())[-1].endswith(f"{known} of {known + 2} variables")


TABLE = """
title = "Realizations from a table"
[scene]
particles = 1
duration = 2.0
[sample]
design = "table.csv"
"""


def test_table(tmp_path):
    table, path = tmp_path / "table.csv", tmp_path / "sweep.h5"
    table.write_text("restitution,amplitude\n0.9,1.2\n0.8,1.0\n")
    run_sweep(parse_spec(TABLE, tmp_path / "sweep.toml"), path, threads=1)
    report = everything(path)
    assert report.passed
    assert not report.not_compared()
    table.write_text("restitution,amplitude\n0.9,1.2\n0.8,1.1\n")
    assert "is not the one that was used" in everything(path).not_compared()["amplitude"]
    table.unlink()
    report = everything(path)
    assert report.passed
    assert "there is no table" in report.not_compared()["amplitude"]


@pytest.mark.parametrize("design", ["sobol", "latin"])
def test_draws_of_another_scipy_are_not_compared(computed, tmp_path, design):
    text = f"""
title = "Drawn by scipy"
[scene]
particles = 1
duration = 2.0
[sample]
design = "{design}"
realizations = 4
amplitude = [0.5, 1.5]
"""
    path = computed(text)
    assert not everything(path).not_compared()
    with h5py.File(path, "r+") as file:
        before = file["identity"].attrs["identity"]
        file["identity"].attrs["identity"] = before.replace(version("scipy"), "0.1")
    assert list(everything(path).not_compared()) == ["amplitude", "base_acceleration"]


def test_recurrence_within_a_cycle_of_the_end(computed):
    text = """
title = "Observed for hardly longer than it takes to recur"
[scene]
restitution = 0.3
launch = [0.3]
launch_velocity = 4.905
duration = 73.0
[sample]
design = "grid"
amplitude = { start = 3.45, stop = 4.0, num = 21 }
[measure]
regimes = true
trust = true
"""
    path = computed(text)
    with h5py.File(path) as file:
        assert np.sum(file["recurrent_from"][...] > 72.0) > 10
    report = everything(path)
    assert report.passed
    assert len(report.variables()["recurrent_from"].compared) == 21


RESTS = """
title = "Orbits that rest twice, once, or never, over few periods"
[scene]
base = "{}"
rebound = "{}"
particles = 3
launch = [0.0, 0.37, 10.7]
duration = 12.0
[sample]
realizations = 30
seed = 4
contact_time = 0.02
restitution = [0.1, 0.5]
base_acceleration = [1.05, 4.0]
[measure]
transient = {}
regimes = true
lyapunov = true
trust = true
per_particle = true
"""
# Values that a file holds for a particle without a known cycle
UNSETTLED = {
    "regime": Regime.UNSETTLED,
    **dict.fromkeys(("cycle_impacts", "cycle_periods", "cycle_rests"), 0),
    **dict.fromkeys(("cycle_uncertain", "orbit", "slot"), -1),
    **dict.fromkeys(("recurrent_from", "lyapunov_largest", "lyapunov_sum"), math.nan),
}


@pytest.mark.parametrize(
    ("scene", "transient"),
    [
        (("high-bounce", "rest"), 0.0),
        (("high-bounce", "reflect"), 6.0),
        (("moving", "rest"), 6.0),
    ],
)
def test_a_cycle_that_is_closed_by_two_rests(computed, edited, scene, transient):
    path = computed(RESTS.format(*scene, transient))
    report = everything(path)
    assert not list(report.complaints())
    proved = {o.realization for o in report.outcomes if o.state is ProofState.COMPARED}
    with edited(path) as (changed, file):
        rests = file["particle_rest_count"][...]
        once = (rests == 1) & (file["regime"][...] == Regime.UNSETTLED)
        assert np.any(once)
        assert np.all(np.isnan(file["lyapunov_largest"][...][once]))
        row = min(proved & set(np.flatnonzero(rests[:, 0] > 1).tolist()))
        # take back everything that the file says about the cycle, and nothing else
        for name, none in UNSETTLED.items():
            assert file[name][row, 0] != none
            file[name][row, 0] = none
    found = {c.partition(": ")[2].partition(" ")[0] for c in everything(changed).complaints()}
    assert found >= UNSETTLED.keys()


@pytest.mark.parametrize("number", range(6))
def test_honest_file_never_fails(computed, number):
    text = random_spec(np.random.default_rng([0, number]), longest=60.0)
    report = everything(computed(text))
    assert not list(report.complaints()), text


def test_lyapunov_sum_has_a_bound_after_a_launch_that_the_base_pushes(computed):
    # a flight that begins without speed relative to the base contracts areas to zero
    text = """
title = "Launched at rest"
[scene]
base = "moving"
particles = 2
launch_velocity = 0.0
duration = 1.0
[sample]
realizations = 12
restitution = [0.3, 0.75]
amplitude = [4.0, 9.0]
[measure]
lyapunov = true
trust = true
"""
    path = computed(text)
    assert everything(path).passed
    with h5py.File(path) as file:
        known = np.isfinite(file["lyapunov_sum"][...])
        assert known.sum() > 3
        assert np.all(file["lyapunov_sum_error"][...][known] > 0.0)


def test_tie_is_undecided(computed):
    # the only landing is at 2 v / g = 1 s, exactly the duration
    text = """
title = "A landing at the very end"
[scene]
particles = 1
gravity = 2.0
launch_velocity = 1.0
launch = [0.0]
amplitude = 0.0
restitution = 0.5
duration = 1.0
"""
    report = everything(computed(text))
    assert report.passed
    assert report.outcomes[0].state is ProofState.NO_CLAIM


def test_landing_at_the_edge_of_the_window_is_undecided(computed):
    text = """
title = "The first landing is at the beginning of the window"
[scene]
particles = 1
gravity = 2.0
launch_velocity = 1.0
launch = [0.0]
duration = 3.0
[measure]
transient = 1.0
"""
    report = everything(computed(text))
    assert report.passed
    found = report.variables()
    for name in ("impact_count", "rebound_height_mean", "flight_time_mean"):
        assert found[name].undecided == {"realization 0"}
    assert found["at_rest_count"].errors == [0.0]


def test_progress(bare):
    seen = []
    everything(bare, advance=lambda done, total: seen.append((done, total)))
    assert seen == [(n, 5) for n in range(1, 6)]


def test_nothing_sampled(computed):
    report = everything(computed('title = "One realization"\n[scene]\nparticles = 2\n'))
    assert report.passed
    assert report.total == report.count(ProofState.COMPARED) == 1


@pytest.mark.parametrize(
    "options", [{"sample": 0}, {"seed": -1}, {"max_landings": 0}], ids=lambda o: next(iter(o))
)
def test_numbers_out_of_range(claimed, options):
    with pytest.raises(ParameterError, match=f"{next(iter(options))} = .* at least"):
        verify(claimed, **options)


def without_status(file):
    del file["status"]


def with_restitution(file):
    file["restitution"][0] = 1.5


def with_duration(file):
    file["duration"][...] = math.nan


def with_rebound(file):
    file.attrs["rebound"] = "bounce"


def with_particle_status(file):
    file.attrs["particles"] = 5


@pytest.mark.parametrize(
    "harm", [without_status, with_restitution, with_duration, with_rebound, with_particle_status]
)
def test_values_that_no_sweep_writes_are_refused(claimed, edited, harm):
    with edited(claimed) as (path, file):
        harm(file)
    what = harm.__name__.partition("_")[2]
    with pytest.raises(DataError, match=f"{what}.*: is not what"):
        everything(path)


def test_command(claimed, changed, capsys):
    assert main(["verify", str(claimed), "--sample", "9", "--seed", "3"]) == 0
    assert "passed" in capsys.readouterr().out
    wrong = changed(claimed, "rest_count", lambda n: n + 1)
    assert main(["verify", str(wrong.path)]) == 1
    assert f"{wrong.place}: rest_count is" in capsys.readouterr().out
    assert main(["verify", str(claimed.parent / "none.h5")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("words", [["--sample", "0"], ["--sample", "all"], ["--seed", "-1"]])
def test_command_with_bad_numbers(claimed, words, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["verify", str(claimed), *words])
    assert "whole number" in capsys.readouterr().err


def test_command_without_flint(claimed):
    code = (
        "import sys; sys.modules['flint'] = None\n"
        f"from vibrosweep.cli import main; sys.exit(main(['verify', {str(claimed)!r}]))"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ended.returncode == 2
    assert 'pip install "vibrosweep[verify]"' in ended.stderr
    assert "Traceback" not in ended.stderr


def test_exponent_of_a_cycle_that_stretches_on_its_way(computed):
    text = """
title = "A cycle of 32 impacts that amplifies its own rounding"
[scene]
restitution = 0.516493550487592
amplitude = 1.612882656497882
phase = -1.8396508706849062
launch = [0.25]
duration = 160.0
rebound = "reflect"
[measure]
lyapunov = true
regimes = true
"""
    path = computed(text)
    with h5py.File(path) as file:
        assert file["cycle_impacts"][0, 0] == 32
    report = everything(path)
    assert not list(report.complaints())
    assert report.variables()["lyapunov_largest"].compared


MOVING = """
title = "Over the moving base, from rests for good to flights of several periods"
[scene]
base = "moving"
particles = 2
duration = 60.0
[sample]
design = "grid"
restitution = [0.5, 0.8]
base_acceleration = [0.5, 1.1, 1.2, 1.5]
[measure]
transient = 3.0
separation = true
per_particle = true
regimes = true
lyapunov = true
trust = true
[record]
restitution = 0.9
amplitude = 1.2
duration = 8.0
"""


@pytest.fixture(scope="module")
def moving(computed):
    return computed(MOVING)


@pytest.fixture(scope="module")
def moving_report(moving):
    return everything(moving)


def test_sound_dataset_of_the_moving_base(moving, moving_report):
    report = moving_report
    assert not list(report.complaints())
    # a realization that a graze leaves undecided claims nothing
    assert report.count(ProofState.COMPARED) >= 6
    assert (
        report.count(ProofState.COMPARED) + report.count(ProofState.NO_CLAIM) == report.total == 8
    )
    assert not report.not_compared()
    found = report.variables()
    assert all(variable.errors for variable in found.values())
    with h5py.File(moving) as file:
        regimes = set(file["regime"][...].ravel().tolist())
    assert regimes >= {Regime.AT_REST, Regime.RESTING, Regime.LOCKED}


def test_changes_of_a_dataset_of_the_moving_base_are_found(moving, moving_report, edited):
    proved = [o.realization for o in moving_report.outcomes if o.state is ProofState.COMPARED]
    places = {}
    with edited(moving) as (path, file):
        for name in ("rebound_height_mean", "flight_time_mean", "lyapunov_sum"):
            values = file[name][...]
            rows = values.reshape(8, -1)
            row = next(
                n for n in proved if n is not None and np.isfinite(rows[n, 0]) and rows[n, 0]
            )
            proved.remove(row)
            rows[row, 0] *= 1.0 + 1e-3
            file[name][...] = values
            places[name] = f"realization {row}"
    complaints = list(everything(path).complaints())
    for name, place in places.items():
        assert any(c.startswith(place) and name in c for c in complaints), name


# Definitions of measures against plain code: all pairs, in doubles, on random landings.

PARAMETERS = {
    "restitution": 0.9,
    "amplitude": 1.2,
    "frequency": 1.0,
    "phase": 0.0,
    "gravity": 9.81,
    "launch_velocity": 5.0,
    "contact_time": 0.03,
}


def scene(particles, transient=0.0):
    measures, launch = Measures(transient=transient), tuple(j / particles for j in range(particles))
    made = Scene(particles=particles, launch=launch, duration=10.0, measures=measures)
    return ExactRealization(made, PARAMETERS)


def flight(velocity):
    periods = 2.0 * velocity / 9.81
    return ProvedFlight(arb(periods), arb(velocity**2 / 2.0 / 9.81), arb(periods), None)


LAUNCH = flight(5.0)


def trajectory(rng, landings, at_rest):
    """Random landings; every other one is followed by a stay, the last one for good on request."""
    times = np.sort(rng.uniform(0.0, 10.0, landings))
    stays = np.diff(times, append=10.5) * rng.uniform(0.0, 1.0, landings)
    impacts = []
    for n, (time, stay) in enumerate(zip(times.tolist(), stays.tolist(), strict=True)):
        for_good = at_rest and n == landings - 1
        rested = for_good or n % 2 == 0
        velocity = float(rng.uniform(0.0, 6.0))
        impacts.append(
            ProvedImpact(
                landing_time=arb(time),
                liftoff_time=None if for_good else arb(time + stay * rested),
                rebound_velocity=None if for_good else arb(velocity),
                rested=rested,
                count=0,
                phase=arb(0),
                flight=None if for_good else flight(velocity),
                arrival=arb(1),
            )
        )
    return Trajectory(LAUNCH, tuple(impacts), at_rest, Status.COMPLETED, 128)


def stays_of(trajectories):
    for particle, t in enumerate(trajectories):
        for number, impact in enumerate(t.impacts):
            land = float(impact.landing_time)
            leave = math.inf if impact.liftoff_time is None else float(impact.liftoff_time)
            yield particle, number, land, max(leave, land + PARAMETERS["contact_time"]), impact


def expected(trajectories, begin):
    stays = list(stays_of(trajectories))
    seen = [s for s in stays if s[2] >= begin]
    pairs = [(a, b) for a, b in itertools.combinations(seen, 2) if a[0] != b[0]]
    gaps = [abs(a[2] - b[2]) for a, b in pairs]
    same = [abs(a[2] - b[2]) for a, b in pairs if a[1] == b[1]]
    overlaps = [
        min(a[3], b[3]) - max(a[2], b[2], begin)
        for a, b in itertools.combinations([s for s in stays if s[3] >= begin], 2)
        if a[0] != b[0]
    ]
    speeds = [float(s[4].rebound_velocity) for s in seen if s[4].rebound_velocity is not None]
    return {
        "impact_count": len(seen),
        "rest_count": sum(s[4].rested for s in seen),
        "at_rest_count": sum(t.at_rest for t in trajectories),
        "rebound_height_mean": np.mean(np.square(speeds)) / 2 / 9.81 if speeds else None,
        "rebound_height_max": max(speeds) ** 2 / 2 / 9.81 if speeds else None,
        "flight_time_mean": 2 * np.mean(speeds) / 9.81 if speeds else None,
        "dt_min": min(gaps, default=None),
        "dt_min_same_index": min(same, default=None),
        "base_shared": int(max(overlaps, default=-1.0) >= 0.0),
        "collision_free": int(max(overlaps, default=-1.0) < 0.0),
    }, max(overlaps, default=None)


def agree(proved, plain):
    if plain is None:
        return proved is None
    return proved is not None and math.isclose(float(proved), plain, rel_tol=1e-9, abs_tol=1e-12)


@each_of("transient", [0.0, 4.0])
@each_of("seed", range(60))
def test_definitions(seed, transient):
    rng = np.random.default_rng(seed)
    particles, most = int(rng.integers(1, 6)), int(rng.integers(1, 8))
    trajectories = [
        trajectory(rng, int(rng.integers(0, most + 1)), bool(rng.random() < 0.3 and most > 3))
        for _ in range(particles)
    ]
    found = prove_measures(scene(particles, transient), trajectories)
    plain, overlap = expected(trajectories, transient or -math.inf)
    for name, value in plain.items():
        assert agree(found.values[name], value), name
    assert agree(found.overlap, overlap)
    for particle, t in enumerate(trajectories):
        own, _ = expected([t], transient or -math.inf)
        for name in ("impact_count", "rest_count", "rebound_height_mean", "flight_time_mean"):
            assert agree(found.values[f"particle_{name}"][particle], own[name])


def test_launch_counts_for_the_height_only_inside_the_window():
    rng = np.random.default_rng(1)
    launched = 25.0 / (2.0 * 9.81)
    low = trajectory(rng, 3, False)
    for transient, counts in ((0.0, True), (0.5, True), (0.51, False)):
        heights = prove_measures(scene(2, transient), [low, low]).values
        own = heights["rebound_height_max"]
        top = max(float(own), launched) if counts else float(own)
        assert float(heights["flight_height_max"]) == pytest.approx(top, rel=1e-15)


def test_no_landing_at_all():
    nothing = Trajectory(LAUNCH, (), False, Status.COMPLETED, 128)
    values = prove_measures(scene(2), [nothing, nothing]).values
    undefined = {"rebound_height_mean", "rebound_height_max", "flight_time_mean", "dt_min"}
    assert {n for n in undefined if values[n] is None} == undefined
    assert values["impact_count"] == values["base_shared"] == 0
    assert float(values["flight_height_max"]) == pytest.approx(25.0 / (2.0 * 9.81))


def test_squares_beyond_doubles_are_not_finite():
    fast = ProvedImpact(arb(1), arb(1), arb(1e200), False, 1, arb(0), flight(1e100), arb(1e100))
    values = prove_measures(
        scene(1), [Trajectory(LAUNCH, (fast,), False, Status.COMPLETED, 128)]
    ).values
    assert values["status"] == Status.NON_FINITE


# Observables in `verify`: combinations, estimates, and functions other than those of the file.

SPRUNG = {"mass_ratio": 0.05, "mount_frequency": 4.0, "mount_damping": 0.1}
SPRUNG |= {"duration": 2.5, "transient": 0.5, "restitution": 0.7}
BASES = {"high-bounce": {}, "moving": {}, "sprung": SPRUNG}
SWEEP = {
    "restitution": [0.6, 0.8],
    "amplitude": [1.2, 3.0],
    "duration": 6.0,
    "transient": 2.0,
    "particles": 3,
}


def computed(path, observables, **more):
    vs.run(SWEEP | more, path, observables=observables).close()
    return path


@pytest.mark.parametrize("base", BASES)
def test_every_field_and_combination_over_every_base(base, tmp_path):
    path = computed(tmp_path / "out.h5", OBSERVABLES, base=base, **BASES[base])
    report = vs.verify(path, observables=OBSERVABLES)
    assert report.passed
    compared = report.variables()
    for one in OBSERVABLES:
        rows = (2 if base == "sprung" else 4) * (3 if one.particles == "each" else 1)
        assert len(compared[one.name].errors) == rows
        assert max(compared[one.name].claims) < 1e-3
    assert [*report.estimated] == ["root"]


def test_a_change_of_an_observable_is_found_unless_it_is_left_out(tmp_path):
    path = computed(tmp_path / "out.h5", OBSERVABLES)
    with h5py.File(path, "r+") as file:
        file["flight_time_max"][0, 0, 1] += 1e-5
    outcomes = vs.verify(path, observables=OBSERVABLES).outcomes
    wrong = [j.variable for o in outcomes for j in o.judgements if j.complaint]
    assert wrong == ["flight_time_max"]
    report = vs.verify(path, observables=OBSERVABLES[:1])
    assert report.passed
    assert {*report.not_compared()} == {one.name for one in OBSERVABLES[1:]}


def test_no_landing_has_no_maximum_and_a_sum_of_zero(tmp_path):
    path = computed(tmp_path / "out.h5", OBSERVABLES, duration=0.5, transient=0.0)
    with vs.open_sweep(path) as found:
        assert np.isnan(found.root).all()
        assert (found.lost == 0.0).all()
    assert vs.verify(path, observables=OBSERVABLES).passed


def test_another_function_than_that_of_the_file_is_refused(tmp_path):
    path = computed(tmp_path / "out.h5", OBSERVABLES)
    other = vs.Observable("fastest", root, "root", "m s-1", landings="max", particles="each")
    for wrong in (other, vs.Observable("unknown", root, "root", landings="min")):
        with pytest.raises(vs.errors.DataError, match=wrong.name):
            vs.verify(path, observables=[wrong])


def test_a_function_that_changes_totals_is_refused(tmp_path, monkeypatch):
    everything_plain(monkeypatch)

    def count(totals, landing):
        totals[0] += landing.rests

    one = vs.Observable("counted", count, "rests")
    path = computed(tmp_path / "out.h5", [one])
    assert "counted" in vs.verify(path).not_compared()
    with pytest.raises(vs.errors.ParameterError, match="counted"):
        vs.verify(path, observables=[one])


def test_a_ball_contains_the_result_in_doubles():
    def formula(a, b, c):
        return (a * b - c) ** 3 / (1.5 + abs(b)) - 2 * a / c + max(a, b, 0.1) - (-c if a < b else c)

    for numbers in np.random.default_rng(0).uniform(-1.0, 1.0, (1000, 3)):
        found = formula(*(Rounded(arb_observed(x)) for x in numbers.tolist()))
        assert found.ball.contains(arb_observed(formula(*numbers.tolist())))
        assert found.ball.rad() < 1e-9


# Results with noise: trajectories under the stored noise stream are proved like any others.

NOISE_NOISE = {"restitution_noise": 0.3, "kick_noise": 0.2}
RECORD_NOISE = {"restitution": 0.4, "amplitude": 0.3, "duration": 2.5}
# noise reverses some kicks, and the kick jumps where a forcing period begins
DRIVE = {"drive_noise": 0.9, "contact_time": 0.06, "record": RECORD_NOISE}


@pytest.mark.parametrize(
    "scene",
    [
        DRIVE,
        {**DRIVE, "phase": 8.0, "trust": True},
        {"base": "moving"},
        {"base": "sprung", "mass_ratio": 0.05, "mount_frequency": 2.3, **RIGID},
    ],
    ids=["high-bounce", "turned", "moving", "sprung"],
)
def test_the_stored_stream_is_proved(scene, tmp_path):
    path = tmp_path / "noisy.h5"
    asked = {"restitution": (0.5, 0.95), "amplitude": (0.2, 2.0), "realizations": 4, "seed": 1}
    asked |= {**NOISE_NOISE, **scene, "particles": 2, "duration": 2.5, "noise_seed": 5}
    vs.run(asked, path).close()
    report = vs.verify(path)
    assert report.passed
    assert report.count(ProofState.COMPARED) == report.total == 4
    assert not report.not_compared()
    for name, found in report.variables().items():
        assert found.errors, name
        assert not found.undecided
    with h5py.File(path, "r+") as file:
        file["noise_stream"][2] += 1.0
    outside = vs.verify(path).variables()
    assert outside["noise_stream"].outside
    assert outside["rebound_height_mean"].outside == {"realization 2"}
