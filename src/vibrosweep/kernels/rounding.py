"""Rounding errors of operations and of the kernels' inputs, for rigorous error bounds."""

from __future__ import annotations

HALF_ULP = 2.0**-53  # relative error of one rounding
ROUNDING = 16.0 * HALF_ULP  # of a component of an image, relative to the sum of its terms
SMALLEST = 2.0**-1020  # absolute, of a product or quotient that is subnormal
# x0 is a reduced sum of launch and phase, each rounded; a staggered launch is known to an ulp.
LAUNCH_ERROR = 4.0 * HALF_ULP
# a = 2 f A / g and u0 = 2 f v0 / g take two roundings, r = f tau_c one.
KICK_ERROR = 2.0 * HALF_ULP
REST_ERROR = HALF_ULP
