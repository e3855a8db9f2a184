"""Waveforms from a measured motion: a synthetic trace gives its own waveform back."""

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.errors import SpecError
from vibrosweep.model.shapes import Waveform
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.keywords import keyword_spec
from vibrosweep.scene.sweep import parse_spec, read_spec
from vibrosweep.scene.traces import measured
from vibrosweep.scene.waveform import Traced

TWO = Waveform("harmonics", ((1, 1.0, 0.3), (2, 0.4, 1.7)))
FREQUENCY, VELOCITY = 19.73, 0.31


def motion(time, column, noise=0.0, seed=1):
    """Height (m) or acceleration (m s-2) of a base whose greatest speed is `VELOCITY`."""
    x = FREQUENCY * time
    size = VELOCITY / np.abs(TWO.velocity(np.linspace(0.0, 1.0, 100001))).max()
    if column == "height":
        values = 0.002 + size / FREQUENCY * TWO.height(x)
    else:
        values = 9.81 + size * FREQUENCY * TWO.slope(x)
    random = np.random.default_rng(seed)
    return values + noise * np.std(values) * random.normal(size=time.size)


def written(path, time, values, column="height"):
    rows = "".join(f"{t!r},{v!r}\n" for t, v in zip(time.tolist(), values.tolist(), strict=True))
    path.write_text(f"time,{column}\n{rows}", "utf-8")
    return path


@pytest.mark.parametrize("column", ["height", "acceleration"])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_synthetic_trace_gives_its_waveform_back(tmp_path, column, noise):
    time = np.arange(0.0, 1.5, 4e-4)
    written(tmp_path / "shaker.csv", time, motion(time, column, noise), column)
    waveform, frequency, velocity = measured(Traced("shaker.csv", column, 4), tmp_path)
    close = 1e-7 if noise == 0.0 else 5e-3
    assert frequency == pytest.approx(FREQUENCY, rel=max(close / 10.0, 1e-9))
    assert velocity == pytest.approx(VELOCITY, rel=close)
    turns = np.linspace(0.0, 1.0, 500)
    assert np.abs(waveform.velocity(turns)).max() == pytest.approx(1.0, abs=1e-4)
    size = np.abs(TWO.velocity(np.linspace(0.0, 1.0, 100001))).max()
    assert waveform.velocity(turns) == pytest.approx(TWO.velocity(turns) / size, abs=4 * close)
    assert waveform.trace.held == pytest.approx(1.0 / (1.0 + noise**2), abs=1e-3)


@pytest.mark.parametrize("strongest", range(1, 17, 3))
def test_any_harmonic_may_be_the_strongest(tmp_path, strongest):
    tones = {1: 0.1, 2: 0.04, 5: 0.07, 11: 0.03, strongest: 1.0}
    shape = Waveform("harmonics", tuple((k, c, 0.3 * k) for k, c in sorted(tones.items())))
    time = np.arange(0.0, 0.6, 4e-3)
    written(tmp_path / "shaker.csv", time, 1e-3 * shape.height(7.3 * time))
    waveform, frequency, _ = measured(Traced("shaker.csv", "height", 16), tmp_path)
    assert frequency == pytest.approx(7.3, rel=1e-6)
    weights = [weight for _, weight, _ in waveform.tones]
    assert int(np.argmax(weights)) + 1 == strongest


def test_a_result_no_longer_needs_its_trace(tmp_path):
    time = np.arange(0.0, 1.0, 5e-4)
    trace = written(tmp_path / "shaker.csv", time, motion(time, "height"))
    text = (
        'title = "Two tones"  # measured\n[scene]\nduration = 2.0\n'
        'waveform = { trace = "shaker.csv", column = "height", harmonics = 2 }\n'
    )
    (tmp_path / "sweep.toml").write_text(text, "utf-8")
    sweep = read_spec(tmp_path / "sweep.toml")
    assert sweep.scene.inputs["frequency"] == pytest.approx(FREQUENCY, rel=1e-8)
    assert sweep.scene.inputs["base_velocity"] == pytest.approx(VELOCITY, rel=1e-6)
    trace.unlink()
    again = parse_spec(sweep.text)
    assert again.scene == sweep.scene
    assert again.scene.waveform.trace.digest
    assert "# measured" in sweep.text
    with pytest.raises(SpecError, match="cannot be read"):
        read_spec(tmp_path / "sweep.toml")


def test_a_run_goes_on_and_is_found_again_without_its_trace(tmp_path):
    time = np.arange(0.0, 1.0, 5e-4)
    trace = written(tmp_path / "shaker.csv", time, motion(time, "height"))
    asked = '{ trace = "shaker.csv", column = "height", harmonics = 2 }'
    sweep, out = tmp_path / "sweep.toml", tmp_path / "out.h5"
    sweep.write_text(
        f'title = "Two tones"\n[scene]\nduration = 0.5\nwaveform = {asked}\n'
        f'[sample]\ndesign = "grid"\nrestitution = [0.5, 0.6, 0.7]\n'
    )

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(read_spec(sweep), out, threads=1, chunk=1, advance=stop)
    whole = vs.run(sweep, tmp_path / "whole.h5").load()
    trace.unlink()
    with vs.run(sweep, out) as found:
        assert found.waveform == whole.waveform
        np.testing.assert_array_equal(found.impact_count, whole.impact_count)
    with vs.run(sweep, out) as again:  # the finished result of this very sweep
        assert again.sizes["restitution"] == 3
    sweep.write_text(sweep.read_text().replace("0.7", "0.8"))
    with pytest.raises(SpecError, match="cannot be read"):
        vs.run(sweep, out)


def test_a_mapping_is_found_again_without_its_trace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    time = np.arange(0.0, 1.0, 5e-4)
    trace = written(tmp_path / "shaker.csv", time, motion(time, "height"))
    asked = {"trace": "shaker.csv", "column": "height", "harmonics": 2}
    given = {"waveform": asked, "duration": 0.5, "restitution": [0.5, 0.6, 0.7]}
    vs.run(given, "out.h5").close()
    trace.unlink()
    scene = {"waveform": asked, "duration": 0.5}
    for one in (given, {"scene": scene, "restitution": [0.5, 0.6, 0.7]}):
        with vs.run(one, "out.h5") as again:
            assert again.sizes["restitution"] == 3
            assert vs.simulate(again.isel(restitution=1)).waveform == again.waveform
    for other in ({"base_velocity": 1.0}, {"waveform": {**asked, "harmonics": 3}}):
        with pytest.raises(SpecError, match="cannot be read"):
            vs.run(given | other, "out.h5")


def test_frequency_and_forcing_that_are_given_stay(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    time = np.arange(0.0, 1.0, 5e-4)
    written(tmp_path / "shaker.csv", time, motion(time, "height"))
    asked = {"trace": "shaker.csv", "column": "height", "harmonics": 2}
    sweep = keyword_spec(
        {"waveform": asked, "frequency": 30.0, "amplitude": (0.2, 3.5), "realizations": 3}
    )
    assert sweep.scene.inputs["frequency"] == 30.0
    assert "base_velocity" not in sweep.scene.inputs
    one = vs.simulate(waveform=asked, duration=0.5)
    assert float(one.frequency) == pytest.approx(FREQUENCY, rel=1e-8)
    assert one.forcing == "base_velocity"
    assert "digest" in one.waveform


@pytest.mark.parametrize(
    ("make", "harmonics", "message"),
    [
        (lambda t: motion(t, "height")[: int(0.5 / FREQUENCY / 5e-4)], 2, "periods; at least 2"),
        (lambda t: np.random.default_rng(2).normal(size=t.size), 2, "no period"),
        (lambda t: motion(t, "height") + 0.05 * t, 2, "mean velocity"),
        (lambda t: np.ones(t.size), 2, "shows no motion"),
        (lambda t: np.where(t > 0.003, np.nan, motion(t, "height")), 2, "7 lines; at least 8"),
        (lambda t: motion(t, "height"), 17, "from 1 to 16"),
        (lambda t: motion(t, "height")[:7], 2, "7 lines; at least 8"),
    ],
    ids=["half a period", "noise", "drift", "still", "nan", "seventeen", "seven"],
)
def test_a_trace_that_cannot_be_used(tmp_path, monkeypatch, make, harmonics, message):
    monkeypatch.chdir(tmp_path)
    time = np.arange(0.0, 1.0, 5e-4)
    values = make(time)
    written(tmp_path / "shaker.csv", time[: values.size], values)
    asked = {"trace": "shaker.csv", "column": "height", "harmonics": harmonics}
    with pytest.raises(SpecError, match="waveform") as caught:
        keyword_spec({"waveform": asked})
    assert len(caught.value.mistakes) == 1
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"trace": "none.csv", "column": "height", "harmonics": 2}, "cannot be read"),
        ({"trace": "shaker.csv", "column": "acceleration", "harmonics": 2}, "no column"),
        ({"trace": "shaker.csv", "column": "speed", "harmonics": 2}, 'must be "height" or'),
    ],
)
def test_a_file_or_column_that_is_not_there(tmp_path, monkeypatch, asked, message):
    monkeypatch.chdir(tmp_path)
    time = np.arange(0.0, 1.0, 5e-4)
    written(tmp_path / "shaker.csv", time, motion(time, "height"))
    with pytest.raises(SpecError, match=message):
        keyword_spec({"waveform": asked})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time;height\n0;1\n", "the trace has 1 lines; at least 8"),
        ("time,height\n" + "".join(f"{t},0\n" for t in (0, 1, 2, 3, 2, 5, 6, 7)), "time in line 6"),
    ],
)
def test_short_traces_and_decreasing_times_are_refused(tmp_path, monkeypatch, text, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shaker.csv").write_text(text)
    with pytest.raises(SpecError, match=message):
        keyword_spec({"waveform": {"trace": "shaker.csv", "column": "height", "harmonics": 2}})
