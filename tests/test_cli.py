"""The command line as a hostile user meets it: exit codes, one clear message, nothing left over."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from itertools import cycle
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from tests.cases import each_of
from vibrosweep import cli
from vibrosweep.cli import main
from vibrosweep.system import ENDINGS

ROOT = Path(__file__).parents[1]
SINGLE = ROOT / "sweeps" / "single_ball.toml"
COMMAND = [sys.executable, "-m", "vibrosweep"]
# Half a minute of work in chunks, and hours in one call of a kernel that nothing can stop, because
# error bounds follow every landing
CHUNKS = """
title = "A long sweep"
[scene]
particles = 20
[sample]
realizations = 10_000_000
restitution = [0.8, 0.98]
"""
KERNEL = """
title = "A long orbit"
[scene]
duration = 1e12
[measure]
trust = true
impact_budget = 1_000_000_000_000
"""


@pytest.fixture
def vibrosweep(capsys):
    """Run a command in this process; return its exit code, output and messages."""

    def call(*words):
        try:
            code = main([str(word) for word in words])
        except SystemExit as ending:  # argparse
            code = ending.code
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    return call


@pytest.fixture
def refused(vibrosweep):
    """Run a command that must fail by the user's mistake; return its one message."""

    def call(*words):
        code, _, message = vibrosweep(*words)
        assert code == 2
        assert message.count("vibrosweep: ") == 1
        assert message.endswith("\n")
        return message

    return call


@pytest.fixture
def spec(tmp_path):
    """Write a sweep file."""

    def write(text, name="sweep.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    path = tmp_path_factory.mktemp("computed") / "result.h5"
    assert main(["run", str(SINGLE), "-o", str(path)]) == 0
    return path


@pytest.fixture
def result(tmp_path, computed):
    return Path(shutil.copy(computed, tmp_path))


@pytest.fixture
def start():
    """Start a command as a process that ends with the test at the latest."""
    begun = []

    def begin(*words, **options):
        process = subprocess.Popen(
            [*COMMAND, *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            **options,
        )
        begun.append(process)
        return process

    yield begin
    for process in begun:
        with process:
            process.kill()


def wait_for(process, directory, pattern, number=1):
    """Wait until a run has written so many files."""
    for _ in range(1200):
        found = [path for path in directory.glob(pattern) if path.stat().st_size]
        if len(found) >= number:
            return found
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)
    raise TimeoutError


PARTIAL, PARTS = "*.parts/.*.partial", "*.parts/chunk-*.part"


def variables(path):
    with xr.open_dataset(path) as result:
        return {name: values.values.tobytes() for name, values in result.variables.items()}


# normal use


def test_the_whole_job(vibrosweep, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, text, messages = vibrosweep("run", SINGLE)
    assert code == 0
    assert all("of 1 realization" in line for line in messages.splitlines())  # where it takes long
    assert text.startswith("Height of one particle at Table 1 against time\n1 realization of 1 ")
    assert "rebound_height_max (m)" in text
    assert text.endswith("written to single_ball.h5\n")
    code, text, _ = vibrosweep("info", "single_ball.h5")
    assert code == 0
    assert text.startswith("Height of one particle")
    code, text, _ = vibrosweep("figures", "single_ball.h5")
    assert code == 0
    written = [line for line in text.splitlines() if not line.startswith("left out: ")]
    assert sorted(written) == sorted(str(p) for p in Path("figures").iterdir())
    assert len(written) > 2
    assert {p.name for p in tmp_path.iterdir()} == {"single_ball.h5", "figures"}


def test_figures_of_a_result_without_particles(vibrosweep, spec, tmp_path):
    """Staggered launches at a sampled frequency: no variable has the dimension of particles."""
    sweep = spec('title = "x"\n[sample]\nrealizations = 3\nfrequency = [8, 9]')
    assert vibrosweep("run", sweep, "-o", tmp_path / "f.h5")[0] == 0
    code, text, message = vibrosweep("figures", tmp_path / "f.h5", "-o", tmp_path / "figures")
    assert (code, message) == (0, "")
    assert "return_map need the record" in text


def test_options_do_not_change_the_result(vibrosweep, result, tmp_path):
    other = tmp_path / "other.h5"
    assert vibrosweep("run", SINGLE, "-o", other, "--threads", 1, "--chunk", 1)[0] == 0
    one, two = xr.load_dataset(result), xr.load_dataset(other)
    assert one.drop_attrs().identical(two.drop_attrs())
    assert two.attrs["threads"] == 1


def test_version_and_help(vibrosweep):
    assert vibrosweep("--version")[:2] == (0, "vibrosweep 0.1.0\n")
    code, text, _ = vibrosweep("--help")
    assert code == 0
    assert all(name in text for name in ("plan", "run", "info", "figures", "verify"))
    for command in ("plan", "run", "info", "figures", "verify"):
        assert vibrosweep(command, "--help")[0] == 0


def test_help_loads_nothing_but_the_standard_library():
    """That makes it quick: 0.04 s."""
    code = (
        "import sys\nbefore = set(sys.modules)\nfrom vibrosweep.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n"
        "    loaded = {name.partition('.')[0] for name in set(sys.modules) - before}\n"
        "    print(*loaded - sys.stdlib_module_names, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "vibrosweep"


# mistakes in commands and sweep files


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("title = ", "is not valid TOML"),
        ("", "title: is missing"),
        ('title = "x"\n[scene]\nrestituton = 0.9', 'did you mean "restitution"'),
        ('title = "x"\n[scene]\nrestitution = "0.9"', "is not a finite number"),
        ('title = "x"\n[scene]\nrestitution = 1.5', "at least 0 and at most 1"),
        ('title = "x"\n[sample]\nrealizations = 9\nrestitution = [0.9, 0.9]', "range is empty"),
        ('title = "x"\n[sample]\ndesign = "sobel"', 'did you mean "sobol"'),
        ('title = "x"\n[sample]\ndesign = "none.csv"', "there is no such table"),
        ('title = "x"\n[scene]\nduration = 1e300', "forcing periods"),
    ],
)
def test_a_bad_sweep_file(spec, refused, tmp_path, text, words):
    path = spec(text)
    assert words in refused("run", path, "-o", tmp_path / "out.h5")
    assert [p.name for p in tmp_path.iterdir()] == ["sweep.toml"]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("restitution\n0.9\n", 'column "amplitude" is missing'),
        ("restitution,amplitude\n0.9,nan\n", "nan is not allowed"),
        ("restitution,amplitude\n0.9,\n", "nothing is not allowed"),
        ("restitution,amplitude\n", "has no rows"),
    ],
)
def test_a_bad_table(spec, refused, tmp_path, rows, words):
    (tmp_path / "table.csv").write_text(rows)
    path = spec('title = "x"\n[sample]\ndesign = "table.csv"')
    assert words in refused("run", path, "-o", tmp_path / "out.h5")
    assert {p.name for p in tmp_path.iterdir()} == {"sweep.toml", "table.csv"}


def test_a_sweep_file_that_is_none(refused, tmp_path, result):
    assert "no such" in refused("run", tmp_path / "none.toml")
    assert "is a directory" in refused("run", tmp_path)
    assert "sweep file" in refused("run", result)


def test_outputs_that_cannot_be_written(refused, spec, tmp_path):
    path = spec(SINGLE.read_text(encoding="utf-8"))
    for command in ("run", "plan"):
        assert "is a directory" in refused(command, path, "-o", tmp_path)
    assert "is not a directory; create it" in refused("run", path, "-o", tmp_path / "no" / "o.h5")
    assert "is not a directory" in refused("run", path, "-o", path / "out.h5")
    assert "too long" in refused("run", path, "-o", tmp_path / ("x" * 300))
    assert "is an input" in refused("run", path, "-o", path, "--force")
    assert "not a regular file" in refused("run", path, "-o", os.devnull, "--force")
    assert [p.name for p in tmp_path.iterdir()] == ["sweep.toml"]


@pytest.mark.skipif(
    not Path("/proc/self").exists(), reason="needs a file system that takes no file"
)
def test_an_unwritable_directory(refused):
    assert "cannot write in /proc" in refused("run", SINGLE, "-o", "/proc/out.h5")


@pytest.mark.parametrize("words", [["--threads", "0"], ["--threads", "two"], ["--chunk", "-1"]])
def test_numbers_on_the_command_line(vibrosweep, words):
    code, _, message = vibrosweep("run", SINGLE, *words)
    assert code == 2
    assert f"{words[1]!r} is not a whole number" in message


@pytest.mark.parametrize("words", [[], ["run"], ["run", "a", "b"], ["info", "--force"]])
def test_wrong_commands_get_the_usage(vibrosweep, words):
    code, _, message = vibrosweep(*words)
    assert code == 2
    assert message.startswith("usage: vibrosweep")


# mistakes in result files


@pytest.mark.parametrize("command", ["info", "figures", "verify"])
def test_files_that_are_no_results(refused, result, tmp_path, command):
    garbage, empty, foreign, half, cut = (tmp_path / f"{k}.h5" for k in range(5))
    garbage.write_bytes(b"no HDF5 at all")
    empty.touch()
    with h5py.File(foreign, "w") as file:
        file["x"] = np.arange(3)
    xr.Dataset({"impact_count": ("realization", [1])}).to_netcdf(half, engine="h5netcdf")
    cut.write_bytes(result.read_bytes()[:-1000])
    assert "no such" in refused(command, tmp_path / "none.h5")
    before = set(tmp_path.iterdir())
    for path in (garbage, empty, foreign, half, cut, tmp_path):
        assert f"{path}: is not a result" in refused(command, path)
    assert set(tmp_path.iterdir()) == before


def test_damaged_data_is_named(refused, result, tmp_path):
    """The file opens, but what it holds cannot be read."""
    with h5py.File(result) as file:
        chunk = file["record/rested"].id.get_chunk_info(0)
    with result.open("r+b") as file:
        file.seek(chunk.byte_offset)
        file.write(b"\xff" * chunk.size)
    message = refused("figures", result, "-o", tmp_path / "figures")
    assert f"{result}: is damaged" in message
    assert not (tmp_path / "figures").exists()


def test_figures_that_cannot_be_written(refused, result, tmp_path):
    (tmp_path / "taken").touch()
    assert "cannot be made" in refused("figures", result, "-o", tmp_path / "taken")


# accidents


def test_memory_that_runs_out(refused, monkeypatch, spec, tmp_path):
    """The advice can be followed with the command that was given."""

    def measure(*arguments, **options):
        raise MemoryError("Unable to allocate 1 TiB")

    monkeypatch.setattr("vibrosweep.commands.describe.describe", measure)
    monkeypatch.setattr("vibrosweep.scene.sweep.read_spec", measure)
    output = tmp_path / "out.h5"
    for command, chunked in (("run", True), ("windows", False), ("basins", False)):
        message = refused(command, spec, "-o", output)
        assert "not enough memory: Unable to allocate 1 TiB" in message
        assert ("--chunk" in message) == chunked
    assert "--chunk" not in refused("info", "x.h5")


@pytest.mark.parametrize(
    "ending", [signal.SIGINT, *(pytest.param(s, marks=pytest.mark.weekly) for s in ENDINGS[1:])]
)
def test_an_interrupted_run_leaves_nothing(start, spec, tmp_path, ending):
    """It has no finished chunk: one call of a kernel computes it all."""
    if signal.getsignal(ending) is signal.SIG_IGN:
        pytest.skip("this signal is ignored, as under nohup, and so the command ignores it, too")
    old = tmp_path / "out.h5"
    old.write_bytes(b"old")
    process = start("run", spec(KERNEL), "-o", old, "--force")
    wait_for(process, tmp_path, PARTIAL)
    for _ in range(3):  # an impatient user
        process.send_signal(ending)
        time.sleep(0.01)
    messages = process.communicate(timeout=20)[1]
    expected = "vibrosweep: interrupted; the unfinished result was discarded\n"
    assert (process.returncode, messages) == (130, expected)
    assert old.read_bytes() == b"old"
    assert {p.name for p in tmp_path.iterdir()} == {"sweep.toml", "out.h5"}


def test_an_interrupted_run_keeps_what_is_finished(start, spec, vibrosweep, tmp_path):
    """By SIGTERM: the command treats all signals that end it alike."""
    output = tmp_path / "out.h5"
    words = ("run", spec(CHUNKS.replace("10_000_000", "60_000")), "-o", output)
    process = start(*words, "--chunk", 200)
    wait_for(process, tmp_path, PARTS, 3)
    process.send_signal(signal.SIGTERM)
    messages = process.communicate(timeout=20)[1]
    finished = len(list(tmp_path.glob(PARTS)))
    assert 3 <= finished < 300
    assert process.returncode == 130
    assert messages.startswith(f"vibrosweep: interrupted; {finished} of 300 chunks are finished")
    assert messages.endswith(": run the same command again to continue\n")
    assert messages.count("\n") == 1
    assert not output.exists()
    code, text, _ = vibrosweep("info", output)
    assert code == 0
    assert text.startswith(f"{output}: is not finished: {finished} of 300 chunks are in ")
    assert vibrosweep(*words)[0] == 0
    assert {p.name for p in tmp_path.iterdir()} == {"sweep.toml", "out.h5"}
    assert vibrosweep("run", words[1], "-o", tmp_path / "whole.h5")[0] == 0
    assert variables(output) == variables(tmp_path / "whole.h5")


def test_a_killed_run_continues(start, spec, refused, vibrosweep, tmp_path):
    """One kill; checks/kills.py makes hundreds at random moments."""
    output, path = tmp_path / "out.h5", spec(CHUNKS.replace("10_000_000", "60_000"))
    with start("run", path, "-o", output, "--chunk", 200) as process:
        wait_for(process, tmp_path, PARTS)
        process.kill()
    assert not output.exists()
    partial = tmp_path / "out.h5.parts" / ".x.partial"
    partial.write_bytes(b"what a killed write leaves")
    refused("figures", partial, "-o", tmp_path / "figures")
    refused("run", spec(CHUNKS, "other.toml"), "-o", output)
    assert vibrosweep("run", path, "-o", output)[0] == 0
    assert not (tmp_path / "out.h5.parts").exists()
    assert vibrosweep("run", path, "-o", tmp_path / "whole.h5")[0] == 0
    assert variables(output) == variables(tmp_path / "whole.h5")


def test_a_spent_budget_is_listed_and_tried_again(spec, refused, vibrosweep, tmp_path):
    text = 'title = "x"\n[sample]\nrealizations = 9\namplitude = [0.001, 3.0]\n[measure]\n'
    path, output = spec(text + "impact_budget = 16"), tmp_path / "out.h5"
    assert vibrosweep("run", path, "-o", output)[0] == 0
    lines = vibrosweep("info", output)[1].splitlines()
    spent = int(np.sum(xr.load_dataset(output)["status"] == 1))
    assert 0 < spent < 9
    again = "vibrosweep run --retry-failed --impact-budget N"
    head = f"realizations that did not complete: {spent}; {again}"
    listed = lines[lines.index(head) + 1 :]
    assert len(listed) == spent
    assert all(", amplitude " in line and "budget_exceeded" in line for line in listed)
    again = ("run", path, "-o", output, "--retry-failed", "--impact-budget")
    assert "would not reach" in refused(*again, 8)
    code, text, _ = vibrosweep(*again, 100_000)
    assert code == 0
    assert text.splitlines()[1] == f"{spent} realization{'s' * (spent > 1)} computed again"
    assert text.endswith(f"written to {output}\n")
    assert "did not complete" not in vibrosweep("info", output)[1]
    code, text, _ = vibrosweep(*again, 200_000)
    assert text.splitlines()[1] == "0 realizations computed again"
    assert text.endswith(f"{output} is unchanged\n")
    assert "goes with --retry-failed" in refused("run", path, "--impact-budget", 3)


def test_a_plan(spec, refused, vibrosweep, tmp_path, memory):
    code, text, message = vibrosweep("plan", SINGLE, "-o", tmp_path / "out.h5")
    assert (code, message) == (0, "")
    names = [line.split()[0] for line in text.splitlines()[1:]]
    assert names[:3] == ["realizations", "chunks", "impacts"]
    assert list(tmp_path.iterdir()) == []
    many = spec(CHUNKS.replace("10_000_000", "1_000_000_000_000"))
    message = refused("plan", many, "-o", tmp_path / "out.h5")
    assert "GiB of disk" in message
    assert "lower sample.realizations" in message
    assert "GiB of disk" in refused("run", many, "-o", tmp_path / "out.h5")
    assert [p.name for p in tmp_path.iterdir()] == ["sweep.toml"]
    record = spec('title = "x"\n[scene]\nduration = 1e12\n[record]\nduration = 1e12\n')
    memory(10**7)
    for command in ("plan", "run"):
        assert "shorten the duration" in refused(command, record, "-o", tmp_path / "out.h5")


def test_a_call_leaves_the_process_alone(vibrosweep, result):
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    vibrosweep("info", result)
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_an_output_stream_that_is_full():
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*COMMAND, "examples"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 2
    assert done.stderr == "vibrosweep: [Errno 28] No space left on device\n"


def test_readers_that_go_away():
    command = " ".join(f"'{word}'" for word in [*COMMAND, "examples"])
    for line in (f"{command} | head -n 1", f"{command} >&- 2>&-", f"{command} | true"):
        done = subprocess.run(
            ["bash", "-o", "pipefail", "-c", line], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, ""), line


def test_any_title_can_be_printed(start, spec, tmp_path):
    path = spec('title = "Kugelstoß ☃"')
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    process = start("run", path, "-o", tmp_path / "out.h5", env=environment)
    out, messages = process.communicate()
    assert (process.returncode, messages) == (0, "")
    assert out.startswith("Kugelsto\\xdf \\u2603\n")


def test_exit_codes():
    assert (cli.DONE, cli.MISTAKE, cli.INTERRUPTED) == (0, 2, 130)


@each_of(
    ("words", "message"),
    [
        (["bifurcation", str(SINGLE), "-o", ""], "'' is not the name of a file"),
        (["run", str(SINGLE), "-o", "/"], "'/' is not the name of a file"),
        (["windows", str(SINGLE), "-o", ".."], "'..' is not the name of a file"),
        (["figures", "any.h5", "-o", ""], "'' is not the name of a directory"),
        (["run", str(SINGLE), "--threads", "9" * 20], "at least 1 and at most 4096"),
        (["run", str(SINGLE), "--workers", "9" * 5000], "at least 1 and at most 4096"),
        (["verify", "any.h5", "--sample", "9" * 20], "at most 9007199254740992"),
    ],
)
def test_absurd_values_of_options(words, message, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert message in said
    assert len(said) < 2000


def test_a_notebooks_backend_does_not_stop_a_command():
    """It may not be installed."""
    code = (
        "import sys; sys.argv[1:] = ['examples']; from vibrosweep.cli import main; main()\n"
        "import matplotlib.pyplot; print(matplotlib.get_backend())"
    )
    environment = {**os.environ, "MPLBACKEND": "module://none"}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert (done.stderr, done.stdout.splitlines()[-1]) == ("", "agg")


# What sends a signal, and where, as lines of Python before the command
AT_IMPORT = """
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            interrupted()
sys.meta_path.insert(0, Finder())
"""
PLACES = {
    **{
        name: AT_IMPORT.format(name=name)
        for name in (
            *("vibrosweep.cli", "vibrosweep.errors", "vibrosweep.commands.results"),
            *("numpy.linalg", "h5py._hl", "matplotlib.figure", "xarray.core.dataset"),
        )
    },
    "parse": "import argparse; argparse.ArgumentParser.parse_args = interrupted",
    "command": "import vibrosweep.commands.results as c\nc.figures = interrupted",
    "draw": "import matplotlib.axes as m; m.Axes.draw = interrupted",
    "save": "import matplotlib.backends.backend_agg as m; m.FigureCanvasAgg.draw = interrupted",
    "compile": "import numba.core.typeinfer as n; n.TypeInferer.propagate = interrupted",
    "destructor": """
class Closing:
    __del__ = interrupted
def perform(options):
    Closing()
    while True:
        time.sleep(0.01)
import vibrosweep.commands.results as c
c.figures = perform
""",
}


# early and late imports, a compilation, a drawing, and where exceptions are lost
DAILY = ("vibrosweep.errors", "h5py._hl", "compile", "draw", "destructor")


@pytest.mark.parametrize(
    ("place", "ending"),
    [
        pytest.param(*one, marks=[pytest.mark.weekly] * (one[0] not in DAILY))
        for one in zip(PLACES, cycle(["SIGINT", "SIGTERM"]))
    ],
)
def test_a_signal_anywhere_is_one_message(place, ending, result, tmp_path):
    """The command is interrupted while it imports, parses, compiles, draws, or tidies."""
    words = ["figures", str(result), "-o", "drawn"]
    if place == "compile":
        words = ["run", str(SINGLE), "-o", "new.h5"]
    program = f"""
import signal, sys, time
def interrupted(*a, **k): signal.raise_signal(signal.{ending})
signal.signal(signal.SIGINT, signal.default_int_handler)
{PLACES[place]}
sys.argv = ["vibrosweep", *{words!r}]
import vibrosweep.__main__
sys.exit(vibrosweep.__main__.main())
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)} if place == "compile" else None,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
        timeout=60,
    )
    assert done.returncode == 130
    early = place in ("vibrosweep.cli", "vibrosweep.errors")
    said = "before it began" if early else "the unfinished result was discarded"
    assert re.fullmatch(f"vibrosweep: interrupted;? {said}\n", done.stderr)
    assert not list(tmp_path.glob("drawn/*"))
    assert not list(tmp_path.glob("new.h5*"))


def test_the_package_begins_at_once():
    """Signals cannot be handled before the package is imported: it loads nothing for that."""
    code = (
        "import sys\nbefore = set(sys.modules)\nimport vibrosweep\n"
        "print(*sorted(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {*done.stdout.split()} <= {"__future__", "vibrosweep", "vibrosweep._version"}
