"""Try each command of the README and of docs/start.md after the install that its page names.

    python checks/page_commands.py [--list] [--without WORD ...]

The commands are read from the pages.  One that names a file that the reader has, such as
`SPEC.toml`, needs an entry in `FILLED` that says what is run in its place, and without one nothing
is run.  `--without` leaves out commands that contain a word, such as `pytest`; `--list` only says
what would be run.  A copy of the tree and a virtual environment are made in the system's temporary
directory; between two installs what the first one added is removed.  The exit code is 1 if a
command fails.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "docs/start.md")
INSTALL = re.compile(r"pip install '?\.(?:\[(\w+)\])?'?")
SENTENCE = re.compile(r"(?<=[.;])\s+|\n\n|(?<=\|)\n")
INLINE = re.compile(r"`((?:vibrosweep|python -m) [^`]+|--[a-z][^`]*)`")
PLACEHOLDER = re.compile(r"(?<![\w.-])[A-Z]+\b")  # SPEC.toml, OUT.h5, N

SPECS = {
    "two.toml": "restitution = [0.5, 0.9]\namplitude = [1.0, 1.2]",
    "along.toml": "amplitude = [0.6, 1.2, 2.4]",
    "launches.toml": "launch_velocity = [1.0, 4.0, 6.0]",
    "windows.toml": "restitution = [0.6, 0.9]\namplitude = { start = 0.1, stop = 4.0, num = 20 }\n"
    '[windows]\nconditions = ["locked(1)"]',
}
SCENE = """title = "{name}"
[scene]
particles = 2
duration = 100.0
{fixed}[sample]
design = "grid"
"""
FILLED = {
    "vibrosweep run SPEC.toml": "vibrosweep run two.toml",
    "vibrosweep plan SPEC.toml": "vibrosweep plan two.toml",
    "vibrosweep info OUT.h5": "vibrosweep info two.h5",
    "vibrosweep figures OUT.h5": "vibrosweep figures two.h5 -o drawn",
    "vibrosweep explore OUT.h5": "vibrosweep explore two.h5 -o page.html",
    "vibrosweep verify OUT.h5": "vibrosweep verify two.h5",
    "vibrosweep windows SPEC.toml": "vibrosweep windows windows.toml",
    "vibrosweep bifurcation SPEC.toml": "vibrosweep bifurcation along.toml",
    "vibrosweep basins SPEC.toml": "vibrosweep basins launches.toml",
    "vibrosweep orbits SPEC.toml": "vibrosweep orbits along.toml",
    "vibrosweep branches SPEC.toml": "vibrosweep branches along.toml",
    "vibrosweep boundaries SPEC.toml": "vibrosweep boundaries two.toml",
    "vibrosweep lab": "vibrosweep lab synthesize sweeps/laboratory/two_tones.toml",
    "--workers N": "vibrosweep run two.toml -o workers.h5 --workers 2",
    "--scheduler ADDRESS": "python -c 'from vibrosweep.runs import cluster'",  # none runs here
}


class Step(NamedTuple):
    """A command, and the extra that is installed before it."""

    page: str
    extra: str
    command: str


def steps(page: str, text: str) -> Iterator[Step]:
    """Yield the commands of a page in their order."""
    extra, python = "", ""
    for part in re.split(r"^(```\w+\n.*?^```)$", text, flags=re.MULTILINE | re.DOTALL):
        if part.startswith("```sh\n"):
            for command in re.split(r" && |\n", part.removeprefix("```sh\n").removesuffix("```")):
                if install := INSTALL.search(command):
                    extra = install[1] or ""
                elif command:
                    yield Step(page, extra, command)
        elif part.startswith("```python\n"):
            python += part.removeprefix("```python\n").removesuffix("```")
        else:
            yield from _of_prose(page, part)
    if python:
        yield Step(page, "", f"python -c {shlex.quote(python)}")


def _of_prose(page: str, text: str) -> Iterator[Step]:
    """Yield commands within sentences and rows of tables, which may name their own install."""
    for sentence in SENTENCE.split(text):
        install = INSTALL.search(sentence)
        for command in INLINE.findall(sentence):
            if not INSTALL.search(command):
                yield Step(page, (install and install[1]) or "", command)


def all_steps() -> list[Step]:
    """Return the commands of all pages, those without an extra first, each as it is run."""
    found = [one for page in PAGES for one in steps(page, (ROOT / page).read_text("utf-8"))]
    unknown = [
        f"{one.page}: {one.command}"
        for one in found
        if PLACEHOLDER.search(one.command.partition(" -c ")[0]) and one.command not in FILLED
    ]
    if unknown:
        raise SystemExit("give an example in FILLED for: " + "; ".join(unknown))
    extras = list(dict.fromkeys(["", *(one.extra for one in found)]))
    filled = [one._replace(command=FILLED.get(one.command, one.command)) for one in found]
    return sorted(dict.fromkeys(filled), key=lambda one: extras.index(one.extra))


def tried(chosen: list[Step], place: Path) -> int:
    """Run commands in environments made in a directory; return how many failed."""
    home = place / "venv"
    venv.create(home, with_pip=True)
    bin_directory = home / ("Scripts" if os.name == "nt" else "bin")
    python = bin_directory / ("python.exe" if os.name == "nt" else "python")
    environment = {
        **{k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "NUMBA_"))},
        "PATH": os.pathsep.join([str(bin_directory), os.environ["PATH"]]),
        "NUMBA_CACHE_DIR": str(place / "cache"),
        "MPLBACKEND": "agg",
    }
    for page in PAGES:
        tree = place / Path(page).stem
        left_out = shutil.ignore_patterns(".git", "*.h5", "build", "dist", "figures-*", ".*cache")
        shutil.copytree(ROOT, tree, ignore=left_out)
        for name, sample in SPECS.items():
            fixed = "" if "restitution" in sample else "restitution = 0.9\n"
            fixed += "" if "amplitude" in sample else "amplitude = 1.2\n"
            (tree / name).write_text(SCENE.format(name=name, fixed=fixed) + sample + "\n")

    def pip(*arguments: str) -> str:
        command = [python, "-m", "pip", *arguments, "--disable-pip-version-check"]
        done = subprocess.run(
            command,
            cwd=place / "README",
            env=environment,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        )
        return done.stdout

    def packages() -> set[str]:
        return {line.partition("==")[0] for line in pip("list", "--format=freeze").splitlines()}

    failed, plain = 0, set[str]()
    for extra in dict.fromkeys(["", *(one.extra for one in chosen)]):
        if extra and (added := packages() - plain):
            pip("uninstall", "-qy", *added)
        target = f".[{extra}]" if extra else "."
        pip("install", "-q", target)
        plain = plain or packages()
        for page, _, command in (one for one in chosen if one.extra == extra):
            print(f"{target:12}{page}: {command.splitlines()[0]}", flush=True)
            done = subprocess.run(
                ["bash", "-euo", "pipefail", "-c", command],
                cwd=place / Path(page).stem,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                check=False,
            )
            if done.returncode:
                failed += 1
                print(f"FAILED with {done.returncode}:\n{done.stdout[-3000:]}", flush=True)
    return failed


def main() -> int:
    """Try the commands; return the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--without", nargs="+", default=[])
    options = parser.parse_args()
    chosen = [s for s in all_steps() if not any(word in s.command for word in options.without)]
    if options.list:
        for page, extra, command in chosen:
            print(f"{page:14}{extra or '-':9}{command.splitlines()[0]}")
        return 0
    with tempfile.TemporaryDirectory() as place:
        failed = tried(chosen, Path(place))
    print(f"{len(chosen)} commands, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
