"""The page in a file."""

import re

import pytest

from vibrosweep.errors import ExistingOutputError, OutputError
from vibrosweep.explorer.static import Limits, write_page


def test_a_page_is_one_file_that_says_what_it_holds(points, tmp_path):
    limits, path = Limits(points=20, motions=3), tmp_path / "page.html"
    said = write_page(points, path, force=False, limits=limits)
    text = path.read_text("utf-8")
    assert "20 of 30 points; a click shows the nearest of 3 realizations" in said
    assert "20 of 30 points" in text
    # nothing is fetched: scripts and styles are in the file
    assert not re.search(r"<(script|link|img)[^>]*\b(src|href)\s*=\s*.?(?!data:)\w+:", text)
    with pytest.raises(ExistingOutputError):
        write_page(points, path, force=False)
    # a page that would be too large gets fewer motions, or is refused
    smaller = limits._replace(size=path.stat().st_size - 1)
    said = write_page(points, path, force=True, limits=smaller)
    assert "nearest of 1 realizations" in said
    least = Limits(size=1000, motions=1)
    with pytest.raises(OutputError, match=r"other\.html: would have \d+ bytes, more than 1000"):
        write_page(points, tmp_path / "other.html", force=False, limits=least)
    assert not (tmp_path / "other.html").exists()
