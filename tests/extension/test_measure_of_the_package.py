"""The recipe of a measure of the package, done on a copy of the package."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import vibrosweep as vs

RECIPE = Path(__file__).with_name("flight_time_min.diff")
SCENES = [{"restitution": e, "amplitude": 1.2, "duration": 9.0} for e in (0.6, 0.9)]
SCRIPT = """
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


def test_the_new_measure_is_that_of_all_landings_and_verify_notices_a_change(tmp_path):
    package = Path(vs.__file__).parent
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(package, tmp_path / "src" / "vibrosweep", ignore=ignored)
    apply(RECIPE.read_text(), tmp_path)
    words = [sys.executable, "-W", "error", "-c", SCRIPT, json.dumps(SCENES)]
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "src")}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for scene, found in zip(SCENES, json.loads(done.stdout), strict=True):
        np.testing.assert_allclose(found, shortest_flight(scene), rtol=1e-9)
