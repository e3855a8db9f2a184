"""Realizations that are computed at once."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.runs import chunks
from vibrosweep.scene.realizations import open_design
from vibrosweep.scene.sweep import parse_spec

SPEC = parse_spec(
    'title = "x"\n[sample]\nrealizations = 10_000_000\nrestitution = [0.8, 0.98]\n'
    "amplitude = [0.2, 3.5]\n"
)
DESIGN = open_design(SPEC)


@given(
    particles=st.integers(1, 10**7),
    rows=st.integers(1, 10**7),
    threads=st.integers(1, 64),
    duration=st.floats(1e-3, 1e12),
)
def test_pieces_are_neither_too_many_nor_too_large(particles, rows, threads, duration):
    spec = replace(SPEC, scene=replace(SPEC.scene, particles=particles, duration=duration))
    size, apart = chunks.rows_at_once(spec, DESIGN, rows, threads)
    assert 1 <= size <= min(rows, chunks.batch_size(spec))
    if apart:
        assert rows // size >= chunks.PIECES_PER_THREAD * threads
        assert chunks.LEAST_PER_PIECE // particles <= size <= chunks.MOST_PER_PIECE // particles


@pytest.mark.parametrize(
    ("rows", "particles", "duration", "cut"),
    [
        (200, 20, 12.0, (200, False)),  # too little to share out
        (100_000, 20, 12.0, (6553, True)),
        (100_000, 20, 1000.0, (819, True)),  # as much work in fewer
        (1000, 10**6, 12.0, (1, False)),  # very many particles: on all threads together
    ],
)
def test_a_sweep_is_cut_by_its_work(rows, particles, duration, cut):
    spec = replace(SPEC, scene=replace(SPEC.scene, particles=particles, duration=duration))
    assert chunks.rows_at_once(spec, DESIGN, rows, 2) == cut
