"""Symbols, units and names of quantities as a page writes them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from vibrosweep.model.forcing import INPUTS

SYMBOLS: Final[Mapping[str, str]] = {
    "restitution": "e",
    "amplitude": "A",
    "base_velocity": "V₀",
    "base_displacement": "B",
    "base_acceleration": "Γ",
    "frequency": "f",
    "phase": "φ",
    "gravity": "g",
    "launch_velocity": "v₀",
    "contact_time": "τc",
    "restitution_speed": "vᵣ",
    "mass_ratio": "μ",
    "particle_mass": "m",
    "base_mass": "M",
    "mount_frequency": "f₀",
    "mount_damping": "ζ",
}
_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def units_text(units: str) -> str:
    """Units with raised exponents: 'm s-1' becomes 'm s⁻¹'; empty if there is no unit."""
    if units in ("", "1"):
        return ""
    return re.sub(r"(?<=[A-Za-z])-?\d+", lambda found: found[0].translate(_RAISED), units)


def legible(text: object) -> str:
    """Text in which invalid bytes are escaped, since a page cannot hold them."""
    return str(text).encode(errors="backslashreplace").decode()


def label(name: str, words: str, units: str) -> str:
    """Words, symbol and units of a quantity."""
    unit = units_text(units)
    symbol = SYMBOLS.get(name, "")
    return legible(f"{words}{symbol and f' {symbol}'}{unit and f' ({unit})'}")


def input_label(name: str) -> str:
    """Label of a physical parameter: 'launch velocity v₀ (m s⁻¹)'."""
    return label(name, name.replace("_", " "), INPUTS[name].units)


def meanings(attributes: Mapping[Any, Any]) -> dict[int, str]:
    """Meanings of the codes of a variable, from its attributes."""
    codes = np.atleast_1d(attributes["flag_values"]).tolist()
    words = legible(attributes["flag_meanings"]).split()
    return {int(c): word.replace("_", " ") for c, word in zip(codes, words, strict=True)}
