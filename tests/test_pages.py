"""Pages for those who read and change the code name files and functions that exist."""

import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "vibrosweep"
PAGES = [ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
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
