"""Verification of a finished dataset: each number is compared with its claimed error."""

from vibrosweep.proof.verification import Report
from vibrosweep.proof.verifying import verify

__all__ = ["Report", "verify"]
