"""Claims 5, 6 and 8: windows of stable operation, the linearised update, the period-2 orbit."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep import simulate
from vibrosweep.analysis.conditions import Locked
from vibrosweep.analysis.decay import slot_decay
from vibrosweep.analysis.scene import Scene
from vibrosweep.analysis.windows import find_windows
from vibrosweep.engine.workers import Workers
from vibrosweep.figures.plane import parameter_plane
from vibrosweep.figures.returns import return_map
from vibrosweep.model import theory
from vibrosweep.model.status import Regime
from vibrosweep.study.batches import swept
from vibrosweep.study.figures.multipliers import decay_per_impact
from vibrosweep.study.verdict import Check, Number, Outcome, Picture

__all__ = ["linearised_update", "period_two", "windows"]

Array = NDArray[np.float64]

# Orbits at e = 0.98 settle to the last bit, by sqrt(e) per impact, in half this time, s
HORIZON: Final = 8000.0
# Those of mode 4 take four times as long, s
SETTLED: Final = 30_000.0
MODES: Final = (1, 2, 3, 4)
RESTITUTIONS: Final = np.linspace(0.5, 0.98, 12)


def windows(threads: int) -> Outcome:
    """Stable operation in A_min < A < A_max, Eq. 27."""
    e, part = (v.ravel() for v in np.meshgrid(RESTITUTIONS, np.linspace(0.02, 0.98, 12)))
    low, high = theory.amplitude_min(1, e), theory.amplitude_max(1, e)
    plane_e, plane_a = np.meshgrid(np.linspace(0.5, 0.98, 49), np.linspace(0.1, 4.0, 40))
    with Workers(threads) as workers:
        inside = swept(
            workers,
            restitution=e,
            amplitude=low + part * (high - low),
            particles=40,
            duration=HORIZON,
            regimes=True,
        )
        plane = swept(
            workers,
            restitution=plane_e.ravel(),
            amplitude=plane_a.ravel(),
            particles=20,
            duration=HORIZON,
            regimes=True,
        )
        k, near_e = (v.ravel() for v in np.meshgrid(np.array(MODES, np.float64), RESTITUTIONS))
        ends = theory.amplitude_min(k, near_e), theory.amplitude_max(k, near_e)
        width = ends[1] - ends[0]
        held = [
            _returns(k, near_e, amplitude, 1e-3, workers)
            for amplitude in (ends[0] + 0.02 * width, ends[1] - 0.02 * width)
        ]
        left = [
            _returns(k, near_e, amplitude, 1e-3, workers)
            for amplitude in (ends[0] * 0.98, ends[1] + 0.02 * width)
        ]
    deviation = _window_deviation(threads)
    share = plane["locked_count"] / plane.attrs["particles"]
    plane["locked_share"] = share.assign_attrs(long_name="share of launches that lock", units="1")
    return Outcome(
        as_stated=(
            Check(
                "share of launches in the window of mode 1 that lock",
                float(np.mean(inside["regime"].values == Regime.LOCKED)),
                "at least",
                1.0,
            ),
        ),
        conditional=(
            Check(
                "share of close launches that return to the orbit, 2 % inside the ends",
                float(np.mean(held)),
                "at least",
                1.0,
            ),
            Check("the same, 2 % outside the ends", float(np.mean(left)), "at most", 0.0),
            Check(
                "ends found in the map against the closed form, largest relative deviation",
                deviation,
                "at most",
                1e-8,
            ),
        ),
        numbers=(
            Number("launches in the window of mode 1", float(inside["regime"].size)),
            Number("close launches inside, and as many outside", float(np.size(held))),
            Number("A_min of mode 1 at Table 1", float(theory.amplitude_min(1, 0.9)), "m s-1"),
            Number("A_max of mode 1 at Table 1", float(theory.amplitude_max(1, 0.9)), "m s-1"),
        ),
        pictures=(
            Picture(
                "claim05_locked_share",
                "Share of twenty staggered launches that end on a locked orbit, with the "
                "closed-form ends of the windows of modes 1 to 3.",
                parameter_plane(plane, variable="locked_share"),
            ),
        ),
    )


def _window_deviation(threads: int) -> float:
    """Largest relative deviation of computed ends of windows from the closed form."""
    e = np.array([0.3, 0.5, 0.7, 0.9, 0.98])
    largest = 0.0
    for frequency in (1.0, 17.0):
        low = 0.9 * theory.amplitude_min(1, e[-1], frequency)
        scan = np.linspace(low, 1.05 * theory.amplitude_max(MODES[-1], e[0], frequency), 40)
        found = find_windows(
            Scene(frequency=frequency), e, scan, [Locked(k) for k in MODES], threads=threads
        ).isel(direction=0)
        for k, one in zip(MODES, (found.isel(condition=i) for i in range(len(MODES))), strict=True):
            widest = one.isel(window=np.maximum(one["widest"], 0))
            for name, end in (("A_min", theory.amplitude_min), ("A_max", theory.amplitude_max)):
                ratio = widest[name].values / end(k, e, frequency)
                # a window that is not found is NaN and stays so: its test is not passed
                largest = float(np.maximum(largest, np.max(np.abs(ratio - 1.0))))
    return largest


def _returns(
    k: Array, e: Array, amplitude: Array, offset: float, workers: Workers
) -> NDArray[np.bool_]:
    """Whether launches `offset` periods off the locked orbits of mode k come to lie on them.

    Where the orbit does not exist the launch is at the phase of the strongest kick.
    """
    phase = theory.locked_phase(k, e, amplitude)
    found = swept(
        workers,
        restitution=e,
        amplitude=amplitude,
        launch_velocity=theory.locked_velocity(k),
        phase=2.0 * np.pi * (np.where(np.isnan(phase), 0.25, phase) + offset),
        launch=(0.0,),
        particles=1,
        duration=SETTLED,
        regimes=True,
    )
    on = (found["regime"].values[:, 0] == Regime.LOCKED) & (
        found["cycle_impacts"].values[:, 0] == 1
    )
    return np.asarray(on & (found["cycle_periods"].values[:, 0] == k))


def linearised_update(threads: int) -> Outcome:
    """The linearised update of sec. 2.1.2 decides stability."""
    e, part = (v.ravel() for v in np.meshgrid(RESTITUTIONS, np.linspace(0.05, 0.95, 19)))
    low, high = theory.amplitude_min(1, e), theory.amplitude_max(1, e)
    inside, beyond = low + part * (high - low), (1.05 + part) * high
    both_e, amplitude = np.tile(e, 2), np.concatenate([inside, beyond])
    with Workers(threads) as workers:
        stable = _returns(np.ones_like(both_e), both_e, amplitude, 1e-6, workers)
    predicted = np.abs(theory.multipliers(1, both_e, amplitude)).max(axis=-1) < 1.0
    linearised = both_e < 1.0  # its multiplier is e
    at = np.linspace(0.6, 2.95, 9)
    measured = np.array([_fitted_decay(0.9, a, threads) for a in at])
    table_1 = _fitted_decay(0.9, 1.2, threads)
    return Outcome(
        as_stated=(
            Check(
                "share of orbits on which the update agrees with the map",
                float(np.mean(linearised == stable)),
                "at least",
                1.0,
            ),
            Check(
                "share of unstable orbits that the update recognises",
                float(np.mean(~linearised[~stable])),
                "at least",
                1.0,
            ),
        ),
        numbers=(
            Number("locked orbits tested", float(stable.size)),
            Number("of these unstable in the map, share", float(np.mean(~stable))),
            Number(
                "share on which the full multipliers agree with the map",
                float(np.mean(predicted == stable)),
            ),
            Number("decay per impact at Table 1, measured", table_1),
            Number(
                "the same from the full multipliers",
                float(np.abs(theory.multipliers(1, 0.9, 1.2)).max()),
            ),
            Number("the same from the linearised update", 0.9),
        ),
        pictures=(
            Picture(
                "claim06_decay_per_impact",
                "Factor by which a small offset from the locked orbit of mode 1 changes per impact "
                "(e = 0.9): measured in the map, from the full multipliers, and from the "
                "linearised update.",
                decay_per_impact(
                    0.9,
                    xr.Dataset(
                        {"modulus_fitted": ("amplitude", measured)}, coords={"amplitude": at}
                    ),
                ),
            ),
        ),
    )


def _fitted_decay(e: float, amplitude: float, threads: int) -> float:
    """Decay per impact of the separation of two particles near the locked orbit of mode 1."""
    phase = float(theory.locked_phase(1, e, amplitude))
    record = simulate(
        restitution=e,
        amplitude=amplitude,
        launch_velocity=4.905,
        launch_time=[phase, phase + 1e-4],
        duration=450.0,
        threads=threads,
    )
    return float(slot_decay(record)["modulus_fitted"][0])


def period_two(threads: int) -> Outcome:
    """At Table 1 the return map shows a stable period-2 orbit on two branches of slope e."""
    with Workers(threads) as workers:
        dense = swept(workers, particles=2000, duration=HORIZON, regimes=True)
        speeds = swept(
            workers,
            particles=300,
            duration=HORIZON,
            regimes=True,
            launch_velocity=np.linspace(0.5, 12.0, 40),
        )
        doubled = swept(workers, particles=500, duration=HORIZON, regimes=True, amplitude=3.05)
    cycles = [_cycles(dense), _cycles(speeds)]
    found = [np.concatenate(values) for values in zip(*cycles, strict=True)]
    regime, impacts, periods, rests = found
    without_rest = (regime == Regime.LOCKED) & (rests == 0)
    return Outcome(
        as_stated=(
            Check(
                "launches that end in a cycle of two impacts without rest",
                float(np.count_nonzero(without_rest & (impacts == 2))),
                "at least",
                1.0,
            ),
        ),
        numbers=(
            Number("launches", float(regime.size)),
            *(
                Number(
                    f"locked with one impact in {q} {'period' if q == 1 else 'periods'}, share",
                    float(np.mean(without_rest & (impacts == 1) & (periods == q))),
                )
                for q in (1, 2)
            ),
            Number("on an orbit that rests, share", float(np.mean(regime == Regime.RESTING))),
            Number(
                "impacts in a cycle of those that rest, median",
                float(np.median(impacts[regime == Regime.RESTING])),
            ),
            Number(
                "neither locked nor resting, share",
                float(np.mean((regime != Regime.LOCKED) & (regime != Regime.RESTING))),
            ),
            Number(
                "at 3.05 m/s, above A_max: cycles of two impacts without rest, share",
                _two_share(doubled),
            ),
        ),
        pictures=(
            Picture(
                "claim08_return_map",
                "Return map of twenty launches at Table 1. Late points, darker, are those of the "
                "locked orbit (on the diagonal) and of the orbit that rests once in each period.",
                return_map(
                    simulate(launch_time=np.arange(20) / 20, duration=300.0, threads=threads)
                ),
            ),
        ),
    )


def _cycles(found: xr.Dataset) -> list[NDArray[Any]]:
    names = ("regime", "cycle_impacts", "cycle_periods", "cycle_rests")
    return [found[name].values.ravel() for name in names]


def _two_share(found: xr.Dataset) -> float:
    regime, impacts, _, rests = _cycles(found)
    return float(np.mean((regime == Regime.LOCKED) & (impacts == 2) & (rests == 0)))
