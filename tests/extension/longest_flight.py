"""The longest flight that ends with a landing in the window: a statistic."""

import vibrosweep as vs


def flight_time(landing):
    return landing.flight_time


LONGEST_FLIGHT = vs.Observable(
    "flight_time_max", flight_time, "longest flight", "s", landings="max", particles="each"
)
