"""Commands that film, measure and compare; one message for each mistake."""

import json
import re

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from vibrosweep.cli import main

SPEC = """
title = "A short experiment"
[scene]
restitution = 0.85
amplitude = 0.12
particles = 2
duration = 6.0
[measure]
transient = 2.0
[trials]
repeats = 2
"""


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """A folder with the tracks of two repeats."""
    folder = tmp_path_factory.mktemp("filmed")
    (folder / "short.toml").write_text(SPEC, encoding="utf-8")
    assert main(["lab", "synthesize", str(folder / "short.toml"), "-o", str(folder / "out")]) == 0
    return folder / "out"


@pytest.fixture
def vibrosweep(capsys):
    def call(*words):
        code = main(["lab", *map(str, words)])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    return call


def trials(folder):
    return sorted(p for p in folder.glob("*.csv") if "truth" not in p.name)


def test_synthesized_files_hold_tracks_and_truth(filmed):
    names = sorted(p.name for p in filmed.iterdir())
    assert names == [f"short_002_trial{k}{end}.csv" for k in (1, 2) for end in ("", "_truth")]
    tracks = pd.read_csv(filmed / names[0])
    assert list(tracks.columns) == ["time", "particle", "height"]
    assert len(tracks) == 2 * 960
    truth = pd.read_csv(filmed / names[1])
    first = truth[truth.particle == 0]
    assert (first.landing_time.diff().dropna() > 0.0).all()
    # Eq. 7 for a landing without rest: v' = e v + A sin(2 pi f t)
    row = first[(first.rested == 0) & (first.rested.shift(1, fill_value=1) == 0)].iloc[5]
    before = first[first.impact == row.impact - 1].rebound_velocity.item()
    kick = 0.12 * np.sin(2.0 * np.pi * 20.0 * row.landing_time)
    assert row.rebound_velocity == pytest.approx(0.85 * before + kick, abs=1e-6)


def test_films_are_not_replaced_unless_forced_and_are_reproducible(filmed, vibrosweep):
    spec = filmed.parent / "short.toml"
    code, _, message = vibrosweep("synthesize", spec, "-o", filmed)
    assert code == 2
    assert "exists and was not replaced" in message
    content = trials(filmed)[0].read_bytes()
    assert vibrosweep("synthesize", spec, "-o", filmed, "--force")[0] == 0
    assert trials(filmed)[0].read_bytes() == content


def test_impacts_of_repeats(filmed, vibrosweep):
    code, text, _ = vibrosweep("impacts", *trials(filmed), "--frequency", 20)
    assert code == 0
    assert text.count("standard error of a landing time") == 2
    assert re.search(r"flight_time .* yes  s\n", text)


def test_impacts_to_a_file_and_figures(filmed, vibrosweep, tmp_path):
    out, pictures = tmp_path / "impacts.h5", tmp_path / "pictures"
    code, text, _ = vibrosweep(
        "impacts", trials(filmed)[0], "--frequency", 20, "-o", out, "--figures", pictures
    )
    assert code == 0
    assert f"written to {out}" in text
    with xr.open_dataset(out) as found:
        assert found.sizes["particle"] == 2
        assert found.attrs["method"] == "fit"
    assert sorted(p.name for p in pictures.iterdir()) == ["lab_track.pdf", "lab_track.png"]
    assert vibrosweep("impacts", trials(filmed)[0], "-o", out)[0] == 2


def test_compare_prints_the_table(filmed, vibrosweep, tmp_path):
    out = tmp_path / "table.h5"
    code, text, _ = vibrosweep(
        "compare",
        *trials(filmed),
        "--frequency",
        20,
        "--draws",
        4,
        "-o",
        out,
        "--figures",
        tmp_path,
    )
    assert code == 0
    assert re.search(r"case +repeats +compared", text)
    assert "the study" not in text  # its ranges have no meaning for this film
    assert re.search(r"restitution 0\.8\d* ± 0\.00\d+, amplitude 0\.1\d* ± ", text)
    assert "base favoured by the landings: level" in text
    with xr.open_dataset(out) as table:
        assert table["case"].values.tolist() == ["N=2"]
    assert (tmp_path / "lab_table4.png").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["impacts", "none.csv"], "there is no such file; check the path"),
        (["impacts", "TRACK", "--gravity", "0"], "--gravity 0.0: must be at least 1e-30"),
        (["impacts", "TRACK", "--frequency", "0"], "--frequency 0.0: must be at least 1e-30"),
        (["impacts", "TRACK", "--phase", "nan"], "--phase nan: must be at least -1e+09"),
        (["impacts", "TRACK", "--base", "nan"], "--base nan: must be a number, at least -1e+30"),
        (["impacts", "TRACK", "--exposure", "2"], "--exposure 2.0: must be a number, at least 0"),
        (["impacts", "TRACK", "--scale", "1000"], "multiply the scale by about 0.001"),
        (["impacts", "TRACK", "--base", "1"], "lies above the whole track"),
        (["impacts", "TRACK", "TRACK", "-o", "x.h5"], "holds one recording, but there are 2"),
        (["compare", "TRACK", "--restitution", "2"], "--restitution 2.0: must be at least 0"),
        (["compare", "TRACK", "--restitution", "0.9"], "restitution is given alone"),
        (["synthesize", "none.toml"], "there is no such sweep file"),
    ],
)
def test_one_message_for_a_mistake(filmed, vibrosweep, monkeypatch, tmp_path, words, message):
    monkeypatch.chdir(tmp_path)
    words = [str(trials(filmed)[0]) if word == "TRACK" else word for word in words]
    code, _, printed = vibrosweep(*words)
    assert code == 2
    assert printed.count("vibrosweep: ") == 1
    assert message in printed
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("part", ["synthesize", "impacts", "restitution", "compare"])
def test_each_part_prints_an_example_json_or_nothing(filmed, tmp_path, capsys, part):
    with pytest.raises(SystemExit):
        main(["lab", part, "--help"])
    assert f"example: vibrosweep lab {part} " in capsys.readouterr().out
    times = tmp_path / "times.csv"
    pd.DataFrame({"time (s)": np.cumsum(0.8 ** np.arange(8.0))}).to_csv(times, index=False)
    words = {
        "synthesize": [filmed.parent / "short.toml", "--force", "-o", filmed],
        "impacts": [trials(filmed)[0], "--frequency", 20],
        "restitution": [times],
        "compare": [trials(filmed)[0], "--frequency", 20, "--draws", 4],
    }[part]
    words = ["lab", part, *map(str, words)]
    assert main([*words, "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    if part == "impacts":
        (one,) = numbers["recordings"]
        assert one["base_motion"] == "level"
        assert one["landings"] > 0
    assert main([*words, "--quiet"]) == 0
    assert capsys.readouterr().out == ""
