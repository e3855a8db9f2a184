"""The bases under which claims are judged."""

from __future__ import annotations

from typing import Final

HIGH_BOUNCE: Final = "high-bounce"  # the study's equations
MOVING: Final = "moving"
SPRUNG: Final = "sprung"  # of finite mass: particles act on each other through it
FIXED: Final = (HIGH_BOUNCE, MOVING)
BASES: Final = (*FIXED, SPRUNG)
