"""Parameters of a base of finite mass: masses and mount."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Final

from vibrosweep.model.parameters import LARGEST, MOUNT, SMALLEST, SPRUNG, Parameter, by_name

MASS_RATIO: Final = "mass_ratio"

# Both masses together may replace their ratio
MASSES: Final = by_name(
    Parameter("particle_mass", "m", "kg", "mass of one particle", math.nan, 0.0, LARGEST),
    Parameter("base_mass", "M", "kg", "mass of the base", math.nan, SMALLEST, LARGEST),
)

# All parameters by which a mount may be given, in the order of files
OF_MOUNT: Final = {MASS_RATIO: MOUNT[MASS_RATIO], **MASSES, **MOUNT}


def mount_mistakes(base: str, given: Collection[str]) -> dict[str, str]:
    """Return mistakes in the given parameters of the mount of a base, by parameter.

    Each text says what to change; there is none if the names are complete and consistent.
    """
    found = [name for name in OF_MOUNT if name in given]
    if base != SPRUNG:
        text = f'belongs to a base of finite mass: write base = "{SPRUNG}", or leave it out'
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
