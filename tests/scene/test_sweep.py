"""Sweep files."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep.errors import SpecError, TableError
from vibrosweep.mistakes import ABSENT, visible
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import MASSES, MOUNT, OF_MOUNT, PARAMETERS
from vibrosweep.runs.chunks import identity
from vibrosweep.runs.result import silent_defaults
from vibrosweep.scene.design import GridAxis, Range, open_design
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.sweep import keyword_spec, parse_spec, read_spec

# Every kind of mistake is named by file, key, value and allowed values; sound files are read.

SWEEPS = sorted((Path(__file__).parents[2] / "sweeps").glob("*.toml"))
TITLE = 'title = "x"\n'


def message(text: str) -> str:
    with pytest.raises(SpecError) as caught:
        parse_spec(text, Path("dir/bad.toml"))
    return str(caught.value)


def test_paper():
    spec = read_spec(next(p for p in SWEEPS if p.name == "paper.toml"))
    assert spec.design.name == "uniform"
    assert (spec.design.realizations, spec.design.seed, spec.scene.particles) == (200, 1, 20)
    assert dict(spec.design.sampled) == {
        "restitution": Range(0.80, 0.98),
        "amplitude": Range(0.2, 3.5),
    }
    assert spec.scene.inputs["gravity"] == 9.81
    assert spec.scene.inputs.keys() | spec.design.sampled.keys() == PARAMETERS.keys()
    assert spec.scene.given == {"frequency", "launch_velocity"}
    assert spec.scene.measures.separation
    assert spec.record is not None
    assert spec.record.duration == 120.0
    assert spec.record.particles == 20
    assert list(spec.record.inputs) == list(PARAMETERS)


@each_of("path", SWEEPS)
def test_every_sweep_of_the_repository_is_sound(path):
    spec = read_spec(path)
    text = path.read_text(encoding="utf-8")
    if "trace =" in text:  # a sweep holds the measured waveform and no longer needs the trace
        assert parse_spec(spec.text).scene == spec.scene
    else:
        assert spec.text == text
    assert spec.source == path
    assert len(spec.title) > 20


def test_all_sweeps_are_there():
    names = "basins bifurcation bifurcation_reflect laboratory million paper plane population"
    names += " basin_shares boundaries branches orbits"
    names += " inelastic moving ordering shaker noisy_lock steel_ball two_tones"
    names += (
        " return_map sensitivity separations single_ball twenty_balls windows windows_hysteresis"
    )
    fewer = [f"population_{n:03}" for n in (5, 10, 20, 50)]
    assert [p.stem for p in SWEEPS] == sorted([*names.split(), *fewer])


def test_populations_differ_in_the_number_of_particles_alone():
    specs = [read_spec(p) for p in SWEEPS if p.stem.startswith("population")]
    assert sorted(s.scene.particles for s in specs) == [5, 10, 20, 50, 100]
    same = [(replace(s.scene, particles=1), s.design, s.windows) for s in specs]
    assert all(one == same[0] for one in same)


def test_laboratory_keeps_the_dimensionless_kick_of_the_paper():
    spec = read_spec(next(p for p in SWEEPS if p.stem == "laboratory"))
    f, amplitude = spec.design.sampled["frequency"], spec.design.sampled["amplitude"]
    kicks = [2 * f.low * amplitude.low / 9.81, 2 * f.high * amplitude.high / 9.81]
    assert 2 * 0.2 / 9.81 <= kicks[0] <= kicks[1] <= 2 * 3.5 / 9.81


def test_defaults():
    spec = parse_spec(TITLE)
    assert dict(spec.scene.inputs) == {name: p.default for name, p in PARAMETERS.items()}
    assert (spec.scene.particles, spec.scene.launch, spec.scene.duration, spec.scene.rebound) == (
        1,
        "staggered",
        12.0,
        "rest",
    )
    assert (spec.design.name, spec.design.realizations, spec.design.seed, spec.record) == (
        "uniform",
        1,
        0,
        None,
    )
    assert spec.scene.measures == Measures()
    assert spec.scene.given == frozenset()


def test_an_integer_serves_as_a_number_and_stays_float():
    spec = parse_spec(f"{TITLE}[scene]\namplitude = 2\nduration = 3\nlaunch = [0, 1]")
    assert isinstance(spec.scene.inputs["amplitude"], float)
    assert isinstance(spec.scene.duration, float)
    assert spec.scene.launch == (0.0, 1.0)
    assert spec.scene.particles == 2


def test_sampled_parameters_keep_the_order_of_the_registry():
    text = f"{TITLE}[sample]\nrealizations = 3\namplitude = [1, 2]\nrestitution = [0, 1]\ngravity=2"
    spec = parse_spec(text)
    assert list(spec.design.sampled) == ["restitution", "amplitude"]
    assert spec.scene.inputs["gravity"] == 2.0


def test_grid():
    spec = parse_spec(
        f'{TITLE}[sample]\ndesign = "grid"\nrestitution = {{ start = 0.8, stop = 0.9, num = 3 }}\n'
        "amplitude = [2.0, 1.0]\nphase = [0.5]\nrealizations = 6"
    )
    assert spec.design.sampled["amplitude"] == GridAxis((2.0, 1.0))
    assert spec.design.sampled["restitution"].values == pytest.approx((0.8, 0.85, 0.9))
    assert spec.design.realizations == 6


def test_table_path_is_relative_to_the_file():
    text = f'{TITLE}[sample]\ndesign = "t/rows.csv"\ncolumns = ["amplitude", "restitution"]'
    spec = parse_spec(text, Path("dir/sweep.toml"))
    assert spec.design.name == "table"
    assert spec.design.table == Path("dir/t/rows.csv")
    assert spec.design.columns == ("restitution", "amplitude")
    assert spec.design.realizations is None
    assert "amplitude" not in spec.scene.inputs


def test_record_overrides_the_scene():
    spec = parse_spec(
        f"{TITLE}[scene]\nparticles = 3\namplitude = 2.0\n[record]\nlaunch = [0.0, 0.5]\n"
        'rebound = "reflect"\nphase = 1.0'
    )
    assert spec.record is not None
    assert (spec.record.particles, spec.record.rebound) == (2, "reflect")
    assert spec.record.inputs["phase"] == 1.0
    assert spec.record.inputs["amplitude"] == 2.0
    assert spec.scene.inputs["phase"] == 0.0


def test_tables_of_the_schema_know_every_parameter():
    for table in ("scene", "sample", "record"):
        assert [name for name in SECTIONS[table] if name in PARAMETERS] == list(PARAMETERS)


NAN = math.nan
MISTAKES = {
    "no title": ("", "title", ABSENT),
    "title type": ("title = 3", "title", 3),
    "empty title": ('title = " "', "title", " "),
    "title that a terminal obeys": (r'title = "a\u001b[2J"', "title", "a\x1b[2J"),
    "unknown table": ("[sampel]", "sampel", {}),
    "unknown key": ("[scene]\nfrequencey = 3", "scene.frequencey", 3),
    "key of another table": ("[measure]\nseed = 3", "measure.seed", 3),
    "top-level key": ("seed = 3", "seed", 3),
    "table type": ("scene = 3", "scene", 3),
    "table array": ("[[record]]", "record", [{}]),
    "number type": ('[scene]\ngravity = "9"', "scene.gravity", "9"),
    "bool is not a number": ("[scene]\ngravity = true", "scene.gravity", True),
    "nan": ("[scene]\nphase = nan", "scene.phase", NAN),
    "inf": ("[scene]\namplitude = inf", "scene.amplitude", math.inf),
    "huge integer": (f"[scene]\nphase = {'9' * 400}", "scene.phase", 10**400 - 1),
    "range": ("[scene]\nrestitution = 1.2", "scene.restitution", 1.2),
    "open range": ("[record]\nfrequency = 0", "record.frequency", 0),
    "particles": ("[scene]\nparticles = 0", "scene.particles", 0),
    "too many particles": (f"[scene]\nparticles = 1{400 * '0'}", "scene.particles", 10**400),
    "particles type": ("[scene]\nparticles = 2.0", "scene.particles", 2.0),
    "launch word": ('[scene]\nlaunch = "now"', "scene.launch", "now"),
    "launch value": ("[scene]\nlaunch = [0.0, inf]", "scene.launch", [0.0, math.inf]),
    "launch empty": ("[scene]\nlaunch = []", "scene.launch", []),
    "launch length": ("[scene]\nparticles = 3\nlaunch = [0.0, 1.0]", "scene.particles", 3),
    "record launch length": (
        "[scene]\nlaunch = [0.0, 1.0]\n[record]\nparticles = 5",
        "record.particles",
        5,
    ),
    "duration": ("[scene]\nduration = 0", "scene.duration", 0),
    "rebound": ('[scene]\nrebound = "stick"', "scene.rebound", "stick"),
    "design": ('[sample]\ndesign = "sobel"', "sample.design", "sobel"),
    "design type": ("[sample]\ndesign = 3", "sample.design", 3),
    "no realizations": ("[sample]\nphase = [0.0, 1.0]", "sample.realizations", ABSENT),
    "realizations": ("[sample]\nrealizations = 0", "sample.realizations", 0),
    "seed": ("[sample]\nseed = -1", "sample.seed", -1),
    "huge seed": (f"[sample]\nseed = {2**63}", "sample.seed", 9223372036854775808),
    "empty range": (
        "[sample]\nrealizations = 2\nrestitution = [0.9, 0.9]",
        "sample.restitution",
        (0.9, 0.9),
    ),
    "reversed range": (
        "[sample]\nrealizations = 2\nrestitution = [0.98, 0.8]",
        "sample.restitution",
        (0.98, 0.8),
    ),
    "range end": (
        "[sample]\nrealizations = 2\nrestitution = [0.8, 1.2]",
        "sample.restitution",
        [0.8, 1.2],
    ),
    "three numbers": (
        "[sample]\nrealizations = 2\nphase = [0.8, 1.2, 3.0]",
        "sample.phase",
        (0.8, 1.2, 3.0),
    ),
    "empty list": ("[sample]\nphase = []", "sample.phase", []),
    "steps without grid": (
        "[sample]\nrealizations = 2\nphase = { start = 0, stop = 1, num = 2 }",
        "sample.phase",
        {"start": 0.0, "stop": 1.0, "num": 2},
    ),
    "given twice": ("[scene]\nphase = 1.0\n[sample]\nphase = 2.0", "sample.phase", 2.0),
    "grid count": (
        '[sample]\ndesign = "grid"\nrealizations = 3\nphase = [1, 2]',
        "sample.realizations",
        3,
    ),
    "grid too large": (
        '[sample]\ndesign = "grid"\n'
        + "\n".join(
            f"{n} = {{ start = 0.1, stop = 0.2, num = 100000 }}"
            for n in ("phase", "gravity", "amplitude")
        ),
        "sample.realizations",
        ABSENT,
    ),
    "grid duplicate": (
        '[sample]\ndesign = "grid"\nphase = [1, 2, 1]',
        "sample.phase",
        (1.0, 2.0, 1.0),
    ),
    "steps keys": (
        '[sample]\ndesign = "grid"\nphase = { start = 1, end = 2 }',
        "sample.phase",
        {"start": 1, "end": 2},
    ),
    "steps order": (
        '[sample]\ndesign = "grid"\nphase = { start = 2, stop = 1, num = 3 }',
        "sample.phase",
        {"start": 2, "stop": 1, "num": 3},
    ),
    "steps number": (
        '[sample]\ndesign = "grid"\nphase = { start = 1, stop = 2, num = 1 }',
        "sample.phase",
        {"start": 1, "stop": 2, "num": 1},
    ),
    "columns without table": ('[sample]\ncolumns = ["phase"]', "sample.columns", ("phase",)),
    "columns unknown": (
        '[sample]\ndesign = "a.csv"\ncolumns = ["fase"]',
        "sample.columns",
        ["fase"],
    ),
    "columns type": ('[sample]\ndesign = "a.csv"\ncolumns = []', "sample.columns", []),
    "columns twice": (
        '[sample]\ndesign = "a.csv"\ncolumns = ["phase", "phase"]',
        "sample.columns",
        ["phase", "phase"],
    ),
    "column fixed": (
        '[scene]\nphase = 1.0\n[sample]\ndesign = "a.csv"\ncolumns = ["phase"]',
        "sample.columns",
        ("phase",),
    ),
    "range under a table": (
        '[sample]\ndesign = "a.csv"\nphase = [0.0, 1.0]',
        "sample.phase",
        (0.0, 1.0),
    ),
    "transient": ("[scene]\nduration = 5.0\n[measure]\ntransient = 5.0", "measure.transient", 5.0),
    "base": ('[scene]\nbase = "still"', "scene.base", "still"),
    "law without meaning": ('[scene]\nbase = "moving"\nrebound = "reflect"', "scene.", ABSENT),
    "law of the record without meaning": (
        '[scene]\nrebound = "reflect"\n[record]\nbase = "moving"',
        "record.",
        ABSENT,
    ),
    "two forcings": ("[scene]\namplitude = 1.0\nbase_velocity = 0.5", "scene.base_velocity", 0.5),
    "two forcings in two tables": (
        "[scene]\nbase_displacement = 0.1\n[sample]\nrealizations = 2\namplitude = [1.0, 2.0]",
        "sample.amplitude",
        (1.0, 2.0),
    ),
    "two forcings in columns": (
        '[sample]\ndesign = "a.csv"\ncolumns = ["base_velocity", "base_acceleration"]',
        "sample.columns",
        ("base_velocity", "base_acceleration"),
    ),
    "a forcing beside a column": (
        '[scene]\nbase_acceleration = 2.0\n[sample]\ndesign = "a.csv"\ncolumns = ["amplitude"]',
        "sample.columns",
        ("amplitude",),
    ),
    "two forcings of the record": (
        "[record]\namplitude = 1.0\nbase_velocity = 0.5",
        "record.base_velocity",
        0.5,
    ),
    "record lacks the forcing": (
        "[sample]\nrealizations = 2\nbase_velocity = [0.1, 0.2]\n[record]",
        "record.base_velocity",
        ABSENT,
    ),
    "forcing out of range": ("[scene]\nbase_acceleration = -1", "scene.base_acceleration", -1),
    "amplitude too large": (
        "[scene]\nbase_acceleration = 1e29\nfrequency = 0.001",
        "scene.",
        ABSENT,
    ),
    "two durations": (
        "[scene]\nduration = 5.0\nduration_periods = 6.0",
        "scene.duration_periods",
        6.0,
    ),
    "two transients": (
        "[measure]\ntransient = 5.0\ntransient_periods = 6.0",
        "measure.transient_periods",
        6.0,
    ),
    "duration in periods": ("[scene]\nduration_periods = 0", "scene.duration_periods", 0),
    "transient in periods": (
        "[scene]\nduration_periods = 5.0\n[measure]\ntransient_periods = 5.0",
        "measure.transient_periods",
        5.0,
    ),
    "transient in periods, duration in s": (
        "[scene]\nduration = 5.0\nfrequency = 2.0\n[measure]\ntransient_periods = 10.0",
        "measure.transient_periods",
        10.0,
    ),
    "window empty at one frequency": (
        "[scene]\nduration_periods = 5.0\n[measure]\ntransient = 2.0\n"
        "[sample]\nrealizations = 2\nfrequency = [1.0, 3.0]",
        "measure.transient",
        2.0,
    ),
    "uncountable periods": ("[scene]\nduration_periods = 1e20", "scene.", ABSENT),
    "negative transient": ("[measure]\ntransient = -1", "measure.transient", -1),
    "bool": ("[measure]\nseparation = 1", "measure.separation", 1),
    "bool text": ('[measure]\nper_particle = "yes"', "measure.per_particle", "yes"),
    "budget": ("[measure]\nimpact_budget = 0", "measure.impact_budget", 0),
    "record lacks": (
        "[sample]\nrealizations = 2\nrestitution = [0.8, 0.9]\n[record]",
        "record.restitution",
        ABSENT,
    ),
    "record of a table": ('[sample]\ndesign = "a.csv"\n[record]', "record", ABSENT),
    "uncountable": ("[scene]\nduration = 1e20", "scene.", ABSENT),
    "uncountable corner": (
        "[scene]\nduration = 1e14\n[sample]\nrealizations = 2\nfrequency = [1.0, 100.0]",
        "scene.",
        ABSENT,
    ),
    "uncountable record": ("[record]\nlaunch = [1e20]", "record.", ABSENT),
    "beyond double precision": ("[scene]\nfrequency = 1e-157", "scene.frequency", 1e-157),
}


@each_of(("text", "key", "value"), MISTAKES.values())
def test_each_mistake_is_one_clear_line_with_its_key_and_value(text, key, value):
    with pytest.raises(SpecError) as caught:
        parse_spec(text if "title" in text or not text else TITLE + text, Path("dir/bad.toml"))
    (mistake,) = caught.value.mistakes
    assert mistake.key == key
    # NaN equals nothing, and ABSENT only itself
    assert mistake.value is value or mistake.value == value or mistake.value != mistake.value
    said = str(caught.value)
    assert said.startswith(f"{Path('dir/bad.toml')}: {key.removesuffix('.')}")
    assert "\n" not in said
    for word in ("pydantic", "value error", "input should", "validation", "type=", "nonetype"):
        assert word not in said.lower()  # of the machinery


@each_of(
    ("text", "parts"),
    [
        ("[sampel]", ['did you mean "sample"?']),
        ("[scene]\nfrequencey = 3", ['did you mean "frequency"?', "Known keys of [scene]"]),
        ("[measure]\nseed = 3", ["belongs in [sample]"]),
        ("[scene]\nphase = nan", ["not a finite number", "at most 1e+09 rad"]),
        ("[scene]\nrestitution = 1.2", ["at least 0 and at most 1"]),
        (
            "[scene]\nrestitution = [0.8, 0.9]",
            ["must be one number", "lists are for [sample]"],
        ),
        ("[scene]\nphase = { min = 0, max = 1 }", ["must be one number", "for [sample]"]),
        (
            "[sample]\nphase = { min = 0, max = 1 }",
            ["an axis as { start", "a range as [low, high]"],
        ),
        (f"[scene]\nparticles = 1{400 * '0'}", ["a huge number", "at most 1000000000"]),
        ('[sample]\ndesign = "sobel"', ['did you mean "sobol"?', '"latin"', '".csv" or ".nc"']),
        ("[sample]\nrealizations = 2\nrestitution = [0.98, 0.8]", ["write [0.8, 0.98]"]),
        ("[sample]\nphase = 2.0\n[scene]\nphase = 1.0", ["scene.phase = 1.0", "keep one"]),
        ("[scene]\nduration = 5.0\n[measure]\ntransient = 5.0", ["than scene.duration = 5.0 s"]),
        ("[scene]\nbase_acceleration = 1e29\nfrequency = 0.001", ["at most 1e+30 m s-1"]),
    ],
)
def test_a_message_tells_what_is_allowed_and_the_remedy(text, parts):
    said = message(TITLE + text)
    for part in parts:
        assert part in said


def test_all_mistakes_at_once():
    said = message(
        'tilte = "x"\n[scene]\nrestitution = 1.2\nparticles = 3\nlaunch = [0.0]\nduration = "1"\n'
        "[sample]\namplitude = [2.0, 1.0]\nrealizations = -1\n[measure]\ntransient = 20.0\n"
        "[record]\nphase = nan"
    )
    head, *lines = said.splitlines()
    assert head == f"{Path('dir/bad.toml')}: 8 mistakes"
    keys = {line.split()[0].rstrip(":") for line in lines}
    # the transient is not compared with the default duration, because another one was meant
    assert keys == {
        "tilte",
        "scene.restitution",
        "scene.particles",
        "scene.duration",
        "sample.amplitude",
        "sample.realizations",
        "record.amplitude",
        "record.phase",
    }


def test_a_misspelt_key_is_not_reported_as_missing_too():
    said = message(f"{TITLE}[sample]\nphase = [0.0, 1.0]\nrealisations = 3")
    assert "\n" not in said
    assert 'did you mean "realizations"?' in said


@each_of(
    ("text", "part"),
    [
        ("a b", "line 1, column 3"),
        ("title = 'x'\n[scene\n", "line 2"),
        ("[a]\n[a]\n", "line 2"),
        (f"a = {'9' * 5000}", "digits"),
        (f"a = {'[' * 100_000}", "valid TOML"),
    ],
)
def test_broken_toml(text, part):
    said = message(text)
    assert "is not valid TOML" in said
    assert part in said


def test_unreadable_files(tmp_path):
    latin = tmp_path / "latin.toml"
    latin.write_bytes('title = "\xe9"'.encode("latin-1"))
    cases = {
        tmp_path / "none.toml": "no such sweep file",
        tmp_path: "is a directory",
        latin: "not UTF-8",
        latin / "below.toml": "cannot be read",
        Path("a\0b"): "cannot be read",
    }
    for path, part in cases.items():
        with pytest.raises(SpecError) as caught:
            read_spec(path)
        assert visible(str(path)) in str(caught.value)
        assert part in str(caught.value)


def test_byte_order_mark(tmp_path):
    path = tmp_path / "windows.toml"
    path.write_bytes(b'\xef\xbb\xbftitle = "x"\r\n')
    assert read_spec(path).title == "x"


def test_text_without_a_file():
    with pytest.raises(SpecError, match="title"):
        parse_spec("")


JSON_LIKE = st.recursive(
    st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.text(st.characters(codec="ascii", exclude_characters="'", categories=["L"]), max_size=5),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=4,
)
KEYS = sorted(
    {f"scene.{k}" for k in SECTIONS["scene"]}
    | {f"sample.{k}" for k in SECTIONS["sample"]}
    | {"measure.transient", "record.launch", "title", "scene", "record.what"}
)


@given(st.dictionaries(st.sampled_from(KEYS), JSON_LIKE, max_size=4))
def test_any_value_gives_a_spec_or_a_spec_error(entries):
    lines = [f"{key} = {toml(value)}" for key, value in entries.items()]
    try:
        parse_spec("\n".join(lines))
    except SpecError as error:
        assert str(error)  # noqa: PT017 - either outcome is right


def toml(value: object) -> str:
    if isinstance(value, str):
        return f"'{value}'"
    if isinstance(value, list):
        return f"[{', '.join(toml(v) for v in value)}]"
    return str(value).lower()


def test_import_is_light():
    code = (
        "import sys, vibrosweep.scene.sweep;"
        "print({'numba', 'xarray', 'scipy', 'matplotlib', 'pandas', 'h5py'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize("path", [r"C:\Users\me\shaker.csv", r"D:\x\a.csv", r"C:\data\new.csv"])
def test_backslashes_in_double_quotes_get_a_hint(path):
    text = f'title = "x"\n[scene]\nwaveform = {{ trace = "{path}", column = "height" }}\n'
    with pytest.raises(SpecError) as caught:
        parse_spec(text)
    assert f"in single quotes, '{path}'" in str(caught.value)


# A base of finite mass in a sweep file: keys, mistakes, and realizations.

SCENE = 'title = "x"\n[scene]\nbase = "sprung"\n'
MOUNTED = SCENE + "mass_ratio = 0.004\nmount_frequency = 3.0\n"
GRID = '[sample]\ndesign = "grid"\namplitude = [1.0, 2.0]\n'


def message_sprung(text):
    with pytest.raises(SpecError) as caught:
        parse_spec(text, Path("bad.toml"))
    return str(caught.value)


def test_a_sweep_over_the_mount():
    spec = parse_spec(
        SCENE + "mount_frequency = 3.0\n[sample]\nrealizations = 5\nmass_ratio = [0.0, 0.1]\n"
    )
    assert spec.design.sampled == {"mass_ratio": Range(0.0, 0.1)}
    assert spec.scene.inputs.keys() == {*PARAMETERS, "mount_frequency", "mount_damping"}
    assert spec.scene.inputs["mount_damping"] == 0.05
    design = open_design(spec)
    assert "mount_damping" in silent_defaults(spec, design)
    sampled = design.take(0, 5)
    given = spec.scene.parameters(sampled, 5)
    assert [*given] == [*PARAMETERS, *MOUNT]
    assert np.array_equal(given["mass_ratio"], sampled["mass_ratio"])
    assert spec.scene.varying(design.sampled) == ("mass_ratio",)


def test_masses_take_the_place_of_their_ratio():
    spec = parse_spec(
        SCENE + "mount_frequency = 3.0\nparticle_mass = 0.004\n"
        '[sample]\ndesign = "grid"\nbase_mass = [1.0, 2.0]\n'
    )
    assert "mass_ratio" not in spec.scene.inputs
    design = open_design(spec)
    found = spec.scene.timed(design.take(0, 2), 2)
    assert found["mass_ratio"].tolist() == [0.004, 0.002]
    assert found.keys() >= MASSES.keys()
    assert spec.scene.varying(design.sampled) == ("base_mass", "mass_ratio")


def test_other_bases_hold_nothing_of_a_mount():
    spec = parse_spec('title = "x"\n[scene]\nbase = "moving"\n')
    assert spec.scene.timed({}, 1).keys().isdisjoint(OF_MOUNT)
    assert spec.scene.inputs.keys() == PARAMETERS.keys()


@each_of(
    ("text", "parts"),
    [
        (SCENE + "mount_frequency = 3.0", ["scene.mass_ratio: is missing", "particle_mass and"]),
        (SCENE + "mass_ratio = 0.1", ["scene.mount_frequency: is missing", "Hz"]),
        (
            MOUNTED + "base_mass = 1.0",
            ["scene.base_mass: mass_ratio is given too; keep it or both masses"],
        ),
        (
            SCENE + "mount_frequency = 3.0\nbase_mass = 1.0",
            ["scene.particle_mass: is missing; base_mass needs it"],
        ),
        (
            'title = "x"\n[scene]\nbase = "moving"\nmount_damping = 0.1',
            ["scene.mount_damping: belongs to a base of finite mass", 'write base = "sprung"'],
        ),
        (MOUNTED + "mount_damping = -0.1", ["scene.mount_damping = -0.1", "at least 0"]),
        (MOUNTED + "mount_damping = nan", ["scene.mount_damping = nan", "finite number"]),
        (
            SCENE + "mount_frequency = 0.0\nmass_ratio = 0.1",
            ["scene.mount_frequency = 0.0", "at least 1e-30"],
        ),
        (
            SCENE + "mount_frequency = 3.0\nparticle_mass = 5.0\nbase_mass = 1e-3",
            ["scene: particle_mass and base_mass: give a mass_ratio of 5e+03", "at most 1000"],
        ),
        (
            MOUNTED + "[measure]\ntrust = true",
            ["measure.trust = true: describes particles that are not"],
        ),
        (MOUNTED + 'rebound = "reflect"', ['"reflect" has no meaning with base = "sprung"']),
        (
            SCENE + '[sample]\ndesign = "a.csv"\ncolumns = ["restitution", "mass_ratio"]',
            ["scene.mount_frequency: is missing"],
        ),
        (
            'title = "x"\n[sample]\ndesign = "a.csv"\ncolumns = ["restitution", "mass_ratio"]',
            ["sample.columns: mass_ratio belongs to a base of finite mass"],
        ),
        (
            'title = "x"\n[record]\nbase = "sprung"\nmass_ratio = 0.1',
            ["record.mount_frequency: is missing"],
        ),
        (MOUNTED + '[record]\nbase = "moving"\nmass_ratio = 0.1', ["record.mass_ratio: belongs"]),
        (
            SCENE + "mount_frequency = 3.0\n[sample]\nrealizations = 2\nmass_ratio = [0.0, 0.1]\n"
            "[record]\nparticles = 2",
            ["record.mass_ratio: is missing; the sweep samples it"],
        ),
    ],
)
def test_each_mistake_is_one_line(text, parts):
    said = message_sprung(text)
    assert said.startswith("bad.toml: ")
    assert "\n" not in said
    for part in parts:
        assert part in said


def test_a_record_takes_from_the_sweep_what_it_does_not_state():
    assert parse_spec(MOUNTED + "[record]\n").record.inputs["mass_ratio"] == 0.004
    weighed = parse_spec(MOUNTED + "[record]\nparticle_mass = 1.0\nbase_mass = 2.0\n").record
    assert "mass_ratio" not in weighed.inputs
    still = parse_spec(MOUNTED + '[record]\nbase = "moving"\n').record
    assert still.inputs.keys() == PARAMETERS.keys()
    alone = parse_spec(
        'title = "x"\n[record]\nbase = "sprung"\nmass_ratio = 0.1\nmount_frequency = 2.0\n'
    ).record
    assert alone.inputs["mount_damping"] == 0.05


def table(folder, header, row, scene=SCENE):
    (folder / "rows.csv").write_text(f"{header}\n{row}\n", "utf-8")
    return parse_spec(f'{scene}[sample]\ndesign = "rows.csv"\n', folder / "sweep.toml")


def test_columns_of_a_table(tmp_path):
    header = "restitution,amplitude,particle_mass,base_mass,mount_frequency"
    spec = table(tmp_path, header, "0.9,1.2,0.004,2.0,3.0")
    design = open_design(spec)
    found = spec.scene.parameters(design.take(0, 1), 1)
    assert (found["mass_ratio"].item(), found["mount_damping"].item()) == (0.002, 0.05)


@pytest.mark.parametrize(
    ("header", "scene", "parts"),
    [
        ("mass_ratio", SCENE, ['column "mount_frequency" is missing', "add the column"]),
        ("mass_ratio", 'title = "x"\n', ['column "mass_ratio" belongs to a base of finite mass']),
        ("mu", MOUNTED, ['did you mean "mass_ratio"']),
    ],
)
def test_mistakes_of_a_table(tmp_path, header, scene, parts):
    spec = table(tmp_path, f"restitution,amplitude,{header}", "0.9,1.2,0.1", scene)
    with pytest.raises(TableError) as caught:
        open_design(spec)
    for part in parts:
        assert part in str(caught.value)


def test_masses_may_be_labels_of_another_base(tmp_path):
    spec = table(tmp_path, "restitution,amplitude,mass", "0.9,1.2,0.004", 'title = "x"\n')
    assert open_design(spec).labels["mass"].values.tolist() == [0.004]


def test_the_identity_holds_the_mount():
    one = identity(parse_spec(MOUNTED + GRID))
    other = identity(parse_spec(MOUNTED.replace("3.0", "4.0") + GRID))
    assert {key for key in one if one[key] != other[key]} == {"mount_frequency"}


# The key ``waveform``: its values, and mistakes in them.

TWO = "{ harmonics = [[1, 1.0, 0.0], [2, 0.4, 1.1]] }"


def test_file_and_keywords_give_the_same_waveform():
    text = f'title = "Two tones"\n[scene]\nwaveform = {TWO}\n'
    written = parse_spec(text).scene.waveform
    spoken = keyword_spec({"waveform": {"harmonics": [[2, 0.4, 1.1], [1, 1, 0]]}})
    assert written == spoken.scene.waveform
    assert written.text == TWO
    assert parse_spec(spoken.text).scene.waveform == written


def test_results_name_the_waveform(tmp_path):
    scene = {"waveform": {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}, "duration": 2.0}
    assert vs.simulate(**scene).waveform == TWO
    with vs.run({**scene, "record": {}}, tmp_path / "two.h5") as found:
        assert found.waveform == TWO
    assert vs.sweep(duration=1.0).waveform == "sine"


@each_of(
    ("given", "message"),
    [
        ("square", 'must be "sine", "parabolic", or the harmonics'),
        ({"tones": [[1, 1.0, 0.0]]}, "or the harmonics"),
        ({"harmonics": []}, "is empty"),
        ({"harmonics": [[h, 1.0, 0.0] for h in range(1, 18)]}, "has 17 harmonics; at most 16"),
        ({"harmonics": [[0, 1.0, 0.0]]}, "mean velocity"),
        ({"harmonics": [[1.5, 1.0, 0.0]]}, "the motion has the period of the forcing"),
        ({"harmonics": [[17, 1.0, 0.0]]}, "from 1 to 16"),
        ({"harmonics": [[1, float("nan"), 0.0]]}, "the weight of harmonic 1 is nan"),
        ({"harmonics": [[1, 1.0, float("inf")]]}, "the phase in rad of harmonic 1 is inf"),
        ({"harmonics": [[1, 1.0]]}, "is not a list of number, weight and phase"),
        ({"harmonics": [[1, 1.0, 0.0], [1, 0.5, 0.0]]}, "gives a harmonic twice"),
        ({"harmonics": [[1, 0.0, 0.0]]}, "does not move"),
    ],
)
def test_a_mistake_gets_one_message(given, message):
    with pytest.raises(SpecError, match="waveform") as caught:
        keyword_spec({"waveform": given})
    assert len(caught.value.mistakes) == 1
    assert message in str(caught.value)
