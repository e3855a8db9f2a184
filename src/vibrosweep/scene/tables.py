"""Tables as other programs write them: their cells, what headings say, and the clocks of times.

A table is text of any dialect, or a sheet of a workbook: a heading and rows that hold numbers.  A
line without any number is part of a heading, so titles, names, units and the labels above several
tables are told apart by their places.  Times are as they were stamped: rounded, with gaps, on any
clock.
"""

from __future__ import annotations

import csv
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.mistakes import escaped
from vibrosweep.scene.design import factor

__all__ = [
    "MISSING",
    "PIXELS",
    "Cells",
    "Heading",
    "cells_of",
    "decoded",
    "even_times",
    "heading",
    "length_factor",
    "origin_of",
    "read_content",
    "rounding_of",
    "strongest_rate",
    "time_factor",
]


WORKBOOKS: Final = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # first bytes of xlsx and ods, and of xls
MISSING: Final = frozenset(
    ("", "nan", "na", "n/a", "#n/a", "none", "null", "-", "--", "lost", "missing")
)
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)
_COMMA: Final = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
_POINT: Final = re.compile(r"[+-]?\d*\.\d+(e[+-]?\d+)?", re.IGNORECASE)
_COMMENT: Final = re.compile(r"#(?!\d)|%|//")

Row = tuple[int, list[str]]  # number of the line, cells


@dataclass(frozen=True)
class Cells:
    """A table: a heading for each column, and its cells as text with decimal points."""

    source: str  # the file, and the sheet of a workbook
    sheet: str
    title: str  # what stands above the whole table
    headings: tuple[Heading, ...]
    rows: list[list[str]]
    lines: list[int]  # numbers of the lines in the file
    breaks: tuple[int, ...] = ()  # rows before which a line is empty

    @property
    def names(self) -> str:
        """Names of the columns, for messages."""
        return ", ".join(h.text for h in self.headings if h.text) or "none"

    def column(self, k: int) -> list[str]:
        """Cells of a column."""
        return [row[k] for row in self.rows]

    def numbers(self, k: int) -> Array:
        """Numbers of a column; those missing are NaN.  A ValueError names a cell that is none."""
        cells = self.column(k)
        try:
            found = np.array([float(cell) if cell else np.nan for cell in cells])
            if np.isfinite(found).all():
                return found
        except ValueError:
            found = np.full(len(cells), np.nan)
        for row, cell in enumerate(cells):
            if cell.lower() in MISSING:
                found[row] = np.nan
            elif _NUMBER.fullmatch(cell) and np.isfinite(float(cell)):
                found[row] = float(cell)
            else:
                raise ValueError(
                    f'{self.source}: column "{self.headings[k].text}", line {self.lines[row]}: '
                    f"{cell!r} is not a number; leave lost values empty"
                )
        return found

    def wordless(self, k: int) -> bool:
        """Tell whether a column holds numbers only, and at least one."""
        cells = [cell for cell in self.column(k) if cell.lower() not in MISSING]
        return bool(cells) and all(map(_NUMBER.fullmatch, cells))


def read_content(path: Path) -> bytes:
    """Return the content of a file; a ValueError says why there is none."""
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ValueError(f"{path}: there is no such file; check the path{escaped(path)}") from error
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}{escaped(path)}") from error


def cells_of(content: bytes, source: str, sheet: str | None = None) -> list[Cells]:
    """Return the tables of a file, or those of one sheet of a workbook.

    A ValueError says why there are none.
    """
    if content.startswith(WORKBOOKS):
        sheets = _sheets(content, source)
        if sheet is not None:
            sheets = {name: rows for name, rows in sheets.items() if name.strip() == sheet.strip()}
            if not sheets:
                known = ", ".join(_sheets(content, source))
                raise ValueError(f"{source}: has no sheet {sheet!r}; its sheets are {known}")
        several = len(sheets) > 1
        found = [
            table
            for name, rows in sheets.items()
            for table in _tables(rows, f"{source}: sheet {name.strip()}", several * name.strip())
        ]
    elif sheet is not None:
        raise ValueError(f"{source}: is not a workbook, so it has no sheet {sheet!r}")
    else:
        found = _tables(_text_rows(content, source), source, "")
    if not found:
        raise ValueError(f"{source}: holds no table of numbers; check the file")
    return found


def _sheets(content: bytes, source: str) -> dict[str, list[Row]]:
    import io

    from python_calamine import load_workbook

    try:
        book = load_workbook(io.BytesIO(content))
        return {
            name: [
                (line, [_text(cell) for cell in row])
                for line, row in enumerate(
                    book.get_sheet_by_name(name).to_python(skip_empty_area=False), start=1
                )
            ]
            for name in book.sheet_names
        }
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # damaged files: its errors have no common base
        raise ValueError(f"{source}: is not a workbook that can be read: {error}") from error


def _text(cell: object) -> str:
    return repr(cell) if isinstance(cell, float) else str(cell).strip()


def decoded(content: bytes, source: str) -> str:
    """Return the text of a file in UTF-8, in UTF-16 with its mark, or in the set of Windows."""
    utf_16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    for encoding in ("utf-16" if utf_16 else "utf-8-sig", "cp1252"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not re.search("[\0-\x08\x0e-\x1f]", text):
            return text
    raise ValueError(f"{source}: is not a text, a workbook or a sound; export it as one of them")


def _text_rows(content: bytes, source: str) -> list[Row]:
    lines = re.split(r"\r\n|\r|\n", decoded(content, source))
    separator = _separator(lines)
    if separator == " ":
        # an opening bracket continues the name before it: Time (s)
        rows = [
            (k, re.split(r"\s+(?![(\[])", line.strip().replace('"', "")))
            for k, line in enumerate(lines, start=1)
        ]
    else:
        try:
            reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
            rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
        except csv.Error as error:
            raise ValueError(f"{source}: is not a table: {error}") from error
    cells = [cell for _, row in rows for cell in row]
    if any(map(_COMMA.fullmatch, cells)) and not any(map(_POINT.fullmatch, cells)):
        for _, row in rows:
            row[:] = [c.replace(",", ".") if _COMMA.fullmatch(c) else c for c in row]
    return rows


def _separator(lines: Sequence[str]) -> str:
    """Find what separates the columns, from up to 400 lines that hold digits."""
    bare = [re.sub(r'"[^"]*"', "0", line).rstrip() for line in lines if line.strip()]
    body = [line for line in bare if re.match(r"[\s.,;+-]*\d", line)][:400] or bare[:1]
    for mark in "\t;,":
        if 2 * sum(mark in line for line in body) >= max(len(body), 1):
            break
    else:
        return " " if any(" " in line.strip() for line in body) else ","
    if mark == "," and not any('"' in line for line in lines):
        words = [line.split() for line in body]
        decimal = all(_NUMBER.fullmatch(w) or _COMMA.fullmatch(w) for row in words for w in row)
        # 0,25 0,31; or one column of 0,25 below a name without a comma
        above = bare[max(bare.index(body[0]) - 1, 0)]
        if decimal and (len(words[0]) > 1 or "," not in above):
            return " "
    return mark


def _tables(rows: Iterable[Row], source: str, sheet: str) -> list[Cells]:
    """Divide rows into tables, each of which begins with a heading."""
    found: list[Cells] = []
    above: list[Row] = []  # rows of the next heading
    current: Cells | None = None
    empty = False
    for line, cells in rows:
        row = [cell.strip() for cell in cells]
        if all(cell.lower() in MISSING for cell in row):
            empty = True
            continue
        comment = _COMMENT.match(next(filter(None, row)))
        last = current.rows[-1] if current else []
        repeats = all(not c or c == d for c, d in zip(row, last, strict=False))
        if comment or not (any(map(_NUMBER.fullmatch, row)) or (last and repeats)):
            above.append((line, row))
            if not comment:
                current = None
            continue
        if current is None:
            current = _headed(above, len(row), source, sheet, found[-1] if found else None)
            found.append(current)
        elif empty:
            current = replace(current, breaks=(*current.breaks, len(current.rows)))
            found[-1] = current
        current.rows.append(row)
        current.lines.append(line)
        above, empty = [], False
    return [_even(table) for table in found]


def _even(table: Cells) -> Cells:
    """Give all rows a cell for each column, and leave out empty columns without a name."""
    width = max(len(table.headings), *map(len, table.rows))
    rows = [row + [""] * (width - len(row)) for row in table.rows]
    names = list(table.headings) + [heading("")] * (width - len(table.headings))
    kept = [k for k in range(width) if names[k].text or any(row[k] for row in rows)]
    return replace(
        table,
        headings=tuple(
            names[k] if names[k].text else replace(names[k], text=f"column {k + 1}") for k in kept
        ),
        rows=[[row[k] for k in kept] for row in rows],
    )


def _headed(above: list[Row], width: int, source: str, sheet: str, before: Cells | None) -> Cells:
    """Begin a table with the heading that stands above it."""
    lines = [row for _, row in above if not _COMMENT.match(next(filter(None, row)))]
    if not lines:  # names in a comment, as numpy writes them
        bare = [[_COMMENT.sub("", row[0], count=1).strip(), *row[1:]] for _, row in above]
        lines = [row for row in bare if sum(map(bool, row)) == width][-1:]
    counts = [sum(map(bool, row)) for row in lines]
    if before is not None and max(counts, default=1) == 1 < len(before.headings):
        title = next(filter(None, lines[-1])) if lines else ""
        return Cells(source, sheet, title, before.headings, [], [])
    if not lines:
        return Cells(source, sheet, "", (), [], [])
    place = counts.index(max(counts))
    names = lines[place]
    units = [""] * len(names)
    for row in lines[place + 1 :]:
        if all(is_unit(cell) for cell in row if cell):
            units = (row + units)[: len(names)]
    labels, title = [""] * len(names), ""
    for row, count in zip(lines[:place], counts[:place], strict=True):
        if count == 1:
            title = next(filter(None, row))
        else:
            carried = ""
            for k in range(len(names)):
                carried = (row[k] if k < len(row) else "") or carried
                labels[k] = carried
    return Cells(
        source,
        sheet,
        title,
        tuple(heading(*cell) for cell in zip(names, units, labels, strict=True)),
        [],
        [],
    )


# --- Headings -------------------------------------------------------------------------------------

# Names as other programs write them, in small letters without marks between
_NAMES: Final = {
    "time": "t time times zeit temps tempo tiempo tijd sec secs second seconds timestamp positiont "
    "timestamps clock",
    "frame": "frame frames framenumber frameno frameindex bild",
    "height": "y h height heights hoehe hohe altezza hauteur altura hoogte altitude positiony "
    "yposition posy ypos ycoordinate elevation",
    "depth": "z positionz zposition posz zpos",
    "horizontal": "x positionx xposition posx xpos xcoordinate",
    "interval": "interval intervals dt deltat",
    "acceleration": "a acc accel acceleration accelerations beschleunigung",
    "particle": "particle particleid track trackid ball object",
    "recording": "recording run drop trial film video file experiment series case throw group "
    "measurement",
}
_ROLES: Final = {name: role for role, names in _NAMES.items() for name in names.split()}
_SECONDS: Final = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds"), "us"),
    "min": "min",
}
_METRES: Final = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), "m"),
    **dict.fromkeys(("cm", "centimetre", "centimetres", "centimeter", "centimeters"), "cm"),
    **dict.fromkeys(("mm", "millimetre", "millimetres", "millimeter", "millimeters"), "mm"),
    **dict.fromkeys(("um", "micron", "microns", "micrometre", "micrometer"), "um"),
}
PIXELS: Final = frozenset(("px", "pixel", "pixels", "pix"))
STANDARD_GRAVITY: Final = 9.80665  # m s-2, of an acceleration in g
# Words of columns that hold no instants although they are in s
_NO_INSTANT: Final = re.compile(r"interval|differ|durat|delta|\bdt\b|error|uncert|sigma|std|period")


@dataclass(frozen=True)
class Heading:
    """The heading of a column."""

    text: str  # as it stands in the file
    role: str  # a key of `_NAMES`, or empty
    unit: str  # as the file spells it; empty if it states none
    label: str  # what stands above the column, or the number or name that ends its own name

    def means(self, column: str) -> bool:
        """Tell whether a user who writes `column` means this one."""
        wanted = column.strip().lower()
        return wanted in (self.text.lower(), _split(self.text)[0].lower())


def heading(text: str, unit: str = "", label: str = "") -> Heading:
    """Interpret the heading of a column, and what stands below and above it."""
    name, own = _split(text)
    unit = own or unit.strip(" ()[]")
    plain = _plain(name)
    role = _ROLES.get(plain, "")
    if not role and (match := re.fullmatch(r"(\D+?)[\s_.#]*(?:\{?(\d+|[A-Za-z ]\w*)\}?)", name)):
        # y1, y_2, t.1, y_{mass A}
        base = _ROLES.get(_plain(match[1]), "")
        if base in ("time", "height", "horizontal") and (match[2].isdigit() or "_" in name):
            role, label = base, label or match[2]
    if not role and _SECONDS.get(_ascii(unit)) and not _NO_INSTANT.search(name.lower()):
        role = "time"
    if not role and re.search(r"\btime\b", name.lower()) and not _NO_INSTANT.search(name.lower()):
        role = "time"
    if not role and acceleration_factor(unit) and not length_factor(unit):
        role = "acceleration"
    if not role and (plain.startswith("acceleration") or plain in ("ax", "ay", "az")):
        role = "acceleration"
    return Heading(text.strip(), role, unit, label)


def is_unit(text: str) -> bool:
    """Tell whether a cell below a name is a unit."""
    bare = _ascii(text.strip(" ()[]"))
    known = bare in _SECONDS or bare in _METRES or bare in PIXELS or bare in ("frame", "g")
    bracketed = text.strip()[:1] in "([" and text.strip()[-1:] in ")]"
    return known or bracketed or acceleration_factor(bare) is not None


def time_factor(unit: str) -> tuple[float, float] | None:
    """Numerator and denominator of the factor to s; None for another unit."""
    return factor(_SECONDS.get(_ascii(unit), unit), "s") if unit else (1.0, 1.0)


def length_factor(unit: str) -> tuple[float, float] | None:
    """Numerator and denominator of the factor to m; None for another unit."""
    return factor(_METRES.get(_ascii(unit), unit), "m") if unit else (1.0, 1.0)


def acceleration_factor(unit: str) -> tuple[float, float] | None:
    """Numerator and denominator of the factor to m s-2; None for another unit."""
    if unit == "g":
        return STANDARD_GRAVITY, 1.0
    plain = unit.replace("\N{SUPERSCRIPT TWO}", "2").replace("\N{SUPERSCRIPT MINUS}", "-")
    return factor(plain, "m s-2") if unit else (1.0, 1.0)


def _split(text: str) -> tuple[str, str]:
    """Divide a heading into name and unit: y (cm), y [cm], y / cm, y in cm, y_cm."""
    text = text.strip()
    if match := re.fullmatch(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]", text):
        return match[1], match[2].strip()
    for pattern in (r"(.*?)\s*/\s*(\S.*)", r"(.+?)\s+in\s+(\S+)", r"(.+)[_\s](\w+)"):
        match = re.fullmatch(pattern, text)
        if match and is_unit(match[2]):
            return match[1], match[2]
    return text, ""


def _ascii(unit: str) -> str:
    return unit.strip().lower().replace("\N{MICRO SIGN}", "u").replace("\u03bc", "u")


def _plain(name: str) -> str:
    """Return the letters and digits of a name, without accents, in small letters."""
    spread = unicodedata.normalize("NFKD", name.lower())
    return "".join(c for c in spread if c.isalnum())


# --- Clocks ---------------------------------------------------------------------------------------

FAR: Final = 100.0  # durations from its zero at which a clock counts from 1970 or from midnight
STEADY: Final = 0.02  # largest relative difference between a rate and its first estimate


def rounding_of(cells: Iterable[str]) -> float:
    """Step to which numbers are rounded, from the decimals with which they are written."""
    decimals = 0
    for cell in cells:
        mantissa, _, exponent = cell.lower().partition("e")
        digits = len(mantissa.partition(".")[2].rstrip("0"))
        decimals = max(decimals, digits - int(exponent or 0))
    return float(10.0**-decimals)


def even_times(time: Array, rounding: float, rate: float | None = None) -> tuple[Array, float]:
    """Undo the rounding of times (s) that a steady clock stamped; gaps are allowed.

    Returns times and the rate in Hz, which is `rate`, a whole number or 1000/1001 of one if
    the stamps allow it.  Times that no steady clock explains stay as they are, and the rate is
    that of the median step.
    """
    steps = np.diff(time)
    if time.size < 2:
        return time, np.nan
    usual = float(np.median(steps))
    if time.size < 4:
        return time, 1.0 / usual
    wide = max(0.5 * usual, (1.0 + 1e-6) * rounding)  # rounded steps may differ by their rounding
    usual = float(steps[steps < usual + wide].mean())
    since = time - time[0]
    for _ in range(2):  # two-frame steps among the usual ones make the first estimate too long
        frame = np.concatenate([[0.0], np.cumsum(np.rint(steps / usual))])
        usual = float(np.polyfit(frame, since, 1)[0])
    found = 1.0 / usual
    slack = (1.0 + 1e-6) * rounding + 4.0 * float(np.spacing(np.abs(time).max()))
    for candidate in _rates(found, rate):
        rest = since - frame / candidate
        if abs(candidate / found - 1.0) < STEADY and np.ptp(rest) <= slack:
            middle = 0.5 * float(rest.min() + rest.max())
            return time[0] + middle + frame / candidate, candidate
    return time, 1.0 / float(np.median(steps))


def _rates(found: float, rate: float | None) -> Iterator[float]:
    """Yield rates near one that was found, the likeliest first."""
    if rate is not None:
        yield rate
    for candidate in (round(found), 1000.0 * round(1.001 * found) / 1001.0, round(found, 1), found):
        if candidate > 0.0:
            yield float(candidate)


def origin_of(time: Array) -> float:
    """Whole second from which to count times, so that phases hold: 0 unless it is far away."""
    begin, span = float(time[0]), float(time[-1] - time[0])
    return float(np.floor(begin)) if abs(begin) > FAR * span else 0.0


def strongest_rate(time: Array, values: Array, padding: int = 1) -> float:
    """Frequency in Hz of the highest peak of the spectrum of values without mean or trend.

    Values are put on an even clock of the usual step, and gaps hold zeros: where all steps are
    multiples of one this is the spectrum of Lomb and Scargle but for its norm.
    """
    step = 1.0 / even_times(time, 0.0)[1]
    place = np.rint((time - time[0]) / step).astype(np.intp)
    even = np.zeros(place[-1] + 1)
    even[place] = values
    power = np.abs(np.fft.rfft(even, padding * even.size)) ** 2
    return (int(np.argmax(power[1:])) + 1) / (padding * even.size * step)
