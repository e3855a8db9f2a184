"""The identity of a sweep holds every field of its spec on which numbers depend."""

import json
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import vibrosweep
from vibrosweep.errors import ParameterError
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.observables import Observable
from vibrosweep.model.shapes import Waveform
from vibrosweep.runs.chunks import EXEMPT, differences, identity, sources
from vibrosweep.scene.design import Design
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep, parse_spec

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
def spec(request, tmp_path):
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


def test_every_field_is_in_the_identity_or_cannot_change_a_number(spec, tmp_path):
    (tmp_path / "other.csv").write_bytes((tmp_path / "table.csv").read_bytes())
    before = identity(spec)
    for field in fields(Sweep):
        value = getattr(spec, field.name)
        for name, other in changed(value):
            path = f"{field.name}{name}"
            impossible = path == "design.table" and value.table is None
            if other == value or impossible:  # a measure that another one requires stays
                continue
            if is_dataclass(value) and name == "":  # the record: there is one or none
                assert field.name == "record" or other is None
                continue
            now = identity(replace(spec, **{field.name: other}))
            assert (now != before) is not any(path.startswith(one) for one in EXEMPT), path


def test_every_exempt_path_is_a_field_and_has_a_reason():
    kinds = {"scene": Scene, "record": Scene, "design": Design}
    for path, reason in EXEMPT.items():
        room, _, name = path.rpartition(".")
        assert name in {field.name for field in fields(kinds[room] if room else Sweep)}
        assert len(reason) > 10


def test_a_field_of_an_unknown_kind_is_an_error(spec):
    with pytest.raises(TypeError, match=r"^title: .* object"):
        identity(replace(spec, title=object()))


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
