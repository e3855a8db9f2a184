"""Status of a particle's computation and regime of its orbit: codes that are stored as data.

A bad realization never ends a sweep; it gets a code, and the code has a sentence with advice.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class _Code(IntEnum):
    """A code that a dataset holds."""

    @property
    def meaning(self) -> str:
        """The code's name as it stands in a dataset's ``flag_meanings``."""
        return self.name.lower()


class Status(_Code):
    """End of the computation of one particle, or the worst end in a realization.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sweep(duration=12.0)
    >>> vs.Status(found.status.item()).sentence
    'The trajectory is known up to the end of the observation.'
    """

    COMPLETED = 0
    BUDGET_EXCEEDED = 1
    NON_FINITE = 2
    REFUSED = 3

    @property
    def sentence(self) -> str:
        """Description and advice, in one sentence."""
        return _SENTENCES[self]


# Landings in the window that a Lyapunov exponent takes at least
LANDINGS_OF_AN_EXPONENT: Final = 64


class Regime(_Code):
    """Regime of a particle's orbit at the end of the observation.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sweep(launch=[0.432982], duration=4000.0, regimes=True)
    >>> vs.Regime(found.regime.item()).meaning
    'locked'
    """

    AT_REST = 0
    RESTING = 1
    LOCKED = 2
    UNSETTLED = 3
    APERIODIC = 4

    @property
    def sentence(self) -> str:
        """Meaning of the regime, in one sentence."""
        return _REGIMES[self]


_REGIMES = {
    Regime.AT_REST: "The particle came to rest for good.",
    Regime.RESTING: "The orbit repeats exactly and rests at least once in its cycle.",
    Regime.LOCKED: "The orbit repeats exactly and never rests.",
    Regime.UNSETTLED: (
        "No exact repetition was found, and nothing shows that there is none: the orbit may still "
        "be settling; observe for longer."
    ),
    Regime.APERIODIC: (
        f"No exact repetition was found, and the largest Lyapunov exponent, over "
        f"{LANDINGS_OF_AN_EXPONENT} landings or more, exceeds zero by three standard errors."
    ),
}

_SENTENCES = {
    Status.COMPLETED: "The trajectory is known up to the end of the observation.",
    Status.BUDGET_EXCEEDED: (
        "The impact budget ran out: measures cover only the landings found; raise "
        "measure.impact_budget, or shorten scene.duration."
    ),
    Status.NON_FINITE: (
        "A value became infinite or undefined: the parameters are too extreme for double "
        "precision, whatever the impact budget; lower the forcing or the launch velocity, or take "
        "a mount further from resonance."
    ),
    Status.REFUSED: (
        "A time is more than 2^51 forcing periods, which cannot be counted exactly, or the "
        "amplitude is above 1e30 m s-1; nothing was measured, and counts are -1: lower frequency "
        "or forcing, or shorten scene.duration."
    ),
}
