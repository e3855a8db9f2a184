"""Laws of restitution: how the coefficient of restitution depends on the speed of an impact.

An impact at the relative speed v leaves E(v) = e(v) v, with the slope q(v) = E'(v):

    constant       e(v) = e
    plastic        e(v) = e up to v_y, e (v / v_y)^(-1/4) above it
    viscoelastic   e(v) = P(y_0 (v / v_r)^(1/10)), P(y_0) = e

`restitution` is e, and `restitution_speed` v_y or v_r.  P is a Pade approximation for two
viscoelastic spheres, which are in contact until the force between them vanishes.  It exceeds the
exact e(v) by 4e-3 where e(v) = 0.46, and by less where e(v) is larger; a smaller e(v) is computed
in the same way, but reported as out of range.  Users register further laws.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, require_one_of
from vibrosweep.mistakes import quoted
from vibrosweep.model.functions import digest_of, plain
from vibrosweep.model.parameters import OF_RESTITUTION, physical

CONSTANT: Final = "constant"
PLASTIC: Final = "plastic"
VISCOELASTIC: Final = "viscoelastic"
# `vibrosweep.model.restitution_laws.register_law` appends others
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
        e(v), broadcast over the arguments.

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


OUTSIDE: Final[dict[str, Law]] = {}  # laws of `register_law`, by name


@dataclass(frozen=True)
class Law:
    """A law of restitution: an impact at the relative speed v leaves E(v) = e(v) v.

    Speeds are in units of ``restitution_speed``, and the law holds over every base.

    Parameters
    ----------
    name
        Value of ``restitution_law`` that selects it.
    ratio
        ``ratio(e, s)``: the coefficient e(v), 0 to 1, at the speed s = v / ``restitution_speed``
        for the ``restitution`` e; plain Python that numba compiles.  If it calls no functions of
        math, `verify` evaluates it in ball arithmetic too.
    slope
        ``slope(e, s)``: the derivative of s ratio(e, s) with respect to s, which is E'(v).
    bend
        ``bend(e)``: a bound on the modulus of the derivative of `slope` with respect to s, for all
        s >= 0.
    roundings
        Bound on the errors of `ratio` and `slope`, in roundings of half an ulp.
    ball_ratio, ball_slope
        The same two functions for balls of `flint.arb`, if `ratio` and `slope` cannot take them.

    Raises
    ------
    ParameterError
        The name is not allowed, or a function takes other arguments, draws random numbers, or uses
        something from outside whose value could change without notice.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> def ratio(e, s):
    ...     return 0.5 * e
    >>> def slope(e, s):
    ...     return 0.5 * e
    >>> def bend(e):
    ...     return 0.0
    >>> law = vs.register_law(vs.Law("halved", ratio, slope, bend, roundings=1))
    >>> scene = {"restitution_law": "halved", "restitution_speed": 1.0, "restitution": 0.8}
    >>> found = vs.simulate(**scene, amplitude=0.0, duration=2.0)
    >>> print(f"{found.rebound_velocity.values[0, 0, 0]:.6g}")
    2
    """

    name: str
    ratio: Callable[..., Any]
    slope: Callable[..., Any]
    bend: Callable[..., Any]
    roundings: int = 2
    ball_ratio: Callable[..., Any] | None = None
    ball_slope: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        wrong = next(self._mistakes(), "")
        if wrong:
            raise ParameterError(f"law {self.name!r}: {wrong}")
        digest_of(self._compiled(), f"law {self.name!r}")

    def _compiled(self) -> Sequence[FunctionType]:
        return [plain(function) for function in (self.ratio, self.slope, self.bend)]

    def _mistakes(self) -> Iterator[str]:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            yield "name must be a word of letters, digits and _"
        for key, count in {"ratio": 2, "slope": 2, "bend": 1}.items():
            function = plain(getattr(self, key))
            if not isinstance(function, FunctionType):
                yield f"{key} = {function!r} must be a Python function"
            elif len(inspect.signature(function).parameters) != count:
                yield f"{key} must take {count} arguments"
        if not isinstance(self.roundings, int) or self.roundings < 0:
            yield f"roundings = {self.roundings!r} must be a whole number, at least 0"

    @property
    def code(self) -> str:
        """Digest of the functions as they are now, and of the number of roundings."""
        return digest_of(self._compiled(), f"law {self.name!r}", str(self.roundings))


def register_law(law: Law) -> Law:
    """Make a law available as ``restitution_law``; an earlier one of that name is replaced.

    Parameters
    ----------
    law
        The law.

    Returns
    -------
    Law
        The same law.

    Raises
    ------
    ParameterError
        The name is that of a law of this package.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> def ratio(e, s):
    ...     return e / (1.0 + s)
    >>> def slope(e, s):
    ...     return e / ((1.0 + s) * (1.0 + s))
    >>> def bend(e):
    ...     return 2.0 * e
    >>> law = vs.register_law(vs.Law("falling", ratio, slope, bend, roundings=3))
    >>> found = vs.simulate(restitution_law="falling", restitution_speed=5.0, duration=2.0)
    >>> int(found.status.max())
    0
    """
    if not isinstance(law, Law):
        raise ParameterError(f"law = {law!r}: must be a vibrosweep.Law")
    if law.name in RESTITUTION_LAWS and law.name not in OUTSIDE:
        raise ParameterError(f"law {law.name!r}: is a law of this package; choose another name")
    if law.name not in OUTSIDE:
        RESTITUTION_LAWS.append(law.name)
    OUTSIDE[law.name], OUTSIDE_RATIOS[law.name] = law, law.ratio
    return law
