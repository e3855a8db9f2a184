"""Files of every format give the same tracks."""

import numpy as np
import pandas as pd
import pytest

from vibrosweep.errors import TrackError
from vibrosweep.lab.recordings import read_tracks, tracks_from_frame

TIME = np.arange(8) / 240.0
HEIGHT = np.stack([np.linspace(0.0, 0.07, 8), np.linspace(0.2, 0.06, 8)], axis=1)


def same(tracks, height=HEIGHT, time=TIME):
    np.testing.assert_allclose(tracks["height"].values, height, atol=1e-12)
    np.testing.assert_allclose(tracks["time"].values, time, atol=1e-12)


@pytest.fixture
def write(tmp_path):
    def to(text, name="tracks.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return to


def long(columns, order="F"):
    return pd.DataFrame(
        dict(
            zip(
                columns,
                (
                    np.tile(TIME, 2) if order == "F" else np.repeat(TIME, 2),
                    np.repeat([0, 1], 8) if order == "F" else np.tile([0, 1], 8),
                    HEIGHT.ravel(order=order),
                ),
                strict=True,
            )
        )
    )


@pytest.mark.parametrize("order", ["F", "C"])
def test_plain_csv_by_particle_or_by_frame(write, order):
    same(read_tracks(write(long(["time", "particle", "height"], order).to_csv(index=False))))


def test_trackpy_pixel_rows_increase_downwards(write):
    """As trackpy writes them: an index, more columns, rows of pixels from the top."""
    table = pd.DataFrame(
        {
            "y": 1000.0 - HEIGHT.ravel() / 1e-4,
            "x": 12.5,
            "mass": 900.0,
            "frame": np.repeat(np.arange(8), 2),
            "particle": np.tile([0, 1], 8),
        }
    )
    options = {"frame_rate": 240.0, "scale": 1e-4, "base": 1000.0}
    same(tracks_from_frame(table, **options))
    same(read_tracks(write(table.to_csv()), **options))
    with pytest.raises(TrackError, match="need the frame rate in Hz and the scale"):
        tracks_from_frame(table, frame_rate=240.0)


def tracker(columns, delimiter="\t", decimal="."):
    return "\n".join(
        delimiter.join(f"{v:.9E}".replace(".", decimal) for v in row)
        for row in zip(*columns, strict=True)
    )


@pytest.mark.parametrize(
    ("delimiter", "decimal"), [("\t", "."), (",", "."), (";", ","), ("\t", ",")]
)
def test_tracker_one_mass_a_file(write, delimiter, decimal):
    files = []
    for k, name in enumerate(("mass_A", "mass_B")):
        body = tracker([TIME, 0.5 + 0.0 * TIME, HEIGHT[:, k]], delimiter, decimal)
        files.append(write(f"{name}\n{delimiter.join('txy')}\n{body}\n", f"{name}.txt"))
    tracks = read_tracks(files)
    same(tracks)
    assert tracks["particle"].values.tolist() == ["mass_A", "mass_B"]


def test_tracker_masses_side_by_side_with_units_and_lost_positions(write):
    body = tracker([TIME, TIME, 100 * HEIGHT[:, 0], TIME, 100 * HEIGHT[:, 1]]).split("\n")
    cells = body[3].split("\t")
    body[3] = "\t".join([*cells[:3], "", ""]) + "\t"
    text = "#multi:\n\tmass A\t\tmass B\t\t\nt (s)\tx (cm)\ty (cm)\tx (cm)\ty (cm)\t\n"
    expected = HEIGHT.copy()
    expected[3, 1] = np.nan
    tracks = read_tracks(write(text + "\n".join(body) + "\n"))
    same(tracks, expected)
    assert tracks["particle"].values.tolist() == ["mass A", "mass B"]


def test_slow_motion_is_rescaled_to_the_frame_rate(write):
    table = long(["time", "particle", "height"])
    table["time"] *= 8.0  # 240 frames per second, played and exported at 30
    path = write(table.to_csv(index=False))
    tracks = read_tracks(path, frame_rate=240.0)
    same(tracks)
    assert tracks.attrs["frame_rate"] == 240.0


def test_scale_axis_and_base(write):
    path = write(long(["time", "particle", "height"]).to_csv(index=False))
    same(read_tracks(path, scale=1e-3, axis="down", base=0.1), -1e-3 * (HEIGHT - 0.1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no table of numbers"),
        ("time,particle,height\n", "holds no table of numbers"),
        ("time,particle,height\n0.0,1,0.1\n0.1,,0.2\n", "line 3 has no particle"),
        ("time,particle,height\n0.0,1,0.1\n,1,0.2\n", "line 3 has no time"),
        ("time,particle,height\n0.0,1,high\n0.1,1,0.2\n", "line 2: 'high' is not a number"),
        ("time,depth,speed\n0.0,1.0,2.0\n0.1,1.1,2.0\n", "holds times of impacts, and no tracks"),
        ("mass_A\nt\tx\n0.0\t1.0\n0.1\t1.0\n", "has the columns t, x; give"),
        ("mass_A\nt\ty (ft)\n0.0\t1.0\n0.1\t1.0\n", "heights are in 'ft'; known units: m, cm, mm"),
        ('time,particle,height\n"0.0,1,2\n', "holds no table of numbers"),
        ("t,y,h\n0,1,2\n1,2,3\n", r'several columns may hold heights: "y", "h"; choose one'),
    ],
)
def test_files_that_hold_no_tracks(write, text, message):
    with pytest.raises(TrackError, match=message) as caught:
        read_tracks(write(text))
    assert "tracks.csv" in str(caught.value)


def test_files_that_cannot_be_read(tmp_path, write):
    with pytest.raises(TrackError, match="there is no such file"):
        read_tracks(tmp_path / "none.csv")
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(TrackError, match="holds no table"):
        read_tracks(binary)
    with pytest.raises(TrackError, match="cannot be read"):
        read_tracks(tmp_path)
    path = write(long(["time", "particle", "height"]).to_csv(index=False))
    with pytest.raises(TrackError, match="particle 0 is in each of them"):
        read_tracks([path, path])
    with pytest.raises(TrackError, match="scale = 0:"):
        read_tracks(path, scale=0.0)
