"""Names of parameters that a user may have meant."""

from __future__ import annotations

from vibrosweep.mistakes import nearest
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.mount import OF_MOUNT
from vibrosweep.model.parameters import HIGH_BOUNCE, SPRUNG, Parameter


def another_name(word: str, base: str = HIGH_BOUNCE) -> str | None:
    """Return the parameter of which a word is the symbol, the beginning or a part of the name."""
    short, known = word.lower(), _known(base)
    for name, parameter in known.items():
        if word == parameter.symbol:  # v0 is not V0
            return name
    for name, parameter in known.items():
        if short and (short == parameter.symbol.lower() or name.startswith(short)):
            return name
    parts = [name for name in known if short in name.split("_")]
    return parts[0] if len(parts) == 1 else None


def likely_parameter(word: str, base: str = HIGH_BOUNCE) -> str | None:
    """Return the parameter of a base that an unknown word probably means."""
    return another_name(word, base) or nearest(word, _known(base))


def _known(base: str) -> dict[str, Parameter]:
    return {n: p for n, p in INPUTS.items() if base == SPRUNG or n not in OF_MOUNT}
