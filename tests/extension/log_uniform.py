"""A design from outside the package: margins that are uniform on a logarithmic scale."""

import vibrosweep as vs


def log_uniform(unit, low, high):
    """Place coordinates in [0, 1] evenly between the logarithms of the ends of a range."""
    return low * (high / low) ** unit


vs.register_design("log-uniform", log_uniform)
