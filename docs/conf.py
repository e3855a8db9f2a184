"""The site: Markdown pages, tutorials that run when it is built, and the reference of the API.

python -m sphinx -W --keep-going docs build/site
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING
from xml.sax.saxutils import unescape

from latex2mathml.converter import convert

import vibrosweep

if TYPE_CHECKING:
    from docutils.nodes import Element
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator

project = "vibrosweep"
author = copyright = "The vibrosweep developers"  # noqa: A001
version = release = vibrosweep.__version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.doctest",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["build"]
default_role = "py:obj"
nitpicky = False

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
os.environ["TQDM_DISABLE"] = "1"  # no progress bars in what tutorials print
nb_execution_mode = "force"
nb_execution_in_temp = True  # a tutorial leaves no file behind
nb_execution_raise_on_error = True
nb_execution_timeout = 180
nb_merge_streams = True

autosummary_generate = True
numpydoc_show_class_members = False

html_theme = "pydata_sphinx_theme"
html_title = "vibrosweep"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"  # drawn by the browser: nothing is loaded from elsewhere
html_show_sourcelink = False
html_sidebars = {page: [] for page in ("index", "start", "gallery")}  # nothing is below them
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
}


def inline(translator: HTML5Translator, node: Element) -> None:
    """Write a formula within a line."""
    _write(translator, node, "inline")


def display(translator: HTML5Translator, node: Element) -> None:
    """Write a formula on lines of its own."""
    _write(translator, node, "block")


def _write(translator: HTML5Translator, node: Element, shown: str) -> None:
    from docutils.nodes import SkipNode

    formula = convert(unescape(node.astext()), display=shown)
    translator.body.append(f'<div class="formula">{formula}</div>' if shown == "block" else formula)
    raise SkipNode


def setup(app: Sphinx) -> None:
    """Draw formulas as MathML."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
