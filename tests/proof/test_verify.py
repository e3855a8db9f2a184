"""A sound dataset passes; whatever cannot be compared or read is reported."""

import math
import subprocess
import sys
from importlib.metadata import version

import h5py
import numpy as np
import pytest

from honest import random_spec
from vibrosweep.cli import main
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.model.measures import MEASURE_OF, MEASURES, OF_TRAJECTORIES, RECORD, Regime
from vibrosweep.model.parameters import NOISE, OF_MOUNT, OF_RESTITUTION, STREAM
from vibrosweep.proof.report import State
from vibrosweep.proof.sampling import RECORD_COORDINATES, SWEEP_COORDINATES, VARIABLES, read_sample
from vibrosweep.proof.verifying import verify
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import parse_spec


def everything(path, **options):
    return verify(path, sample=10**9, **options)


def test_sound_dataset(claimed):
    report = everything(claimed)
    assert report.passed
    assert report.count(State.COMPARED) == report.total == 3
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
    assert report.count(State.COMPARED) == 5
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
    assert 0 < report.count(State.TOO_LONG) < 3
    assert report.count(State.TOO_LONG) + report.count(State.COMPARED) == 3
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


@pytest.mark.parametrize(("budget", "state"), [(10**6, State.NO_CLAIM), (40, State.NOT_COMPLETED)])
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


@pytest.mark.parametrize("transient", [0.0, 6.0])
@pytest.mark.parametrize(
    "scene", [("high-bounce", "rest"), ("high-bounce", "reflect"), ("moving", "rest")]
)
def test_a_cycle_that_is_closed_by_two_rests(computed, edited, scene, transient):
    path = computed(RESTS.format(*scene, transient))
    report = everything(path)
    assert not list(report.complaints())
    proved = {o.realization for o in report.outcomes if o.state is State.COMPARED}
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


@pytest.mark.parametrize("number", range(12))
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
    assert report.outcomes[0].state is State.NO_CLAIM


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
    assert report.total == report.count(State.COMPARED) == 1


@pytest.mark.parametrize(
    "options", [{"sample": 0}, {"seed": -1}, {"max_landings": 0}], ids=lambda o: next(iter(o))
)
def test_numbers_out_of_range(claimed, options):
    with pytest.raises(ParameterError, match=f"{next(iter(options))} = .* at least"):
        verify(claimed, **options)


def test_missing_file(tmp_path):
    with pytest.raises(DataError, match="no such"):
        verify(tmp_path / "none.h5")


def test_damaged_file(claimed, tmp_path):
    path = tmp_path / "half.h5"
    path.write_bytes(claimed.read_bytes()[: claimed.stat().st_size // 2])
    with pytest.raises(DataError, match="damaged"):
        verify(path)


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


def test_locked_orbits(computed):
    text = """
title = "Orbits of one and of two impacts, and one that is not yet settled"
[scene]
particles = 2
launch = [0.125, 0.15]
duration = 900.0
[sample]
design = "grid"
restitution = [0.5, 0.9]
amplitude = [2.6, 3.1]
[measure]
regimes = true
trust = true
"""
    path = computed(text)
    report = everything(path)
    assert report.passed
    with h5py.File(path) as file:
        locked = np.argwhere(file["regime"][...] == Regime.LOCKED)
        assert {1, 2} & set(file["cycle_impacts"][...][tuple(locked.T)].tolist())
        assert report.variables()["cycle_impacts"].errors


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
duration = 100.0
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
    assert report.count(State.COMPARED) >= 6
    assert report.count(State.COMPARED) + report.count(State.NO_CLAIM) == report.total == 8
    assert not report.not_compared()
    found = report.variables()
    assert all(variable.errors for variable in found.values())
    with h5py.File(moving) as file:
        regimes = set(file["regime"][...].ravel().tolist())
    assert regimes >= {Regime.AT_REST, Regime.RESTING, Regime.LOCKED}


def test_changes_of_a_dataset_of_the_moving_base_are_found(moving, moving_report, edited):
    proved = [o.realization for o in moving_report.outcomes if o.state is State.COMPARED]
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
