"""Outputs that are in the way: nothing is lost, and the message says what is there and why."""

import ast
import re
from pathlib import Path

import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.cli import main
from vibrosweep.errors import ExistingOutputError, ParameterError, TakenOutputError
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import read_spec
from vibrosweep.store.parts import run_directory

PACKAGE = Path(vs.__file__).parent
SWEEP = """title = "A sweep of a test"
[sample]
realizations = 6
seed = 1
restitution = [0.8, 0.9]
"""
GRID = 'title = "A grid"\n[scene]\nparticles = 2\nduration = 40.0\n[sample]\ndesign = "grid"\n'
PICTURED = {
    "windows": GRID + 'amplitude = [0.4, 1.0]\n[windows]\nconditions = ["locked(1)"]\n',
    "bifurcation": GRID + "amplitude = [1.0, 2.0]\n",
    "basins": GRID + "launch_velocity = [1.0, 3.0]\n",
}


@pytest.fixture
def spec(tmp_path):
    def write(text=SWEEP):
        path = tmp_path / "s.toml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def output(tmp_path):
    return tmp_path / "out.h5"


@pytest.fixture
def refused(capsys):
    def call(*words):
        assert main([str(word) for word in words]) == 2
        message = capsys.readouterr().err
        assert "Traceback" not in message
        return message

    return call


# files that appear during a computation


@pytest.mark.parametrize("chunk", [2, None])
@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_appears_during_a_run_is_kept(spec, output, monkeypatch, chunk, links):
    if not links:  # as on a file system without hard links

        def refuse(self, target):
            raise PermissionError

        monkeypatch.setattr(Path, "hardlink_to", refuse)
    sweep, beside = read_spec(spec()), output.with_name("out-2.h5")
    output.with_name("out-1.h5").write_bytes(b"mine, too")
    with pytest.raises(TakenOutputError, match=f"is kept; the result is complete in {beside}$"):
        run_sweep(
            sweep, output, threads=1, chunk=chunk, advance=lambda *now: output.write_bytes(b"mine")
        )
    assert output.read_bytes() == b"mine"
    assert output.with_name("out-1.h5").read_bytes() == b"mine, too"
    whole = output.with_name("whole.h5")
    run_sweep(sweep, whole, threads=1)
    xr.testing.assert_identical(
        xr.load_dataset(beside).drop_attrs(), xr.load_dataset(whole).drop_attrs()
    )
    assert not run_directory(output).exists()
    run_sweep(sweep, output, threads=1, force=True)
    assert output.read_bytes() != b"mine"


@pytest.mark.parametrize("ending", [".h5", ".png"])
def test_a_file_that_appears_beside_a_diagram_is_kept(spec, output, refused, monkeypatch, ending):
    taken = output.with_suffix(ending)
    original = "vibrosweep.analysis.bifurcation.summary"
    monkeypatch.setattr(original, lambda found: [str(taken.write_bytes(b"mine"))])
    message = refused("bifurcation", spec(PICTURED["bifurcation"]), "-o", output)
    assert f"{taken}: appeared" in message
    assert taken.read_bytes() == b"mine"
    assert output.with_name(f"out-1{ending}").stat().st_size > 1000


# impossible names


@pytest.mark.parametrize("command", PICTURED)
@pytest.mark.parametrize("name", ["x.png", "x.PNG"])
def test_a_dataset_does_not_take_the_name_of_its_picture(command, name, spec, tmp_path, refused):
    path = spec(PICTURED[command])
    assert "x.h5 with -o" in refused(command, path, "-o", tmp_path / name, "--force")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("command", ["run", "info", "verify", "figures", *PICTURED])
def test_a_circle_of_links(command, spec, output, refused):
    output.symlink_to(output)
    path = spec(PICTURED.get(command, SWEEP))
    reads = command in ("info", "verify", "figures")
    words = (command, output) if reads else (command, path, "-o", output)
    assert str(output) in refused(*words)
    with pytest.raises(OSError, match=r"cannot be written.*output="):
        vs.run(path, output)


@pytest.mark.parametrize("chunk", [1.5, 0, -5, True, "2"])
def test_a_chunk_is_a_whole_number(spec, output, chunk):
    with pytest.raises(ParameterError, match=r"^chunk = "):
        vs.run(spec(), output, chunk=chunk)
    assert not output.exists()


# existing outputs


def test_existing_results_are_told_apart(spec, output, refused):
    assert main(["run", str(spec()), "-o", str(output)]) == 0
    before = output.read_bytes()
    message = refused("run", spec("# a comment\n" + SWEEP), "-o", output)
    assert "exists and is kept: it is the finished result of exactly this sweep;" in message
    message = refused("run", spec(SWEEP + "[measure]\nregimes = true\n"), "-o", output)
    assert "the result of another sweep or version:\n  measure.regimes: was false, is" in message
    assert "is true\nwrite to another file with -o, or replace it with --force" in message
    assert output.read_bytes() == before
    output.write_bytes(b"other")
    assert "it is not the result of a sweep" in refused("run", spec(), "-o", output)


def test_existing_diagrams_are_told_apart(spec, output, refused):
    path = spec(PICTURED["windows"])
    assert main(["windows", str(path), "-o", str(output)]) == 0
    words = "it is a result of vibrosweep windows from {} sweep file"
    assert words.format("this very") in refused("windows", path, "-o", output)
    path = spec(PICTURED["windows"].replace("40", "41"))
    assert words.format("another") in refused("windows", path, "-o", output)
    assert words.format("another") in refused("run", spec(), "-o", output)


def test_python_opens_a_result_that_is_there(spec, output):
    with vs.run(spec(), output) as found:
        first = found.load()
    before = output.stat()
    with vs.run(spec("# again\n" + SWEEP), output) as found:
        xr.testing.assert_identical(found.load(), first)
    assert output.stat().st_mtime_ns == before.st_mtime_ns
    with pytest.raises(ExistingOutputError, match=r"another sweep.*\n  sample.seed") as caught:
        vs.run(spec(SWEEP.replace("seed = 1", "seed = 2")), output)
    assert "output=, or replace it with force=True" in str(caught.value)


def test_the_library_never_advises_options_of_the_command_line():
    """Only the command line does, because it knows the option for each argument."""
    options = re.compile(r"(?<![\w-])-o\b|--(force|chunk|impact-budget)\b")
    rooms = ("commands", "doctor")
    advice = [
        (path.name, node.lineno, node.value)
        for path in sorted(PACKAGE.rglob("*.py"))
        if path.relative_to(PACKAGE).parts[0] not in rooms and path.name != "mistakes.py"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and options.search(node.value)
    ]
    assert advice == []


# a picture that fails


@pytest.mark.parametrize("command", PICTURED)
def test_a_picture_that_fails_after_its_dataset(command, spec, output, refused, monkeypatch):
    def fail(*arguments, **options):
        raise OverflowError("too many")

    monkeypatch.setattr("vibrosweep.figures.registry.save", fail)
    message = refused(command, spec(PICTURED[command]), "-o", output)
    assert f"{output}: is written and complete, but its picture failed: OverflowErr" in message
    assert xr.load_dataset(output).attrs["result"] == command


def test_an_interrupted_picture(spec, output, capsys, monkeypatch):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("vibrosweep.figures.registry.save", interrupt)
    words = ["basins", str(spec(PICTURED["basins"])), "-o", str(output)]
    assert main(words) == 130
    assert f"{output} is written and complete" in capsys.readouterr().err
    assert output.exists()


def test_a_directory_that_is_a_circle_of_links(spec, output, tmp_path, refused):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    assert main(["run", str(spec()), "-o", str(output)]) == 0
    assert str(loop) in refused("figures", output, "-o", loop)
