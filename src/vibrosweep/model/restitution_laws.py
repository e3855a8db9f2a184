"""Laws of restitution: how the coefficient of restitution depends on the speed of an impact.

An impact at the relative speed v leaves E(v) = e(v) v, with the slope q(v) = E'(v):

    constant       e(v) = e
    plastic        e(v) = e up to v_y, e (v / v_y)^(-1/4) above it
    viscoelastic   e(v) = P(y_0 (v / v_r)^(1/10)), P(y_0) = e

`restitution` is e, and `restitution_speed` v_y or v_r.  P is a Pade approximation for two
viscoelastic spheres, which are in contact until the force between them vanishes.  It exceeds the
exact e(v) by 4e-3 where e(v) = 0.46, and by less where e(v) is larger; a smaller e(v) is computed
in the same way, but reported as out of range.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, require_one_of
from vibrosweep.mistakes import quoted
from vibrosweep.model.parameters import OF_RESTITUTION
from vibrosweep.model.physical import physical

CONSTANT: Final = "constant"
PLASTIC: Final = "plastic"
VISCOELASTIC: Final = "viscoelastic"
# `vibrosweep.model.outside_laws.register_law` appends others
RESTITUTION_LAWS: Final = [CONSTANT, PLASTIC, VISCOELASTIC]

(SPEED,) = OF_RESTITUTION
LEAST_VISCOELASTIC: Final = 0.46
# P(y) = (1 + n1 y) / (1 + n1 y + d2 y^2 + d3 y^3 + d4 y^4): n1, d2, d3, d4
PADE: Final = (0.501086, 1.15345, 0.577977, 0.532178)
# Functions e(v), of e and v / v_r, of registered laws
OUTSIDE_RATIOS: Final[dict[str, Callable[[Any, Any], Any]]] = {}


@physical
def restitution_at(
    velocity: ArrayLike,
    restitution: ArrayLike,
    law: str = CONSTANT,
    restitution_speed: ArrayLike = math.nan,
) -> Array:
    """Coefficient of restitution e(v) of an impact.

    Parameters
    ----------
    velocity
        Speed v of the impact relative to the base (m s-1), not negative.
    restitution, law, restitution_speed
        As in a scene: ``restitution``, ``restitution_law`` and, unless that is ``"constant"``,
        ``restitution_speed`` (m s-1).  All numbers broadcast.

    Returns
    -------
    numpy.ndarray
        e(v), as the arguments broadcast.

    Raises
    ------
    ParameterError
        There is no such law, its speed is missing, or it does not hold for the restitution.

    Notes
    -----
    ``"plastic"``: K. L. Johnson 1985, Contact Mechanics, section 11.5.  ``"viscoelastic"``:
    P. Mueller and T. Poeschel 2011, Phys. Rev. E 84, 021302.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> vs.theory.restitution_at([0.1, 10.0], 0.8, "viscoelastic", 1.0).round(6)
    array([0.866619, 0.708939])
    """
    require_one_of("law", law, RESTITUTION_LAWS)
    v, e = np.asarray(velocity, np.float64), np.asarray(restitution, np.float64)
    if wrong := range_mistake(law, e):
        raise ParameterError(wrong)
    if law == CONSTANT:
        return np.broadcast_to(e, np.broadcast(v, e).shape).copy()
    if np.any(np.isnan(restitution_speed)):
        raise ParameterError(f"{SPEED}: is missing; law {law!r} needs it (m s-1)")
    s = v / np.asarray(restitution_speed, np.float64)
    if law == PLASTIC:
        return np.asarray(e * np.maximum(s, 1.0) ** -0.25)
    if law == VISCOELASTIC:
        return np.asarray(_pade(_root_at(e) * s**0.1))
    return np.asarray(np.vectorize(OUTSIDE_RATIOS[law], otypes=[float])(e, s))


def _pade(y: Array) -> Array:
    n1, d2, d3, d4 = PADE
    top = 1.0 + n1 * y
    return np.asarray(top / (top + y * y * (d2 + y * (d3 + y * d4))))


def _root_at(e: Array) -> Array:
    """Return y_0 by an iteration that reduces the error to a fifth at each step."""
    n1, d2, d3, d4 = PADE
    y = np.zeros_like(e)
    for _ in range(40):
        y = np.sqrt((1.0 - e) * (1.0 + n1 * y) / (e * (d2 + y * (d3 + y * d4))))
    return y


def fastest_in_range(law: str, restitution: Array, restitution_speed: Array | None) -> Array:
    """Return the speed (m s-1) up to which a law of restitution holds; infinite for no limit."""
    if law != VISCOELASTIC or restitution_speed is None:
        return np.full_like(restitution, np.inf)
    with np.errstate(divide="ignore"):
        ratio = _root_at(np.asarray(LEAST_VISCOELASTIC)) / _root_at(restitution)
    return np.asarray(restitution_speed * ratio**10)


def range_of(law: str, inputs: Mapping[str, float]) -> str:
    """Return a sentence on the range of a law for inputs that do not vary; "" for no limit."""
    if law != VISCOELASTIC:
        return ""
    text = f"holds where e(v) is at least {LEAST_VISCOELASTIC:g}"
    if {"restitution", SPEED} <= inputs.keys():
        e, speed = (np.asarray(inputs[name], np.float64) for name in ("restitution", SPEED))
        text += f", in impacts of up to {float(fastest_in_range(law, e, speed)):.4g} m s-1"
    return f"{text}; faster ones are computed with the same law"


def law_in(attributes: Mapping[str, Any]) -> str:
    """Return the law of restitution in attributes of a result; by default the constant one."""
    return str(attributes.get("restitution_law", CONSTANT))


def speed_mistakes(law: str, given: Collection[str]) -> dict[str, str]:
    """Return mistakes in the given parameters of a law of restitution, by parameter.

    Each text says what to change.
    """
    if law == CONSTANT and SPEED in given:
        others = quoted(name for name in RESTITUTION_LAWS if name != CONSTANT)
        text = f"belongs to a law that depends on the speed: write restitution_law = {others}"
        return {SPEED: f"{text}, or leave it out"}
    if law != CONSTANT and SPEED not in given:
        return {SPEED: f'is missing; restitution_law = "{law}" needs it (in m s-1, above 0)'}
    return {}


def range_mistake(law: str, restitution: Array) -> str:
    """Return a message if a law does not hold for a restitution; else ""."""
    if law != VISCOELASTIC or not np.any(restitution < LEAST_VISCOELASTIC):
        return ""
    return (
        f"restitution: {float(np.min(restitution)):g} is out of range: with restitution_law = "
        f'"{law}" it must be at least {LEAST_VISCOELASTIC}; raise it, or take another law'
    )
