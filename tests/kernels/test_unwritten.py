"""Results that a kernel forgets are named, whatever their type."""

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.engine import coupled, measure
from vibrosweep.errors import RunError
from vibrosweep.kernels.coupled.follow import empty_per_realization
from vibrosweep.kernels.coupled.joint_orbits import empty_joint
from vibrosweep.kernels.fixed import empty_fixed
from vibrosweep.kernels.memory import require_written
from vibrosweep.kernels.record import empty_record
from vibrosweep.kernels.separation import empty_separations
from vibrosweep.kernels.settle import empty_orbits, empty_shortest
from vibrosweep.kernels.statistics import KINDS, empty_statistics, empty_sums
from vibrosweep.kernels.trust import empty_trust

EMPTY = [
    empty_fixed(3),
    empty_joint(3),
    empty_orbits(3),
    empty_per_realization(3),
    empty_record(3, 2),
    empty_separations(3),
    empty_shortest(3),
    empty_statistics(3),
    empty_sums(3, KINDS),
    empty_trust(3),
]


def arrays(results):
    for values in results:
        if isinstance(values, np.ndarray):
            yield values
        elif hasattr(values, "_fields"):
            yield from arrays(values)


@pytest.mark.parametrize("results", EMPTY, ids=lambda results: type(results).__name__)
def test_a_single_unwritten_number_is_reported(results):
    for values in arrays(results):
        if values.dtype.kind in "fc":
            assert np.isnan(values).all()
        with pytest.raises(RunError, match="not completely written"):
            require_written(results)
        first = values.flat[0]
        values[...] = 0
        values.flat[0] = first
        with pytest.raises(RunError, match="not completely written"):
            require_written(results)
        values[...] = np.nan if values.dtype.kind in "fc" else -1
    require_written(results)


def left(kernel, *fields):
    """Return the kernel, made to leave a number of its results unwritten."""

    def leaves(*arguments):
        result, out = kernel(*arguments), arguments[-1]
        for field in fields:
            out = getattr(out, field)
        out[-1] = empty_statistics(1).status[0]
        return result

    return leaves


def test_a_result_that_a_kernel_leaves_unwritten_is_named(monkeypatch):
    scene = {"particles": 3, "restitution": [0.7, 0.8], "duration": 3.0, "design": "grid"}
    monkeypatch.setattr(measure, "separate", left(measure.separate, "shared"))
    with pytest.raises(RunError, match=r"Separations\.shared"):
        vs.sweep(**scene, separation=True)
    monkeypatch.setattr(measure, "combine", left(measure.combine, "status"))
    with pytest.raises(RunError, match=r"Statistics\.status"):
        vs.sweep(**scene)


def test_a_variable_that_nothing_computes_is_named(monkeypatch):
    monkeypatch.setattr(coupled, "separations_in_units", lambda *_: {})
    monkeypatch.setattr(measure, "separations_in_units", lambda *_: {})
    for base in (
        {"base": "high-bounce"},
        {"base": "sprung", "mass_ratio": 0.1, "mount_frequency": 2.0},
    ):
        with pytest.raises(RunError, match=r"dt_min, .*not computed"):
            vs.sweep(particles=2, realizations=2, duration=2.0, separation=True, **base)
