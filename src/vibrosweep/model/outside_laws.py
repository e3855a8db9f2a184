"""Laws of rebound from outside the package."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Final

from vibrosweep.errors import ParameterError
from vibrosweep.model.functions import digest_of, plain
from vibrosweep.model.parameters import HIGH_BOUNCE, LAWS, LAWS_OF

OUTSIDE: Final[dict[str, Law]] = {}  # by name, those of `register_law`


@dataclass(frozen=True)
class Law:
    """A law of rebound w = k(e, v) + kick, which says what an impact keeps of the speed.

    Speeds are durations of flights that begin with them from a base at rest, in forcing periods.  A
    particle rests where w does not exceed the threshold of rest.  It is a law of the base
    ``"high-bounce"``; other bases refuse it.

    Parameters
    ----------
    name
        Value of ``rebound`` that selects it.
    kept
        ``kept(e, v)``: the speed k that an impact at speed v keeps, plain Python that numba
        compiles.  Without functions of math it is evaluated in ball arithmetic too, as `verify`
        needs it.
    slope
        ``slope(e, v)``: the derivative of k by v.
    bend
        ``bend(e)``: a bound of the modulus of the second derivative of k by v, for all v >= 0.
    roundings
        Number of roundings, each half an ulp, by which the value of `kept` may be wrong.
    ball_kept, ball_slope
        The same two for balls of `flint.arb`, where `kept` and `slope` cannot take them.

    Raises
    ------
    ParameterError
        The name is not allowed, or a function takes other arguments, draws numbers at random, or
        depends on something that can change without notice.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> def kept(e, v):
    ...     return 0.5 * e * v
    >>> def slope(e, v):
    ...     return 0.5 * e
    >>> def bend(e):
    ...     return 0.0
    >>> law = vs.register_law(vs.Law("halved", kept, slope, bend, roundings=2))
    >>> found = vs.simulate(rebound="halved", amplitude=0.0, restitution=0.8, duration=2.0)
    >>> print(f"{found.rebound_velocity.values[0, 0, 0]:.6g}")
    2
    """

    name: str
    kept: Callable[..., Any]
    slope: Callable[..., Any]
    bend: Callable[..., Any]
    roundings: int = 2
    ball_kept: Callable[..., Any] | None = None
    ball_slope: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        wrong = next(self._mistakes(), "")
        if wrong:
            raise ParameterError(f"law {self.name!r}: {wrong}")
        digest_of(self._compiled(), f"law {self.name!r}")

    def _compiled(self) -> Sequence[FunctionType]:
        return [plain(function) for function in (self.kept, self.slope, self.bend)]

    def _mistakes(self) -> Iterator[str]:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            yield "name must be a word of letters, digits and _"
        for key, count in {"kept": 2, "slope": 2, "bend": 1}.items():
            function = plain(getattr(self, key))
            if not isinstance(function, FunctionType):
                yield f"{key} = {function!r} must be a Python function"
            elif len(inspect.signature(function).parameters) != count:
                yield f"{key} must take {count} arguments"
        if not isinstance(self.roundings, int) or self.roundings < 0:
            yield f"roundings = {self.roundings!r} must be a whole number, at least 0"

    @property
    def code(self) -> str:
        """Digest of what its functions compute at this moment, and of the number of roundings."""
        return digest_of(self._compiled(), f"law {self.name!r}", str(self.roundings))


def register_law(law: Law) -> Law:
    """Register a law under its name, a value of ``rebound``, or replace one from outside.

    Parameters
    ----------
    law
        The law.

    Returns
    -------
    Law
        The same.

    Raises
    ------
    ParameterError
        The name is that of a law of this package.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> def kept(e, v):
    ...     return e * v / (1.0 + v)
    >>> def slope(e, v):
    ...     return e / ((1.0 + v) * (1.0 + v))
    >>> def bend(e):
    ...     return 2.0 * e
    >>> law = vs.register_law(vs.Law("falling", kept, slope, bend, roundings=3))
    >>> int(vs.simulate(rebound="falling", amplitude=0.5, duration=2.0).status.max())
    0
    """
    if law.name in LAWS and law.name not in OUTSIDE:
        raise ParameterError(f"law {law.name!r}: is a law of this package; choose another name")
    if law.name not in OUTSIDE:
        LAWS.append(law.name)
        LAWS_OF[HIGH_BOUNCE] += (law.name,)
    OUTSIDE[law.name] = law
    return law
