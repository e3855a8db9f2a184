"""Laws of restitution that users register."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Final

from vibrosweep.errors import ParameterError
from vibrosweep.model.functions import digest_of, plain
from vibrosweep.model.restitution_laws import OUTSIDE_RATIOS, RESTITUTION_LAWS

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
