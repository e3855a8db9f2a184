"""All claims in order: texts from ``texts.toml``, outcomes from computation."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.resources import files
from typing import Any, Final

from study import (
    claims_on_attraction,
    claims_on_chance,
    claims_on_contact,
    claims_on_energy,
    claims_on_heights,
    claims_on_laboratory,
    claims_on_order,
    claims_on_repeats,
    claims_on_robustness,
    claims_on_scheme,
    claims_on_setup,
    claims_on_stability,
    claims_on_transients,
    claims_on_windows,
)
from study.samples import Plan
from study.verdict import Claim, Outcome

TESTS: Final[Mapping[str, Callable[[Plan], Outcome]]] = {
    "1": claims_on_energy.decay,
    "2": claims_on_energy.balance,
    "3": claims_on_order.preserved,
    "4a": claims_on_attraction.synchronous,
    "4b": claims_on_attraction.staggered,
    "5": claims_on_windows.windows,
    "6": claims_on_stability.linearised_update,
    "7": claims_on_heights.plateau,
    "8": claims_on_stability.period_two,
    "9": claims_on_order.bounded_and_ordered,
    "10": claims_on_contact.separation_stays_positive,
    "11": claims_on_contact.heights_differ,
    "12": claims_on_scheme.step_of_one_millisecond,
    "13": claims_on_laboratory.measured_and_predicted,
    "14": claims_on_heights.larger_amplitude,
    "15": claims_on_energy.weak_excitation,
    "16": claims_on_windows.strong_excitation,
    "17": claims_on_order.invariant,
    "18": claims_on_repeats.steady,
    "19": claims_on_repeats.repeatable,
    "20": claims_on_laboratory.height_uncertainty,
    "21": claims_on_contact.grooves,
    "22": claims_on_laboratory.masses,
    "23": claims_on_laboratory.camera_from_above,
    "24": claims_on_chance.repulsion,
    "25": claims_on_transients.transient_decays,
    "26": claims_on_stability.no_fixed_point,
    "27": claims_on_setup.timing_within_a_frame,
    "28": claims_on_setup.configuration,
    "29": claims_on_transients.replenished,
    "30": claims_on_setup.eccentric_motor,
    "31": claims_on_robustness.persists,
    "32": claims_on_robustness.stays_staggered,
    "33": claims_on_robustness.heights_hardly_change,
    "34": claims_on_robustness.excitation_separates,
}


def texts() -> dict[str, Any]:
    """The words of the page; each text is one line."""
    raw = files("study").joinpath("texts.toml").read_text(encoding="utf-8")
    found = tomllib.loads(raw)
    claims = {
        key: {name: " ".join(text.split()) for name, text in words.items()}
        for key, words in found.pop("claim").items()
    }
    return {key: " ".join(text.split()) for key, text in found.items()} | {"claims": claims}


def judge_all(plan: Plan, keys: Iterable[str] | None = None) -> Iterator[Claim]:
    """Compute the outcomes of claims, all by default, one after the other."""
    words = texts()["claims"]
    for key in TESTS if keys is None else keys:
        yield Claim(key=key, **words[key], outcome=TESTS[key](plan))
