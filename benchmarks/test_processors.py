"""The kernels against their sine, by vector width; ``pytest benchmarks/test_processors.py -s``."""

from __future__ import annotations

import pytest

from processors import measured, ways

# The chain of dependent operations of the bare map is half as long again as that of the sine alone,
# and the number of such chains that a core has under way limits the speed: a vector half as wide
# halves the lanes in each chain, but not its length.
BARE_MAP = {"512": 1.0 / 0.75}


@pytest.mark.parametrize("way", ways())
def test_streaming_and_the_bare_map_as_multiples_of_the_sine(way):
    found = measured(way)
    print(f"\n{way} bits: {found}")
    assert found["1000 periods"] <= 6.0
    assert found["12 periods"] <= 8.0
    assert found["bare map"] <= BARE_MAP.get(way, 2.0)
