"""A plan: chunks of bounded work, and estimates that a run bears out."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vibrosweep.cli import main
from vibrosweep.engine import landings
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import OutputError, ParameterError, RunError
from vibrosweep.runs import chunks, plan
from vibrosweep.runs.chunks import in_process
from vibrosweep.runs.driver import run_sweep
from vibrosweep.runs.plan import (
    UNKNOWN,
    estimate,
    explore,
    interval,
    make_plan,
    require_disk,
    require_memory,
)
from vibrosweep.scene.sweep import parse_spec, read_spec

SWEEPS = Path(__file__).parents[2] / "sweeps"
WIDE = """title = "x"
[scene]
particles = 20
[sample]
realizations = {}
restitution = [0.8, 0.98]
amplitude = [0.2, 3.5]
[measure]
"""


@pytest.fixture
def costs(monkeypatch):
    """Let plans find this cost of a realization."""

    def says(seconds):
        def explored(spec, design, *rest):
            return replace(
                UNKNOWN, seconds=seconds, impacts=np.ones(1), columns={"status": np.zeros(1)}
            )

        monkeypatch.setattr(plan, "explore", explored)

    return says


@pytest.mark.parametrize(
    ("realizations", "seconds", "chunk"),
    [
        (200, 1e-4, 200),  # short: not cut
        (10**6, 2e-6, 10**6),
        (10**6, 1e-3, 10_000),  # ten seconds each
        (1000, 60.0, 1),  # never less than a realization
        (10**9, 2e-6, (2**26 // 81) // 26214 * 26214),  # results of a chunk are held in memory
    ],
)
def test_a_chunk_is_some_seconds_of_work(workers, costs, realizations, seconds, chunk):
    costs(seconds)
    spec = parse_spec(WIDE.format(realizations))
    assert make_plan(spec, workers).chunk == chunk
    assert make_plan(spec, workers, 7).chunk == 7
    assert make_plan(spec, workers, at_least=10).chunks >= 10


def test_the_results_of_a_chunk_have_the_bytes_that_are_planned(workers):
    spec = parse_spec(WIDE.format(50) + "separation = true\nregimes = true\nper_particle = true\n")
    design = chunks.open_design(spec)
    columns = next(chunks.compute_rows(spec, design, 0, 50, workers))
    assert sum(v.nbytes for v in columns.values()) == 50 * chunks.bytes_per_realization(
        spec, design
    )


def test_the_sample_is_drawn_from_all_over_a_grid(workers, monkeypatch):
    """The first rows of a grid are those of its quietest corner."""
    text = WIDE.replace("realizations = {}", 'design = "grid"')
    text = text.replace("[0.8, 0.98]", "{ start = 0.0, stop = 0.98, num = 100 }")
    spec = parse_spec(text.replace("[0.2, 3.5]", "{ start = 0.2, stop = 3.5, num = 100 }"))
    design = chunks.open_design(spec)
    few = explore(spec, design, workers, 1e-9).columns
    assert few["status"].size < 20
    for name, low, high in (("restitution", 0.2, 0.8), ("amplitude", 0.9, 2.8)):
        assert few[name].min() < low
        assert few[name].max() > high


def test_hours_are_foreseen_in_a_moment(workers):
    """Error bounds follow every landing, even where an orbit repeats."""
    spec = parse_spec(WIDE.format(64) + "trust = true\nimpact_budget = 1_000_000_000_000\n")
    spec = replace(spec, scene=replace(spec.scene, duration=1e9))
    cost = explore(spec, chunks.open_design(spec), workers, 0.2)
    assert cost.share < 0.01
    assert cost.seconds > 1e-10 * cost.impacts.mean() > 2.0  # no processor is as fast as that
    # some landings in each second of the scene
    landings = cost.impacts.mean() / (spec.scene.particles * spec.scene.duration)
    assert 1.0 < landings < 10.0


def test_the_estimate_of_a_whole_sweep_is_exact_but_for_time(workers, tmp_path):
    """Both are small enough that the sample is the sweep."""
    for name in ("paper", "laboratory"):
        spec = read_spec(SWEEPS / f"{name}.toml")
        needs = estimate(spec, make_plan(spec, workers, seconds=5.0, enough=0.0), workers)
        summary = run_sweep(spec, tmp_path / f"{name}.h5", threads=2)
        assert needs.impacts == pytest.approx(summary.landings)
        assert needs.result == pytest.approx((tmp_path / f"{name}.h5").stat().st_size, rel=0.2)


def test_no_room_for_a_sample_file_names_its_place(workers, limited):
    spec = read_spec(SWEEPS / "paper.toml")
    plan = make_plan(spec, workers, seconds=5.0)
    with limited(1000), pytest.raises(OutputError, match=r"sample\.h5.*another place with TMPDIR="):
        estimate(spec, plan, workers)


def test_disk_is_foreseen_from_a_sample(workers, tmp_path):
    spec = parse_spec(WIDE.format(150_000) + "per_particle = true\nregimes = true\n")
    spec = replace(spec, scene=replace(spec.scene, particles=3, duration=3.0))
    # a sample that does not depend on how busy the machine is
    start = replace(spec, design=replace(spec.design, realizations=20_000))
    cost = make_plan(start, workers, seconds=60.0, enough=0.0).cost
    assert cost.columns["status"].size == 20_000
    needs = estimate(spec, replace(make_plan(spec, workers, 40_000), cost=cost), workers)
    sizes = []

    def weighing(job, indices, tick):
        failed = in_process(2)(job, indices, tick)
        sizes.extend(part.stat().st_size for part in job.parts.finished().values())
        return failed

    summary = run_sweep(spec, tmp_path / "out.h5", threads=2, chunk=40_000, runner=weighing)
    assert needs.impacts == pytest.approx(summary.landings, rel=0.1)
    assert needs.result == pytest.approx((tmp_path / "out.h5").stat().st_size, rel=0.2)
    assert needs.parts == pytest.approx(sum(sizes), rel=0.2)


MEMORY = """
import re, sys
from pathlib import Path
from dataclasses import replace
from vibrosweep.engine.workers import Workers
from vibrosweep.runs.plan import estimate
from vibrosweep.runs.plan import make_plan
from vibrosweep.runs.chunks import in_process
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import parse_spec
spec = parse_spec(sys.argv[1])
spec = replace(spec, scene=replace(spec.scene, duration=1.0))
chunk = int(sys.argv[4])  # a plan of its own would depend on how busy the machine is
if sys.argv[2] == "plan":
    with Workers(2) as workers:
        print(estimate(spec, make_plan(spec, workers, chunk, seconds=0.1), workers).memory)
else:
    run_sweep(spec, Path(sys.argv[3]), threads=2, chunk=chunk)
    # not that of getrusage, which knows the process that started this one
    peak = re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())
    print(int(peak[1]) * 1024)
"""


def foreseen_and_used(text, number, path, chunk):
    """Memory in bytes that a plan foresees for a run in a fresh process, and that the run takes."""
    # compile beforehand, because compiling takes memory of its own
    few = parse_spec(text.format(60))
    few = replace(few, scene=replace(few.scene, duration=1.0))
    run_sweep(few, path.with_name("few.h5"), threads=2)
    for what in ("plan", "run"):
        words = [sys.executable, "-c", MEMORY, text.format(number), what, path, str(chunk)]
        yield float(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs the peak of a process")
@pytest.mark.parametrize(
    ("measures", "chunk"),
    [
        ("regimes = true\nseparation = true\n", 60_000),
        pytest.param("per_particle = true\n", 15_000, marks=pytest.mark.weekly),
    ],
)
def test_memory_is_foreseen(tmp_path, measures, chunk):
    foreseen, used = foreseen_and_used(WIDE + measures, 60_000, tmp_path / "out.h5", chunk)
    assert foreseen == pytest.approx(used, rel=0.2)


RECORDS = {
    "many particles": "particles = 400_000\nduration = 1.5",
    "a spent budget": "duration = 1e12",
    "early landings": "particles = 20\namplitude = 0.0\nrestitution = 0.9999\nduration = 1e9",
}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs the peak of a process")
@pytest.mark.parametrize(
    "name",
    [
        "early landings",
        *(pytest.param(n, marks=pytest.mark.weekly) for n in RECORDS if n != "early landings"),
    ],
)
def test_the_memory_of_a_record_is_foreseen(tmp_path, name):
    scene = RECORDS[name]
    text = f'title = "x"\n[measure]\nimpact_budget = {{:_}}\n[record]\n{scene}\n'
    foreseen, used = foreseen_and_used(text, 4_000_000, tmp_path / "out.h5", 1)
    assert foreseen == pytest.approx(used, rel=0.2)


@pytest.mark.parametrize("scene", RECORDS.values(), ids=RECORDS)
def test_the_disk_for_a_record_is_foreseen(workers, tmp_path, monkeypatch, scene):
    monkeypatch.setattr(plan, "SAMPLE_BYTES", 1 << 20)
    text = f'title = "x"\n[measure]\nimpact_budget = 200_000\n[record]\n{scene}\n'
    spec = parse_spec(text)
    needs = estimate(spec, make_plan(spec, workers), workers)
    run_sweep(spec, tmp_path / "out.h5", threads=2)
    assert needs.result == pytest.approx((tmp_path / "out.h5").stat().st_size, rel=0.2)


@pytest.mark.parametrize("ragged", ["true", "false"])
def test_a_run_counts_the_landings_of_its_record_once(tmp_path, monkeypatch, ragged):
    """Then it writes them, in as many places."""
    followed, recorded = [], landings._recorded

    def counting(*arguments):
        followed.append(arguments)
        return recorded(*arguments)

    monkeypatch.setattr(landings, "_recorded", counting)
    spec = parse_spec(f'title = "x"\n[record]\nragged = {ragged}\n')
    run_sweep(spec, tmp_path / "out.h5", threads=1)
    assert len(followed) == 2


def test_a_plan_cuts_a_sweep_as_a_run_does(monkeypatch, tmp_path, capsys):
    """It measures for longer than a run, which may find another cost, but not for its chunks."""
    spec = tmp_path / "wide.toml"
    spec.write_text(WIDE.format(1000))
    explore = plan.explore

    def explored(spec, design, workers, seconds, enough=0.0):
        counts = np.full(10, 1000.0 * seconds)
        found = explore(spec, design, workers, 1e-9)
        return replace(found, seconds=0.4 * seconds, impacts=counts)

    monkeypatch.setattr(plan, "explore", explored)
    with Workers(1) as workers:
        chunks_of_a_run = make_plan(read_spec(spec), workers).chunks
    assert main(["plan", str(spec), "--threads", "1", "-o", str(tmp_path / "out.h5")]) == 0
    lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()[1:])
    assert lines["chunks"].startswith(f"about {chunks_of_a_run} of about")
    assert lines["impacts"].startswith("2e+06")


def test_the_interval_of_an_estimate_holds_the_truth():
    """Also of skewed counts, of which a small sample shows too little spread."""
    rng = np.random.default_rng(2)
    whole = {"even": rng.normal(10.0, 1.0, 4000), "skewed": np.exp(rng.normal(size=4000))}
    for counts in whole.values():
        drawn = (rng.choice(counts, 64, replace=False) for _ in range(200))
        held = sum(low <= counts.mean() <= high for low, high in (interval(d, 4000) for d in drawn))
        assert held >= 0.9 * 200
    few = np.array([1.0, 2.0, 6.0])
    assert interval(few, 3) == (3.0, 3.0)
    assert np.isnan(interval(few[:1], 3)).all()


def test_realizations_that_are_refused_count_no_impacts(workers):
    """Their count is -1, which is no number of impacts."""
    spec = parse_spec(WIDE.format(8))
    spec = replace(spec, scene=replace(spec.scene, duration=1e17))
    assert (explore(spec, chunks.open_design(spec), workers, 1e-9).impacts >= 0.0).all()


def test_a_run_that_does_not_fit_is_refused(tmp_path):
    with pytest.raises(OutputError, match=r"needs 9.31e\+05 GiB of disk.*lower sample.realiz"):
        require_disk(tmp_path / "out.h5", 1e15)
    with pytest.raises(ParameterError, match=r"needs 9.31e\+05 GiB of memory.*lower chunk="):
        require_memory(1e15)


def test_a_sample_that_cannot_be_computed(workers, monkeypatch):
    def fail(*arguments):
        raise FloatingPointError

    monkeypatch.setattr(plan, "measure_all", fail)
    spec = parse_spec(WIDE.format(1000))
    unknown = make_plan(spec, workers)
    assert unknown.chunk == 10
    with pytest.raises(RunError, match="first realizations"):
        estimate(spec, unknown, workers)


def test_a_run_spends_little_on_a_plan(workers):
    """A short sweep is planned from a few of its realizations."""
    spec = read_spec(SWEEPS / "paper.toml")
    cost = make_plan(spec, workers).cost
    assert cost.columns["status"].size < 20
    assert cost.columns["impact_count"].sum() < 0.1 * spec.design.realizations * cost.impacts.mean()
