"""Interrupt commands at random moments, and give them too little room for their files.

    python checks/interruptions.py [--times 20] [--seed 1] [--only lab]

Every command that writes or reads a file is started and gets SIGINT or SIGTERM after a random part
of its time.  It must finish, or exit with code 130, without a traceback, and leave nothing but
complete files.  Then it is started where no file may be larger than a random size: it must finish,
or exit with code 2.  Two marks in a pipe tell how far the start had come when a signal arrived:
before the package was imported it is Python's own (early), and so for the millisecond in which the
package and its entry point are imported (opening); from then on it is ours.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from accuracy import options_of
from vibrosweep.lab import FloorExperiment, hear_drops
from vibrosweep.store.disk import FileState, state_of

# The script ``vibrosweep``, with a mark before and after its import
START = """import os, sys
mark = int(sys.argv.pop(1))
os.write(mark, b"1")
from vibrosweep.__main__ import main
os.write(mark, b"2")
os.close(mark)
sys.exit(main())
"""
SCENE = """title = "A sweep to be interrupted"
[scene]
restitution = 0.9
frequency = 1.0
launch_velocity = 5.0
duration = 300.0
[sample]
design = "grid"
amplitude = { start = 0.3, stop = 4.0, num = 8 }
"""
MOVING = SCENE.replace("restitution = 0.9", 'base = "moving"')
BASINS = """title = "Basins to be interrupted"
[scene]
restitution = 0.9
amplitude = 1.2
frequency = 1.0
duration = 300.0
particles = 4
[sample]
design = "grid"
launch_velocity = { start = 0.3, stop = 4.0, num = 4 }
"""
FILM = """title = "A film to be interrupted"
[scene]
restitution = 0.85
amplitude = 0.12
frequency = 20.0
particles = 2
duration = 6.0
[measure]
transient = 2.0
[trials]
repeats = 1
"""
# Files of the laboratory, which are there before its commands
GIVEN = ("spec.toml", "made.h5", "film.toml", "film.csv", "times.csv")
# Words of each command, and its sweep file
COMMANDS = {
    "run": ("run spec.toml -o out.h5", SCENE),
    "bifurcation": ("bifurcation spec.toml -o out.h5 --samples 8", SCENE),
    "windows": ("windows spec.toml -o out.h5", f'{SCENE}[windows]\nconditions = ["locked(1)"]\n'),
    "basins": ("basins spec.toml -o out.h5", BASINS),
    "orbits": ("orbits spec.toml -o out.h5", SCENE),
    "branches": ("branches spec.toml -o out.h5", SCENE),
    "boundaries": ("boundaries spec.toml -o out.h5", f"{MOVING}restitution = [0.7, 0.8]\n"),
    "plan": ("plan spec.toml", SCENE),
    "figures": ("figures made.h5 -o pictures", SCENE),
    "info": ("info made.h5", SCENE),
    "verify": ("verify made.h5 --sample 1", SCENE),
    "lab synthesize": ("lab synthesize film.toml -o tracks", SCENE),
    "lab impacts": ("lab impacts film.csv -o out.h5 --figures pictures", SCENE),
    "lab compare": ("lab compare film.csv --frequency 20 --draws 4 -o out.h5", SCENE),
    "lab restitution": ("lab restitution times.csv -o out.h5 --figures pictures", SCENE),
    "wrong option": ("run spec.toml --no-such-option", SCENE),
}


def ended(words: list[str], folder: Path, delay: float, number: int) -> tuple[int, str, bytes]:
    """Run a command that gets a signal after some seconds; return exit code, errors and marks."""
    seen, mark = os.pipe()
    with subprocess.Popen(
        [sys.executable, "-c", START, str(mark), *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        pass_fds=(mark,),
    ) as process:
        os.close(mark)
        try:
            _, errors = process.communicate(timeout=delay)
        except subprocess.TimeoutExpired:
            process.send_signal(number)
            _, errors = process.communicate()
    with os.fdopen(seen, "rb") as pipe:
        return process.returncode, errors, pipe.read()


def cramped(words: list[str], folder: Path, size: int) -> tuple[int, str]:
    """Run a command where no file may be larger than a number of bytes."""
    limit = f"import os, resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))"
    start = [
        sys.executable,
        "-c",
        f"{limit}; os.execv(sys.argv[1], sys.argv[1:])",
        sys.executable,
        "-m",
        "vibrosweep",
        *words,
    ]
    done = subprocess.run(start, capture_output=True, text=True, cwd=folder, check=False)
    return done.returncode, done.stderr


def wrong_files(folder: Path) -> list[str]:
    """Return the names of results that are not complete, and of temporary files."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    broken = [p for p in files if p.suffix == ".h5" and state_of(p) is not FileState.INTACT]
    return [path.name for path in (*broken, *(p for p in files if p.suffix == ".partial"))]


def film_and_times(folder: Path) -> None:
    """Write a film, tracks, and times of impacts on a floor."""
    (folder / "film.toml").write_text(FILM, encoding="utf-8")
    ended(["lab", "synthesize", "film.toml", "-o", "tracks"], folder, 600.0, signal.SIGINT)
    shutil.copy(folder / "tracks" / "film_002_trial1.csv", folder / "film.csv")
    times = hear_drops(FloorExperiment(scatter=0.004))[0][0].time
    (folder / "times.csv").write_text("time (s)\n" + "\n".join(map(str, times)), encoding="utf-8")


def clear(folder: Path) -> None:
    """Remove what a command wrote."""
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name not in GIVEN:
            path.unlink()


def campaign(name: str, times: int, rng: np.random.Generator) -> Counter[str]:
    """Interrupt a command, and give it too little room, a number of times; count its ends."""
    line, text = COMMANDS[name]
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "spec.toml").write_text(text, encoding="utf-8")
        words = line.split()
        if name.startswith("lab"):
            film_and_times(folder)
        ended(["run", "spec.toml", "-o", "made.h5"], folder, 600.0, signal.SIGINT)
        ended(words, folder, 600.0, signal.SIGINT)  # compiles its kernels
        clear(folder)
        began = time.perf_counter()
        code, errors, _ = ended(words, folder, 600.0, signal.SIGINT)
        whole = time.perf_counter() - began
        if code != (2 if name == "wrong option" else 0):
            raise SystemExit(f"{name} ended with {code}: {errors}")
        for k in range(2 * times):
            clear(folder)
            if k < times:
                number = (signal.SIGINT, signal.SIGTERM)[k % 2]
                delay = rng.uniform(0.0, 1.1 * whole)
                how = f"{number.name} after {delay:.3f} of {whole:.3f} s"
                code, errors, marks = ended(words, folder, delay, number)
            else:
                size = int(10.0 ** rng.uniform(1.0, 5.0))
                how = f"files of {size} bytes"
                code, errors = cramped(words, folder, size)
            wrong, kind = wrong_files(folder), how.split()[0]
            if k < times and marks != b"12" and not wrong:
                found[f"{kind}: {'opening' if marks else 'early'}"] += 1
                continue
            found[f"{kind}: exit {code}"] += 1
            good = code in (0, 2, 130) if k < times else code in (0, 2)
            if wrong or not good or "Traceback" in errors or "KeyboardInterrupt" in errors:
                found["FAULTS"] += 1
                print(f"{name}: {how}: exit {code} {wrong} {errors}", flush=True)
    return found


def main() -> None:
    options = options_of(__doc__, times=(20, "of each command"), seed=1, only="")
    rng, faults = np.random.default_rng(options.seed), 0
    for name in filter(lambda name: name.startswith(options.only), COMMANDS):
        found = campaign(name, options.times, rng)
        faults += found["FAULTS"]
        print(f"{name:14}", dict(sorted(found.items())), flush=True)
    raise SystemExit(1 if faults else 0)


if __name__ == "__main__":
    main()
