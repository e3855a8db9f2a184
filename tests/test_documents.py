"""Pages, their commands, examples and the reference say what the program does."""

import ast
import inspect
import os
import re
import shutil
import subprocess
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
import xarray as xr

import vibrosweep
import vibrosweep as vs
from docs.page_tables import PAGES as PAGES_WITH_TABLES
from docs.page_tables import insert
from tests.cases import each_of
from vibrosweep.cli import main
from vibrosweep.commands import COMMANDS
from vibrosweep.errors import ExistingOutputError, ParameterError, TakenOutputError
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.sweep import read_spec
from vibrosweep.store.parts import run_directory

# The pages name files and functions that exist, and every key, variable, command and picture.

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "vibrosweep"
DOCS = ROOT / "docs"
PAGES = [
    *sorted(ROOT.glob("[!C]*.md")),
    ROOT / "CONTRIBUTING.md",
    *(
        page
        for room in ("docs", "study", "checks", "benchmarks")
        for page in sorted((ROOT / room).rglob("*.md"))
    ),
]
ROOMS = [path.parent.name for path in PACKAGE.glob("*/__init__.py")] + ["api"]
MADE = ("claims/", "pictures/")  # by the commands of a page


@each_of("page", PAGES)
def test_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    path = r"(?:\.?\w+/)+(?:[\w-]+\.(?:py|toml|md|json))?"
    named = set(re.findall(rf"`(?:python )?({path})[ `]", text))
    named |= {link.partition("#")[0] for link in re.findall(r"\]\((?!http)([^)]+)\)", text)}
    homes = (ROOT, PACKAGE, page.parent)
    missing = {name for name in named if not any((home / name).exists() for home in homes)}
    assert {name for name in missing if not name.startswith(MADE)} == set()


@each_of("page", PAGES)
def test_functions_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(rf"`(?:vibrosweep\.)?((?:{'|'.join(ROOMS)})(?:\.\w+)+)[`(]", text):
        parts = name.split(".")
        inside = PACKAGE.joinpath(*parts)
        if inside.is_dir() or inside.with_suffix(".py").exists():
            continue
        module, function = import_module(".".join(["vibrosweep", *parts[:-1]])), parts[-1]
        assert hasattr(module, function), name


@pytest.mark.parametrize("name", PAGES_WITH_TABLES)
def test_the_tables_of_a_page_are_those_of_the_registries(name):
    text = (DOCS / name).read_text(encoding="utf-8")
    assert insert(text) == text


def test_every_key_of_a_sweep_file_is_explained():
    text = (DOCS / "sweep-files.md").read_text(encoding="utf-8")
    names = {key for keys in SECTIONS.values() for key in keys} | {f"[{t}]" for t in SECTIONS}
    assert {name for name in names if f"`{name}`" not in text} == set()


@pytest.mark.parametrize("page", ["README.md", "docs/which.md"])
def test_every_command_is_listed(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert [name for name in COMMANDS if not re.search(rf"`vibrosweep {name}[ `]", text)] == []


@each_of("page", sorted((DOCS / "tutorials").glob("[!i]*.md")))
def test_every_tutorial_can_be_downloaded_and_finds_the_program(page):
    text = page.read_text(encoding="utf-8")
    assert f"<{page.stem}.ipynb>`" in text
    assert "\n!vibrosweep" not in text.partition('sysconfig.get_path("scripts")')[0]
    assert ("\n!vibrosweep" in text) == ("sysconfig" in text)


@pytest.mark.parametrize("room", ["docs", "study", "benchmarks"])
def test_every_picture_is_shown(room):
    pages = [*(ROOT / room).glob("*.md"), ROOT / "checks" / "README.md"]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    stored = {path.name for path in (ROOT / room / "images").iterdir()}
    assert stored - {*re.findall(r"images/([\w.]+)", text)} == set()


def test_every_page_that_the_package_names_exists():
    """Messages and docstrings send readers to pages of the repository."""
    sources = [path for kind in ("*.py", "*.toml", "*.js") for path in PACKAGE.rglob(kind)]
    text = "".join(path.read_text(encoding="utf-8") for path in sources)
    named = {
        *re.findall(r"(?<![\w/.])((?:docs|study|checks|sweeps)/[\w./-]+\.(?:md|rst|toml))", text)
    }
    assert "docs/limits.md" in named
    assert {name for name in named if not (ROOT / name).exists()} == set()


def captions():
    """Captions of the gallery's cards by their picture."""
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    cards = re.findall(r"\(images/([^)]+)\)\n\n(.*?)\n\n", page, flags=re.DOTALL)
    return {picture: " ".join(words.split()) for picture, words in cards}


@each_of("picture", sorted(captions()))
def test_every_caption_states_its_scene(picture):
    """Restitution, forcing, frequency, number of particles, base and law."""
    text = captions()[picture]
    for words in (r"\be (=|0\.)", r"\b(A|a|V0|Γ) (=|\d)", r"\bf (=|0\.)", r"\bN = ", r"\blaw\b"):
        assert re.search(words, text), words
    assert re.search(r"high-bounce map|moving base|sprung base", text)


# The README is true: its commands, its files and its Python.

README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS_README = {
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


@pytest.mark.parametrize("heading", COMMANDS_README)
def test_continuous_integration_finds_the_command(heading, tmp_path):
    assert extracted(README, heading, tmp_path).stdout == COMMANDS_README[heading] + "\n"


@pytest.mark.parametrize("change", ["", "x\n", "absent"])
def test_continuous_integration_fails_without_one_command(change, tmp_path):
    line = COMMANDS_README["Install and run"] + "\n"
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
    assert {"docs/model.md", "docs/images/moving_height_time_all.png"} <= named


def test_two_small_pictures():
    shown = re.findall(r"!\[.+\]\((.+\.png)\)", README)
    assert len(shown) == 2
    assert all((ROOT / path).stat().st_size < 200_000 for path in shown)


def test_the_first_screen_is_short():
    assert len(README.split()) <= 700


def test_the_python_runs():
    (code,) = blocks("python")
    done = {}
    exec(compile(code.replace("120", "12"), "README.md", "exec"), done)  # takes seconds with 120
    assert done["sweep"]["locked_count"].shape == (12, 12)


# The reference: every public name has its page, with parameters, results, errors, an example.

PAGE = (Path(__file__).parents[1] / "docs" / "reference" / "python.rst").read_text(encoding="utf-8")
LISTED = re.findall(r"^   (vibrosweep\.[\w.]+)$", PAGE, re.MULTILINE)


def namespaces(module):
    """A public module, and the modules among its public names."""
    yield module
    for name in module.__all__:
        if isinstance(getattr(module, name), ModuleType):
            yield from namespaces(getattr(module, name))


NAMESPACES = {module.__name__: module for module in namespaces(vibrosweep)}
PUBLIC = {
    f"{home}.{name}": getattr(module, name)
    for home, module in NAMESPACES.items()
    for name in module.__all__
    if not isinstance(getattr(module, name), ModuleType)
}
FUNCTIONS = [n for n in vibrosweep.__all__ if inspect.isfunction(getattr(vibrosweep, n))]
TOLD = {"vibrosweep.__version__", "vibrosweep.errors.OPTIONS"}  # names that need no entry


def found(path):
    """Return the object of a dotted name."""
    home, _, name = path.rpartition(".")
    return getattr(import_module(home), name)


def sections(thing):
    """Sections of a numpydoc docstring, by their titles."""
    parts = re.split(r"^(\w[\w ]+)\n-+$", inspect.getdoc(thing), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(section):
    """Names that head the entries of a section."""
    heads = re.findall(r"^(\*{0,2}\w.*)$", section, re.MULTILINE)
    return {name.strip(" *") for head in heads for name in head.partition(":")[0].split(",")}


def test_the_page_lists_the_public_names_and_no_others():
    assert {path for path, thing in PUBLIC.items() if callable(thing)} == {*LISTED}
    data = {path for path, thing in PUBLIC.items() if not callable(thing)} - TOLD
    assert {path for path in data if not re.search(rf"\b{path.split('.')[-1]}``", PAGE)} == set()


@each_of("home", NAMESPACES)
def test_no_public_name_is_that_of_a_hidden_module(home):
    """Once the module is imported, the name would refer to it."""
    folders = getattr(NAMESPACES[home], "__path__", [])
    beside = {path.stem for folder in folders for path in Path(folder).iterdir()}
    names = {path.rpartition(".")[2] for path in PUBLIC if path.rpartition(".")[0] == home}
    assert names & beside == set()


@each_of("home", NAMESPACES)
def test_names_that_are_loaded_late_are_those_that_are_public(home):
    late = getattr(NAMESPACES[home], "_HOMES", None)
    if late is not None:
        assert {*late} == {*NAMESPACES[home].__all__} - {"__version__"}


def test_every_parameter_is_documented():
    for path in LISTED:
        thing = found(path)
        if inspect.isclass(thing):
            assert inspect.getdoc(thing), path
            continue
        told = sections(thing)
        asked = thing.__annotations__.keys() - {"return"}
        assert asked - documented(told.get("Parameters", "")) == set(), path
        assert "Returns" in told, path


def test_every_name_shows_an_example():
    """Sphinx runs them when the site is checked."""
    for path in LISTED:
        if not path.startswith("vibrosweep.errors."):
            name, shown = path.rpartition(".")[2], sections(found(path)).get("Examples", "")
            assert re.search(rf"^(>>>|\.\.\.) .*\b{name}\b", shown, re.MULTILINE), path


@each_of("name", FUNCTIONS)
def test_every_public_function_tells_its_errors_and_shows_an_example(name):
    told = sections(getattr(vibrosweep, name))
    assert re.search(r"^\w+Error", told["Raises"], re.MULTILINE)
    assert f"vs.{name}(" in told["Examples"]
    if inspect.signature(getattr(vibrosweep, name)).return_annotation == "xr.Dataset":
        assert re.search(r"\b[Dd]ims?\b|As `", told["Returns"])


# Outputs that are in the way: nothing is lost, and the message says what is there and why.

PACKAGE_OUTPUTS = Path(vs.__file__).parent
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
    with pytest.raises(
        TakenOutputError, match=f"was not replaced; the result is complete in {beside}$"
    ):
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
    assert (
        "exists and was not replaced: it is the finished result of exactly this sweep;" in message
    )
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
        for path in sorted(PACKAGE_OUTPUTS.rglob("*.py"))
        if path.relative_to(PACKAGE_OUTPUTS).parts[0] not in rooms and path.name != "mistakes.py"
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
