"""Compiled kernels: numbers in, numbers out; no files, no datasets, no configuration."""

from __future__ import annotations

import os
from contextlib import suppress

from vibrosweep.errors import VibrosweepError

with suppress(ValueError):  # numba ignores a value that is not a number
    if int(os.environ.get("NUMBA_NUM_THREADS", "1")) < 1:  # numba cannot be imported then
        raise VibrosweepError(
            f"NUMBA_NUM_THREADS={os.environ['NUMBA_NUM_THREADS']}: numba takes no number below 1; "
            f"unset it, and give the number of threads to vibrosweep"
        )
