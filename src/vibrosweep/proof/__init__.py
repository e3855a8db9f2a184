"""Verification of a finished dataset: whether each number is within its claimed error."""

from vibrosweep.proof.verification import Report
from vibrosweep.proof.verifying import verify

__all__ = ["Report", "verify"]
