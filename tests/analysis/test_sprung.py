"""Analyses of independent particles are refused over a base that couples them."""

import pytest
import xarray as xr

from vibrosweep.analysis.decay import slot_decay
from vibrosweep.analysis.energy import energy_balance
from vibrosweep.analysis.heights import heights_against_restitution
from vibrosweep.analysis.records import moves, recoils
from vibrosweep.errors import DataError

SPRUNG = xr.Dataset(attrs={"base": "sprung"})


def test_a_sprung_base_moves_and_recoils():
    assert moves(SPRUNG)
    assert recoils(SPRUNG)
    for base, moving in (("high-bounce", False), ("moving", True)):
        other = SPRUNG.assign_attrs(base=base)
        assert (moves(other), recoils(other)) == (moving, False)


@pytest.mark.parametrize(
    "analysis",
    [
        energy_balance,
        heights_against_restitution,
        slot_decay,
    ],
)
def test_analyses_of_independent_particles_refuse_a_sprung_base(analysis):
    with pytest.raises(DataError, match=r"mass_ratio = 0"):
        analysis(SPRUNG)
