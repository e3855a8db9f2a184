"""What tells a base of finite mass from another: masses, and the mount that it stands on."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

from vibrosweep.errors import ParameterError
from vibrosweep.model.parameters import LARGEST, MOUNT, SMALLEST, SPRUNG, Parameter

MASS_RATIO: Final = "mass_ratio"

# The two together may take the place of their ratio.
MASSES: Final[Mapping[str, Parameter]] = {
    p.name: p
    for p in (
        Parameter("particle_mass", "m", "kg", "mass of one particle", math.nan, 0.0, LARGEST),
        Parameter("base_mass", "M", "kg", "mass of the base", math.nan, SMALLEST, LARGEST),
    )
}

# All that a mount may be given by, in the order of files
OF_MOUNT: Final[Mapping[str, Parameter]] = {
    name: parameter
    for own, one in MOUNT.items()
    for name, parameter in ({own: one, **MASSES} if own == MASS_RATIO else {own: one}).items()
}


def mount_mistakes(base: str, given: Collection[str]) -> dict[str, str]:
    """Find what is wrong with the names that are given for the mount of a base.

    What must be changed, in words, by the name of the parameter that it is about; empty if the
    names suffice and fit together.
    """
    found = [name for name in OF_MOUNT if name in given]
    if base != SPRUNG:
        text = f'is of a base of finite mass: write base = "{SPRUNG}", or leave it out'
        return dict.fromkeys(found, text)
    mistakes = {}
    masses = [name for name in MASSES if name in given]
    if MASS_RATIO in given and masses:
        mistakes[masses[0]] = f"{MASS_RATIO} is given too; keep it or both masses"
    elif len(masses) == 1:
        (lacking,) = MASSES.keys() - {*masses}
        mistakes[lacking] = f"is missing; {masses[0]} needs it (in kg)"
    elif MASS_RATIO not in given and not masses:
        mistakes[MASS_RATIO] = (
            f'is missing; base = "{SPRUNG}" needs it (mass of one particle in units of that of the '
            f"base), or {' and '.join(MASSES)} in kg"
        )
    if "mount_frequency" not in given:
        mistakes["mount_frequency"] = (
            f'is missing; base = "{SPRUNG}" needs it (natural frequency in Hz)'
        )
    return mistakes


def require_mount(base: str, given: Collection[str]) -> None:
    """Refuse names that `mount_mistakes` finds fault with; the ParameterError names all of them."""
    mistakes = mount_mistakes(base, given)
    if mistakes:
        raise ParameterError("; ".join(f"{name}: {text}" for name, text in mistakes.items()))
