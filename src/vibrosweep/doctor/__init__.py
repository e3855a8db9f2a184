"""Checks of `vibrosweep doctor`: libraries, processor, kernels, disk and memory."""

from vibrosweep.doctor.examination import examine
from vibrosweep.doctor.finding import Finding

__all__ = ["Finding", "examine"]
