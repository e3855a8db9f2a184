"""Particles that the search over a base of finite mass examines, for benchmarks/README.md.

``NUMBA_DISABLE_JIT=1 PYTHONPATH=benchmarks python checks/coupled_looks.py`` counts, per landing,
how often a single particle is examined (a look), and the steps of the iteration that ends at the
landing, in plain Python on the scenes of ``benchmarks/test_coupled.py``.
"""

import sys
from collections import Counter

import numba

from test_coupled import engine, parameters
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.coupled import events

SIZES = {2: 40, 5: 12, 20: 4, 50: 1}  # realizations by number of particles


def counting(calls, function):
    """Return a function that counts its calls under its name."""

    def counted(*arguments):
        calls[function.__name__] += 1
        return function(*arguments)

    return counted


def main():
    if not numba.config.DISABLE_JIT:
        print("calls can be counted in plain Python only: set NUMBA_DISABLE_JIT=1")
        return 2
    calls = Counter()
    for module, name in ((events, "look"), (events, "_land"), (events, "_step")):
        setattr(module, name, counting(calls, getattr(module, name)))
    with Workers(1) as workers:
        for particles, realizations in SIZES.items():
            calls.clear()
            engine(parameters(realizations), particles, workers)()
            looks, steps = (calls[name] / calls["_land"] for name in ("look", "_step"))
            print(f"{particles:3} particles: {looks:.2f} looks and {steps:.2f} steps per landing")
    return 0


if __name__ == "__main__":
    sys.exit(main())
