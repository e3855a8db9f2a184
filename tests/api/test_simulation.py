"""The contract of `simulate`: its results, and the messages with which it refuses."""

import re
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

import vibrosweep
from vibrosweep import analysis, figures, simulate
from vibrosweep.errors import DataError, ParameterError, ShortObservationWarning, SpecError
from vibrosweep.mistakes import PYTHON
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import IMPACTS, RECORD
from vibrosweep.model.parameters import PARAMETERS


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


@pytest.mark.parametrize(
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


@pytest.mark.parametrize(
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
    assert cut.attrs["notes"].startswith("2 of 2 particles were given up after 6 landings: raise")
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


def test_names_that_are_no_longer_public_point_to_their_successors():
    with pytest.raises(AttributeError, match=r"vibrosweep\.windows"):
        _ = vibrosweep.analysis.Scene


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
    with pytest.raises(SpecError, match="base_acceleration: makes an amplitude"):
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
