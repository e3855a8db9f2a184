"""Cost of waveforms; run with ``pytest benchmarks/test_waveforms.py -s``."""

from __future__ import annotations

from dataclasses import replace

import pytest

from test_moving import batch, streaming
from vibrosweep.engine.workers import Workers
from vibrosweep.model.shapes import Waveform

TONES = {
    2: ((1, 1.0, 0.0), (2, 0.4, 1.1)),
    8: ((1, 1.0, 0.0), *((h, 0.3 / h**2, 0.7 * h) for h in range(2, 9))),
}


@pytest.mark.parametrize(
    ("base", "tones", "most"),
    # measured on a busy machine: 1.6 and 2.2, 1.6 and 2.6
    [("high-bounce", 2, 2.0), ("high-bounce", 8, 2.8), ("moving", 2, 2.0), ("moving", 8, 3.0)],
)
def test_an_impact_under_harmonics_against_one_under_the_sine(race, base, tones, most):
    """Both have the same ranges; the numbers of impacts differ, and each time is per impact."""
    sine = batch("paper", 8000, 12.0, base)
    shape = Waveform("harmonics", TONES[tones])
    shaped = sine._replace(scene=replace(sine.scene, waveform=shape))
    with Workers(1) as workers:
        subject, impacts = streaming(shaped, workers)
        reference, others = streaming(sine, workers)
        ratio = race(subject, reference, work_subject=impacts, work_reference=others)
    assert ratio >= 1.0 / most
