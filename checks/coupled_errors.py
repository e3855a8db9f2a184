"""Errors over a base of finite mass against proved landings, and the estimates that verify uses.

    python checks/coupled_errors.py [--realizations 40] [--seed 1] [--write]

Random realizations of 2, 4 and 10 particles are drawn; each is computed in ball arithmetic, and
again with changed parameters and launches (`vibrosweep.proof.claims`), which gives the estimate.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from accuracy import options_of, provenance, show, table
from vibrosweep import simulate
from vibrosweep.proof.claims import prove
from vibrosweep.proof.reference.arithmetic import UndecidableError, arb, ctx
from vibrosweep.proof.reference.sprung import TooManyLandingsError
from vibrosweep.proof.sampling import ExactRealization
from vibrosweep.scene.scene import Scene

PAGE = Path(__file__).parent / "README.md"
STATES = ("compared", "not claimed", "undecided", "too many landings", "different")
PARTICLES = (2, 4, 10)
DURATION = 6.0  # s
MOST = 1000  # landings


def draw(rng):
    """Physical parameters, as keywords."""
    return {
        "restitution": rng.uniform(0.3, 0.98),
        "amplitude": rng.uniform(0.2, 3.5),
        "frequency": 1.0,
        "phase": rng.uniform(-1.0, 1.0),
        "gravity": 9.81,
        "launch_velocity": rng.uniform(2.0, 8.0),
        "contact_time": 0.01,
        "mass_ratio": 10.0 ** rng.uniform(-3.0, -0.3),
        "mount_frequency": 10.0 ** rng.uniform(-0.7, 0.5),
        "mount_damping": 10.0 ** rng.uniform(-2.0, 0.5),
    }


def compare(parameters, launches, duration, most=MOST):
    """Return the judgement of a realization, its number of landings, and the largest error twice.

    The error is in units of the estimate, and of the error that `verify` claims for each number.
    """
    found = simulate(base="sprung", launch_time=list(launches), duration=duration, **parameters)
    landings = int(found.impact_count.sum())
    scene = Scene(particles=len(launches), launch=tuple(launches), duration=duration, base="sprung")
    realization = ExactRealization(scene, parameters)
    try:
        proved, estimate = prove(realization, most)
    except TooManyLandingsError:
        return "too many landings", landings, 0.0, 0.0
    except UndecidableError:
        return "undecided", landings, 0.0, 0.0
    if estimate is None:
        return "not claimed", landings, 0.0, 0.0
    worst = share = 0.0
    with ctx.workprec(max(one.precision_bits for one in proved)):
        for p, one in enumerate(proved):
            own = found.isel(realization=0, particle=p)
            rested = own.rested.values[: len(one.impacts)].tolist()
            if int(own.impact_count) != len(one.impacts) or rested != [
                int(impact.rested) for impact in one.impacts
            ]:
                return "different", landings, np.inf, np.inf
            for k, impact in enumerate(one.impacts):
                claims = {
                    "landing_time": estimate.time,
                    "liftoff_time": estimate.time,
                    "rebound_velocity": estimate.velocity,
                }
                for name, claim in claims.items():
                    value, ball = float(own[name].values[k]), getattr(impact, name)
                    if ball is None:
                        continue
                    if not np.isfinite(value):
                        return "different", landings, np.inf, np.inf
                    error = float((arb(value) - ball).abs_upper())
                    if error > 0.0:  # a parameter of 0 is not changed, so that the claim may be 0
                        worst = max(worst, error / claim if claim > 0.0 else np.inf)
                    share = max(share, error / estimate.record_claims(realization, value)[name])
    return "compared", landings, worst, share


def main() -> None:
    options = options_of(__doc__, realizations=(40, "of each number of particles"), seed=1)
    began, rng, rows = time.perf_counter(), np.random.default_rng(options.seed), []
    for particles in PARTICLES:
        launches = [j / particles for j in range(particles)]
        each = [compare(draw(rng), launches, DURATION) for _ in range(options.realizations)]
        states = [state for state, *_ in each]
        counts = (states.count(s) for s in STATES)
        landings = sum(landings for _, landings, *_ in each)
        largest = max(worst for _, _, worst, _ in each)
        rows.append((particles, landings, *counts, f"{largest:.2g}"))
        print(rows[-1], flush=True)
    head = (
        "particles",
        "landings",
        *STATES,
        "largest error over the estimate",
    )
    text = table(head, rows)
    text += f"\n\n{provenance(time.perf_counter() - began, options.seed)}"
    show(options, "coupled", text, PAGE)


if __name__ == "__main__":
    main()
