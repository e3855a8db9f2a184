"""All measures that can be combined, over every base, law and waveform, computed and proved.

    python checks/together.py

For each base, law of rebound, law of restitution and waveform of the table of abilities, one small
sweep without noise and one with all noise that the base allows measure what the table allows there,
and `vibrosweep verify` recomputes them where it can.  The same sweep without them, for which the
engine takes special machine code, must give the same bits.
Every combination is compiled, so this takes long.  Exit code 1 if anything is missing or fails.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import vibrosweep as vs
from accuracy import options_of
from vibrosweep.abilities import refusal
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.parameters import BASES, LAWS, NOISE, RELATIVE_NOISE, SPRUNG
from vibrosweep.model.restitution_laws import CONSTANT, POINTS, POWER, RESTITUTION_LAWS
from vibrosweep.model.shapes import HARMONICS_NAME, WAVEFORMS
from vibrosweep.proof.verifying import verify

MOUNT = {"mass_ratio": 0.1, "mount_frequency": 2.0}
TONES = {HARMONICS_NAME: [[1, 1.0, 0.0], [2, 0.4, 1.1]]}


# Laws of restitution, as keywords with those that they need
LAWFUL: Final[dict[str, dict[str, Any]]] = {
    **{law: {"restitution_law": law, "restitution_speed": 1.0} for law in RESTITUTION_LAWS},
    CONSTANT: {"restitution_law": CONSTANT},
    POWER: {"restitution_law": POWER, "restitution_speed": 1.0, "restitution_exponent": 0.2},
    POINTS: {"restitution_law": POINTS, "restitution_points": [[0.1, 0.9], [1.0, 0.8]]},
}


def combinations() -> Iterator[tuple[dict[str, str], bool]]:
    """Yield the laws and waveforms of each base, and whether there is noise."""
    for base, law, kept, shape in product(BASES, LAWS, RESTITUTION_LAWS, WAVEFORMS):
        allowed = not (refusal(base, law=law) or refusal(base, restitution=kept))
        if allowed:
            of = {"base": base, "rebound": law, "restitution_law": kept, "waveform": shape}
            yield from ((of, False), (of, True))


def together(path: Path, combination: dict[str, str], *, noisy: bool) -> list[str]:
    """Compute all measures of one combination into a file; return what is wrong with it.

    Where the table of abilities says that there is no proof, none is required.
    """
    base, law, kept, shape = combination.values()
    kinds = NOISE.keys() - {RELATIVE_NOISE}  # which is the same kind in another unit
    noise = [key for key in NOISE if noisy and key in kinds and not refusal(base, noise=[key])]
    asked: dict[str, Any] = {"law": law, "restitution": kept, "noise": noise}
    wanted = [key for key in MEASURES if not refusal(base, **asked, measure=key)]
    scene: dict[str, Any] = {**combination, **LAWFUL[kept], "amplitude": (0.3, 3.0)}
    scene |= {} if kept == POINTS else {"restitution": (0.5, 0.9)}
    scene |= {"realizations": 4, "particles": 3, "duration": 6.0, **dict.fromkeys(wanted, True)}
    scene |= dict.fromkeys(noise, 0.1)
    scene |= MOUNT if base == SPRUNG else {}
    scene |= {"waveform": TONES} if shape == HARMONICS_NAME else {}
    with vs.run(scene, path) as found:
        wrong = [
            f"{variable.name} is missing"
            for key in wanted
            for variable in MEASURES[key].variables
            if variable.name not in found
        ]
        alone = vs.sweep({key: value for key, value in scene.items() if key not in wanted})
        common = [name for name in alone if name in found]
        wrong += [f"{name} differs alone" for name in common if not alone[name].equals(found[name])]
    if not refusal(base, analysis="verify", noise=noise) and not verify(path, sample=2).passed:
        wrong.append("NOT PROVED")
    return wrong


def main() -> int:
    """Compute every combination; return 1 if anything fails."""
    options_of(__doc__, write=False)
    failed = 0
    with TemporaryDirectory() as folder:
        for number, (combination, noisy) in enumerate(combinations()):
            path = Path(folder) / f"{number}.h5"
            wrong = together(path, combination, noisy=noisy)
            failed += bool(wrong)
            names = " ".join([*combination.values(), *["noise"] * noisy])
            print(f"{names}: {', '.join(wrong) or 'passed'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
