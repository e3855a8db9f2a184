"""What the README says is true: its commands, files, keys, variables and its Python."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from vibrosweep.model.markdown import insert
from vibrosweep.spec.schema import _KEYS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = {
    "Install and run": "python -m pip install . && vibrosweep run sweeps/paper.toml"
    " && vibrosweep figures paper.h5 -o figures",
    "Install and test": "python -m pip install '.[test]' && python -m pytest -n 2",
}


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def extracted(readme, heading, tmp_path):
    """What .ci/run finds below a heading of a README."""
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
    assert {"sweeps/paper.toml", "docs/model.md", "docs/images/return_map.png"} <= named


def test_pictures_are_small():
    shown = re.findall(r"!\[.+\]\((.+\.png)\)", README)
    assert len(shown) == 4
    assert sum((ROOT / path).stat().st_size for path in shown) < 400_000


def test_the_tables_of_measures_are_those_of_the_registry():
    assert insert(README) == README


def test_every_other_key_is_explained():
    names = {key for keys in _KEYS.values() for key in keys} | {f"[{t}]" for t in _KEYS}
    assert {name for name in names if f"`{name}`" not in README} == set()


def test_the_python_prints_what_is_shown(paper, monkeypatch, capsys):
    monkeypatch.chdir(paper.parent)
    (code,) = blocks("python")
    exec(compile(code, "README.md", "exec"), {})
    numbers = re.compile(r"(?<![\w.])\d+\.\d+(?:e[+-]\d+)?")
    shown = next(text for text in blocks("text") if text.startswith("<xarray.Dataset>"))
    printed = capsys.readouterr().out.partition("Attributes")[0]
    assert numbers.findall(printed) == numbers.findall(shown)
    assert len(numbers.findall(shown)) > 10


def test_the_functions_it_names(paper, tmp_path):
    import vibrosweep

    for name in re.findall(r"`vibrosweep\.(\w+)\(", README):
        assert name in vibrosweep.__all__
    call = re.search(r"`(vibrosweep\.simulate\(.*?\))`", README)[1]
    assert eval(call, {"vibrosweep": vibrosweep}).sizes["particle"] == 2
