"""Arcsine of a number or an array in plain arithmetic, compiled or not.

The arcsine of a library may differ in the last bit between processors.  No product is fused with a
sum, so that numpy gives the same bits as compiled code.
"""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["ARCSINE_ERROR", "arcsin_turns"]

# Bound of the relative error, proved by checks/elementary_error.py
ARCSINE_ERROR = 6.3 * 2.0**-53
# 1 / (2 pi) as a sum of two doubles; a single one would cost half an ulp
FIRST, FIRST_LOW = 0.15915494309189535, -9.839338337591243e-18
# Polynomial in x^2 for (arcsin(x) / x - 1) / x^2 in turns, for x^2 <= 1/4, highest power first: the
# minimax of the relative error of the arcsine (9.8e-19), by the Remez exchange with 60 digits
HIGHER = (
    0.005200684761607661,
    -0.0033545498665686958,
    0.003463765046412365,
    0.0005861756317760742,
    0.0017167290890160065,
    0.0018140124485332078,
    0.002225139116032715,
    0.002761592926005343,
    0.003560648710192094,
    0.004835436358835583,
    0.007105131393165858,
    0.011936620731844823,
    0.026525823848649373,
)


def arcsin_turns(x: Any) -> Any:
    """Return the phase in turns, from 0 to 1/4, whose sine is x, from 0 to 1."""
    far = x > 0.5
    z = far * (0.5 * (1.0 - x)) + (1 - far) * (x * x)
    root = far * np.sqrt(z) + (1 - far) * x
    higher = 0.0
    for coefficient in HIGHER:
        higher = higher * z + coefficient
    near = root * FIRST + root * (z * higher + FIRST_LOW)
    return far * (0.25 - 2.0 * near) + (1 - far) * near
