"""Verification of a finished dataset: each number is compared with its claimed error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibrosweep.waiting import lazily

if TYPE_CHECKING:
    from vibrosweep.proof.orbits import prove_windows, verify_orbits
    from vibrosweep.proof.report import Report
    from vibrosweep.proof.verifying import verify

__all__ = ["Report", "prove_windows", "verify", "verify_orbits"]

_HOMES: Final = {
    "Report": "vibrosweep.proof.report",
    "verify": "vibrosweep.proof.verifying",
    **dict.fromkeys(("prove_windows", "verify_orbits"), "vibrosweep.proof.orbits"),
}
__getattr__ = lazily(__name__, _HOMES)
