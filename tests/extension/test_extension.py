"""Measures, laws and designs that somebody adds."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from tests.extension.log_uniform import log_uniform
from tests.extension.rest_share import REST_SHARE, rest_share
from tests.scenes import OBSERVABLES
from vibrosweep.proof.verifying import verify
from vibrosweep.runs.chunks import identity
from vibrosweep.scene.sweep import keyword_spec

# A design is one function and one registration: in memory, in files, in plans and in `verify`.

SWEEP = {
    "restitution": (0.8, 0.98),
    "amplitude": (0.01, 10.0),
    "design": "log-uniform",
    "realizations": 200,
    "seed": 4,
    "duration": 3.0,
}
MOUNT = {"mass_ratio": 0.01, "mount_frequency": 2.0}


@pytest.mark.parametrize("base", ["high-bounce", "moving", "sprung"])
def test_values_are_uniform_on_a_logarithmic_scale(base):
    found = vs.sweep({**SWEEP, "base": base, **(MOUNT if base == "sprung" else {})})
    decades = np.log10(found.amplitude.values)
    assert -2.0 <= decades.min() < -1.9 < 0.9 < decades.max() <= 1.0
    assert np.histogram(decades, bins=3)[0].min() > 45
    assert found.attrs["design"] == "log-uniform"


def test_a_file_in_chunks_holds_the_same_bits_and_passes_verify(tmp_path):
    path = tmp_path / "out.h5"
    with vs.run(SWEEP, path, chunk=23, threads=1) as found:
        in_memory = vs.sweep(SWEEP)
        assert np.array_equal(found.amplitude, in_memory.amplitude)
        assert np.array_equal(found.rebound_height_max, in_memory.rebound_height_max)
    assert verify(path, sample=5).passed


def test_an_edited_function_is_another_sweep(monkeypatch):
    from vibrosweep.scene import design

    before = identity(keyword_spec(SWEEP))
    monkeypatch.setattr(design, "DESIGNS", dict(design.DESIGNS))
    vs.register_design("log-uniform", lambda unit, low, high: low * (high / low) ** (unit * unit))
    now = identity(keyword_spec(SWEEP))
    assert {key for key in now if now[key] != before[key]} == {"code of the design"}


def test_a_name_that_is_taken_is_refused():
    with pytest.raises(vs.errors.ParameterError, match="taken"):
        vs.register_design("sobol", log_uniform)


# A statistic of another package: over every base, with repeated cycles, and after an edit.

SOURCE = Path(__file__).with_name("longest_flight.py")
LAUNCHES = [0.0, 0.13, 0.4]
SCENE = {"restitution": [0.6, 0.8], "amplitude": [1.2, 3.0], "duration": 9.0}
SPRUNG = {"mass_ratio": 0.05, "mount_frequency": 4.0, "mount_damping": 0.1}
BASES = {"high-bounce": {}, "moving": {}, "sprung": SPRUNG}


def flight_times(landings, begin):
    """Flights that end in the window, from all landings."""
    first = np.tile(np.array(LAUNCHES)[:, np.newaxis], (landings.sizes["realization"], 1, 1))
    lifts = np.concatenate([first, landings.liftoff_time.values[..., :-1]], axis=-1)
    return np.where(landings.landing_time >= begin, landings.landing_time - lifts, np.nan)


@pytest.mark.parametrize("base", BASES)
def test_the_longest_flight_is_that_of_all_landings(base):
    found = vs.sweep(
        **SCENE,
        **BASES[base],
        base=base,
        launch=LAUNCHES,
        transient=2.0,
        particles=3,
        observables=OBSERVABLES,
    ).flight_time_max
    assert found.attrs == {"long_name": "longest flight", "units": "s"}
    for e in SCENE["restitution"]:
        for a in SCENE["amplitude"]:
            one = SCENE | {"restitution": e, "amplitude": a} | BASES[base]
            every = vs.simulate(**one, base=base, launch_time=LAUNCHES)
            here = found.sel(restitution=e, amplitude=a).values
            np.testing.assert_allclose(
                here, np.nanmax(flight_times(every, 2.0)[0], axis=-1), rtol=1e-12
            )


def test_a_sum_over_repeated_cycles_is_that_of_all_landings():
    scene = {"restitution": 0.8, "amplitude": [1.2, 2.0, 3.0], "duration": 2000.0}
    found = vs.sweep(
        **scene, launch=LAUNCHES, particles=3, transient=100.0, observables=OBSERVABLES
    )
    every = vs.simulate(**scene, launch_time=LAUNCHES)
    expected = np.nansum(flight_times(every, 100.0), axis=(1, 2))
    np.testing.assert_allclose(found.flown.values.ravel(), expected, rtol=1e-10)


SCRIPT = """
import json, sys
sys.path.insert(0, sys.argv[1])
import softening
import vibrosweep as vs
from longest_flight import LONGEST_FLIGHT
given = {"particles": 1, "transient": 1.0, "separation": False, "observables": [LONGEST_FLIGHT]}
given |= {"restitution_law": "softening", "restitution_speed": 4.905}
found = vs.sweep(restitution=0.9, amplitude=1.2, **given)
print(json.dumps([found.flight_time_max.item(), found.impact_count.item()]))
"""


def test_an_edit_never_runs_stale_machine_code(tmp_path):
    """Neither of a measure nor of a law."""

    def run(measure=("return landing",) * 2, law=("e / (1.0 + s)",) * 2):
        for file, edit in ((SOURCE, measure), (SOURCE.with_name("softening.py"), law)):
            text = file.read_text()
            assert edit[0] in text
            (tmp_path / file.name).write_text(text.replace(*edit))
        words = [sys.executable, "-W", "ignore", "-c", SCRIPT, str(tmp_path)]
        done = subprocess.run(words, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    flight, count = run()
    edits = {
        "measure": ("return landing", "return -1.0 * landing"),
        "law": ("e / (1.0 + s)", "0.5 * e"),
    }
    negative, other = run(**edits)
    assert negative < 0.0 < flight
    assert other != count
    assert run() == [flight, count]


# The recipe of a measure of the package, done on a copy of the package.

RECIPE = Path(__file__).with_name("flight_time_min.diff")
SCENES = [{"restitution": e, "amplitude": 1.2, "duration": 9.0} for e in (0.6, 0.9)]
SCRIPT_MEASURE_OF_THE_PACKAGE = """
import json, sys
import h5netcdf
import vibrosweep as vs

found = []
for number, scene in enumerate(json.loads(sys.argv[1])):
    path = f"{number}.h5"
    with vs.run({**scene, "particles": 1, "per_particle": True, "transient": 2.0}, path) as result:
        found.append([result.flight_time_min.item(), result.particle_flight_time_min.item()])
    report = vs.verify(path)
    assert report.passed
    assert len(report.variables()["flight_time_min"].errors) == 1
    with h5netcdf.File(path, "a") as file:
        file.variables["flight_time_min"][...] *= 1.0 - 1e-6
    changed = {j.variable for o in vs.verify(path).outcomes for j in o.judgements if j.complaint}
    assert changed == {"flight_time_min"}, changed
print(json.dumps(found))
"""


def apply(diff, root):
    """Apply a diff to the files in a folder; the old lines must stand there once."""
    for file in re.split(r"^diff .*\n", diff, flags=re.MULTILINE)[1:]:
        path = root / re.search(r"^\+\+\+ b/(.*)$", file, re.MULTILINE)[1]
        text = path.read_text()
        for hunk in re.split(r"^@@ .*\n", file, flags=re.MULTILINE)[1:]:
            lines = hunk.splitlines(keepends=True)
            old = "".join(line[1:] for line in lines if line[0] != "+")
            new = "".join(line[1:] for line in lines if line[0] != "-")
            assert text.count(old) == 1, f"{path}: {old}"
            text = text.replace(old, new)
        path.write_text(text)


def shortest_flight(scene):
    """The shortest of the flights that follow a landing in the window."""
    every = vs.simulate(**scene | {"duration": scene["duration"] + 3.0})
    left, landed = every.liftoff_time.values.ravel(), every.landing_time.values.ravel()
    seen = (landed[:-1] >= 2.0) & (landed[:-1] <= scene["duration"])
    return np.min((landed[1:] - left[:-1])[seen])


@pytest.fixture
def changed_package(tmp_path):
    """A folder with a copy of the package, to which the recipe was applied."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(vs.__file__).parent, tmp_path / "src" / "vibrosweep", ignore=ignored)
    apply(RECIPE.read_text(), tmp_path)
    return tmp_path


def with_measure(folder, script, *arguments):
    words = [sys.executable, "-W", "error", "-c", script, *arguments]
    environment = os.environ | {"PYTHONPATH": str(folder / "src")}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_recipe_of_a_measure_still_applies(changed_package):
    script = "import json, vibrosweep.model.measures as m; print(json.dumps([*m.VARIABLES]))"
    assert {"flight_time_min", "particle_flight_time_min"} <= {
        *with_measure(changed_package, script)
    }


@pytest.mark.weekly
def test_the_new_measure_is_that_of_all_landings_and_verify_notices_a_change(changed_package):
    computed = with_measure(changed_package, SCRIPT_MEASURE_OF_THE_PACKAGE, json.dumps(SCENES))
    for scene, found in zip(SCENES, computed, strict=True):
        np.testing.assert_allclose(found, shortest_flight(scene), rtol=1e-9)


# An analysis of another package: its result, its figure and what the commands say of it.

SOURCE_REST_SHARE = Path(__file__).with_name("rest_share.py")
SCENE_REST_SHARE = {"restitution": [0.5, 0.7, 0.9], "particles": 2, "duration": 8.0}
SPRUNG_REST_SHARE = {"mass_ratio": 0.1, "mount_frequency": 5.0, "mount_damping": 0.1}
BASES_REST_SHARE = {"high-bounce": {}, "moving": {}, "sprung": SPRUNG_REST_SHARE}


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder that holds the analysis as pip would install it."""
    folder = tmp_path_factory.mktemp("site")
    (folder / SOURCE_REST_SHARE.name).write_bytes(SOURCE_REST_SHARE.read_bytes())
    about = folder / "rest_share-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: rest-share\nVersion: 1.0\n")
    entry = "[vibrosweep.results]\nrest_share = rest_share:REST_SHARE\n"
    (about / "entry_points.txt").write_text(entry)
    return folder


def command(folder, *words):
    paths = [str(folder), os.environ.get("PYTHONPATH", "")]
    return subprocess.run(
        [sys.executable, "-m", "vibrosweep", *map(str, words)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("base", BASES_REST_SHARE)
def test_the_share_over_every_base(base):
    sweep = vs.sweep(**SCENE_REST_SHARE, base=base, **BASES_REST_SHARE[base])
    found = rest_share(sweep)
    np.testing.assert_array_equal(found["rest_share"] * sweep["impact_count"], sweep["rest_count"])
    assert found["rest_share"].max() > 0.0


def test_a_record_is_refused():
    with pytest.raises(vs.errors.DataError, match="rest_count"):
        rest_share(vs.simulate(duration=1.0))


def test_the_commands_know_its_result(installed, tmp_path):
    result = rest_share(vs.sweep(**SCENE_REST_SHARE))
    path = vs.save_result(result, tmp_path / "share.h5", REST_SHARE)
    xr.testing.assert_identical(xr.load_dataset(path).drop_attrs(), result.drop_attrs())
    said = command(installed, "info", path)
    assert said.returncode == 0, said.stderr
    assert f"to {float(result['rest_share'].max()):.3g}" in said.stdout
    assert "no seal" not in said.stdout
    said = command(installed, "figures", path, "-o", tmp_path / "figures")
    assert said.returncode == 0, said.stderr
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {
        "rest_share.png",
        "rest_share.pdf",
    }
    said = command(installed, "verify", path)
    assert said.returncode == 2
    assert REST_SHARE.command in said.stderr
    with pytest.raises(vs.errors.DataError, match=REST_SHARE.command):
        vs.open_sweep(path)


def test_without_the_package_its_result_is_refused(tmp_path):
    path = vs.save_result(
        rest_share(vs.sweep(**SCENE_REST_SHARE)), tmp_path / "share.h5", REST_SHARE
    )
    said = command(tmp_path, "info", path)
    assert said.returncode == 2
    assert "rest_share" in said.stderr


def test_two_kinds_of_one_name_are_refused():
    assert vs.register_kind(REST_SHARE) is REST_SHARE
    with pytest.raises(vs.errors.ParameterError, match="rest_share"):
        vs.register_kind(vs.ResultKind("rest_share", "another package"))
