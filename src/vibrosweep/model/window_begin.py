"""Lower end of the window of a locked orbit, in the high-bounce limit and over the moving base.

The notation is that of `locked_theory`.  At the lower end s = 0, and the particle lands and leaves
at the phase 1/4.  Over a moving base, whose velocity has the amplitude alpha = Gamma / pi, the
clearance of the flight at the angle t, 2 pi times the periods since lift-off, is

    t (k - t / 2 pi) / 4 pi - (alpha / 4 pi) sin t,

which has to be positive for 0 < t < 2 pi k.  At the lower end alpha = k (1 - e) / (1 + e), so that
this is the condition

    e > e_k = max (t^2 / 2 pi - k (t - sin t)) / (k sin t + k t - t^2 / 2 pi)    over 0 < t < pi,

about 0.019 / k^2; after the first half turn t (k - t / 2 pi) is greater than k wherever sin t > 0.
At a smaller restitution the particle would meet the base during the flight.  The orbit then begins
with s > 0, at the amplitude at which its flight grazes the base, for which there is no closed form.
At e = 0 a particle rests while the base presses against it, and the orbit begins with s = 1, where
Gamma^2 = 1 + (pi k)^2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.model.orbit_theory import HALVINGS, above_sine, moves

TWO_PI = 2.0 * np.pi


def lower_end(
    k: ArrayLike, restitution: ArrayLike, frequency: ArrayLike, gravity: ArrayLike, base: str
) -> Array:
    """Return `amplitude_min`; NaN where there is no closed form."""
    e = np.asarray(restitution, dtype=np.float64)
    speed = np.asarray(gravity) * np.asarray(k) / (2.0 * np.asarray(frequency))
    begins = (1.0 - e) * speed
    if not moves(base):
        return np.asarray(begins)
    grazes = np.where(e < grazing(k), np.nan, begins)
    falling = np.hypot(1.0 / (np.pi * np.asarray(k)), 1.0) * speed
    return np.where(e == 0.0, falling, grazes)


def grazing(k: ArrayLike) -> Array:
    """Return the restitution below which there is no closed form, e_k of the module's text."""
    k = np.asarray(k, dtype=np.float64)
    turn = TWO_PI * k
    low, high = np.zeros_like(k), np.full_like(k, np.pi)
    for _ in range(HALVINGS):  # bisect for the maximum, at 1 / t - cot t = 1 / (2 pi k - t)
        t = 0.5 * (low + high)
        before = (2.0 * t * np.sin(0.5 * t) ** 2 - above_sine(t)) * (turn - t) < t * np.sin(t)
        low, high = np.where(before, t, low), np.where(before, high, t)
    below = t * t / TWO_PI - k * above_sine(t)
    return np.asarray(below / (k * np.sin(t) + t * (turn - t) / TWO_PI))
