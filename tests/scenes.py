"""Scenes that tests share, since a new combination needs machine code of its own.

Over the high-bounce and the moving base: a sine with constant restitution, two tones with constant
restitution, a sine with plastic restitution, and noise of all kinds that the base allows.  Over a
base of finite mass: a sine with constant restitution, and plastic restitution with noise.  Over the
high-bounce base alone: particles that turn back (`rebound = "reflect"`), and the other laws.  All
tests that add measures add these observables, and all that add a law add that of
`tests/extension/softening.py`.
"""

import math

import vibrosweep as vs
from tests.extension.longest_flight import LONGEST_FLIGHT
from vibrosweep.model.parameters import NOISE, RELATIVE_NOISE

KINDS_OF_NOISE = tuple(name for name in NOISE if name != RELATIVE_NOISE)  # each in one unit
TWO_TONES = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
# the machine code of noise, which changes no bit here; a base that moves has no noise of its drive
STILL = dict.fromkeys(KINDS_OF_NOISE, 1e-300)
STILL_MOVING = {name: value for name, value in STILL.items() if name != "drive_noise"}
# the machine code of a law of restitution, at speeds at which nothing yields
RIGID = {"restitution_law": "plastic", "restitution_speed": 1e6}


def lost(landing):
    return landing.impact_speed**2 - landing.rebound * landing.rebound


def root(landing):
    return math.sqrt(landing.impact_speed)


def late(landing):
    return 1.0 if landing.phase > 0.1 else 0.0


def arrival(landing):
    return landing.impact_speed


def rests(landing):
    return landing.rests


OBSERVABLES = [
    vs.Observable("lost", lost, "sum of squares lost", "m2 s-2", landings="sum"),
    vs.Observable("root", root, "least root", landings="min"),
    vs.Observable("late", late, "late landings", landings="sum", particles="max"),
    vs.Observable("fastest", arrival, "fastest arrival", "m s-1", landings="max", particles="each"),
    vs.Observable("rests_seen", rests, "rests", landings="sum"),
    vs.Observable("flown", LONGEST_FLIGHT.function, "sum of flights", "s", landings="sum"),
    LONGEST_FLIGHT,
]
