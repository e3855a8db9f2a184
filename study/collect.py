"""All claims in order: texts from ``texts.toml``, outcomes from computation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

from matplotlib.figure import Figure

from study import claims_on_attraction as attraction
from study import claims_on_chance as chance
from study import claims_on_contact as contact
from study import claims_on_energy as energy
from study import claims_on_heights as heights
from study import claims_on_laboratory as laboratory
from study import claims_on_order as order
from study import claims_on_repeats as repeats
from study import claims_on_robustness as robustness
from study import claims_on_scheme as scheme
from study import claims_on_setup as setup
from study import claims_on_stability as stability
from study import claims_on_transients as transients
from study import claims_on_windows as windows
from study.bases import BASES, FIXED
from study.samples import Plan
from study.texts import pictures, texts
from study.verdict import Claim, Evidence, Outcome


def _on(
    bases: Sequence[str],
    evidence: Callable[[Plan, str], Evidence],
    figures: Callable[[Plan], Mapping[str, Figure]] = lambda plan: {},
) -> Callable[[Plan], Outcome]:
    """Return the test of a claim that concerns some bases."""

    def test(plan: Plan) -> Outcome:
        judged = [evidence(plan, base) for base in bases if base in plan.bases]
        return Outcome(judged, pictures(figures(plan)))

    return test


TESTS: Final[Mapping[str, Callable[[Plan], Outcome]]] = {
    "1": _on(FIXED, energy.decay, energy.decay_figures),
    "2": _on(FIXED, energy.balance, energy.balance_figures),
    "3": _on(BASES, order.preserved, order.preserved_figures),
    "4a": _on(BASES, attraction.synchronous, attraction.synchronous_figures),
    "4b": _on(BASES, attraction.staggered),
    "5": _on(BASES, windows.windows, windows.windows_figures),
    "6": _on(FIXED, stability.linearised_update, stability.linearised_update_figures),
    "7": _on(BASES, heights.plateau, heights.plateau_figures),
    "8": _on(FIXED, stability.period_two, stability.period_two_figures),
    "9": _on(BASES, order.bounded_and_ordered),
    "10": _on(BASES, contact.separation_stays_positive, contact.separation_stays_positive_figures),
    "11": _on(BASES, contact.heights_differ, contact.heights_differ_figures),
    "12": scheme.step_of_one_millisecond,
    "13": laboratory.measured_and_predicted,
    "14": _on(BASES, heights.larger_amplitude),
    "15": _on(BASES, energy.weak_excitation),
    "16": _on(FIXED, windows.strong_excitation, windows.strong_excitation_figures),
    "17": _on(BASES, order.invariant),
    "18": _on(FIXED, repeats.steady),
    "19": _on(FIXED, repeats.repeatable),
    "20": laboratory.height_uncertainty,
    "21": contact.grooves,
    "22": laboratory.masses,
    "23": laboratory.camera_from_above,
    "24": _on(FIXED, chance.repulsion, chance.repulsion_figures),
    "25": _on(FIXED, transients.transient_decays),
    "26": _on(FIXED, stability.no_fixed_point),
    "27": setup.timing_within_a_frame,
    "28": setup.configuration,
    "29": _on(BASES, transients.replenished),
    "30": _on(FIXED, setup.eccentric_motor),
    "31": _on(FIXED, robustness.persists),
    "32": _on(FIXED, robustness.stays_staggered),
    "33": _on(FIXED, robustness.heights_hardly_change),
    "34": _on(FIXED, robustness.excitation_separates),
}


def judge_all(plan: Plan, keys: Iterable[str] | None = None) -> Iterator[Claim]:
    """Compute the outcomes of claims, all by default, one after the other."""
    words = texts()["claims"]
    for key in TESTS if keys is None else keys:
        yield Claim(key=key, **words[key], outcome=TESTS[key](plan))
