"""A statistic of another package: over every base, with repeated cycles, and after an edit."""

import json
import subprocess
import sys
from pathlib import Path

import h5netcdf
import numpy as np
import pytest

import vibrosweep as vs
from tests.extension.longest_flight import LONGEST_FLIGHT

SOURCE = Path(__file__).with_name("longest_flight.py")
LAUNCHES = [0.0, 0.13, 0.4]
SCENE = {"restitution": [0.6, 0.8], "amplitude": [1.2, 3.0], "duration": 9.0}
SPRUNG = {"mass_ratio": 0.05, "mount_frequency": 4.0, "mount_damping": 0.1}
BASES = {"high-bounce": {}, "moving": {}, "sprung": SPRUNG}


def flight_times(landings, begin):
    """Flights that end in the window, from all landings."""
    first = np.tile(np.array(LAUNCHES)[:, np.newaxis], (landings.sizes["realization"], 1, 1))
    lifts = np.concatenate([first, landings.liftoff_time.values[..., :-1]], axis=-1)
    return np.where(landings.landing_time >= begin, landings.landing_time - lifts, np.nan)


@pytest.mark.parametrize("base", BASES)
def test_the_longest_flight_is_that_of_all_landings(base):
    found = vs.sweep(
        **SCENE,
        **BASES[base],
        base=base,
        launch=LAUNCHES,
        transient=2.0,
        particles=3,
        observables=[LONGEST_FLIGHT],
    ).flight_time_max
    assert found.attrs == {"long_name": "longest flight", "units": "s"}
    for e in SCENE["restitution"]:
        for a in SCENE["amplitude"]:
            one = SCENE | {"restitution": e, "amplitude": a} | BASES[base]
            every = vs.simulate(**one, base=base, launch_time=LAUNCHES)
            here = found.sel(restitution=e, amplitude=a).values
            np.testing.assert_allclose(
                here, np.nanmax(flight_times(every, 2.0)[0], axis=-1), rtol=1e-12
            )


@pytest.mark.parametrize("base", BASES)
def test_verify_compares_the_longest_flight_and_notices_a_change(base, tmp_path):
    path = tmp_path / "out.h5"
    sweep = {**SCENE, **BASES[base], "base": base, "launch": LAUNCHES, "transient": 2.0}
    vs.run({**sweep, "particles": 3}, path, observables=[LONGEST_FLIGHT]).close()
    report = vs.verify(path, observables=[LONGEST_FLIGHT])
    assert report.passed
    compared = report.variables()["flight_time_max"]
    assert len(compared.compared) >= 3  # of four: over a sprung base one may be undecided
    assert len(compared.errors) == 3 * len(compared.compared)
    assert "flight_time_max" in vs.verify(path).not_compared()
    with h5netcdf.File(path, "a") as file:
        file.variables["flight_time_max"][0, 0, 1] += 1e-5
    report = vs.verify(path, observables=[LONGEST_FLIGHT])
    assert [j.variable for o in report.outcomes for j in o.judgements if j.complaint] == [
        "flight_time_max"
    ]
    assert vs.verify(path).passed


def test_a_sum_over_repeated_cycles_is_that_of_all_landings():
    total = vs.Observable("flown", LONGEST_FLIGHT.function, "sum of flights", "s", landings="sum")
    scene = {"restitution": 0.8, "amplitude": [1.2, 2.0, 3.0], "duration": 2000.0}
    found = vs.sweep(**scene, launch=LAUNCHES, particles=3, transient=100.0, observables=[total])
    every = vs.simulate(**scene, launch_time=LAUNCHES)
    expected = np.nansum(flight_times(every, 100.0), axis=(1, 2))
    np.testing.assert_allclose(found.flown.values.ravel(), expected, rtol=1e-10)


SCRIPT = """
import json, sys
sys.path.insert(0, sys.argv[1])
import vibrosweep as vs
from longest_flight import LONGEST_FLIGHT
given = {"particles": 1, "transient": 1.0, "separation": False, "observables": [LONGEST_FLIGHT]}
found = vs.sweep(restitution=0.9, amplitude=1.2, **given)
print(json.dumps(found.flight_time_max.values.ravel().tolist()))
"""


def test_an_edit_never_runs_stale_machine_code(tmp_path):
    text = SOURCE.read_text()

    def run():
        words = [sys.executable, "-W", "ignore", "-c", SCRIPT, str(tmp_path)]
        done = subprocess.run(words, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    (tmp_path / SOURCE.name).write_text(text)
    first = run()
    edited = text.replace("return landing.flight_time", "return -1.0 * landing.flight_time")
    assert edited != text
    (tmp_path / SOURCE.name).write_text(edited)
    second = run()
    assert max(first) > 0.0 > max(second)
    (tmp_path / SOURCE.name).write_text(text)
    assert run() == first
