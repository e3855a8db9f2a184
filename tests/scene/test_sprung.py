"""A base of finite mass in a sweep file: keys, mistakes, and realizations."""

from pathlib import Path

import numpy as np
import pytest

from vibrosweep.errors import SpecError, TableError
from vibrosweep.model.parameters import MASSES, MOUNT, OF_MOUNT, PARAMETERS
from vibrosweep.runs.chunks import identity
from vibrosweep.runs.result import silent_defaults
from vibrosweep.scene.design import Range
from vibrosweep.scene.realizations import open_design
from vibrosweep.scene.sweep import parse_spec

SCENE = 'title = "x"\n[scene]\nbase = "sprung"\n'
MOUNTED = SCENE + "mass_ratio = 0.004\nmount_frequency = 3.0\n"
GRID = '[sample]\ndesign = "grid"\namplitude = [1.0, 2.0]\n'


def message(text):
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


@pytest.mark.parametrize(
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
            ["scene: particle_mass and base_mass: make a mass_ratio of 5e+03", "at most 1000"],
        ),
        (
            MOUNTED + "[measure]\ntrust = true",
            ["measure.trust = true: describes particles that do not"],
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
    said = message(text)
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
