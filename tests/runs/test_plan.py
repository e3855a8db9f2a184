"""Plans, chunks and the identity of a run."""

import json
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vibrosweep
from tests.cases import each_of
from vibrosweep.cli import main
from vibrosweep.engine import landings
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import OutputError, ParameterError, RunError
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.observables import Observable
from vibrosweep.model.shapes import Waveform
from vibrosweep.runs import chunks, plan
from vibrosweep.runs.chunks import EXEMPT, differences, identity, in_process, sources
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
from vibrosweep.scene.design import Design, open_design
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep, parse_spec, read_spec

# A plan: chunks of bounded work, and estimates that a run bears out.

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


@each_of(
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
        drawn = (rng.choice(counts, 64, replace=False) for _ in range(30))
        held = sum(low <= counts.mean() <= high for low, high in (interval(d, 4000) for d in drawn))
        assert held >= 0.9 * 30
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


# Realizations that are computed at once.

SPEC = parse_spec(
    'title = "x"\n[sample]\nrealizations = 10_000_000\nrestitution = [0.8, 0.98]\n'
    "amplitude = [0.2, 3.5]\n"
)
DESIGN = open_design(SPEC)


@given(
    particles=st.integers(1, 10**7),
    rows=st.integers(1, 10**7),
    threads=st.integers(1, 64),
    duration=st.floats(1e-3, 1e12),
)
def test_pieces_are_neither_too_many_nor_too_large(particles, rows, threads, duration):
    spec = replace(SPEC, scene=replace(SPEC.scene, particles=particles, duration=duration))
    size, apart = chunks.rows_at_once(spec, DESIGN, rows, threads)
    assert 1 <= size <= min(rows, chunks.batch_size(spec))
    if apart:
        assert rows // size >= chunks.PIECES_PER_THREAD * threads
        assert chunks.LEAST_PER_PIECE // particles <= size <= chunks.MOST_PER_PIECE // particles


@pytest.mark.parametrize(
    ("rows", "particles", "duration", "cut"),
    [
        (200, 20, 12.0, (200, False)),  # too little to share out
        (100_000, 20, 12.0, (6553, True)),
        (100_000, 20, 1000.0, (819, True)),  # as much work in fewer
        (1000, 10**6, 12.0, (1, False)),  # very many particles: on all threads together
    ],
)
def test_a_sweep_is_cut_by_its_work(rows, particles, duration, cut):
    spec = replace(SPEC, scene=replace(SPEC.scene, particles=particles, duration=duration))
    assert chunks.rows_at_once(spec, DESIGN, rows, 2) == cut


# The identity of a sweep holds every field of its spec on which numbers depend.

FULL = """title = "x"
[scene]
gravity = 9.8
particles = 2
{launch}
[sample]
design = {design}
restitution = [0.8, 0.98]
[measure]
{switches}
[record]
restitution = 0.5
[windows]
conditions = ["periodic"]
"""
SWITCHES = "\n".join(f"{name} = true" for name, one in MEASURES.items() if not one.coupled)
TABLE = 'title = "x"\n[sample]\ndesign = "table.csv"\ncolumns = ["restitution", "amplitude"]\n'
SPECS = {
    "drawn": FULL.format(design='"sobol"\nrealizations = 8', launch="", switches=SWITCHES),
    "grid": FULL.format(design='"grid"', launch="launch = [0.0, 0.5]", switches=""),
    "bare": 'title = "x"\n',
    "table": TABLE,
}


@pytest.fixture(params=SPECS)
def spec_identity(request, tmp_path):
    (tmp_path / "table.csv").write_text("restitution,amplitude\n0.9,1.2\n")
    return parse_spec(SPECS[request.param], tmp_path / "sweep.toml")


def changed(value):
    """Yield other values of the kind of a field, each with the name of the part that differs."""
    if is_dataclass(value):
        for field in fields(value):
            for name, other in changed(getattr(value, field.name)):
                if field.name == "waveform" and other is None:  # a scene always has one
                    continue
                with suppress(ParameterError):  # an unknown law
                    yield f".{field.name}{name}", replace(value, **{field.name: other})
        if not isinstance(value, Waveform):  # a scene always has one
            yield "", None
    elif isinstance(value, Mapping):
        for key, member in value.items():
            for name, other in changed(member):
                yield f".{key}{name}", {**value, key: other}
            yield f".{key} left out", {k: v for k, v in value.items() if k != key}
    elif isinstance(value, tuple):
        for place, member in enumerate(value):
            for name, other in changed(member):
                yield f"[{place}]{name}", (*value[:place], other, *value[place + 1 :])
        yield " shorter", value[:-1]
    elif isinstance(value, bool):
        yield "", not value
    elif isinstance(value, int | float):
        yield "", value * (1 + 2.0**-52) if isinstance(value, float) and value else value + 1
    elif isinstance(value, str):
        yield "", value + "x"
    elif isinstance(value, frozenset):
        yield "", value | {"another"}
    elif isinstance(value, Path):
        yield "", value.with_name("other.csv")
    else:
        assert value is None, f"a {type(value).__name__} in a spec is unknown to this test"
        yield "", 1


def test_every_field_is_in_the_identity_or_cannot_change_a_number(spec_identity, tmp_path):
    (tmp_path / "other.csv").write_bytes((tmp_path / "table.csv").read_bytes())
    before = identity(spec_identity)
    for field in fields(Sweep):
        value = getattr(spec_identity, field.name)
        for name, other in changed(value):
            path = f"{field.name}{name}"
            impossible = path == "design.table" and value.table is None
            if other == value or impossible:  # a measure that another one requires stays
                continue
            if is_dataclass(value) and name == "":  # the record: there is one or none
                assert field.name == "record" or other is None
                continue
            now = identity(replace(spec_identity, **{field.name: other}))
            assert (now != before) is not any(path.startswith(one) for one in EXEMPT), path


def test_every_exempt_path_is_a_field_and_has_a_reason():
    kinds = {"scene": Scene, "record": Scene, "design": Design}
    for path, reason in EXEMPT.items():
        room, _, name = path.rpartition(".")
        assert name in {field.name for field in fields(kinds[room] if room else Sweep)}
        assert len(reason) > 10


def test_a_field_of_an_unknown_kind_is_an_error(spec_identity):
    with pytest.raises(TypeError, match=r"^title: .* object"):
        identity(replace(spec_identity, title=object()))


def test_differences_are_told_in_the_words_of_a_sweep_file(tmp_path):
    before, now = (parse_spec(SPECS[name], tmp_path / "x.toml") for name in ("bare", "drawn"))
    told = differences(identity(before), identity(now))
    for line in (
        "scene.particles: was 1, is 2",
        "measure.lyapunov: was false, is true",
        "sample.design: was uniform, is sobol",
        "restitution: was 0.9, is [0.8, 0.98]",
        "record.restitution: was not given, is 0.5",
    ):
        assert line in told


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "restitution = [0.8, 0.9]",
            "restitution = { start = 0.1, stop = 0.9, num = 30 }",
            "restitution: was [0.8, 0.9], is { start = 0.1, stop = 0.9, num = 30 }",
        ),
        (
            "launch = [0.0, 0.5]",
            'launch = "staggered"\nparticles = 2',
            "scene.launch: was [0.0, 0.5], is staggered",
        ),
        (
            "duration = 9",
            "duration_periods = 9",
            "scene.duration: was 9.0, is 9.0 forcing periods",
        ),
        (
            "transient = 1",
            "transient_periods = 2",
            "measure.transient: was 1.0, is 2.0 forcing periods",
        ),
    ],
)
def test_a_change_is_told_as_a_sweep_file_gives_it(old, new, line):
    text = """title = "x"
[scene]
launch = [0.0, 0.5]
duration = 9
[sample]
design = "grid"
restitution = [0.8, 0.9]
[measure]
transient = 1
"""
    before, now = identity(parse_spec(text)), identity(parse_spec(text.replace(old, new)))
    others = [one for one in differences(before, now) if not one.startswith("sample.realizations")]
    assert others == [line]


def count(totals, landing):
    totals[0] += 1.0


def test_only_the_fields_that_an_observable_gains_are_reported():
    spec = parse_spec(SPECS["bare"])
    plain, spread = (
        identity(spec.with_observables([Observable("number", count, "landings", **more)]))
        for more in ({}, {"along": "place", "values": [0.0, 1.0]})
    )
    assert differences(plain, spread) == [
        "measure.observables.number.along: was not given, is place",
        "measure.observables.number.values: was not given, is [0.0, 1.0]",
    ]


NUMBER = st.floats(0.0, 1.0)
SEVERAL = st.lists(NUMBER, min_size=2, max_size=6, unique=True).map(sorted)


@given(
    st.tuples(st.just("uniform"), NUMBER)
    | st.tuples(st.just("uniform"), SEVERAL.map(lambda ends: [ends[0], ends[-1]]))
    | st.tuples(st.just("grid"), NUMBER | SEVERAL)
)
def test_a_value_is_held_as_it_was_given(drawn):
    design, value = drawn
    count = "realizations = 3" if design == "uniform" else ""
    sample = f'[sample]\ndesign = "{design}"\n{count}\nrestitution = {json.dumps(value)}\n'
    held = identity(parse_spec(f'title = "x"\n{sample}'))
    assert tomllib.loads(f"value = {held['restitution']}")["value"] == value
    assert held["sample.design"] == design


def test_every_module_that_a_sweep_loads_is_in_the_digest(tmp_path):
    spec = tmp_path / "sweep.toml"
    spec.write_text(SPECS["drawn"] + "\n")
    program = f"""
import json, sys
from pathlib import Path
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import read_spec
run_sweep(read_spec({str(spec)!r}), Path({str(tmp_path / "out.h5")!r}), threads=1)
modules = [m for name, m in sys.modules.items() if name.partition(".")[0] == "vibrosweep"]
print(json.dumps([m.__file__ for m in modules]))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    loaded = {Path(name) for name in json.loads(done.stdout)}
    assert len(loaded) > 40
    package = Path(vibrosweep.__file__).parent
    kinds = {package / "api" / name for name in ("__init__.py", "result_kinds.py")}
    assert loaded - set(sources()) <= kinds  # these only say how results are shown
