"""Parameters of a base of finite mass, and quantities that follow from them."""

import numpy as np
import pytest

from vibrosweep.errors import ParameterError
from vibrosweep.model.forcing import (
    INPUTS,
    completed,
    differing,
    inputs_of,
    only_parameters,
    refuse_extreme,
)
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    MASSES,
    MOUNT,
    MOVING,
    OF_MOUNT,
    PARAMETERS,
    mount_mistakes,
    representable,
)

OWN = {"mass_ratio": 0.004, "mount_frequency": 3.0, "mount_damping": 0.1}
WEIGHED = {"particle_mass": 0.004, "base_mass": 2.0, "mount_frequency": 3.0}


def arrays(**given):
    every = {name: p.default for name, p in PARAMETERS.items()} | given
    columns = np.broadcast_arrays(*(np.atleast_1d(np.float64(value)) for value in every.values()))
    return dict(zip(every, columns, strict=True))


def test_a_ratio_of_masses_and_a_frequency_are_enough():
    for given in (OWN, WEIGHED, OWN.keys() - {"mount_damping"}):
        assert mount_mistakes("sprung", {"amplitude", *given}) == {}


@pytest.mark.parametrize("base", [HIGH_BOUNCE, MOVING])
@pytest.mark.parametrize("name", OF_MOUNT)
def test_another_base_has_no_mount(base, name):
    assert mount_mistakes(base, {"amplitude"}) == {}
    assert 'write base = "sprung"' in mount_mistakes(base, [name])[name]


@pytest.mark.parametrize(
    ("given", "about"),
    [
        ([], {"mass_ratio", "mount_frequency"}),
        (["mass_ratio"], {"mount_frequency"}),
        (["mount_frequency", "mount_damping"], {"mass_ratio"}),
        (["mount_frequency", "base_mass"], {"particle_mass"}),
        (["mount_frequency", "particle_mass"], {"base_mass"}),
        (["mount_frequency", "particle_mass", "mass_ratio"], {"particle_mass"}),
        (["mount_frequency", "particle_mass", "base_mass", "mass_ratio"], {"particle_mass"}),
    ],
)
def test_each_missing_or_superfluous_input_is_named_once(given, about):
    assert mount_mistakes("sprung", given).keys() == about


def test_inputs_are_those_of_the_base():
    common = tuple(PARAMETERS)
    for base in (HIGH_BOUNCE, MOVING):
        assert inputs_of((), base) == common
    assert inputs_of(OWN, "sprung") == (*common, *MOUNT)
    assert inputs_of(WEIGHED, "sprung") == (*common, *MASSES, "mount_frequency", "mount_damping")


def test_masses_make_a_ratio_that_the_engine_is_given():
    found = completed(arrays(**WEIGHED, mount_damping=0.05))
    assert found["mass_ratio"].item() == 0.002
    assert [*found] == [name for name in INPUTS if name in found]
    assert [*only_parameters(found)] == [*PARAMETERS, *MOUNT]
    assert [*only_parameters(completed(arrays()))] == [*PARAMETERS]


@pytest.mark.parametrize("varied", [*MASSES])
def test_the_ratio_differs_with_either_mass(varied):
    assert differing([varied], "amplitude") == (varied, "mass_ratio")
    assert differing(["mass_ratio"], "amplitude") == ("mass_ratio",)
    assert differing(["mount_damping"], "amplitude") == ("mount_damping",)


def test_masses_of_too_large_a_ratio_are_refused_and_told_apart():
    masses = {"particle_mass": [1.0, 1.0, 1e30], "base_mass": [1e-3, 9e-4, 1e-30]}
    values = completed(arrays(**{**WEIGHED, **masses}))
    assert representable(values, ()).tolist() == [True, False, False]
    with pytest.raises(ParameterError, match="particle_mass and base_mass: make a mass_ratio of"):
        refuse_extreme(values, "amplitude", "constant")
    refuse_extreme({name: v[:1] for name, v in values.items()}, "amplitude", "constant")
