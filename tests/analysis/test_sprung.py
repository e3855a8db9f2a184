"""Bases that move, and those that recoil."""

import xarray as xr

from vibrosweep.analysis.records import moves, recoils

SPRUNG = xr.Dataset(attrs={"base": "sprung"})


def test_a_sprung_base_moves_and_recoils():
    assert moves(SPRUNG)
    assert recoils(SPRUNG)
    for base, moving in (("high-bounce", False), ("moving", True)):
        other = SPRUNG.assign_attrs(base=base)
        assert (moves(other), recoils(other)) == (moving, False)
