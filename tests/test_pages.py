"""The pages name files and functions that exist, and every key, variable, command and picture."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from docs.page_tables import PAGES as PAGES_WITH_TABLES
from docs.page_tables import insert
from vibrosweep.commands import COMMANDS
from vibrosweep.scene.keys import SECTIONS

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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    path = r"(?:\.?\w+/)+(?:[\w-]+\.(?:py|toml|md|json))?"
    named = set(re.findall(rf"`(?:python )?({path})[ `]", text))
    named |= {link.partition("#")[0] for link in re.findall(r"\]\((?!http)([^)]+)\)", text)}
    homes = (ROOT, PACKAGE, page.parent)
    missing = {name for name in named if not any((home / name).exists() for home in homes)}
    assert {name for name in missing if not name.startswith(MADE)} == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
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


@pytest.mark.parametrize("page", ["README.md", "docs/commands.md"])
def test_every_command_is_listed(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert [name for name in COMMANDS if not re.search(rf"`vibrosweep {name}[ `]", text)] == []


@pytest.mark.parametrize(
    "page", sorted((DOCS / "tutorials").glob("[!i]*.md")), ids=lambda p: p.stem
)
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


@pytest.mark.parametrize("picture", sorted(captions()))
def test_every_caption_states_its_scene(picture):
    """Restitution, forcing, frequency, number of particles, base and law."""
    text = captions()[picture]
    for words in (r"\be (=|0\.)", r"\b(A|a|V0|Γ) (=|\d)", r"\bf (=|0\.)", r"\bN = ", r"\blaw\b"):
        assert re.search(words, text), words
    assert re.search(r"high-bounce map|moving base|sprung base", text)
