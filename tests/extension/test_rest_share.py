"""An analysis of another package: its result, its figure and what the commands say of it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from tests.extension.rest_share import REST_SHARE, rest_share

SOURCE = Path(__file__).with_name("rest_share.py")
SCENE = {"restitution": [0.5, 0.7, 0.9], "particles": 2, "duration": 8.0}
SPRUNG = {"mass_ratio": 0.1, "mount_frequency": 5.0, "mount_damping": 0.1}
BASES = {"high-bounce": {}, "moving": {}, "sprung": SPRUNG}


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder that holds the analysis as pip would install it."""
    folder = tmp_path_factory.mktemp("site")
    (folder / SOURCE.name).write_bytes(SOURCE.read_bytes())
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


@pytest.mark.parametrize("base", BASES)
def test_the_share_over_every_base(base):
    sweep = vs.sweep(**SCENE, base=base, **BASES[base])
    found = rest_share(sweep)
    np.testing.assert_array_equal(found["rest_share"] * sweep["impact_count"], sweep["rest_count"])
    assert found["rest_share"].max() > 0.0


def test_a_record_is_refused():
    with pytest.raises(vs.errors.DataError, match="rest_count"):
        rest_share(vs.simulate(duration=1.0))


def test_the_commands_know_its_result(installed, tmp_path):
    result = rest_share(vs.sweep(**SCENE))
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
    path = vs.save_result(rest_share(vs.sweep(**SCENE)), tmp_path / "share.h5", REST_SHARE)
    said = command(tmp_path, "info", path)
    assert said.returncode == 2
    assert "rest_share" in said.stderr


def test_two_kinds_of_one_name_are_refused():
    assert vs.register_kind(REST_SHARE) is REST_SHARE
    with pytest.raises(vs.errors.ParameterError, match="rest_share"):
        vs.register_kind(vs.ResultKind("rest_share", "another package"))
