"""The page in a file."""

import re

import pytest

from vibrosweep.errors import ExistingOutputError, OutputError
from vibrosweep.explore import static


def test_a_page_is_one_file_that_says_what_it_holds(points, tmp_path, monkeypatch):
    monkeypatch.setattr(static, "MOST_MOTIONS", 3)
    monkeypatch.setattr(static, "MOST_POINTS", 20)
    path = tmp_path / "page.html"
    said = static.write_page(points, path, force=False)
    text = path.read_text("utf-8")
    assert "20 of 30 points; a click shows the nearest of 3 realizations" in said
    assert "20 of 30 points" in text
    # nothing is fetched: scripts and styles stand in the file
    assert not re.search(r"<(script|link|img)[^>]*\b(src|href)\s*=\s*.?(?!data:)\w+:", text)
    with pytest.raises(ExistingOutputError):
        static.write_page(points, path, force=False)
    # what would be too large has fewer motions, or is refused
    monkeypatch.setattr(static, "LARGEST", path.stat().st_size - 1)
    assert "nearest of 1 realizations" in static.write_page(points, path, force=True)
    monkeypatch.setattr(static, "LARGEST", 1000)
    monkeypatch.setattr(static, "MOST_MOTIONS", 1)
    with pytest.raises(OutputError, match=r"other\.html: would have \d+ bytes, more than 1000"):
        static.write_page(points, tmp_path / "other.html", force=False)
    assert not (tmp_path / "other.html").exists()
