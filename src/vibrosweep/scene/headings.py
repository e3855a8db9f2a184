"""The heading of a column: its name, its unit, and what the column holds."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from typing import Final

from vibrosweep.scene.realizations import factor

__all__ = ["PIXELS", "Heading", "heading", "length_factor", "time_factor"]

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
