"""Claims 27, 28 and 30: timing within a frame, Table 1 and the laboratory, the eccentric motor."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from study.bases import HIGH_BOUNCE
from study.claims_on_contact import FREQUENCIES
from study.claims_on_laboratory import METHOD
from study.estimates import mean
from study.samples import TABLE_1, Plan, Setting
from study.table4 import SCENE
from study.verdict import ANY_BASE, Check, Evidence, Outcome, Reading, check, number
from vibrosweep import theory
from vibrosweep.lab import Camera, Experiment, find_impacts, perform_trials

# Sec. 3.2.5
FRAME_RATES: Final = (120.0, 240.0)
CAMERAS: Final[dict[str, dict[str, Any]]] = {
    "frames alone": {"noise": 0.0, "whole_pixels": False},
    "whole pixels of 0.17 mm": {"pixel": 0.18 / 1080, "noise": 1.0, "whole_pixels": True},
    "exposure 2 ms": {"exposure": 2e-3, "noise": 0.0, "whole_pixels": False},
    "5 % of the frames dropped": {"dropped": 0.05, "noise": 0.0, "whole_pixels": False},
}
FILMED: Final = 5  # particles
FILM: Final = 2.0  # s
PLATFORM_HEIGHT: Final = 85.0  # Table 2, mm
RESTITUTIONS: Final = (0.9, 0.8, 0.98)
ELASTIC: Final = 0.97


def timing_within_a_frame(plan: Plan) -> Outcome:
    """The uncertainty of impact times stays below one frame, sec. 3.2.8."""
    checks = [_timing(plan, rate, name) for rate in FRAME_RATES for name in CAMERAS]
    reading = Reading("impacts where the velocity turns, as in sec. 3.2.7", checks)
    return Outcome([Evidence(HIGH_BOUNCE, (reading,))])


def _timing(plan: Plan, rate: float, camera: str) -> Check:
    """Test the error of landing times found in a virtual film, one film for each seed."""
    errors = []
    for i in range(plan.seeds):
        seen = Camera(frame_rate=rate, **CAMERAS[camera])
        experiment = Experiment(
            **SCENE,
            particles=FILMED,
            repeats=1,
            transient=20.0,
            duration=20.0 + FILM,
            camera=seen,
            seed=plan.first_seed + i,
        )
        (trial,) = perform_trials(experiment)
        found = find_impacts(trial.tracks, method=METHOD, motion="level", exposure=seen.exposure)
        off = [
            np.abs(times[np.isfinite(times), np.newaxis] - true[np.isfinite(true)]).min(axis=1)
            for times, true in zip(
                found["landing_time"].values, trial.record.landing_time, strict=True
            )
        ]
        errors.append(rate * float(np.sqrt(np.mean(np.concatenate(off) ** 2))))
    setting = Setting(f"{rate:g} fps, {camera.replace('_', ' ')}", constants=SCENE)
    what = "error of an impact time, root mean square, in frames"
    return check(what, mean(errors, 0.0), "at most", 1.0, setting=setting)


def configuration(plan: Plan) -> Outcome:
    """Table 1 is based on the experimental configuration, sec. 3.1."""
    e, amplitude = (TABLE_1.constants[name] for name in ("restitution", "amplitude"))
    velocity = amplitude / (1.0 + e)
    stroke = 2e3 * velocity / (2.0 * math.pi)
    low, high = (2.0 * math.pi * f * velocity / 9.81 for f in FREQUENCIES)
    return Outcome(
        [
            Evidence(
                ANY_BASE,
                readings=(
                    Reading(
                        "its frequency is one of the laboratory's 8 to 35 Hz",
                        (check("frequency of Table 1", 1.0, "at least", FREQUENCIES[0], "Hz"),),
                    ),
                    Reading(
                        "a base that moves with it fits under the platform",
                        (check("stroke at Table 1", stroke, "at most", PLATFORM_HEIGHT, "mm"),),
                    ),
                ),
                numbers=(
                    number("acceleration with the A of Table 1 at 8 Hz, in g", low),
                    number("the same at 35 Hz", high),
                    number("height of mode 1 at 1 Hz", float(theory.locked_height(1)), "m"),
                    number("the same at 35 Hz", float(theory.locked_height(1, 35.0)), "m"),
                ),
            )
        ]
    )


def eccentric_motor(plan: Plan, base: str) -> Evidence:
    """A voltage sets an eccentric motor to stable operation all over 8 to 35 Hz, sec. 3.2.4.

    With a fixed eccentricity the displacement is constant: A grows as f, windows as 1/f.
    """
    slow, fast = FREQUENCIES
    needed = (fast / slow) ** 2
    what = "A_max over A_min of mode 1; the bound is A f at 35 Hz over A f at 8 Hz"
    at_table_1, elastic = (
        check(what, _width(base, e), "at least", needed, setting=_at(e)) for e in (0.9, ELASTIC)
    )
    widths = [
        number(
            f"factor in frequency over which mode 1 can be held, e = {e:g}",
            math.sqrt(_width(base, e)),
            setting=_at(e),
        )
        for e in RESTITUTIONS
    ]
    return Evidence(
        base,
        readings=(Reading("locked to mode 1 with one eccentricity, e = 0.9", (at_table_1,)),),
        conditions=(Reading(f"spheres with e of {ELASTIC:g} or more", (elastic,)),),
        numbers=widths,
    )


def _at(restitution: float) -> Setting:
    given = {"restitution": restitution, "frequency": FREQUENCIES}
    return Setting(f"e = {restitution:g}", constants=given)


def _width(base: str, restitution: float) -> float:
    """Upper end of the window of mode 1 over its lower end."""
    low, high = (
        end(1, restitution, base=base) for end in (theory.amplitude_min, theory.amplitude_max)
    )
    return float(high / low)
