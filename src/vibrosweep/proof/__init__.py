"""A finished dataset against the proved reference: is each number within its claimed error."""

from vibrosweep.proof.verification import Report
from vibrosweep.proof.verify import verify

__all__ = ["Report", "verify"]
