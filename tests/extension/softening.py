"""A restitution that falls with the speed of arrival, as e / (1 + v): a law of rebound."""

import vibrosweep as vs


def kept(e, v):
    return e * v / (1.0 + v)


def slope(e, v):
    return e / ((1.0 + v) * (1.0 + v))


def bend(e):
    return 2.0 * e


SOFTENING = vs.register_law(vs.Law("softening", kept, slope, bend, roundings=3))
