"""Remarks on the settings of a sweep, for readers of its result."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibrosweep.model.forcing import ACCELERATION, INPUTS, completed, inputs_of
from vibrosweep.model.orbit_theory import FIXED, recognition_periods
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.status import LANDINGS_OF_AN_EXPONENT
from vibrosweep.model.times import Periods, in_periods
from vibrosweep.scene.realizations import Realizations
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep

STRONGEST: Final = 100.0  # acceleration of a shaker in g
NEVER_REPEATS: Final = (
    "random motion never repeats: no cycle is searched for, and regimes are at_rest or undetermined"
)


def notes(spec: Sweep, design: Realizations) -> dict[str, str]:
    """Return the remarks on a sweep, by subject; empty if there are none."""
    found = {"defaults": _defaults(spec, design), "forcing": _strong_forcing(spec, design)}
    if spec.scene.noise(design.sampled):
        found["noise"] = NEVER_REPEATS if spec.scene.measures.regimes else ""
    elif spec.scene.measures.regimes:
        found |= {
            "observation": observation_of_orbits(spec, design),
            "exponents": _short_window(spec, design),
        }
    return {subject: text for subject, text in found.items() if text}


def silent_defaults(spec: Sweep, design: Realizations) -> dict[str, float]:
    """Return the parameters that a sweep leaves at their defaults while it states others."""
    stated = {*spec.scene.given, *design.sampled}
    silent = [name for name in inputs_of(stated, spec.scene.base) if stated and name not in stated]
    return {name: INPUTS[name].default for name in silent}


def _defaults(spec: Sweep, design: Realizations) -> str:
    return ", ".join(
        f"{name} {value:g} {INPUTS[name].units}".removesuffix(" 1")
        for name, value in silent_defaults(spec, design).items()
    )


def _strong_forcing(spec: Sweep, design: Realizations) -> str:
    """Return a remark if the base is driven more strongly than by any shaker; else empty."""
    forcing = spec.scene.forcing(design.sampled)
    lowest = {name: _ends(spec, design, name)[0] for name in ("restitution", "gravity")}
    highest = {name: _ends(spec, design, name)[1] for name in (forcing, "frequency")}
    given = {name: np.array([value]) for name, value in (lowest | highest).items()}
    return strong_forcing(float(completed(given, spec.scene.waveform)[ACCELERATION][0]), forcing)


def strong_forcing(acceleration: float, forcing: str) -> str:
    """Return a remark if a base is driven more strongly, in g, than any shaker; else empty."""
    if acceleration <= STRONGEST:
        return ""
    units = "g" if forcing == ACCELERATION else INPUTS[forcing].units
    return (
        f"the base accelerates with up to {acceleration:.4g} g, but shakers with about "
        f"{STRONGEST:g} g at most: check {forcing} ({units}) and frequency (Hz)"
    )


def observation_of_orbits(spec: Sweep, design: Realizations) -> str:
    """Return a remark if the observation is too short to recognise locked orbits; else empty."""
    restitution, frequency = (_ends(spec, design, n) for n in ("restitution", "frequency"))
    return short_observation(spec.scene, restitution[1], frequency[0])


def short_observation(scene: Scene, restitution: float, frequency: float) -> str:
    """Return a remark if a scene is too short to recognise locked orbits; else empty."""
    if scene.base not in FIXED or scene.restitution_law != CONSTANT:
        return ""  # the time that such orbits take to return is not known
    needed = float(recognition_periods(restitution, base=scene.base))
    periods = float(in_periods(scene.duration, np.array([frequency]))[0])
    if periods >= needed:
        return ""
    takes = f"up to {needed:.0f}" if math.isfinite(needed) else "more than any number of"
    enough = f"{needed / frequency:.4g} s"
    if isinstance(scene.duration, Periods):
        enough = f"{needed:.0f} periods"
    longer = f"; {enough} are enough" if math.isfinite(needed) else ""
    return (
        f"an orbit locked to one period takes {takes} periods to return bit for bit at restitution "
        f"{restitution:g}, but {periods:g} are observed: such orbits may "
        f"be called unsettled{longer}"
    )


def _short_window(spec: Sweep, design: Realizations) -> str:
    """Return a remark if the window is too short for the exponent of an orbit; else empty."""
    frequency = np.array(_ends(spec, design, "frequency")[1:])
    begin, end = (
        in_periods(t, frequency) for t in (spec.scene.measures.transient, spec.scene.duration)
    )
    periods = float((end - begin)[0])
    if periods >= LANDINGS_OF_AN_EXPONENT:
        return ""
    return (
        f"a Lyapunov exponent takes {LANDINGS_OF_AN_EXPONENT} landings, but the window has at most "
        f"{periods:g} periods: with fewer landings motion is called unsettled, never aperiodic"
    )


def _ends(spec: Sweep, design: Realizations, name: str) -> tuple[float, float]:
    """Return the smallest and the largest value of a parameter."""
    spread = spec.design.sampled.get(name)
    if spread is not None:
        return spread.ends
    if name in design.sampled:  # a table
        values = design.take(0, design.realizations)[name]
        return float(values.min()), float(values.max())
    return spec.scene.inputs[name], spec.scene.inputs[name]
