"""Claims 31 to 34: the claims under noise, other waveforms and e that falls with speed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr

from study.arrays import Array, Flags
from study.disturbances import Orbit, disturbances, orbit, refusal
from study.estimates import magnitude, mean
from study.records import first_shared_base
from study.samples import ANY_PHASE, FEW, FIRST, Plan, Setting, by_seed, records
from study.slots import RESTITUTION, height_needed
from study.verdict import Check, Evidence, Reading, check, nearly_all
from vibrosweep import theory

NEAR: Final = 1e-3  # distance of launches from an orbit, turns
PART: Final = 0.25  # of the realizations
LONG: Final = 1000.0  # s at 1 Hz: the forcing periods of a film of 40 s at 25 Hz
LOCKED: Final = 0.25  # periods by which the flights of a locked particle may differ from k
SHOWN: Final = 12.0  # s, in the study
HARDLY: Final = 0.1  # relative change of heights that "hardly" allows
POPULATIONS: Final = (FEW, 20)
PER_SLOT: Final = 100  # impacts of each particle
TOGETHER: Final = 1e-6  # launches of a pair, s
END: Final = 10.0  # s at the end in which a pair is judged
# Table 1: restitution, periods per impact, amplitude in m s-1
TABLE_1: Final = (0.9, 1, 1.2)
Test = Callable[[dict[str, Any], Orbit, Setting], Check]


def _judged(
    base: str,
    scenes: Sequence[tuple[float, int, float | None]],
    test: Test,
    name: Callable[[int, str], str],
) -> Evidence:
    """Test a statement under each kind of disturbance of some orbits; name refused combinations.

    A scene is a restitution, a mode and an amplitude; `name` names a reading by mode and kind.
    """
    readings: list[Reading] = []
    refused: dict[str, None] = {}
    for restitution, periods, amplitude in scenes:
        plain = orbit(base, restitution, periods, {}, amplitude)
        for kind, each in disturbances(restitution, plain.amplitude, periods).items():
            checks: list[Check] = []
            for size, keys in each.items():
                if why := refusal(base, keys):
                    refused[why] = None
                    continue
                there = orbit(base, restitution, periods, keys, amplitude)
                scene = {"restitution": restitution, "amplitude": there.amplitude, **keys}
                checks.append(test(scene, there, Setting(size, constants=scene)))
            if checks:
                height = height_needed(periods) if amplitude is None else 0.0
                readings.append(Reading(name(periods, kind), checks, height))
    return Evidence(base, readings, not_computed=tuple(refused))


def _launched(
    plan: Plan,
    base: str,
    scene: dict[str, Any],
    there: Orbit,
    *,
    part: float = PART,
    **keys: Any,
) -> Iterable[xr.Dataset]:
    """Records of launches up to `NEAR` off an orbit, each with independent noise."""
    size = max(1, round(plan.realizations * part))
    off = np.concatenate([random.uniform(-NEAR, NEAR, size) for random in plan.random()])
    drawn = {"phase": 2.0 * np.pi * (there.phase + off), **_streams(plan, scene, off.size)}
    start = {"launch_velocity": there.velocity, "launch_time": 0.0}
    return records(plan, base, {**scene, **drawn}, **{**start, **keys})


def _streams(plan: Plan, scene: dict[str, Any], size: int) -> dict[str, Any]:
    """Streams of noise, where a scene has any, from the seed of the plan."""
    noisy = any(key.endswith("_noise") for key in scene)
    return {"noise_stream": np.arange(size), "noise_seed": plan.first_seed} if noisy else {}


def persists(plan: Plan, base: str) -> Evidence:
    """A periodic impact motion persists under small disturbances, sec. 2.1.2."""
    what = "share of particles locked to mode 1 that stay so for 1000 periods"

    def test(scene: dict[str, Any], there: Orbit, setting: Setting) -> Check:
        each = _launched(plan, base, scene, there, duration=LONG)
        return nearly_all(what, np.concatenate([_stay_locked(one) for one in each]), setting)

    return _judged(base, (TABLE_1,), test, lambda _, kind: kind)


def _stay_locked(record: xr.Dataset) -> Flags:
    """Return whether all flights until the end last one period, to within 1/4, without a rest."""
    landing = record["landing_time"].values[:, 0]
    flights = landing[:, 1:] - record["liftoff_time"].values[:, 0, :-1]
    with np.errstate(invalid="ignore"):
        off = np.isfinite(flights) & (np.abs(flights - 1.0) > LOCKED)
    rests = (record["rested"].values[:, 0] == 1).any(axis=1)
    return np.asarray(~off.any(axis=1) & ~rests & (np.nanmax(landing, axis=1) > LONG - 2.0))


def stays_staggered(plan: Plan, base: str) -> Evidence:
    """Temporal separation is maintained under bounded excitation, secs. 2.1.2 and 5."""
    what = "share of populations in which no two particles share the base in 100 impacts each"

    def test(scene: dict[str, Any], there: Orbit, setting: Setting) -> Check:
        each = _launched(
            plan,
            base,
            scene,
            there,
            part=0.1 * PART,
            launch_time=np.arange(there.periods, dtype=np.float64),
            duration=float(PER_SLOT * there.periods),
        )
        times = [first_shared_base(one)["first_shared_time"].values for one in each]
        return nearly_all(what, np.isnan(np.concatenate(times)), setting)

    return _judged(
        base,
        [(RESTITUTION, n, None) for n in POPULATIONS],
        test,
        lambda n, kind: f"{kind} ({n} particles, each in its own slot)",
    )


def heights_hardly_change(plan: Plan, base: str) -> Evidence:
    """The maximum rebound height hardly changes under realistic uncertainties, Figs. 3 and 8."""
    what = "share of particles locked to mode 1 whose greatest rise in 12 s is its height, to 10 %"

    def test(scene: dict[str, Any], there: Orbit, setting: Setting) -> Check:
        each = _launched(plan, base, scene, there, duration=SHOWN)
        rise = np.concatenate([_rise(one) for one in each])
        same = np.abs(rise / float(theory.locked_height(1)) - 1.0) <= HARDLY
        return nearly_all(what, same, setting)

    locked = _judged(base, (TABLE_1,), test, lambda k, kind: f"{kind} (locked to mode {k})")
    return Evidence(
        base, locked.readings, _on_average(plan, base), not_computed=locked.not_computed
    )


def _rise(record: xr.Dataset) -> Array:
    """Greatest rise of the first particle in a flight after an impact, m; 0 if there are none."""
    speed = np.nan_to_num(record["rebound_velocity"].values[:, 0]).max(axis=1)
    return np.asarray(speed**2 / (2.0 * float(record["gravity"])))


def _on_average(plan: Plan, base: str) -> list[Reading]:
    """Compare medians over random e, A and launches with and without each disturbance."""
    there = FIRST.over(phase=ANY_PHASE)
    drawn = there.drawn(plan)

    def medians(keys: dict[str, Any]) -> Array:
        scene = {**drawn, **keys, **_streams(plan, keys, drawn["phase"].size)}
        each = records(plan, base, scene, launch_time=0.0, duration=SHOWN)
        rises = by_seed(plan, np.concatenate([_rise(one) for one in each]))
        return np.asarray(np.median(rises, axis=1))

    undisturbed = medians({})
    readings = []
    for kind, each in disturbances(drawn["restitution"], drawn["amplitude"], 1).items():
        checks = []
        for name, keys in each.items():
            if refusal(base, keys):
                continue
            change = magnitude(mean(medians(keys) / undisturbed - 1.0))
            given = {key: value if np.ndim(value) == 0 else name for key, value in keys.items()}
            setting = Setting(name, there.ranges, given)
            what = "change of the median of the greatest rise in 12 s, relative"
            checks.append(check(what, change, "at most", HARDLY, setting=setting))
        if checks:
            readings.append(Reading(f"{kind} (in the median over e, A and launches)", checks))
    return readings


def excitation_separates(plan: Plan, base: str) -> Evidence:
    """Synchronous impacts are unstable under perturbations by the excitation, sec. 5."""
    what = "share of pairs launched 1 µs apart near mode 1 that have drawn apart after 1000 periods"

    def test(scene: dict[str, Any], there: Orbit, setting: Setting) -> Check:
        pair = np.array([0.0, TOGETHER])
        each = _launched(plan, base, scene, there, launch_time=pair, duration=LONG)
        apart = [one > TOGETHER for record in each for one in _closest_at_the_end(record)]
        return nearly_all(what, apart, setting)

    return _judged(base, (TABLE_1,), test, lambda _, kind: kind)


def _closest_at_the_end(record: xr.Dataset) -> Iterable[float]:
    """Smallest separation in s of the landings of each pair in the last 10 s."""
    for first, second in record["landing_time"].values:
        one, other = (times[times > LONG - END] for times in (first, second))
        yield float(np.abs(one[:, np.newaxis] - other).min(initial=np.inf))
