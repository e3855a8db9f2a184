"""Realizations of a sweep, when followed again, have the same landings, bit for bit."""

import re

import numpy as np
import pytest

import vibrosweep as vs
from tests.scenes import STILL_MOVING
from vibrosweep.errors import DataError, OtherKernelsWarning, ParameterError
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.parameters import NOISE, OF_MOUNT

MOUNT = {"base": "sprung", "mass_ratio": (0.01, 0.1), "mount_frequency": 7.0}
SCENES = {
    "high-bounce": {"base": "high-bounce"},
    "reflect": {"rebound": "reflect", "base_displacement": (0.01, 0.1)},
    "moving": {
        "base": "moving",
        "base_acceleration": (0.5, 4.0),
        "duration_periods": 90,
        "duration": None,
    },
    "sprung": {**MOUNT, "amplitude": (0.5, 2.0)},
    "two masses": {**MOUNT, "mass_ratio": None, "particle_mass": 0.01, "base_mass": (0.2, 1.0)},
    "law": {"restitution_law": "plastic", "restitution_speed": (0.05, 0.5)},
    "law on a mount": {
        **MOUNT,
        **STILL_MOVING,
        "amplitude": (0.5, 2.0),
        "restitution_law": "plastic",
        "restitution_speed": (0.05, 0.5),
    },
    "listed": {"launch": [0.0, 0.1, 0.37], "phase": (0.0, 6.0)},
}


def swept(**scene):
    given = {"restitution": (0.7, 0.95), "frequency": (20.0, 40.0), "particles": 3, "duration": 1.5}
    return vs.sweep(**given | scene, realizations=6, seed=11, per_particle=True)


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_realizations_of_a_sweep_are_followed_exactly(scene):
    found = swept(**scene)
    again = vs.simulate(found)
    assert np.array_equal(again.impact_count, found.particle_impact_count)
    assert np.array_equal(again.rested.sum("impact"), found.particle_rest_count)
    one = vs.simulate(found.isel(realization=4))
    length = one.sizes["impact"]
    for name in ("landing_time", "liftoff_time", "rebound_velocity"):
        alone, together = one[name].values[0], again[name].values[4, :, :length]
        assert np.array_equal(alone, together, equal_nan=True)
    assert one.restitution.item() == found.restitution[4].item()


RANGES = {
    "restitution": (0.7, 0.9),
    "amplitude": (0.5, 2.0),
    "base_velocity": (0.3, 1.0),
    "base_displacement": (0.05, 0.15),
    "base_acceleration": (0.5, 2.0),
    "frequency": (0.8, 1.2),
    "phase": (-9.0, 9.0),
    "gravity": (8.0, 11.0),
    "launch_velocity": (2.0, 6.0),
    "contact_time": (1e-4, 2e-2),
    "restitution_speed": (0.5, 2.0),
    "mass_ratio": (0.01, 0.1),
    "particle_mass": (0.01, 0.02),
    "base_mass": (0.2, 1.0),
    "mount_frequency": (2.0, 3.0),
    "mount_damping": (0.01, 0.1),
    "restitution_noise": (0.0, 0.1),
    "kick_noise": (0.0, 0.1),
    "drive_noise": (0.0, 0.3),
}
MASS = {"particle_mass": 0.01, "base_mass": 0.2}


@pytest.mark.parametrize("name", INPUTS)
def test_every_input_is_read_back(name):
    """The counts are those of the sweep whichever input varies, and its loss is an error."""
    scene = {}
    if name == "restitution_speed":
        scene = {"restitution_law": "plastic"}
    elif name in NOISE:
        scene = {**dict.fromkeys(NOISE, 0.05), "noise_seed": 3}
    elif name in OF_MOUNT:
        scene = {"base": "sprung", "mount_frequency": 2.3}
        scene |= MASS if name in MASS else {"mass_ratio": 0.05}
    scene |= {name: RANGES[name], "duration": 12.0, "particles": 2}
    found = vs.sweep(**scene, realizations=5, seed=4, per_particle=True)
    assert np.array_equal(vs.simulate(found).impact_count, found.particle_impact_count)
    one = vs.simulate(found.isel(realization=3))
    assert np.array_equal(one.impact_count[0], found.particle_impact_count[3])
    with pytest.raises(DataError, match=f"{name}|restitution_law"):
        vs.simulate(found.drop_vars(name))


def test_launches_are_the_phases_of_the_sweep_and_not_its_seconds():
    """At 30 Hz these fractions of a period change by an ulp if they are given in seconds."""
    scene = {"restitution": 0.85, "frequency": 30.0, "base_acceleration": 2.0, "duration": 2.0}
    found = vs.sweep(**scene, particles=7, base="moving", per_particle=True)
    count = vs.simulate(found).impact_count
    assert np.array_equal(count, found.particle_impact_count)


def test_points_of_a_grid_in_a_file_are_followed_exactly(tmp_path):
    spec = {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0, 3.0], "particles": 2}
    vs.run({**spec, "per_particle": True}, tmp_path / "grid.h5").close()
    with vs.open_sweep(tmp_path / "grid.h5") as found:
        one = vs.simulate(found.sel(amplitude=2.0))
        assert one.restitution.values.tolist() == [0.8, 0.9]
        assert one.amplitude.values.tolist() == [2.0, 2.0]
        chosen = found.particle_impact_count.sel(amplitude=2.0)
        assert np.array_equal(one.impact_count, chosen)


def test_a_result_of_other_kernels_is_warned_of():
    found = swept()
    found.attrs["kernels"] = "of another version"
    with pytest.warns(OtherKernelsWarning, match="another version"):
        vs.simulate(found)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda found: found.isel(particle=[0, 2]), "launch_time"),
        (lambda found: found.drop_vars("gravity"), "gravity"),
        (lambda found: found.assign(gravity=-1.0), "gravity"),
        (lambda found: found.drop_attrs(), "attributes"),
    ],
)
def test_a_result_that_no_sweep_computed_is_refused(change, word):
    found = vs.sweep(restitution=0.9, particles=3)
    with pytest.raises(DataError, match=re.escape(word)):
        vs.simulate(change(found))


def test_a_result_takes_no_keywords():
    with pytest.raises(ParameterError, match=r"^restitution: "):
        vs.simulate(vs.sweep(restitution=0.9), restitution=0.8)
