"""Checks of `vibrosweep doctor`: libraries, processor, kernels, disk and memory."""

import vibrosweep.kernels  # noqa: F401  (before numba: it looks at the environment)
from vibrosweep.doctor.examination import examine
from vibrosweep.doctor.finding import Finding

__all__ = ["Finding", "examine"]
