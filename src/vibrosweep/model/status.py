"""Status of a particle's computation and regime of its orbit: codes that are stored as data.

A bad realization never ends a sweep; it gets a code, and the code has a sentence with advice.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final, Self

# Least number of landings in the window for a Lyapunov exponent
LANDINGS_OF_AN_EXPONENT: Final = 64


class _Code(IntEnum):
    """A code that a dataset holds, with a sentence that explains it."""

    sentence: str

    # The default is for type checkers, which take Status(1) for a call of this function.
    def __new__(cls, code: int, sentence: str = "") -> Self:
        member = int.__new__(cls, code)
        member._value_, member.sentence = code, sentence
        return member

    @property
    def meaning(self) -> str:
        """Name of the code, as in the ``flag_meanings`` of a dataset."""
        return self.name.lower()


class Status(_Code):
    """Status of the computation of one particle, or the worst status in a realization.

    Attributes
    ----------
    sentence
        Description and advice, in one sentence.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sweep(duration=12.0)
    >>> vs.Status(found.status.item()).sentence
    'The trajectory is known up to the end of the observation.'
    """

    COMPLETED = 0, "The trajectory is known up to the end of the observation."
    BUDGET_EXCEEDED = (
        1,
        "The impact budget ran out: measures cover only the landings found; raise "
        "measure.impact_budget, or shorten scene.duration.",
    )
    NON_FINITE = (
        2,
        "A value became infinite or undefined: the parameters are too extreme for double "
        "precision, whatever the impact budget; lower the forcing or the launch velocity, or take "
        "a mount further from resonance.",
    )
    REFUSED = (
        3,
        "A time is more than 2^51 forcing periods, or the particles land 2^53 times or more, which "
        "cannot be counted exactly; or the amplitude is above 1e30 m s-1, or the mass ratio above "
        "1000; nothing is given, and counts are -1: lower the frequency, the forcing or the mass "
        "ratio, take fewer particles, or shorten scene.duration.",
    )


class Regime(_Code):
    """Regime of a particle's orbit at the end of the observation.

    Attributes
    ----------
    sentence
        Meaning of the regime, in one sentence.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sweep(launch=[0.432982], duration=4000.0, regimes=True)
    >>> vs.Regime(found.regime.item()).meaning
    'locked'
    """

    AT_REST = 0, "The particle came to rest for good."
    RESTING = 1, "The orbit repeats exactly and rests at least once in its cycle."
    LOCKED = 2, "The orbit repeats exactly and never rests."
    UNSETTLED = (
        3,
        "No exact repetition was found, but it is not ruled out: the orbit may still be settling; "
        "observe for longer.",
    )
    APERIODIC = (
        4,
        f"No exact repetition was found, and the largest Lyapunov exponent, over "
        f"{LANDINGS_OF_AN_EXPONENT} landings or more, exceeds zero by three standard errors.",
    )
