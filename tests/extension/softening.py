"""A law of restitution: e / (1 + v / v_r), which falls with the speed of an impact."""

import vibrosweep as vs


def ratio(e, s):
    return e / (1.0 + s)


def slope(e, s):
    return e / ((1.0 + s) * (1.0 + s))


def bend(e):
    return 2.0 * e


SOFTENING = vs.register_law(vs.Law("softening", ratio, slope, bend, roundings=3))
