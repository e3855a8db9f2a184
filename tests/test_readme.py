"""The README is true: its commands, its files and its Python."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = {
    "Install and run": "python -m pip install . && vibrosweep run sweeps/paper.toml"
    " && vibrosweep figures paper.h5 -o figures",
    "Install and test": "python -m pip install '.[test]' && python -m pytest -n 2 --dist=loadfile",
}


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def extracted(readme, heading, tmp_path):
    """Code that .ci/run finds below a heading of a README."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "run", tmp_path / ".ci")
    (tmp_path / "README.md").write_text(readme, encoding="utf-8")
    return subprocess.run(
        ["bash", tmp_path / ".ci" / "run", heading], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("heading", COMMANDS)
def test_continuous_integration_finds_the_command(heading, tmp_path):
    assert extracted(README, heading, tmp_path).stdout == COMMANDS[heading] + "\n"


@pytest.mark.parametrize("change", ["", "x\n", "absent"])
def test_continuous_integration_fails_without_one_command(change, tmp_path):
    line = COMMANDS["Install and run"] + "\n"
    readme = README.replace("## Install and run", "## Run") if change == "absent" else ""
    readme = readme or README.replace(line, change and line + change)
    found = extracted(readme, "Install and run", tmp_path)
    assert found.returncode != 0
    assert found.stdout == ""
    assert 'no single command below "## Install and run"' in found.stderr


def test_continuous_integration_can_be_run():
    assert os.access(ROOT / ".ci" / "run", os.X_OK)


def test_every_file_exists():
    named = set(re.findall(r"`([\w./-]+/|[\w./-]*\.(?:toml|md|py|cff))`", README))
    named |= set(re.findall(r"\]\(([^)#]+)\)", README)) | {".ci/run", "LICENSE"}
    homes = (ROOT, ROOT / "sweeps", ROOT / "src" / "vibrosweep" / "kernels")
    missing = {name for name in named if not any((home / name).exists() for home in homes)}
    assert missing == set()
    assert {"sweeps/paper.toml", "docs/model.md", "docs/images/moving_height_time_all.png"} <= named


def test_two_small_pictures():
    shown = re.findall(r"!\[.+\]\((.+\.png)\)", README)
    assert len(shown) == 2
    assert all((ROOT / path).stat().st_size < 200_000 for path in shown)


def test_the_first_screen_is_short():
    assert len(README.split()) <= 700


def test_the_python_runs():
    (code,) = blocks("python")
    done = {}
    exec(compile(code, "README.md", "exec"), done)
    assert done["sweep"]["locked_count"].shape == (120, 120)
