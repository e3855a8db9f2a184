"""Observables from Python: in memory, in files, in chunks, and after an interruption."""

import math

import cloudpickle
import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.api.sweeps import as_sweep
from vibrosweep.commands.describe import describe
from vibrosweep.errors import ExistingOutputError, ParameterError, RunError, TableError
from vibrosweep.proof.sampling import read_sample
from vibrosweep.runs.chunks import in_process
from vibrosweep.runs.driver import retry_failed, run_sweep
from vibrosweep.scene.sweep import keyword_spec

BINS = 8
SWEEP = {
    "restitution": (0.8, 0.98),
    "amplitude": (0.2, 3.5),
    "realizations": 40,
    "particles": 3,
    "seed": 4,
}


def count(totals, landing):
    totals[int((landing.phase + 0.5) * BINS) % BINS] += 1.0


def count_more(totals, landing):
    totals[int((landing.phase + 0.5) * BINS) % BINS] += 2.0


def phases(function=count, **changes):
    given = {"along": "landing_phase", "values": (np.arange(BINS) + 0.5) / BINS - 0.5} | changes
    return vs.Observable("landings_at_phase", function, "landings by phase", **given)


@pytest.fixture(scope="module")
def in_memory():
    return vs.sweep(SWEEP, observables=[phases()])


def test_a_histogram_of_phases(in_memory):
    found = in_memory.landings_at_phase
    assert found.dims == ("realization", "landing_phase")
    assert found.attrs == {"long_name": "landings by phase", "units": "1"}
    np.testing.assert_array_equal(found.landing_phase, phases().values)
    np.testing.assert_array_equal(found.sum("landing_phase"), in_memory.impact_count)
    assert in_memory.attrs["source_of_landings_at_phase"].startswith("def count(")


def test_a_file_in_chunks_holds_the_same(in_memory, tmp_path):
    """Also after an interruption, if the run is continued with the same function."""
    path = tmp_path / "out.h5"

    def interrupted(job, indices, tick):
        in_process(1)(job, indices[:2], tick)
        raise KeyboardInterrupt

    spec = as_sweep(SWEEP, {}).with_observables([phases()])
    with pytest.raises(KeyboardInterrupt):
        run_sweep(spec, path, threads=1, chunk=10, runner=interrupted)
    with pytest.raises(RunError, match=r"landings_at_phase\.code: was"):
        vs.run(SWEEP, path, observables=[phases(count_more)])
    with vs.run(SWEEP, path, observables=[phases()]) as found:
        assert found.landings_at_phase.identical(
            in_memory.landings_at_phase.assign_coords(found.landings_at_phase.coords)
        )
    vs.run(SWEEP, path, observables=[phases()]).close()  # opened: it holds this sweep
    for others in ([phases(count_more)], [phases(initial=1.0)], []):
        with pytest.raises(ExistingOutputError, match="landings_at_phase"):
            vs.run(SWEEP, path, observables=others)


def test_a_retry_without_the_observable_is_refused(tmp_path):
    path = tmp_path / "out.h5"
    vs.run(SWEEP, path, observables=[phases()]).close()
    with pytest.raises(RunError, match=r"landings_at_phase\.code: "):
        retry_failed(keyword_spec(SWEEP), path, threads=1)


def test_an_observable_reaches_workers_of_a_cluster():
    """Functions of a script or a notebook are sent by value, with the numbers that they use."""

    def bins(number):
        def function(totals, landing):
            totals[int((landing.phase + 0.5) * number) % BINS] += math.fabs(1.0)

        return function

    spec = keyword_spec(SWEEP).with_observables([phases(bins(BINS))])
    sent = cloudpickle.loads(cloudpickle.dumps(spec))
    assert sent == spec
    assert sent.scene.measures.observables[0].code == spec.scene.measures.observables[0].code
    assert spec != keyword_spec(SWEEP).with_observables([phases(bins(BINS + 1))])


def test_an_observable_that_cannot_be_compiled_leaves_no_file(tmp_path):
    def function(totals, landing):
        totals[0] += landing.colour

    one = vs.Observable("seen", function, "no such quantity")
    with pytest.raises(ParameterError, match="numba cannot compile"):
        vs.run(SWEEP, tmp_path / "out.h5", chunk=10, observables=[one])
    assert not list(tmp_path.iterdir())


def test_names_that_are_taken_are_refused(tmp_path):
    with pytest.raises(ParameterError, match="name"):
        vs.sweep(SWEEP, observables=[phases(), phases()])
    table = tmp_path / "pairs.csv"
    table.write_text("restitution,amplitude,landing_phase\n0.9,1.2,3\n", encoding="utf-8")
    with pytest.raises(TableError, match="landing_phase"):
        vs.sweep(design=str(table), observables=[phases()])


def test_a_description_lists_an_observable_and_verification_does_not_compare_it(tmp_path):
    path = tmp_path / "out.h5"
    table = {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0], "ball": ["brass", "steel"]}
    vs.run({"design": table}, path, observables=[phases()]).close()
    told = [line.split(maxsplit=1) for line in describe(path)]
    assert ["landings_at_phase", "landings by phase (realization, landing_phase)"] in told
    assert ["ball", "(realization)"] in told
    assert "landings_at_phase" in read_sample(path, 2, 0)[0].others


ABSURD = [1, None, "x", 3.5, [], {}, 1j, b"x", float("nan"), 10**400]


@pytest.mark.parametrize("value", ABSURD)
def test_what_is_registered_has_its_type(value):
    for register in (
        lambda: vs.register_law(value),
        lambda: vs.register_kind(value),
        lambda: vs.register_kind(vs.ResultKind("absurd", "x", draw=value or 1)),
        lambda: vs.register_design(value, value),
        lambda: vs.register_design("absurd", value),
        lambda: vs.Observable(value, value, value),
        lambda: vs.Law(value, value, value, value),
    ):
        with pytest.raises(ParameterError):
            register()


@pytest.mark.parametrize("threads", [10**400, 10**20, 0, -1, 1.5, "2", True])
def test_a_number_of_threads_that_no_machine_has(threads):
    with pytest.raises(ParameterError, match=r"threads = .*at least 1 and at most 4096"):
        vs.sweep(amplitude=1.0, duration=5.0, threads=threads)


def test_an_observable_that_is_not_real():
    imaginary = vs.Observable("absurd", lambda landing: 1j * landing.arrival, "x", landings="sum")
    with pytest.raises(ParameterError, match="complex128; it must be a real number"):
        vs.sweep(amplitude=1.0, duration=5.0, observables=[imaginary])
