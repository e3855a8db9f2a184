"""The site: Markdown pages, tutorials that run when it is built, and the reference of the API.

python -m sphinx -W --keep-going docs build/site
"""

from __future__ import annotations

import os
import re
import tomllib
from enum import EnumType
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING
from xml.sax.saxutils import unescape

from latex2mathml.converter import convert

import vibrosweep

if TYPE_CHECKING:
    from docutils.nodes import Element
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator

HERE = Path(__file__).parent
GIVEN = tomllib.loads((HERE.parent / "MAINTAINERS.toml").read_text("utf-8"))

project = "vibrosweep"
author = copyright = ", ".join(one["name"] for one in GIVEN["authors"])  # noqa: A001
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
doctest_global_cleanup = "import matplotlib.pyplot; matplotlib.pyplot.close('all')"

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
os.environ["TQDM_DISABLE"] = "1"  # no progress bars in what tutorials print
nb_execution_mode = "force"
nb_execution_in_temp = True  # a tutorial leaves no file behind
nb_execution_raise_on_error = True
nb_execution_timeout = 180
nb_merge_streams = True


def public(path: str) -> object:
    """Return the object that a dotted name stands for."""
    home, _, name = path.rpartition(".")
    return getattr(import_module(home), name)


def own_members(path: str) -> list[str]:
    """Methods and properties of a class itself, not its fields and codes."""
    thing = public(path)
    if not isinstance(thing, type):
        return []
    shown = {n: v for n, v in vars(thing).items() if not n.startswith("_")}
    for field in getattr(thing, "__dataclass_fields__", ()):
        shown.pop(field, None)  # its default
    return [n for n, v in shown.items() if isinstance(v, (FunctionType, property, cached_property))]


def codes(path: str) -> list[tuple[str, int, str]]:
    """Return name, number and sentence of each code of an enumeration; else an empty list."""
    thing = public(path)
    return [(c.name, c.value, c.sentence) for c in thing] if isinstance(thing, EnumType) else []


PAGE = (HERE / "reference" / "python.rst").read_text("utf-8")
LISTED = re.findall(r"^   (vibrosweep\.[\w.]+)$", PAGE, re.MULTILINE)
autosummary_context = {
    "own_members": {path: own_members(path) for path in LISTED},
    "codes": {path: codes(path) for path in LISTED},
}
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "NDArray": "NDArray", "Array": "NDArray"}
autosummary_generate = True
templates_path = ["_templates"]
numpydoc_show_class_members = False

# Parts of signatures that Sphinx writes from values, and how they are written in the source
UNREADABLE = {
    r"TypeAliasForwardRef\('(\w+)'\)": r"\1",
    r"Dialect\([^)]*\)": "PYTHON",
    r"<function _\w+( at \w+)?>": "...",
    r"<function (\w+)( at \w+)?>": r"\1",
    r"(\*args|\*\*kwargs): ~typing\.~P": r"\1",
    r"(~numpy\.|np\.)?ndarray\[tuple\[.*?\], (~numpy\.)?dtype\[(~numpy\.)?\w+\]\]": "NDArray",
    r"~P\b": "P",
}
SENTENCE = 45  # characters of a table's cell
FUNCTION = re.compile(r"<m[io]>(sin|cos|tan|ln|log|max|min)</m[io]>(<mo[^>]*>&#x00028;)?")
NUMBER = re.compile(r"[-+\d.,e]+( %)?( (to|of) [-+\d.,e]+( %)?)?")
UNIT = re.compile(r"(?<=\d) (?=%|(?:k?Hz|[mµn]?s|[cmµ]?m|m/s|g|rad|[MG]B|[KM]iB)\b)")
EQUAL = re.compile(r"(?<=\b[A-Za-zΓ]) = (?=[-\d])")
LETTERS = ["Gamma", "Lambda", "Phi", "alpha", "lambda", "mu", "phi", "pi", "sigma", "tau"]
SIGNS = {"<=": "≤", ">=": "≥", **dict(zip(LETTERS, "ΓΛΦαλμφπστ", strict=True))}
SPELLED = re.compile(r"[<>]=|(?<![^\W_])(?:" + "|".join(LETTERS) + r")(?![^\W_])")
# an index (a letter or a short word), an exponent, or the exponent of a unit
RAISED = re.compile(
    r"(?<=(?<!\w)[^\W\d_])_(?P<low>min|max|first|last|[a-z\d]|\([^()]+\))(?!\w)"
    r"|(?<=[\w)>'\N{RIGHT SINGLE QUOTATION MARK}])(?:\^|\*\*)(?P<high>-?\w+|\([^()]+\))"
    r"|(?<=\b[ms])(?P<unit>-\d)(?!\w)"
)
EXPONENT = re.compile(r"(?<=\de-)(?=\d)")
NAME = re.compile(r">[^<>\s]{12,}<")  # a word that is alone in its element
JOINT = re.compile(r"(?<=\w)[._/(=](?=[^\W\d]\w\w)|(?<=[a-z])(?=[A-Z][a-z])")
BAR = re.compile("<mo[^>]*>&#x0007C;</mo>")
PRIME = re.compile("<msup>(<m[in]>[^<]*</m[in]>)<mi>&#x02032;</mi></msup>")
MINUS = re.compile("(<mrow>|<mo[^>]*>(?:\\[|&#x00028;|&#x0002C;|&#x0003D;)</mo>)<mo>&#x02212;</mo>")

# python -m sphinx -b linkcheck -D nb_execution_mode=off docs build/links
linkcheck_timeout = 20
linkcheck_anchors = False  # pages that a script fills have none in their text
linkcheck_allow_unauthorized = True  # publishers refuse robots
linkcheck_rate_limit_timeout = 60.0

html_theme = "pydata_sphinx_theme"
html_title = "vibrosweep"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"  # drawn by the browser: nothing is loaded from elsewhere
html_show_sourcelink = False
html_sidebars = {"**": ["pages.html"]}
html_theme_options = {
    "navbar_center": [],  # all pages are in the sidebar
    "navbar_persistent": ["search-button"],  # with a search field the header takes two lines
    "icon_links": [
        {"name": "Repository", "url": url, "icon": "fa-solid fa-code-branch"}
        for url in (GIVEN["addresses"]["source"],)
        if url
    ],
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

    # equations beside each other, and the parts of a long one, are below each other on a phone
    equations = [
        "".join(convert(part, display=shown) for part in each.split(r"\allowbreak"))
        for each in unescape(node.astext()).split(r"\qquad")
    ]
    formula = "".join(f'<span class="equation">{each}</span>' for each in equations)
    # the spacing of TeX: around the names of functions, and none beside bars
    formula = FUNCTION.sub(_spaced, formula)
    formula = BAR.sub('<mo lspace="0" rspace="0" stretchy="false">|</mo>', formula)
    # a prime as large as its letter, which the font has raised; a minus that belongs to one number
    formula = PRIME.sub(r'<mrow>\1<mo lspace="0" rspace="0">&#x02032;</mo></mrow>', formula)
    formula = MINUS.sub(r'\1<mo form="prefix" lspace="0" rspace="0">&#x02212;</mo>', formula)
    translator.body.append(f'<div class="formula">{formula}</div>' if shown == "block" else formula)
    raise SkipNode


def _spaced(found: re.Match[str]) -> str:
    after = "0" if found[2] else "0.17em"
    function = f'<mo form="prefix" lspace="0.17em" rspace="{after}">{found[1]}</mo>'
    return function + (found[2] or "")


def readable(
    app: Sphinx,
    what: str,
    name: str,
    thing: object,
    options: object,
    given: str | None,
    out: str | None,
) -> tuple[str | None, str | None]:
    """Replace the parts of a signature that Sphinx writes from values by their source text."""
    for found, instead in UNREADABLE.items():
        given, out = (part and re.sub(found, instead, part) for part in (given, out))
    return given, out


def as_written(app: Sphinx, thing: object, bound: bool) -> None:
    """Show a signature as written, without the keywords that `completed` lists for notebooks."""
    if isinstance(thing, FunctionType):
        vars(thing).pop("__signature__", None)


def set_formulas(app: Sphinx, document: Element, name: str) -> None:
    """Set the formulas that docstrings and messages write in plain letters.

    Numbers stay on one line with their units, and minus signs with their exponents.
    """
    from docutils import nodes
    from sphinx.addnodes import desc_sig_element, desc_signature

    apart = (nodes.FixedTextElement, nodes.literal, nodes.math, nodes.reference)
    apart += (desc_signature, desc_sig_element)
    for text in list(document.findall(nodes.Text)):
        if isinstance(text.parent, apart):
            continue
        whole = SPELLED.sub(lambda found: SIGNS[found[0]], text)
        whole = UNIT.sub("\N{NO-BREAK SPACE}", whole)
        whole = EQUAL.sub("\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}", whole)
        whole = EXPONENT.sub("\N{WORD JOINER}", whole)
        parts, end = [], 0
        for found in RAISED.finditer(whole):
            kind = nodes.subscript if found["low"] else nodes.superscript
            raised = (found["low"] or found["high"] or found["unit"]).strip("()")
            parts += [
                nodes.Text(whole[end : found.start()]),
                kind("", raised.replace("-", "\N{MINUS SIGN}")),
            ]
            end = found.end()
        if whole != text or parts:
            text.parent.replace(text, [*parts, nodes.Text(whole[end:])])


def mark_tables(app: Sphinx, document: Element, name: str) -> None:
    """Mark tables of sentences, and cells that hold a number, which never wrap.

    On a phone a row of sentences is a list, in which each entry begins with the name of its column.
    """
    from docutils import nodes

    for table in document.findall(nodes.table):
        cells = list(table.findall(nodes.entry))
        for cell in cells:
            if NUMBER.fullmatch(cell.astext()):
                cell["classes"].append("number")
        columns = list(zip(*table.findall(nodes.row), strict=False))
        widths = [max(len(cell.astext()) for cell in column) for column in columns]
        if max(widths) > SENTENCE or (len(columns) <= 4 and sum(widths) > 2 * SENTENCE):
            table["classes"].append("prose")
            head, *rows = table.findall(nodes.row)
            for row in rows:
                for column, cell in list(zip(head, row, strict=False))[1:]:
                    if len(row) > 2 and column.astext() and cell.astext():
                        title = nodes.inline("", "", classes=["column"])
                        title += [node.deepcopy() for node in column[0].children]
                        cell[0].insert(0, title)


def breakable(app: Sphinx, error: Exception | None) -> None:
    """Let long names break after their dots and underscores, and nowhere else."""
    for page in Path(app.outdir).rglob("*.html"):
        text = page.read_text("utf-8")
        text = NAME.sub(lambda word: JOINT.sub(r"\g<0><wbr>", word[0]), text)
        page.write_text(text, "utf-8")


def setup(app: Sphinx) -> None:
    """Set formulas, mark tables, break names, and shorten signatures."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    app.connect("doctree-resolved", mark_tables)
    app.connect("doctree-resolved", set_formulas)
    app.connect("build-finished", breakable)
    app.connect("autodoc-before-process-signature", as_written)
    app.connect("autodoc-process-signature", readable)
