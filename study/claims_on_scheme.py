"""Claim 12: the study's fixed-step scheme against the exact map."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from study.bases import HIGH_BOUNCE
from study.figures.curves import errors_in_time
from study.rk4 import CONTACT, rk4
from study.samples import Plan
from study.texts import pictures
from study.verdict import Evidence, Outcome, Reading, check, number
from vibrosweep import PARAMETERS, simulate, theory
from vibrosweep.figures.style import for_file

STEP: Final = 1e-3
STEPS: Final = (4e-3, 2e-3, STEP, 5e-4, 1e-4, 1e-5)
# Frequencies at which a period is a whole number of steps, and others
FREQUENCIES: Final = (1.0, 0.97, 1.03)
SHOWN: Final = (4e-3, STEP, 1e-4, 1e-5)
PLAIN, LOCATED = CONTACT
TABLE_1: Final[dict[str, Any]] = {name: parameter.default for name, parameter in PARAMETERS.items()}


def step_of_one_millisecond(plan: Plan) -> Outcome:
    """RK4 with a step of 1 ms is converged, sec. 3.1; a claim on the study's equations alone."""
    launch = np.arange(20) / 20
    exact = simulate(launch_time=launch, duration=12.0, threads=plan.threads).isel(realization=0)
    errors = {h: _errors(plan, exact, TABLE_1, h) for h in STEPS}
    located = _errors(plan, exact, TABLE_1, STEP, LOCATED)
    bouncing = ~(exact["rested"].values == 1).any(axis=-1)
    largest = [float(np.nanmax(errors[h].values[bouncing])) for h in STEPS]
    order = np.polyfit(np.log(STEPS), np.log(largest), 1)[0]
    on_locked = np.max([_locked_error(plan, frequency) for frequency in FREQUENCIES])
    within = check(
        "largest landing-time error in 100 s, where 1 % of a period is enough",
        on_locked,
        "at most",
        0.01,
        "s",
    )
    evidence = Evidence(
        HIGH_BOUNCE,
        readings=(
            _converged("a landing is seen at the next step", errors[STEP]),
            _converged("a landing is located in the step", located),
        ),
        conditions=(Reading("seen at the next step, on a stable locked orbit", (within,)),),
        numbers=(
            number("particles that do not rest in 12 s", np.count_nonzero(bouncing)),
            *(
                number(f"largest error of these at a step of {1e3 * h:g} ms", error, "s")
                for h, error in zip(STEPS, largest, strict=True)
            ),
            number("order of convergence of these errors", order),
            number("landings of all particles, exact", exact["impact_count"].sum()),
            number(
                "landings of all particles, seen at the next step of 1 ms",
                exact["impact_count"].sum() + errors[STEP]["counted"].sum(),
            ),
        ),
    )
    return Outcome([evidence], pictures(_figure(errors, bouncing)))


def _converged(name: str, errors: xr.DataArray) -> Reading:
    return Reading(
        name,
        (
            check(
                "landing-time error at a step of 1 ms in 12 s, largest",
                _largest(errors),
                "at most",
                STEP,
                "s",
            ),
            check(
                "share of particles with the right number of landings",
                np.mean(errors["counted"].values == 0),
                "at least",
                1.0,
            ),
        ),
    )


def _figure(errors: dict[float, xr.DataArray], bouncing: np.ndarray[Any, Any]) -> dict[str, Figure]:
    return {
        "claim12_landing_time_errors": for_file(
            errors_in_time,
            [errors[h].isel(particle=bouncing) for h in SHOWN],
            [f"{1e3 * h:g} ms" for h in SHOWN],
        )
    }


def _locked_error(plan: Plan, frequency: float) -> float:
    """Largest error of a landing time in 100 s of a particle launched 1 ms off the locked orbit."""
    speed = float(theory.locked_velocity(1, frequency))
    launch = float(theory.locked_phase(1, 0.9, 1.2, frequency)) / frequency + 1e-3
    exact = simulate(
        frequency=frequency,
        launch_velocity=speed,
        launch_time=launch,
        duration=100.0,
        threads=plan.threads,
    ).isel(realization=0)
    given = TABLE_1 | {"frequency": frequency, "launch_velocity": speed}
    return _largest(_errors(plan, exact, given, STEP))


def _largest(errors: xr.DataArray) -> float:
    return float(np.nanmax(errors.values))


def _errors(
    plan: Plan, exact: xr.Dataset, parameters: dict[str, Any], step: float, contact: str = PLAIN
) -> xr.DataArray:
    """Absolute errors of landing times (particle, impact) in s; NaN where only one has landed.

    Coordinates: the exact ``landing_time``, and ``counted``, the landings that the scheme finds
    in excess of the exact number.
    """
    times = exact["landing_time"].values
    found = rk4(
        **parameters,
        launch_time=exact["launch_time"].values,
        duration=float(exact["duration"]),
        step=step,
        contact=contact,
        capacity=times.shape[1],
        threads=plan.threads,
    )
    return xr.DataArray(
        np.abs(found.landing_time - times),
        dims=("particle", "impact"),
        coords={
            "landing_time": (("particle", "impact"), times),
            "counted": ("particle", found.impact_count - exact["impact_count"].values),
        },
    )
