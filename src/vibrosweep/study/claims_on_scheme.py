"""Claim 12: the study's fixed-step scheme against the exact map."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep import simulate
from vibrosweep.model import theory
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.study.figures.scheme import errors_in_time
from vibrosweep.study.rk4 import rk4
from vibrosweep.study.verdict import Check, Number, Outcome, Picture

__all__ = ["step_of_one_millisecond"]

Array = NDArray[np.float64]

STEP: Final = 1e-3
STEPS: Final = (4e-3, 2e-3, STEP, 5e-4, 1e-4, 1e-5)
# Of a period that is a whole number of steps, and of others
FREQUENCIES: Final = (1.0, 0.97, 1.03)
SHOWN: Final = (4e-3, STEP, 1e-4, 1e-5)
TABLE_1: Final[dict[str, Any]] = {name: parameter.default for name, parameter in PARAMETERS.items()}


def step_of_one_millisecond(threads: int) -> Outcome:
    """RK4 with a step of 1 ms is converged, sec. 3.1."""
    launch = np.arange(20) / 20
    exact = simulate(launch_time=launch, duration=12.0, threads=threads).isel(realization=0)
    errors = {h: _errors(exact, TABLE_1, h, threads) for h in STEPS}
    bouncing = ~(exact["rested"].values == 1).any(axis=-1)
    orders = np.polyfit(
        np.log(STEPS), np.log([np.nanmax(errors[h].values[bouncing]) for h in STEPS]), 1
    )
    on_locked = max(_locked_error(frequency, threads) for frequency in FREQUENCIES)
    return Outcome(
        as_stated=(
            Check(
                "landing-time error at a step of 1 ms in 12 s, largest",
                _largest(errors[STEP]),
                "at most",
                STEP,
                "s",
            ),
            Check(
                "share of particles with the right number of landings",
                float(np.mean(errors[STEP]["counted"] == 0)),
                "at least",
                1.0,
            ),
        ),
        conditional=(
            Check(
                "landing-time error on the locked orbit in 100 s, largest",
                on_locked,
                "at most",
                0.01,
                "s",
            ),
        ),
        numbers=(
            Number("particles that do not rest in 12 s", float(bouncing.sum())),
            *(
                Number(
                    f"largest error of these at a step of {1e3 * h:g} ms",
                    float(np.nanmax(errors[h].values[bouncing])),
                    "s",
                )
                for h in STEPS
            ),
            Number("order of convergence of these errors", float(orders[0])),
            Number("landings of all particles, exact", float(exact["impact_count"].sum())),
            Number(
                "landings of all particles, step of 1 ms",
                float(exact["impact_count"].sum() + errors[STEP]["counted"].sum()),
            ),
        ),
        pictures=(
            Picture(
                "claim12_landing_time_errors",
                "Error of the landing times of the particles that do not rest in 12 s, for four "
                "steps.",
                errors_in_time(
                    [errors[h].isel(particle=bouncing) for h in SHOWN],
                    [f"{1e3 * h:g} ms" for h in SHOWN],
                ),
            ),
        ),
    )


def _locked_error(frequency: float, threads: int) -> float:
    """Largest error of a landing time in 100 s of a particle launched 1 ms off the locked orbit."""
    speed = float(theory.locked_velocity(1, frequency))
    launch = float(theory.locked_phase(1, 0.9, 1.2, frequency)) / frequency + 1e-3
    exact = simulate(
        frequency=frequency,
        launch_velocity=speed,
        launch_time=launch,
        duration=100.0,
        threads=threads,
    ).isel(realization=0)
    given = TABLE_1 | {"frequency": frequency, "launch_velocity": speed}
    return _largest(_errors(exact, given, STEP, threads))


def _largest(errors: xr.DataArray) -> float:
    return float(np.nanmax(errors.values))


def _errors(
    exact: xr.Dataset, parameters: dict[str, Any], step: float, threads: int
) -> xr.DataArray:
    """Absolute errors of landing times (particle, impact) in s; NaN where only one has landed.

    Coordinates: the exact ``landing_time``, and ``counted``, landings of the scheme too many.
    """
    times = exact["landing_time"].values
    found = rk4(
        **parameters,
        launch_time=exact["launch_time"].values,
        duration=float(exact["duration"]),
        step=step,
        capacity=times.shape[1],
        threads=threads,
    )
    return xr.DataArray(
        np.abs(found.landing_time - times),
        dims=("particle", "impact"),
        coords={
            "landing_time": (("particle", "impact"), times),
            "counted": ("particle", found.impact_count - exact["impact_count"].values),
        },
    )
