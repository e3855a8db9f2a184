"""Table of what can be computed over each base: laws, waveforms, noise, measures, analyses.

Messages, the page of abilities and tests derive from it: nothing else says what a base cannot do.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

from vibrosweep.mistakes import quoted
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.parameters import BASES, HIGH_BOUNCE, LAWS_OF, MOVING, RELATIVE_NOISE, SPRUNG
from vibrosweep.model.restitution_laws import CONSTANT, name_of
from vibrosweep.model.shapes import WAVEFORMS

APART: Final = (HIGH_BOUNCE, MOVING)  # bases over which particles do not act on each other


@dataclass(frozen=True)
class Ability:
    """Bases that a measure, an analysis or a kind of noise supports."""

    bases: tuple[str, ...]
    # Reason why any other base, ``{base}``, is refused; ``{others}`` stands for `bases`
    why: str


_FOLLOWED = (
    "treats particles independently, but base = {base} couples them: compute a sweep instead "
    "(vibrosweep run), or take base = {others}"
)
_ANYWHERE = Ability(BASES, "")
# Bases of a measure, by its field `coupled`
_BY_COUPLING: Final[Mapping[bool | None, Ability]] = {
    None: _ANYWHERE,
    True: Ability((SPRUNG,), "describes particles coupled by base recoil; take base = {others}"),
    False: Ability(
        APART,
        "describes particles that are not coupled; with base = {base} leave it out "
        "(`vibrosweep verify` tells how exact a result is)",
    ),
}
# Analyses of orbits that repeat
_OF_ORBITS: Final = ("bifurcation", "basins", "orbits", "branches", "boundaries")
ANALYSES: Final[Mapping[str, Ability]] = {
    **dict.fromkeys(("windows", *_OF_ORBITS), Ability(APART, _FOLLOWED)),
    **dict.fromkeys(("sobol", "separations", "record", "observables"), _ANYWHERE),
    **dict.fromkeys(("verify", "laboratory", "explore"), _ANYWHERE),
    # imperfections of an experiment in the laboratory
    "frequency_jitter": Ability(
        (HIGH_BOUNCE,), "cannot be computed with base = {base}; leave it out"
    ),
    "restitution_spread": Ability(APART, "cannot be computed with base = {base}; leave it out"),
}
_RANDOM: Final[Mapping[str, Ability]] = {
    **dict.fromkeys(("restitution_noise", RELATIVE_NOISE, "kick_noise"), _ANYWHERE),
    "drive_noise": Ability(
        (HIGH_BOUNCE,),
        "needs base = {others}: a base that moves would jump where its amplitude changes; take "
        "kick_noise or restitution_noise",
    ),
}
# Analyses that require a constant restitution, each with the reason
OF_CONSTANT: Final[Mapping[str, str]] = {
    "explore": "draws closed forms of a constant restitution",
}
# Keywords that an analysis cannot use, because it sets its points and measures itself; a sweep file
# may hold them for other commands
_OF_SWEEPS: Final = (*MEASURES, "tolerance", "record", "windows")
WITHOUT_MEANING: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(_OF_ORBITS, _OF_SWEEPS),
    "windows": (*MEASURES, "record", "realizations", "seed"),
    "sobol": ("design", "record", "windows"),
}
# Measures and analyses that do not work with noise, each with the reason
REPEATS: Final = "looks for orbits that repeat, and random motion never repeats"
WHY_NOT_RANDOM: Final[Mapping[str, str]] = {
    **dict.fromkeys(_OF_ORBITS, REPEATS),
    "joint": "describes orbits that repeat",
    "sobol": "would take noise for an effect of the parameters",
    "explore": "computes points again, but without their streams of random numbers",
    **dict.fromkeys(
        ("laboratory", "frequency_jitter", "restitution_spread"), "draws its own imperfections"
    ),
}


def refusal(
    base: str,
    *,
    law: str = "",
    restitution: str = "",
    waveform: str = "",
    measure: str = "",
    analysis: str = "",
    noise: Collection[str] = (),
) -> str:
    """Return a sentence that says why a base does not support something; empty if it does.

    `base` is one of `BASES`; any other is refused.  `law` is a law of rebound, one of `LAWS`;
    `restitution` is one of `vibrosweep.model.restitution_laws.RESTITUTION_LAWS`, `waveform` one of
    `WAVEFORMS`, `measure` a key of `vibrosweep.model.measures.MEASURES`, `analysis` a key of
    `ANALYSES`; `noise` holds keys of `vibrosweep.model.parameters.NOISE`.
    """
    if base not in BASES:
        return f'base = "{base}": must be {quoted(BASES)}'
    if law and law not in LAWS_OF[base]:
        return _refused_law(base, law)
    if restitution not in ("", CONSTANT) and analysis in OF_CONSTANT:
        return (
            f'{OF_CONSTANT[analysis]}, not of restitution_law = "{name_of(restitution)}": take '
            f'restitution_law = "{CONSTANT}"'
        )
    if waveform and waveform not in WAVEFORMS:
        return f'waveform = "{waveform}": must be {quoted(WAVEFORMS)}'
    wanted = [_BY_COUPLING[MEASURES[measure].coupled]] if measure else []
    wanted += [ANALYSES[analysis]] if analysis else []
    wanted += [_RANDOM[kind] for kind in noise] if not measure and not analysis else []
    for ability in wanted:
        if base not in ability.bases:
            return ability.why.format(base=quoted([base]), others=quoted(ability.bases))
    name = measure or analysis
    if noise and name in WHY_NOT_RANDOM:
        return f"{WHY_NOT_RANDOM[name]}: leave out {' and '.join(noise)}"
    return ""


def _refused_law(base: str, law: str) -> str:
    others = [other for other, laws in LAWS_OF.items() if law in laws]
    remedy = " or ".join(f'rebound = "{known}"' for known in LAWS_OF[base])
    remedy += f", or base = {quoted(others)}" if others else ""
    reason = f'is not implemented with base = "{base}"'
    if law == "reflect":
        reason = f'has no meaning with base = "{base}", which a ball cannot be pushed into'
    return f'rebound = "{law}" {reason}: take {remedy}'
