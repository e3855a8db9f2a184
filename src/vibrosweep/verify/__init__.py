"""A finished dataset against the proved reference: is each number within its claimed error."""

from vibrosweep.verify.check import verify
from vibrosweep.verify.report import Report

__all__ = ["Report", "verify"]
