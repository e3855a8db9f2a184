"""A landing, the argument of statistics and observables."""

from __future__ import annotations

from typing import NamedTuple


class Landing(NamedTuple):
    """A landing in the window, the argument of an observable's function.

    Attributes
    ----------
    phase
        Phase of the forcing in turns, -1/2 to 1/2; 0 where the velocity of the base rises through
        zero.
    flight_time
        Duration in forcing periods of the flight that ends here.
    arrival, rebound
        Speeds relative to the base, before the impact and at lift-off, in units of g / (2 f): from
        a base at rest, a flight with rebound 1 lasts one forcing period.  If the particle rests,
        `rebound` is the speed at the end of the rest.
    rests
        True if the particle rests on the base.

    Examples
    --------
    >>> import numpy as np, vibrosweep as vs
    >>> def rests(totals, landing):
    ...     totals[0] += landing.rests
    >>> totals = np.zeros(1)
    >>> rests(totals, vs.Landing(phase=0.1, flight_time=0.5, arrival=0.5, rebound=0.0, rests=True))
    >>> totals
    array([1.])
    """

    phase: float
    flight_time: float
    arrival: float
    rebound: float
    rests: bool
