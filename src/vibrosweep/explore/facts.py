"""Regimes, exponents and separations of a realization, in words."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Iterator

import numpy as np
import xarray as xr

from vibrosweep.abilities import refusal
from vibrosweep.errors import VibrosweepError
from vibrosweep.explore.choice import Choice
from vibrosweep.explore.labels import SYMBOLS, meanings, units_text
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import known
from vibrosweep.model.parameters import SPRUNG


def parameters_line(choice: Choice) -> str:
    """Write the base and the parameters of a choice in one line."""
    parts = []
    for name, value in choice.scene.inputs.items():
        unit = units_text(INPUTS[name].units)
        parts.append(f"{SYMBOLS[name]} = {value:.5g}{unit and f' {unit}'}")
    return ", ".join([f"{choice.scene.base} base", *parts])


def facts(
    choice: Choice, measured: xr.Dataset, settled: xr.Dataset | None
) -> Iterator[tuple[str, str]]:
    """Yield names and values of the properties of a realization."""
    one = measured.isel(realization=0)
    begin, end = (float(one[n]) * choice.inputs["frequency"] for n in ("transient", "duration"))
    yield "base", choice.scene.base
    yield "acceleration of the base Γ", f"{float(one['base_acceleration']):.5g} g"
    yield "observed", f"{f'{begin:.6g} to ' if begin > 0.0 else ''}{end:.6g} forcing periods"
    if choice.scene.base == SPRUNG:
        joint = one["joint_regime"]
        yield "joint regime", meanings(joint.attrs)[int(joint)]
        yield "largest Lyapunov exponent per period", _number(one["joint_exponent"])
    yield "largest rebound height", _number(one["rebound_height_max"], " m")
    if choice.scene.particles > 1:
        yield "smallest separation Δt min", _number(one["dt_min"], " s")
        shared = {1: "yes", 0: "no"}.get(int(one["base_shared"]), "not known")
        yield "two particles on the base at once", shared
    if settled is not None:
        one = settled.isel(realization=0)
        periods = float(one["duration"]) * choice.inputs["frequency"]
        yield f"regimes after {periods:.6g} periods", ", ".join(_regimes(one))
        yield "largest Lyapunov exponent per impact", _range(one["lyapunov_largest"].values)
        yield "orbits, slots", ", ".join(_number(one[n]) for n in ("orbit_count", "slot_count"))


def facts_html(choice: Choice) -> str:
    """Write the facts of a realization as a table, or the reason why they cannot be computed."""
    try:
        refused = refusal(choice.scene.base, measure="regimes")
        settled = None if refused else choice.settle()
        found = list(facts(choice, choice.observe(), settled))
    except VibrosweepError as error:
        return html.escape(str(error))
    rows = (f"<tr><td>{html.escape(a)}</td><td>{html.escape(b)}</td></tr>" for a, b in found)
    return f"<table>{''.join(rows)}</table>"


def _regimes(one: xr.Dataset) -> Iterator[str]:
    """Yield the number of particles in each regime, with the cycle that they follow."""
    names = ("regime", "cycle_impacts", "cycle_periods")
    regimes = meanings(one["regime"].attrs)
    kinds = Counter(zip(*(one[name].values.tolist() for name in names), strict=True))
    for (regime, impacts, periods), count in kinds.most_common():
        cycle = (
            f" ({_some(impacts, 'impact')} in {_some(periods, 'period')})" if impacts > 0 else ""
        )
        yield f"{count} {regimes.get(regime, 'not known')}{cycle}"


def _some(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _number(value: xr.DataArray, units: str = "") -> str:
    held = known(str(value.name), {value.name: value})
    return f"{float(value):.5g}{units}" if held else "not known"


def _range(values: np.ndarray) -> str:
    numbers = values[~np.isnan(values)]
    if not numbers.size:
        return "not known"
    low, high = float(numbers.min()), float(numbers.max())
    texts = [("-∞" if v == -np.inf else f"{v:.5g}") for v in (low, high)]
    return texts[0] if low == high else f"{texts[0]} to {texts[1]}"
