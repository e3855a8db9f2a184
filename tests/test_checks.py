"""The campaigns of checks/ and benchmarks/: what they judge with, on small cases."""

import inspect
import json
import math
import os
import re
import runpy
import string
import subprocess
import sys
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from llvmlite import binding
from PIL import Image, ImageDraw

import crashes
import definitions
import high_bounce_cost
import noise
import ordering
import page_commands
import redrawn
import resumes
import vibrosweep as vs
from fuzz import FUZZERS, campaign, spoilt_bytes
from methods import ROOT as ROOT_WORK_PRECISION
from methods.ensembles import _numpy_block
from methods.finals import FINALS, error_of, prove_references, read, read_references
from methods.peers_report import NAMES, bare_sentence, peers_table, read_rows
from methods.report import report
from methods.scenes import SCENES
from methods.scenes import Sweep as Sweep_peers
from methods.scenes import table as table_peers
from methods.truth import prove, worst
from page_commands import PAGES, Step, all_steps, steps
from page_commands import ROOT as ROOT_PAGE_COMMANDS
from regressions import Collector, Verdict, again, better, compare
from regressions import report as report_regressions
from tests.cases import each_of
from vibrosweep import theory
from vibrosweep.cli import main
from vibrosweep.commands import COMMANDS
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import SpecError
from vibrosweep.proof.sampling import deviates_of
from vibrosweep.runs import driver as run
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.sweep import Sweep, parse_spec
from vibrosweep.store import disk

# The quick part of the campaign of power cuts; checks/crashes.py is the whole of it.

SHORT = [name for name in crashes.SCENARIOS if name != "200 chunks"]


@pytest.mark.parametrize("name", SHORT)
def test_the_same_command_goes_on_after_a_power_cut(tmp_path, name):
    findings = crashes.campaign(tmp_path / "disk", crashes.SCENARIOS[name], 12, seed=5)
    assert findings.states == 12
    assert findings.failures == 0
    assert (findings.finished > 0) is (name != "one chunk")


@pytest.mark.parametrize("lost", ["bytes", "names"])
def test_the_campaign_notices_data_that_are_not_flushed(tmp_path, monkeypatch, lost):
    if lost == "bytes":  # as if the run had not asked for it
        monkeypatch.setattr(crashes.Recorder, "_flushes", lambda self, descriptor: None)
    else:
        monkeypatch.setattr(disk, "flush_directory", lambda path: None)
    findings = crashes.campaign(tmp_path / "disk", crashes.SCENARIOS["3 chunks"], 15, seed=1)
    assert findings.lost > 0


# The quick part of the campaign of interruptions; checks/resumes.py is the whole of it.


def test_interrupted_and_changed_sweeps_are_refused_or_come_out_the_same(tmp_path):
    findings = resumes.campaign(tmp_path, 5, seed=3)
    assert findings.failures == 0
    assert findings.resumes > 5
    assert findings.refused > 2


def test_the_campaign_notices_a_wrong_resume(tmp_path, monkeypatch):
    monkeypatch.setattr("vibrosweep.runs.driver.differences", lambda before, now: [])
    findings = resumes.campaign(tmp_path, 3, seed=3)
    assert findings.wrongly_taken + findings.harmed > 0


@each_of("seed", range(40))
def test_the_identity_changes_exactly_if_the_change_must_be_refused(seed):
    rng = np.random.default_rng(seed)
    tables = resumes.random_tables(rng)
    other, key = resumes.changed(tables, rng)
    before, now = (resumes.parse_spec(resumes.text_of(t)) for t in (tables, other))
    assert (run.identity(before) == run.identity(now)) is (key == "")


# The pictures of the pages have recipes, and an old one is told from a new one.

ROOT = Path(__file__).parents[1]


def test_every_picture_has_a_recipe():
    assert sorted(redrawn.RECIPES) == sorted(redrawn.STORED)


def test_recipes_name_files_that_exist():
    for recipe in redrawn.RECIPES.values():
        for word in recipe.lines.split():
            if word.startswith("{ROOT}"):
                assert Path(word.replace("{ROOT}", str(ROOT))).exists(), word


@pytest.mark.parametrize(
    ("draw", "numbers"),
    [
        (high_bounce_cost.draw_limit, (np.array([0.1, 1.0]), {1.0: np.ones((2, 2))})),
        (noise.staggering, ({kind: ([0.1, 1], [1, 0]) for kind in noise.WORDS},)),
        (ordering.draw_phases, ([(0.1, 0.4)] * 2, np.zeros((2, 1, 3)), [0])),
    ],
)
def test_campaigns_draw_their_pictures(draw, numbers, tmp_path):
    draw(*numbers).savefig(tmp_path / "picture.png")


@pytest.mark.parametrize(
    "picture",
    ["peers", *(pytest.param(p, marks=pytest.mark.weekly) for p in ("cost", "work_precision"))],
)
def test_times_are_drawn_from_their_stored_tables(picture, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    redrawn.draw_stored(picture)
    old, new = redrawn.STORED[picture], tmp_path / f"{picture}.png"
    assert redrawn.changed(old, new) < redrawn.TOLERANCE


def test_a_legend_that_has_moved_is_noticed_and_fewer_colours_are_not(tmp_path):
    old = redrawn.STORED["parameter_plane"]
    image = Image.open(old).convert("RGB")
    image.quantize(64).save(tmp_path / "fewer.png")  # as few as any script keeps
    assert redrawn.changed(old, tmp_path / "fewer.png") < redrawn.TOLERANCE / 2
    ImageDraw.Draw(image).rectangle((150, 35, 250, 60), fill="black")  # a word or two
    image.save(tmp_path / "legend.png")
    assert redrawn.changed(old, tmp_path / "legend.png") > redrawn.TOLERANCE


# Damaged and invented input: a short form of checks/fuzz.py, and properties of all sweep files.

NUMBERS = st.one_of(
    st.integers(),
    st.floats(),
    st.sampled_from(["1e400", "-nan", "0x10", "9" * 5000, "1_000", "2026-01-01", "true"]),
).map(str)
TEXTS = st.text().map(lambda text: f"{text!a}") | st.text(string.printable)
VALUES = st.recursive(
    NUMBERS | TEXTS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4).map(lambda items: f"[{', '.join(items)}]"),
        st.fixed_dictionaries({"start": inner, "stop": inner, "num": inner}).map(
            lambda items: f"{{ {', '.join(f'{k} = {v}' for k, v in items.items())} }}"
        ),
    ),
    max_leaves=6,
)
KEYS = [(table, key) for table, keys in SECTIONS.items() for key in keys]
ENTRIES = st.lists(st.tuples(st.sampled_from(KEYS), VALUES), max_size=6)


def either_valid_or_refused(text):
    """Any other exception fails the test."""
    with suppress(SpecError):
        assert isinstance(parse_spec(text), Sweep)


@given(ENTRIES)
@settings(max_examples=100)
def test_any_value_of_any_key_is_accepted_or_refused(entries):
    tables = {}
    for (table, key), value in entries:
        tables.setdefault(table, {})[key] = value
    sections = (
        f"[{table}]\n" + "\n".join(f"{key} = {value}" for key, value in keys.items())
        for table, keys in tables.items()
    )
    either_valid_or_refused('title = "x"\n' + "\n".join(sections))


@given(st.text())
@settings(max_examples=50)
def test_any_text_is_accepted_or_refused(text):
    either_valid_or_refused(text)


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("sweep files", 12),
        ("tables", 8),
        ("result files", 8),
        pytest.param("results saved again", 8, marks=pytest.mark.weekly),  # their pages take long
    ],
)
def test_nothing_fails_badly(name, number, capsys):
    """No traceback, no hang, nothing written beside the output, no changed numbers shown."""
    (found,) = campaign({name: number}, seed=11).values()
    assert found.failures == []
    assert found.ends.total() >= number
    assert found.ends["refused"] > 0
    assert name in FUZZERS


def test_most_spoilt_bytes_differ_from_sound_ones():
    rng = np.random.default_rng(1)
    sound = bytes(range(256)) * 8
    assert sum(spoilt_bytes(rng, sound) != sound for _ in range(50)) > 40


# The quick part of checks/definitions.py: each measure has one meaning, over every base.


@pytest.mark.parametrize("base", definitions.BASES)
def test_measures_of_windows_that_begin_and_end_anywhere(base):
    rng, compared = np.random.default_rng(21), 0
    with Workers(1) as workers:
        for _ in range(12):
            count, wrong = definitions.windows(rng, base, workers)
            assert not wrong
            compared += count
    assert compared > 24


def test_bases_agree_in_their_common_limit():
    rng, compared = np.random.default_rng(22), 0
    with Workers(1) as workers:
        for _ in range(16):
            count, wrong = definitions.limit(rng, workers)
            assert not wrong
            compared += count
    assert compared > 24


@pytest.mark.parametrize("base", definitions.BASES)
def test_realizations_do_not_depend_on_what_was_computed_before(base):
    compared, wrong = definitions.orders(np.random.default_rng(0), base)
    assert compared > 0
    assert not wrong


def test_the_campaign_sees_a_stay_that_is_left_out(monkeypatch):
    """A window may begin or end in a stay."""
    monkeypatch.setattr(definitions.Recorded, "stay_ends", lambda own, landed: landed[0])
    rng, wrong = np.random.default_rng(21), []
    with Workers(1) as workers:
        for _ in range(12):
            wrong += definitions.windows(rng, "moving", workers)[1]
    assert any("base_shared" in one for one in wrong)


def test_a_record_knows_the_lift_off_after_a_stay_in_progress_at_the_end():
    scene = {"restitution": 0.2, "base_acceleration": 1.3, "launch_velocity": 3.0}
    mount = {"mass_ratio": 0.0, "mount_frequency": 0.5}
    last = [
        vs.simulate(base=base, duration=9.2, **scene, **of).isel(impact=-1).squeeze()
        for base, of in (("moving", {}), ("sprung", mount))
    ]
    for name in ("landing_time", "liftoff_time", "rebound_velocity"):
        assert float(last[1][name]) == pytest.approx(float(last[0][name]), rel=1e-13)
    assert float(last[0].landing_time) < 9.2 < float(last[1].liftoff_time)


def test_a_joint_cycle_without_mass_is_that_of_the_particles_together():
    """Rounding neither triples the joint cycle nor reorders particles that coincide."""
    rng = np.random.default_rng(5)
    scenes = {
        "restitution": np.append(rng.uniform(0.0, 0.9, 40), 0.7568630633759008),
        "base_acceleration": np.append(rng.uniform(0.2, 3.0, 40), 0.9230077991579027),
    }
    launched = {"launch": [0.0, 0.3, 0.77], "duration": 300.0}
    each = vs.sweep(base="moving", design=scenes, regimes=True, **launched)
    joint = vs.sweep(
        base="sprung", design=scenes, joint=True, mass_ratio=0.0, mount_frequency=2.8, **launched
    )
    compared = rested = 0
    for i in range(41):
        periods = each.cycle_periods.values[i].tolist()
        if min(periods) == 0 or joint.joint_cycle_impacts[i] == 0:
            continue
        whole = math.lcm(*periods)
        assert joint.joint_cycle_periods[i] == whole
        for name in ("impacts", "rests"):
            own = each[f"cycle_{name}"].values[i].tolist()
            together = sum(n * whole // p for n, p in zip(own, periods, strict=True))
            assert joint[f"joint_cycle_{name}"][i] == together
        compared, rested = compared + 1, rested + int(joint.joint_cycle_rests[i] > 0)
    assert compared > 10
    assert rested > 3


# Work and precision: the references are proved, and the page shows what is stored.

REFERENCES = read_references()
ROWS = read(FINALS)
SCENE = {scene.key: scene for scene in SCENES}
TABLE = read(ROOT_WORK_PRECISION / "benchmarks" / "work_precision.csv")


def test_every_particle_of_every_problem_has_a_reference():
    assert list(REFERENCES) == list(SCENE)
    for key, kept in REFERENCES.items():
        assert [r.launch_time for r in kept] == SCENE[key].sample.tolist()
        assert all(float(r.radius) <= 1e-30 for r in kept)


def test_the_stored_references_are_proved_again():
    assert list(prove_references([SCENE["tones"]])) == REFERENCES["tones"]


def test_the_stored_noise_is_what_the_package_draws():
    for kept in REFERENCES["noise"]:
        drawn = deviates_of(0, 0.0, kept.particle).of_impact
        assert kept.deviates.split() == [repr(drawn(n)[1]) for n in range(kept.landings)]


def test_the_package_reproduces_the_references_of_the_locked_problem():
    scene = SCENE["locked"]
    launches = scene.sample.tolist()
    found = vs.simulate(**scene.parameters, launch=launches, duration=scene.duration)
    assert found.impact_count.values[0].tolist() == [r.landings for r in REFERENCES["locked"]]
    last = found.landing_time.values[0, :, REFERENCES["locked"][0].landings - 1]
    row = {"finals": " ".join(map(repr, last.tolist()))}
    assert error_of(row, REFERENCES["locked"]) <= 0.5 * math.ulp(scene.duration)


def test_errors_are_those_of_the_stored_times():
    kept = REFERENCES["tones"]
    exact = [float(Fraction(r.last_landing)) for r in kept]
    row = {"finals": " ".join(map(repr, [*exact[:-1], exact[-1] + 0.25]))}
    assert error_of(row, kept) == pytest.approx(0.25, rel=1e-12)
    assert math.isnan(error_of({"finals": " ".join(["nan"] * len(kept))}, kept))


def test_every_row_names_processor_versions_and_settings():
    for row in ROWS:
        for column in ("processor", "date", "versions", "setting", "threads", "precision"):
            assert row[column]
        assert "Python" in row["versions"]
        assert "numpy" in row["versions"]
    assert {row["scene"] for row in ROWS if row["method"] == "kernel"} == set(SCENE)


def test_the_page_and_its_table_show_what_is_stored():
    for row in TABLE:
        (stored,) = (r for r in ROWS if all(r[c] == row[c] for c in ("scene", "method", "setting")))
        error = error_of(stored, REFERENCES[row["scene"]])
        assert row["last_landing_error_s"] == f"{error:.3e}"
    assert len(TABLE) == len(ROWS)
    page = (ROOT_WORK_PRECISION / "benchmarks" / "work-precision.md").read_text(encoding="utf-8")
    assert page == report(TABLE, REFERENCES)


# The comparison with peers: what the page shows is the stored table.

ROWS_PEERS = read_rows(ROOT / "benchmarks" / "peers.csv")
PAGE = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("<!-- begin peers -->")[2].partition("<!-- end peers -->")[0]


def test_the_page_shows_the_stored_table():
    assert peers_table(ROWS_PEERS) in SECTION
    assert bare_sentence(ROWS_PEERS) != ""
    assert " ".join(bare_sentence(ROWS_PEERS).split()) in " ".join(SECTION.split())


def test_every_peer_has_a_time_and_an_error_in_both_scenes():
    for scene in ("short", "long"):
        found = {row["method"]: row for row in ROWS_PEERS if row["scene"] == scene}
        assert set(found) == set(NAMES)
        for row in found.values():
            assert float(row["ns_per_impact"]) > 0.0
            assert 0.0 < float(row["largest_error_s"]) < 1e-6


def test_the_written_table_shows_the_rows():
    rows = [dict(row) for row in ROWS_PEERS]
    changed = next(row for row in rows if (row["scene"], row["method"]) == ("long", "numpy"))
    changed["ns_per_impact"] = "12345"
    written, changed_to = (peers_table(r).count("| 12,000 |") for r in (ROWS_PEERS, rows))
    assert changed_to == written + 1


@pytest.fixture(scope="module")
def sweep():
    return Sweep_peers("tiny", "Tiny", 12, 4, 6.0, 6, (1e-12,))


def test_trajectories_of_a_sweep_are_all_pairs(sweep):
    rows = sweep.table
    assert rows.shape == (48, 8)
    assert np.array_equal(rows[:, 0], np.repeat(sweep.arrays["restitution"], 4))
    assert np.array_equal(rows[:4, -1], [0.0, 0.25, 0.5, 0.75])
    assert np.array_equal(table_peers(sweep.cases), rows[sweep.chosen])
    assert len(set((sweep.chosen // 4).tolist())) == 6
    assert set((sweep.chosen % 4).tolist()) == {0, 1, 2, 3}


def test_numpy_follows_the_proved_orbits(sweep):
    orbits = prove(sweep)
    times = np.full((6, 200), np.nan)
    landings = _numpy_block(table_peers(sweep.cases), sweep.duration, times)
    error, missing = worst(orbits, list(times))
    assert landings == sum(orbit.size for orbit in orbits)
    assert missing == ""
    assert error < 1e-10


# The comparison of benchmark figures with stored ones, on made-up numbers.

FAMILY = binding.get_host_cpu_name()
BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def words(stored, measured):
    return {v.name: v.word for v in compare(stored, measured)}


@pytest.mark.parametrize(
    ("slower", "word", "fails"),
    [(1.26, "WORSE", True), (1.24, "as before", False), (1.0, "as before", False),
     (1 / 1.24, "as before", False), (1 / 1.26, "improved", False)],
)  # fmt: skip
def test_a_figure_is_worse_if_the_time_grows_by_more_than_a_quarter(slower, word, fails):
    (verdict,) = compare({"a": 8.0}, {"a": 8.0 / slower})
    assert verdict.word == word
    assert verdict.fails == fails


def test_a_missing_figure_fails_and_a_new_one_is_told():
    verdicts = compare({"gone": 1.0, "kept": 2.0}, {"kept": 2.0, "fresh": 3.0})
    assert [(v.name, v.word, v.fails) for v in verdicts] == [
        ("fresh", "new", False),
        ("gone", "MISSING", True),
        ("kept", "as before", False),
    ]


def test_the_report_names_figures_and_another_family():
    verdicts = [Verdict("a", 8.0, 5.0), Verdict("b", 1.0, None), Verdict("c", 1.0, 2.0)]
    text = report_regressions(verdicts, "one", ["one", "two"])
    assert [line.split()[0] for line in text.splitlines()] == ["WORSE", "MISSING", "improved"]
    assert "8 ->        5  a" in text
    assert "judged" not in text
    assert "no figures are stored for two, only for one: nothing is judged" in report_regressions(
        verdicts, "two", ["one"]
    )


def test_worse_and_failed_tests_are_run_again_and_the_better_run_counts():
    found = Collector()
    found.figures, found.failed = {"a": 1.0, "b": 2.0, "c": 3.0}, {"c"}
    stored = {"a": 2.0, "b": 2.0, "c": 3.0, "gone": 1.0}
    assert again(stored, found) == ["a", "c"]
    assert better(found.figures, {"a": 1.9, "c": 2.0}) == {"a": 1.9, "b": 2.0, "c": 3.0}


RACES = """
import os
import time

def test_race(race):
    race(lambda: spin(float(os.environ["SUBJECT"])), lambda: spin(0.01), rounds=5)
    assert "MISS" not in os.environ

def test_can_fail():
    assert "FAIL" not in os.environ

def spin(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass
"""
NAME = "benchmarks/test_made_up.py::test_race"


@pytest.fixture
def command_regressions(tmp_path):
    """The real command in a folder with two made-up benchmarks; returns exit code and output."""
    folder = tmp_path / "benchmarks"
    folder.mkdir()
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\n", encoding="utf-8")
    (folder / "test_made_up.py").write_text(RACES, encoding="utf-8")
    for name in ("conftest.py", "regressions.py"):
        (folder / name).write_bytes((BENCHMARKS / name).read_bytes())

    def run(*options, **environment):
        done = subprocess.run(
            [sys.executable, str(folder / "regressions.py"), *options],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=False,
        )
        print(done.stdout, done.stderr)  # shown where the test fails
        return done.returncode, done.stdout

    run.stored = folder / "ratios.json"
    return run


def test_the_command_stores_compares_and_fails(command_regressions):
    assert command_regressions("--store", SUBJECT="0.005")[0] == 0
    stored = json.loads(command_regressions.stored.read_text(encoding="utf-8"))[FAMILY]
    assert stored["processor"] != ""
    assert stored["ratios"] == {NAME: pytest.approx(2.0, rel=0.2)}
    code, said = command_regressions(SUBJECT="0.015")
    assert code == 1
    assert re.search(rf"^WORSE .* {re.escape(NAME)}$", said, re.MULTILINE)
    assert said.count("times the speed") == 2  # it was given a second chance
    code, said = command_regressions(SUBJECT="0.005", FAIL="1", MISS="1")
    assert (code, f"misses a target, twice: {NAME}" in said) == (1, True)
    assert "as before" in said
    assert "FAILED, twice: benchmarks/test_made_up.py::test_can_fail" in said


@pytest.mark.weekly
def test_a_missing_figure_fails_and_storing_drops_it(command_regressions):
    gone = "benchmarks/test_gone.py::test"
    known = {"ratios": {NAME: 2.0, gone: 1.0}}
    command_regressions.stored.write_text(json.dumps({FAMILY: known}), encoding="utf-8")
    code, said = command_regressions(SUBJECT="0.005")
    assert code == 1
    assert re.search(rf"^MISSING .* {re.escape(gone)}$", said, re.MULTILINE)
    assert command_regressions("--store", SUBJECT="0.005")[0] == 0
    assert list(
        json.loads(command_regressions.stored.read_text(encoding="utf-8"))[FAMILY]["ratios"]
    ) == [NAME]


@pytest.mark.weekly
def test_a_figure_that_misses_a_target_is_stored_and_a_broken_test_keeps_its_own(
    command_regressions,
):
    broken = "benchmarks/test_made_up.py::test_can_fail"
    known = {"ratios": {NAME: 9.0, broken: 3.0}}
    command_regressions.stored.write_text(json.dumps({FAMILY: known}), encoding="utf-8")
    code, said = command_regressions("--store", SUBJECT="0.005", MISS="1", FAIL="1")
    assert code == 1  # for the broken one
    assert f"misses a target, twice: {NAME}" in said
    ratios = json.loads(command_regressions.stored.read_text(encoding="utf-8"))[FAMILY]["ratios"]
    assert ratios == {NAME: pytest.approx(2.0, rel=0.2), broken: 3.0}


@pytest.mark.weekly
def test_another_family_is_measured_and_not_judged(command_regressions):
    known = {"abacus": {"ratios": {NAME: 1e9, "benchmarks/test_gone.py::test": 1.0}}}
    command_regressions.stored.write_text(json.dumps(known), encoding="utf-8")
    code, said = command_regressions(SUBJECT="0.005")
    assert code == 0
    assert re.search(rf"^new .* {re.escape(NAME)}$", said, re.MULTILINE)
    assert "only for abacus: nothing is judged" in said
    assert command_regressions("--store", SUBJECT="0.005")[0] == 0
    stored = json.loads(command_regressions.stored.read_text(encoding="utf-8"))
    assert stored["abacus"] == known["abacus"]
    assert stored[FAMILY]["ratios"][NAME] == pytest.approx(2.0, rel=0.2)


def test_every_stored_figure_is_of_a_test_that_exists():
    families = json.loads((BENCHMARKS / "ratios.json").read_text(encoding="utf-8"))
    assert families
    for stored in families.values():
        assert {"processor", "date", "versions"} < set(stored)
        assert len(stored["ratios"]) >= 10
        for name, ratio in stored["ratios"].items():
            path, _, test = name.partition("::")
            function = runpy.run_path(str(BENCHMARKS.parent / path))[test.partition("[")[0]]
            assert "race" in inspect.signature(function).parameters
            assert ratio > 0.0


# ``vibrosweep windows``, ``bifurcation`` and ``basins``: what they write, what they refuse.

SWEEPS = Path(__file__).parents[1] / "sweeps"
SPEC = """
title = "Windows of a test"
[scene]
particles = 2
duration = 100.0
[sample]
design = "grid"
restitution = [0.7, 0.8, 0.9]
amplitude = { start = 0.2, stop = 4.0, num = 12 }
[windows]
conditions = ["locked(1)", "periodic"]
"""


@pytest.fixture
def spec(tmp_path):
    def write(text=SPEC):
        path = tmp_path / "w.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_windows_and_their_picture_are_written(spec, tmp_path, capsys):
    output = tmp_path / "found.h5"
    assert main(["windows", str(spec()), "-o", str(output), "--threads", "2"]) == 0
    printed = capsys.readouterr().out
    assert "locked(1)" in printed
    assert "holds at 3 of 3 restitutions" in printed
    with xr.open_dataset(output, engine="h5netcdf") as found:
        one = found.sel(condition="locked(1)", direction="launch").isel(window=0)
        exact = theory.amplitude_min(1, found["restitution"].values)
        assert one["A_min"].values == pytest.approx(exact, rel=1e-8)
        assert found.attrs["title"] == "Windows of a test"
        assert found.attrs["sweep_file"] == SPEC
        assert found.attrs["Conventions"].startswith("CF")
        assert found["A_min"].attrs["units"] == "m s-1"
    assert output.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("conditions", "duration", "told"),
    [
        ('["locked(1)", "periodic"]', 100.0, True),
        ('["locked(1)", "periodic"]', 2000.0, False),
        ('["locked(1)", "separated"]', 100.0, False),  # no orbit has to be recognised
    ],
)
def test_too_short_an_observation_is_told(conditions, duration, told, spec, tmp_path, capsys):
    text = SPEC.replace('["locked(1)", "periodic"]', conditions)
    output = tmp_path / "found.h5"
    file = spec(text.replace("duration = 100.0", f"duration = {duration}"))
    assert main(["windows", str(file), "-o", str(output)]) == 0
    assert ("may be called unsettled" in capsys.readouterr().out) == told
    with xr.open_dataset(output, engine="h5netcdf") as found:
        assert ("may be called unsettled" in found.attrs["notes"]) == told


def test_launches_of_basins_may_be_listed_in_any_order(spec, tmp_path):
    text = SPEC.replace("amplitude = {", "launch_velocity = {").replace("restitution = [", "# [")
    text = text[: text.index("[windows]")]
    times = [0.7, 0.1, 0.4, 0.1]
    sketch = "particles = 4\nlaunch = {}"
    pictures = []
    for launch in (times, sorted(times)):
        output = tmp_path / f"{len(pictures)}.h5"
        listed = text.replace("particles = 2", sketch.format(launch))
        assert main(["basins", str(spec(listed)), "-o", str(output)]) == 0
        with xr.open_dataset(output, engine="h5netcdf") as found:
            assert found["launch_time"].values.tolist() == [0.1, 0.4, 0.7]
        pictures.append(output.with_suffix(".png").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '[windows]\nconditions = ["locked(1)", "periodic"]',
            "",
            ["[windows] is missing", "ordered"],
        ),
        ('"periodic"', '"periodical"', ["windows.conditions", "'periodical' is not known"]),
        ('["locked(1)", "periodic"]', "[]", ["windows.conditions", "one or more names"]),
        ("[windows]", "[windows]\ntolerance = 2.0", ["windows.tolerance = 2.0", "below 1"]),
        ("[windows]", "[windows]\nalong = 1", ["windows.along = 1", "continuation"]),
        (
            "amplitude = { start = 0.2, stop = 4.0, num = 12 }",
            "",
            ["sample.amplitude", "with an axis of amplitude"],
        ),
        ("[sample]", "[sample]\nfrequency = [1.0, 2.0]", ["sample.frequency", "axis of amplitude"]),
        ("[windows]", "[windows]\ncontinuation = 1", ["windows.continuation = 1", "true or false"]),
    ],
)
def test_mistakes_are_named_before_anything_is_written(old, new, words, spec, tmp_path, capsys):
    assert old in SPEC
    output = tmp_path / "found.h5"
    assert main(["windows", str(spec(SPEC.replace(old, new))), "-o", str(output)]) == 2
    message = capsys.readouterr().err
    for word in [*words, "w.toml"]:
        assert word in message
    assert "Traceback" not in message
    assert list(tmp_path.iterdir()) == [tmp_path / "w.toml"]


GRID = """
title = "A grid of a test"
[scene]
particles = 8
duration = 600.0
[sample]
design = "grid"
"""


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("orbits", "1 impact / 1 period"),
        ("branches", "period doubling at 3.57576764885 m s-1"),
        ("boundaries", "saddle node"),
    ],
)
def test_the_examples_of_orbits_are_computed_and_drawn(command, words, tmp_path, capsys):
    output = tmp_path / "found.h5"
    limits = ["--impacts", "1", "--periods", "1"]
    assert main([command, str(SWEEPS / f"{command}.toml"), "-o", str(output), *limits]) == 0
    assert words in capsys.readouterr().out
    assert output.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("command", "axis", "options", "words"),
    [
        (
            "bifurcation",
            "restitution = [0.8, 0.9]",
            [],
            ["sample.restitution", "axis of amplitude"],
        ),
        ("bifurcation", "amplitude = [1.0, 2.0]", ["--observable", "height"], ["rebound_height"]),
        (
            "basins",
            "amplitude = [1.0, 2.0]",
            [],
            ["sample.launch_velocity", "axis of launch_velocity"],
        ),
        (
            "windows",
            'frequency = [0.5, 1.0]\n[windows]\nconditions = ["locked(1)"]',
            [],
            ["sample.frequency", "axis of amplitude"],
        ),
    ],
)
def test_a_grid_of_the_wrong_axes_is_refused(command, axis, options, words, spec, tmp_path, capsys):
    output = tmp_path / "found.h5"
    assert main([command, str(spec(GRID + axis)), "-o", str(output), *options]) == 2
    message = capsys.readouterr().err
    for word in words:
        assert word in message
    assert not output.exists()


# Every command of the README and of docs/start.md is tried by checks/page_commands.py.

PAGE_PAGE_COMMANDS = """
```sh
python -m pip install . && vibrosweep run a.toml
vibrosweep info a.h5
```
`vibrosweep one SPEC.toml` or `--two N` needs (`pip install '.[verify]'`). `python -m three` not.

| `vibrosweep four` | does this |
| `vibrosweep five` | does that (needs `pip install '.[explore]'`) |

```python
print(1)
```
```sh
python -m pip install '.[docs]' && python -m six
```
"""


def test_commands_and_what_is_installed_for_them():
    assert [one[1:] for one in steps("page", PAGE_PAGE_COMMANDS)] == [
        ("", "vibrosweep run a.toml"),
        ("", "vibrosweep info a.h5"),
        ("verify", "vibrosweep one SPEC.toml"),
        ("verify", "--two N"),
        ("", "python -m three"),
        ("", "vibrosweep four"),
        ("explore", "vibrosweep five"),
        ("docs", "python -m six"),
        ("", "python -c 'print(1)\n'"),
    ]


def test_every_command_of_the_pages_is_tried():
    tried = [one.command.split() for one in all_steps()]
    assert {words[1] for words in tried if words[0] == "vibrosweep"} >= set(COMMANDS)
    assert Step("README.md", "docs", "python -m sphinx -W docs build/site") in all_steps()
    for page in PAGES:
        text = (ROOT_PAGE_COMMANDS / page).read_text("utf-8")
        assert text.count("pip install ") == len(page_commands.INSTALL.findall(text))


def test_a_new_command_cannot_be_forgotten(monkeypatch, tmp_path):
    monkeypatch.setattr(page_commands, "ROOT", tmp_path)
    monkeypatch.setattr(page_commands, "PAGES", ("new.md",))
    (tmp_path / "new.md").write_text("`vibrosweep shake SPEC.toml`\n")
    with pytest.raises(SystemExit, match=r"FILLED for: new.md: vibrosweep shake SPEC.toml"):
        all_steps()
