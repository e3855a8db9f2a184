"""Designs: any chunking gives the same bits, values stay in range, strata are filled."""

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.errors import SpecError
from vibrosweep.scene.design import MAX_LATIN_VALUES
from vibrosweep.scene.realizations import open_design
from vibrosweep.scene.sweep import parse_spec

DRAWN = ("uniform", "latin", "sobol")
DESIGNS = (*DRAWN, "grid")
GRID = "restitution = { start = 0.8, stop = 0.9, num = 10 }\namplitude = [1.0, 3.0, 2.0, 0.5]"


def opened(design, realizations=40, seed=1, ranges=None):
    ranges = ranges or "restitution = [0.8, 0.98]\namplitude = [0.2, 3.5]"
    count = "" if design == "grid" else f"realizations = {realizations}\nseed = {seed}\n"
    body = GRID if design == "grid" else ranges
    return open_design(parse_spec(f'title = "x"\n[sample]\ndesign = "{design}"\n{count}{body}'))


@pytest.mark.parametrize("name", DESIGNS)
def test_shape_order_and_range(name):
    design = opened(name)
    values = design.take(0, 40)
    assert design.realizations == 40
    assert tuple(values) == design.sampled == ("restitution", "amplitude")
    for array, low, high in zip(values.values(), (0.8, 0.2), (0.98, 3.5), strict=True):
        assert array.shape == (40,)
        assert array.dtype == np.float64
        assert low <= array.min() < array.max() <= high


WHOLE = {name: opened(name).take(0, 40) for name in DESIGNS}


@given(st.sampled_from(DESIGNS), st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40))))
def test_any_chunk_in_any_order_gives_the_same_bits(name, chunks):
    design = opened(name)
    for ends in chunks:
        start, stop = sorted(ends)
        part = design.take(start, stop)
        for key, whole in WHOLE[name].items():
            assert part[key].tobytes() == whole[start:stop].tobytes()


@pytest.mark.parametrize("name", DRAWN)
def test_the_seed_decides(name):
    again, other = opened(name).take(0, 40), opened(name, seed=2).take(0, 40)
    assert np.array_equal(again["amplitude"], WHOLE[name]["amplitude"])
    assert not np.intersect1d(other["amplitude"], WHOLE[name]["amplitude"]).size


def test_uniform_is_the_generator_row_by_row():
    rows = np.random.Generator(np.random.PCG64(1)).random((40, 2))
    assert np.array_equal(WHOLE["uniform"]["restitution"], 0.8 + rows[:, 0] * (0.98 - 0.8))
    assert np.array_equal(WHOLE["uniform"]["amplitude"], 0.2 + rows[:, 1] * (3.5 - 0.2))


@pytest.mark.parametrize(("name", "count"), [("latin", 40), ("sobol", 64)])
def test_one_value_in_each_stratum(name, count):
    values = opened(name, count, ranges="phase = [0.0, 1.0]\namplitude = [0.0, 1.0]").take(0, count)
    for array in values.values():
        strata = np.ceil(array * count) - 1 if name == "latin" else np.floor(array * count)
        assert sorted(strata) == list(range(count))


def test_sobol_fills_every_elementary_box():
    values = opened("sobol", 256, ranges="phase = [0.0, 1.0]\namplitude = [0.0, 1.0]").take(0, 256)
    x, y = values["phase"], values["amplitude"]
    for columns in (1, 2, 4, 8, 16, 32, 64, 128, 256):
        rows = 256 // columns
        boxes = np.floor(x * columns) * rows + np.floor(y * rows)
        assert np.unique(boxes).size == 256


def test_sobol_from_several_threads():
    design, wrong = opened("sobol"), []

    def check(start):
        for _ in range(20):
            part = design.take(start, start + 10)["amplitude"]
            if not np.array_equal(part, WHOLE["sobol"]["amplitude"][start : start + 10]):
                wrong.append(start)

    threads = [threading.Thread(target=check, args=(s,)) for s in (0, 10, 20, 30)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_grid_order():
    values = opened("grid").take(0, 40)
    assert np.array_equal(values["amplitude"][:5], [1.0, 3.0, 2.0, 0.5, 1.0])
    assert np.array_equal(np.unique(values["restitution"]), np.linspace(0.8, 0.9, 10))
    assert np.all(np.diff(values["restitution"]) >= 0)


@pytest.mark.parametrize("name", DRAWN)
def test_values_stay_in_a_range_of_two_neighbouring_numbers(name):
    high = float(np.nextafter(0.3, 1))
    values = opened(name, 50, ranges=f"restitution = [0.3, {high!r}]").take(0, 50)["restitution"]
    assert set(values) <= {0.3, high}


def test_far_chunks_of_an_enormous_design_are_cheap():
    design = opened("uniform", 10**12)
    assert design.take(10**12 - 3, 10**12)["amplitude"].shape == (3,)


def test_nothing_sampled():
    design = open_design(parse_spec('title = "x"'))
    assert (design.realizations, design.sampled) == (1, ())
    assert design.take(0, 1) == {}


def test_chunk_beyond_the_end():
    with pytest.raises(IndexError, match="41 among 40"):
        opened("uniform").take(3, 41)


def test_latin_hypercube_too_large():
    with pytest.raises(SpecError) as caught:
        opened("latin", MAX_LATIN_VALUES)
    said = str(caught.value)
    assert f"realizations = {MAX_LATIN_VALUES}" in said
    assert f"at most {MAX_LATIN_VALUES}" in said
    assert '"sobol" or "uniform"' in said


def test_more_realizations_than_sobol_points():
    with pytest.raises(SpecError, match=r"realizations = 4294967297: .* 4294967296 points"):
        opened("sobol", 2**32 + 1)
