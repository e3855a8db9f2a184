"""Laws of restitution: how the coefficient of restitution depends on the speed of an impact.

An impact at the relative speed v leaves E(v) = e(v) v, with the slope q(v) = E'(v):

    constant       e(v) = e
    plastic        e(v) = e up to v_y, e (v / v_y)^(-1/4) above it
    power          e(v) = e up to v_0, e (v / v_0)^(-p) above it
    points         e(v) is linear between given points, and constant beyond both ends
    viscoelastic   e(v) = P(y_0 (v / v_r)^(1/10)), P(y_0) = e

`restitution` is e, and `restitution_speed` v_y, v_0 or v_r; for points they follow: e(0), which
gives the kick its size, and the highest speed of a point.  The numbers of a law that all
realizations share, p or the points, stand in its text: ``power(0.2)``.

P is a Pade approximation for two viscoelastic spheres, which are in contact until the force between
them vanishes.  It exceeds the exact e(v) by 4e-3 where e(v) = 0.46, and by less where e(v) is
larger; a smaller e(v) is computed in the same way, but reported as out of range.  Users register
further laws.
"""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from types import FunctionType
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, require_one_of
from vibrosweep.mistakes import quoted
from vibrosweep.model.functions import digest_of, plain
from vibrosweep.model.parameters import LARGEST, OF_RESTITUTION, SMALLEST, physical

CONSTANT: Final = "constant"
PLASTIC: Final = "plastic"
VISCOELASTIC: Final = "viscoelastic"
POWER: Final = "power"
POINTS: Final = "points"
# `vibrosweep.model.restitution_laws.register_law` appends others
RESTITUTION_LAWS: Final = [CONSTANT, PLASTIC, VISCOELASTIC, POWER, POINTS]
# Laws with numbers that all realizations share, and the keys that give these
NUMBERS_OF: Final = {POWER: "restitution_exponent", POINTS: "restitution_points"}
MOST_POINTS: Final = 16
EXPONENTS: Final = "at least 0 and below 1"
PAIRS: Final = (
    "must be two or more points, each with its speed (m s-1) and its restitution, as in "
    "[[0.1, 0.95], [2.0, 0.85]]"
)
Points = tuple[tuple[float, float], ...]  # speeds in m s-1, ascending, and ratios

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
        ``restitution_speed`` (m s-1).  All numbers broadcast.  A law with numbers of its own is
        written with them, as in results: ``"power(0.2)"``, whose exponent is -0.2, or
        ``"points([[0.1, 0.95], [2.0, 0.85]])"``, for which neither restitution nor speed counts.

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
    require_law("law", law)
    v, e = np.asarray(velocity, np.float64), np.asarray(restitution, np.float64)
    if wrong := range_mistake(law, e):
        raise ParameterError(wrong)
    if law == CONSTANT:
        return np.broadcast_to(e, np.broadcast(v, e).shape).copy()
    if name_of(law) == POINTS:
        speeds, ratios = np.array(numbers_of(law)).T
        return np.broadcast_to(np.interp(v, speeds, ratios), np.broadcast(v, e).shape).copy()
    if np.any(np.isnan(restitution_speed)):
        raise ParameterError(f"{SPEED}: is missing; law {law!r} needs it (m s-1)")
    s = v / np.asarray(restitution_speed, np.float64)
    if law == PLASTIC:
        return np.asarray(e * np.maximum(s, 1.0) ** -0.25)
    if name_of(law) == POWER:
        return np.asarray(e * np.maximum(s, 1.0) ** -numbers_of(law))
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


def text_of(name: str, numbers: float | Points) -> str:
    """Return a law with its numbers, a key of `NUMBERS_OF`, as a text."""
    return f"{name}({json.dumps(numbers)})"


def name_of(law: str) -> str:
    """Return the name of a law, without its numbers."""
    return law.partition("(")[0]


def numbers_of(law: str) -> Any:
    """Return the exponent or the points in the text of a law of `NUMBERS_OF`.

    A ValueError says what is wrong with them.
    """
    name, _, text = law.partition("(")
    try:
        found = json.loads(text.removesuffix(")"))
    except ValueError:
        found = None
    return exponent_of(found) if name == POWER else points_of(found)


def is_law(law: str) -> bool:
    """Return whether a text is a law of restitution, with its numbers."""
    try:
        require_law("", law)
    except ParameterError:
        return False
    return True


def require_law(key: str, law: object) -> None:
    """Raise a ParameterError that names a key unless its value is a law, with its numbers."""
    if not isinstance(law, str):
        raise ParameterError(f"{key} = {law!r}: must be one of {', '.join(RESTITUTION_LAWS)}")
    require_one_of(key, name_of(law), RESTITUTION_LAWS)
    if name_of(law) in NUMBERS_OF:
        try:
            numbers_of(law)
        except ValueError as error:
            examples = {POWER: "power(0.2)", POINTS: "points([[0.1, 0.95], [2.0, 0.85]])"}
            example = examples[name_of(law)]
            text = f'{key} = "{law}": {NUMBERS_OF[name_of(law)]} {error}; write "{example}"'
            raise ParameterError(text) from None
    elif law != name_of(law):
        raise ParameterError(f'{key} = "{law}": this law has no numbers of its own; leave them out')


def implied(law: str) -> dict[str, float]:
    """Return the parameters that follow from a law: for points e(0) and the highest speed."""
    if name_of(law) != POINTS:
        return {}
    points = numbers_of(law)
    return {"restitution": points[0][1], SPEED: points[-1][0]}


def kinks_of(law: str) -> list[float]:
    """Return the speeds, in units of that of the law, at which the slope of E jumps."""
    if law == PLASTIC or (name_of(law) == POWER and numbers_of(law) > 0.0):
        return [1.0]
    if name_of(law) != POINTS:
        return []
    points = numbers_of(law)
    rises = [Fraction(0), *(rise for rise, _ in lines_of(points)), Fraction(0)]
    jumps = (a != b for a, b in pairwise(rises))
    return [v / points[-1][0] for (v, _), jump in zip(points, jumps, strict=True) if jump and v > 0]


def lines_of(points: Points) -> list[tuple[Fraction, Fraction]]:
    """Return slope and value at 0 of e(v) between points, v in units of the highest speed."""
    pairs = [(Fraction(v) / Fraction(points[-1][0]), Fraction(e)) for v, e in points]
    found = []
    for (v, e), (faster, less) in pairwise(pairs):
        rise = (less - e) / (faster - v)
        found.append((rise, e - rise * v))
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def exponent_of(value: Any) -> float:
    """Return the exponent of a power; a ValueError says what is allowed."""
    if not (_is_number(value) and 0.0 <= value < 1.0):
        raise ValueError(f"must be a number, {EXPONENTS}: the restitution falls as v^-exponent")
    return float(value)


def points_of(value: Any) -> Points:
    """Return points of a law; a ValueError says what is wrong with them."""
    listed = value if isinstance(value, list | tuple) else []
    pairs = [one for one in listed if isinstance(one, list | tuple) and len(one) == 2]
    if len(pairs) < len(listed) or len(pairs) < 2:
        raise ValueError(PAIRS)
    if len(pairs) > MOST_POINTS:
        most = f"at most {MOST_POINTS} are allowed; leave some out"
        raise ValueError(f"has {len(pairs)} points: {most}")
    for number, (v, e) in enumerate(pairs, 1):
        if not (_is_number(v) and (v == 0.0 or SMALLEST <= v <= LARGEST)):
            allowed = f"0 or from {SMALLEST:g} to {LARGEST:g} m s-1"
            raise ValueError(f"the speed of point {number} is {v!r}; it must be {allowed}")
        if not (_is_number(e) and 0.0 < e <= 1.0):
            allowed = "above 0 and at most 1"
            raise ValueError(f"the restitution of point {number} is {e!r}; it must be {allowed}")
    points = tuple((float(v), float(e)) for v, e in pairs)
    for number, ((v, e), (faster, less)) in enumerate(pairwise(points), 2):
        if not v < faster:
            raise ValueError(
                f"point {number} is not faster than the one before it, {faster:g} after {v:g} "
                f"m s-1; sort the points by speed, each speed once"
            )
        if less > e:
            raise ValueError(
                f"the restitution rises to {less:g} at point {number}, from {e:g}; it must not "
                f"rise with the speed: leave out or average points within their scatter"
            )
    for number, (rise, start) in enumerate(lines_of(points), 2):
        v = Fraction(points[number - 1][0]) / Fraction(points[-1][0])
        if start + 2 * rise * v <= 0:
            raise ValueError(
                f"the restitution falls so steeply before point {number} that faster impacts would "
                f"leave less speed than slower ones; its slope must be less steep than e / v"
            )
    return points


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
        others = quoted(name for name in RESTITUTION_LAWS if name not in (CONSTANT, POINTS))
        text = f"belongs to a law that depends on the speed: write restitution_law = {others}"
        return {SPEED: f"{text}, or leave it out"}
    if law != CONSTANT and SPEED not in given:
        needs = f'restitution_law = "{name_of(law)}" needs it (in m s-1, above 0)'
        return {SPEED: f"is missing; {needs}"}
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
