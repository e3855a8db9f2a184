"""Records from Python, and sweeps that are followed again."""

import re
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

import vibrosweep
import vibrosweep as vs
from tests.cases import each_of
from tests.scenes import KINDS_OF_NOISE, STILL_MOVING
from vibrosweep import analysis, figures, simulate
from vibrosweep.errors import (
    DataError,
    OtherKernelsWarning,
    ParameterError,
    ShortObservationWarning,
    SpecError,
)
from vibrosweep.mistakes import PYTHON
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import IMPACTS, RECORD
from vibrosweep.model.parameters import NOISE, OF_MOUNT, PARAMETERS, RELATIVE_NOISE

# The contract of `simulate`: its results, and the messages with which it refuses.


def test_dims_types_and_attributes_of_a_record():
    found = simulate(amplitude=[1.2, 2.0], launch_time=[0.0, 0.05, 0.1])
    assert dict(found.sizes)["realization"] == 2
    assert dict(found.sizes)["particle"] == 3
    assert found.sizes["impact"] == found.impact_count.max()
    assert set(found.data_vars) - set(INPUTS) - {"duration"} == {*RECORD, *IMPACTS}
    for name, variable in {**RECORD, **IMPACTS}.items():
        assert found[name].dims == variable.dims
        assert found[name].dtype == variable.dtype
        for key, value in variable.attributes.items():
            assert np.array_equal(found[name].attrs[key], value)
    scene = {"base": "high-bounce", "rebound": "rest", "waveform": "sine"}
    assert found.attrs == {**scene, "restitution_law": "constant", "forcing": "amplitude"}


def test_parameters_that_differ_are_coordinates():
    found = simulate(amplitude=[1.2, 2.0], phase=[0.1], launch_time=0.3, duration=5, gravity=9.5)
    assert found.amplitude.dims == ("realization",)
    assert found.amplitude.values.tolist() == [1.2, 2.0]
    assert found.amplitude.attrs["units"] == "m s-1"
    for name, value in (("gravity", 9.5), ("restitution", 0.9), ("duration", 5.0)):
        assert found[name].dims == ()
        assert found[name].item() == value
    assert found.phase.values.tolist() == [0.1, 0.1]  # a list of one is broadcast
    assert found.launch_time.dims == ("particle",)
    assert found.launch_time.values.tolist() == [0.3]
    assert set(found.coords) == {"amplitude", "base_acceleration", "phase", "launch_time"}
    assert set(PARAMETERS) <= set(found.variables)


def test_past_the_last_landing_there_is_nothing():
    found = simulate(launch_time=[0.0, 0.125, 11.0])
    past = np.arange(found.sizes["impact"]) >= found.impact_count.values[..., np.newaxis]
    assert past.any()
    for name in ("landing_time", "liftoff_time", "rebound_velocity"):
        assert np.array_equal(np.isnan(found[name]), past)
    assert not found.rested.values[past].any()


def test_realizations_and_particles_do_not_depend_on_their_company():
    together = simulate(amplitude=[0.4, 1.2, 2.9], launch_time=[0.0, 0.6])
    for i, amplitude in enumerate([0.4, 1.2, 2.9]):
        for p, launch in enumerate([0.0, 0.6]):
            alone = simulate(amplitude=amplitude, launch_time=launch)
            count = alone.sizes["impact"]
            for name in RECORD:
                one = together[name].values[i, p]
                if one.ndim:
                    one = one[:count]
                assert np.array_equal(one, alone[name].values[0, 0], equal_nan=True)


def test_a_base_too_strong_for_any_shaker_is_noted():
    strong = simulate(base_displacement=0.5, frequency=25.0, duration=0.2)
    assert "up to 1258 g" in strong.attrs["notes"]


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_phase_and_speed_of_arrival_give_the_rebound(base):
    """w = e v + A sin(2 pi x), which equals w - V = e (v + V) for A = (1 + e) V0."""
    found = simulate(amplitude=[1.2, 2.0], launch_time=[0.0, 0.4], base=base)
    kick = found.amplitude * np.sin(2.0 * np.pi * found.impact_phase)
    bounced = (found.rested == 0) & np.isfinite(found.rebound_velocity)
    off = (found.rebound_velocity - 0.9 * found.arrival_speed - kick).where(bounced)
    assert float(abs(off).max()) < 1e-12
    first = found.arrival_speed.isel(impact=0)
    if base == "high-bounce":
        assert np.array_equal(first, np.full((2, 2), 5.0))
    assert np.array_equal(np.isnan(found.arrival_speed), np.isnan(found.landing_time))


def test_measures_are_those_of_a_sweep():
    scene = {"amplitude": [1.2, 2.0], "particles": 2, "duration_periods": 500, "lyapunov": True}
    swept = vibrosweep.sweep(**scene)
    with pytest.warns(ShortObservationWarning, match="500 are observed"):
        found = simulate(**scene)
    with pytest.warns(ShortObservationWarning):
        again = simulate(swept, regimes=True, lyapunov=True)
    for name in ("regime", "cycle_periods", "lyapunov_largest", "lyapunov_max", "orbit_count"):
        assert np.array_equal(found[name], swept[name], equal_nan=True)
        assert np.array_equal(again[name], swept[name], equal_nan=True)
    assert found.cycle_periods.values[0, 0] == 1
    with pytest.warns(ShortObservationWarning):
        ragged = simulate(**scene, ragged=True)
    assert vibrosweep.rectangle(ragged).identical(found)
    with pytest.raises(SpecError, match="regimes = True:"):
        simulate(regimes=True, base="sprung", mass_ratio=0.1, mount_frequency=3.0)


@pytest.mark.parametrize("threads", [1, 2, 3, np.int64(2)])
def test_threads_do_not_change_a_record(threads):
    amplitude = np.linspace(0.0, 4.0, 150)
    launch = [0.0, 0.3]
    one = simulate(amplitude=amplitude, launch_time=launch, threads=1, impact_budget=500)
    other = simulate(amplitude=amplitude, launch_time=launch, threads=threads, impact_budget=500)
    xr.testing.assert_identical(one, other)


def test_numbers_of_any_kind_are_taken():
    given = simulate(
        amplitude=np.float32(1.5),
        launch_time=[0, 1],
        duration=np.int32(12),
        frequency=xr.DataArray([1.0, 2.0]),
        impact_budget=np.int64(1000),
    )
    plain = simulate(amplitude=1.5, launch_time=[0.0, 1.0], frequency=[1.0, 2.0])
    xr.testing.assert_identical(given, plain)


ALLOWED = {name: parameter.allowed for name, parameter in PARAMETERS.items()}
ARRAY = "a finite number or a 1-D array of finite numbers"


@each_of(
    ("name", "value", "allowed"),
    [
        ("restitution", -0.1, ALLOWED["restitution"]),
        ("restitution", 1.0 + 1e-13, ALLOWED["restitution"]),
        ("restitution", [0.5, np.nan], ALLOWED["restitution"]),
        ("restitution", (0.8, 0.9), "give a list"),
        ("launch_time", (0.0, 0.1), "give a list"),
        ("launch", (0.0, 0.1), "give a list"),
        ("amplitude", [1.0, -2.0, 3.0], ALLOWED["amplitude"]),
        ("amplitude", np.inf, ALLOWED["amplitude"]),
        ("frequency", 0, ALLOWED["frequency"]),
        ("phase", 2e9, ALLOWED["phase"]),
        ("gravity", -9.81, ALLOWED["gravity"]),
        ("launch_velocity", -1e-300, ALLOWED["launch_velocity"]),
        ("contact_time", 0.0, ALLOWED["contact_time"]),
        ("restitution", "0.9", ALLOWED["restitution"]),
        ("restitution", True, ALLOWED["restitution"]),
        ("amplitude", 1j, ALLOWED["amplitude"]),
        ("amplitude", [[1.0]], ARRAY),
        ("amplitude", [1.0, [2.0]], ARRAY),
        ("amplitude", [], ARRAY),
        ("launch_time", [0.0, np.inf], ARRAY),
        ("launch_time", [[0.0]], ARRAY),
        ("launch_time", "staggered", ARRAY),
        ("duration", 0.0, "above 0 s"),
        ("duration", -1, "above 0 s"),
        ("duration", np.nan, "above 0 s"),
        ("duration", np.inf, "above 0 s"),
        ("duration", [1.0, 2.0], "above 0 s"),
        ("rebound", "bounce", '"rest" or "reflect"'),
        ("rebound", 1, '"rest" or "reflect"'),
        ("rebound", ["rest"], '"rest" or "reflect"'),
        ("impact_budget", 0, "at least 1"),
        ("impact_budget", 1e3, "at least 1"),
        ("impact_budget", True, "at least 1"),
        ("design", "sobol", "is not a known keyword"),
    ],
)
def test_a_mistake_is_named_with_its_value_and_what_is_allowed(name, value, allowed):
    with pytest.raises(SpecError) as caught:
        simulate(**{name: value})
    (mistake,) = caught.value.mistakes
    assert PYTHON.key(mistake.key) == name
    assert mistake.value is value
    assert allowed in PYTHON.write((mistake.rule, mistake.remedy))


@pytest.mark.parametrize("threads", [0, 1.0])
def test_threads_are_a_number(threads):
    with pytest.raises(ParameterError, match=f"^threads = {threads}: "):
        simulate(threads=threads)


@pytest.mark.parametrize("name", ["restitution", "launch_time"])
def test_masked_values_are_not_taken_for_data(name):
    masked = np.ma.array([0.5, 0.7], mask=[False, True])
    with pytest.raises(ParameterError, match=f"^{name}: holds masked values"):
        simulate(**{name: masked})
    with pytest.raises(ParameterError, match=f"^{name}: holds masked values"):
        simulate(**{name: [0.5, np.ma.masked]})
    whole = simulate(**{name: np.ma.array([0.5, 0.7])})
    xr.testing.assert_identical(whole, simulate(**{name: [0.5, 0.7]}))


def test_arrays_of_different_lengths_are_refused_by_name():
    with pytest.raises(SpecError, match=r"one length.*'restitution': 2, 'amplitude': 3"):
        simulate(restitution=[0.8, 0.9], amplitude=[1.0, 2.0, 3.0], gravity=[9.81])


@each_of(
    ("changes", "message"),
    [
        ({"duration": 1e20}, r"duration = 1e\+20 s is 1e\+20 forcing periods:"),
        ({"launch_time": -1e20}, r"launch time = 1e\+20 s is 1e\+20 forcing periods: at most"),
        ({"duration": 1e302, "frequency": 1e-30}, r"duration = 1e\+302 s is 1e\+272 forcing per"),
        ({"frequency": 1e-157}, r"frequency = 1e-157:"),
        ({"amplitude": 1e308}, r"amplitude = 1e\+308:"),
    ],
)
def test_numbers_beyond_double_precision_are_refused(changes, message):
    with pytest.raises(SpecError, match=message):
        simulate(**changes)


def test_an_unknown_parameter_is_refused():
    with pytest.raises(SpecError, match="weight"):
        simulate(weight=1.0)


def test_a_mistake_is_also_a_value_error():
    with pytest.raises(ValueError, match="restitution"):
        simulate(restitution=2.0)


def test_a_particle_that_is_given_up_is_noted():
    cut = simulate(particles=2, impact_budget=6, duration=12.0)
    assert cut.attrs["notes"].startswith("2 of 2 particles were abandoned after 6 landings: raise")
    assert "notes" not in simulate(particles=2).attrs


@pytest.mark.parametrize(
    "draw", [figures.parameter_plane, figures.height_time, analysis.return_map, simulate]
)
def test_a_path_in_place_of_a_dataset_is_refused(draw):
    with pytest.raises(DataError, match=r"^str: .*open_sweep\(path\)"):
        draw("out.h5")


@pytest.mark.parametrize("opened", ["open_sweep", "open_record"])
def test_files_that_are_no_results_are_refused(opened, tmp_path):
    function = getattr(vibrosweep, opened)
    absent, text = tmp_path / "absent.h5", tmp_path / "text.h5"
    text.write_text("no result")
    for path in (absent, text):
        with pytest.raises(DataError, match=re.escape(str(path))):
            function(path)


def test_a_missing_sweep_file_is_named(tmp_path):
    with pytest.raises(SpecError, match=r"absent\.toml"):
        vibrosweep.run(tmp_path / "absent.toml", tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()


def test_public_names_are_loaded_lazily():
    script = (
        "import sys, vibrosweep; "
        "print(sorted({'numba', 'xarray', 'h5py', 'matplotlib', 'scipy'} & set(sys.modules)), "
        "dir(vibrosweep))"
    )
    shown = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    ).stdout
    assert shown.startswith("[] ")
    assert "simulate" in shown
    with pytest.raises(AttributeError, match="no attribute 'absent'"):
        _ = vibrosweep.absent


WAYS = {
    "base_velocity": [0.3, 1.0],
    "base_displacement": [0.02, 0.1],
    "base_acceleration": [0.2, 2.0],
}


@pytest.mark.parametrize("way", WAYS)
def test_a_forcing_is_its_amplitude(way):
    shared = {"frequency": [1.0, 2.0], "restitution": 0.8, "launch_time": [0.0, 0.3]}
    one = simulate(**{way: WAYS[way]}, **shared)
    other = simulate(amplitude=one.amplitude.values, **shared)
    assert one[way].values.tolist() == WAYS[way]
    assert one.attrs["forcing"] == way
    xr.testing.assert_equal(one.reset_coords(drop=True), other.reset_coords(drop=True))
    assert np.allclose(one.base_acceleration, other.base_acceleration, rtol=1e-14)


def test_two_forcings_and_two_durations_are_refused():
    with pytest.raises(SpecError, match=r"base_velocity .* amplitude"):
        simulate(amplitude=1.2, base_velocity=0.5)
    with pytest.raises(SpecError, match=r"duration_periods = 4: duration = 3\.0 is given too"):
        simulate(duration=3.0, duration_periods=4)
    with pytest.raises(SpecError, match="base_acceleration: gives an amplitude"):
        simulate(base_acceleration=1e30, frequency=1e-3)
    with pytest.raises(SpecError, match=r"duration_periods = 0:"):
        simulate(duration_periods=0)


def test_a_law_without_meaning_is_refused():
    with pytest.raises(SpecError, match=r'rebound = "reflect" .* base = "moving"'):
        simulate(base="moving", rebound="reflect")
    with pytest.raises(SpecError, match="base = 'still':"):
        simulate(base="still")


def test_each_realization_lasts_its_own_periods():
    frequency = [1.0, 3.0, 0.7]
    found = simulate(frequency=frequency, duration_periods=9, launch_time=[0.0, 0.1])
    assert found.attrs["duration_periods"] == 9.0
    assert np.array_equal(found.duration, 9.0 / np.array(frequency))
    assert np.nanmax(found.landing_time / found.duration) <= 1.0
    for i, f in enumerate(frequency):
        alone = simulate(frequency=f, duration_periods=9, launch_time=[0.0, 0.1])
        size = alone.sizes["impact"]
        assert np.array_equal(
            found.landing_time[i, :, :size], alone.landing_time[0], equal_nan=True
        )
        assert np.isnan(found.landing_time[i, :, size:]).all()
    seconds = simulate(duration=9, launch_time=[0.0, 0.1])
    periods = simulate(duration_periods=9, launch_time=[0.0, 0.1])
    xr.testing.assert_equal(seconds, periods)


# Realizations of a sweep, when followed again, have the same landings, bit for bit.

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
    RELATIVE_NOISE: (0.0, 0.1),
    "kick_noise": (0.0, 0.1),
    "drive_noise": (0.0, 0.3),
}
MASS = {"particle_mass": 0.01, "base_mass": 0.2}


@each_of("name", INPUTS)
def test_every_input_is_read_back(name):
    """The counts are those of the sweep whichever input varies, and its loss is an error."""
    scene = {}
    if name == "restitution_speed":
        scene = {"restitution_law": "plastic"}
    elif name in NOISE:
        scene = {**dict.fromkeys(KINDS_OF_NOISE, 0.05), "noise_seed": 3}
        if name == RELATIVE_NOISE:
            del scene["restitution_noise"]
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


def test_a_tuple_is_answered_once():
    with pytest.raises(SpecError) as caught:
        simulate(frequency=(20.0, 30.0))
    (mistake,) = caught.value.mistakes
    assert "give a list" in str(caught.value)
    assert mistake.key.endswith("frequency")
