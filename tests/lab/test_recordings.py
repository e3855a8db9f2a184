"""Files of other programs are read with the same numbers, as recordings and as tracks."""

import io
import wave
import zipfile

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vibrosweep.errors import TrackError
from vibrosweep.lab.recordings import read_recordings, read_tracks, tracks_from_frame
from vibrosweep.lab.traces import read_trace

FACTOR = {"": 1.0, "s": 1.0, "ms": 1e-3, "m": 1.0, "cm": 1e-2, "mm": 1e-3}
HEADS = ("{0} ({1})", "{0} [{1}]", "{0} / {1}", "{0}_{1}")


def fall(frames=40, rate=240.0):
    """Times (s) and heights (m) of a ball that bounces once."""
    time = np.arange(frames) / rate
    return time, 0.3 + 0.05 * np.abs(np.sin(9.0 * time)) + 0.1 * time


@st.composite
def table_formats(draw):
    separator = draw(st.sampled_from([",", ";", "\t", " "]))
    return {
        "separator": separator,
        "comma": separator != "," and draw(st.booleans()),
        "names": draw(
            st.sampled_from([("time", "height"), ("t", "y"), ("Time", "Y"), ("Zeit", "h")])
        ),
        "units": draw(
            st.tuples(st.sampled_from(["", "s", "ms"]), st.sampled_from(["m", "cm", "mm"]))
        ),
        "head": draw(st.sampled_from(HEADS)),
        "unit_row": draw(st.booleans()),
        "mark": draw(st.sampled_from(["", "\ufeff"])),
        "end": draw(st.sampled_from(["\n", "\r\n", "\r"])),
        "trailing": separator != " " and draw(st.booleans()),
        "blank": draw(st.integers(0, 2)),
        "comment": draw(st.sampled_from(["", "# made by a program", "% 3 balls"])),
        "quoted": separator != " " and draw(st.booleans()),
        "clock": draw(st.sampled_from([0.0, 12.5, 50_000.0, 1_764_194_400.0])),
        "horizontal": draw(st.booleans()),
    }


def text_of(how, time, height):
    """Format a table."""

    def cell(value):
        text = f"{value:.9f}"
        text = text.replace(".", ",") if how["comma"] else text
        return f'"{text}"' if how["quoted"] else text

    names, units = list(how["names"]), list(how["units"])
    columns = [time / FACTOR[units[0]], height / FACTOR[units[1]]]
    if how["horizontal"]:
        names.insert(1, "x")
        units.insert(1, units[1])
        columns.insert(1, columns[1] * 0.5)
    tail = how["separator"] if how["trailing"] else ""
    heads = [
        n if how["unit_row"] or not u else how["head"].format(n, u)
        for n, u in zip(names, units, strict=True)
    ]
    if how["separator"] == " ":
        heads = [h.replace(" / ", "_") for h in heads]
    lines = [how["comment"]] if how["comment"] else []
    lines.append(how["separator"].join(heads) + tail)
    if how["unit_row"]:
        lines.append(how["separator"].join(u or "s" for u in units) + tail)
    rows = zip(*columns, strict=True)
    lines += [how["separator"].join(map(cell, row)) + tail for row in rows]
    return how["mark"] + how["end"].join([*lines, *[""] * how["blank"]])


@settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(how=table_formats())
def test_tracks_in_any_table_format(tmp_path, how):
    time, height = fall()
    path = tmp_path / "track.csv"
    path.write_bytes(text_of(how, time + how["clock"], height).encode())
    (found,) = read_recordings(path)
    np.testing.assert_allclose(found.time - how["clock"], time, atol=5e-7)
    np.testing.assert_allclose(found.height, height, atol=1e-9)
    assert (found.horizontal is not None) == how["horizontal"]
    assert found.scale_known
    assert found.rate_known
    tracks = read_tracks(path)
    np.testing.assert_allclose(tracks["height"][:, 0], height, atol=1e-9)
    assert tracks.attrs["frame_rate"] == pytest.approx(240.0, rel=1e-9)


@given(
    rate=st.sampled_from([24.0, 30000.0 / 1001.0, 60.0, 240.0, 300.0, 480.0, 600.0]),
    gaps=st.sets(st.integers(2, 197), max_size=40),
    begin=st.sampled_from([0.0, 0.4, 50_000.0]),
)
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_stamps_in_ms_and_lost_frames(tmp_path, rate, gaps, begin):
    """The frame rate is found exactly, and giving it changes nothing."""
    time, height = fall(200, rate)
    valid = np.setdiff1d(np.arange(200), sorted(gaps))
    path = tmp_path / "film.csv"
    rows = zip(begin + time[valid], height[valid], strict=True)
    path.write_text("time,height\n" + "".join(f"{t:.3f},{y:.7f}\n" for t, y in rows))
    (found,), (again,) = read_recordings(path), read_recordings(path, frame_rate=rate)
    since = time[valid] - time[valid][0]
    np.testing.assert_allclose(found.time - found.time[0], since, atol=1e-9)
    np.testing.assert_allclose(again.time, found.time, atol=1e-9)
    assert read_tracks(path).attrs["frame_rate"] == pytest.approx(rate, rel=1e-8)


def workbook(sheets):
    """Return a workbook of named sheets of rows."""
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    rel = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    packages = "http://schemas.openxmlformats.org/package/2006/"

    def cell(value):
        if isinstance(value, str):
            return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
        return f"<c><v>{value!r}</v></c>"

    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{packages}content-types"><Default Extension="xml" '
            f'ContentType="application/xml"/></Types>',
        )
        file.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{packages}relationships"><Relationship Id="r" '
            f'Type="{rel}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        )
        names = "".join(
            f'<sheet name="{name}" sheetId="{k}" r:id="r{k}"/>'
            for k, name in enumerate(sheets, start=1)
        )
        file.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{main}" xmlns:r="{rel}"><sheets>{names}</sheets></workbook>',
        )
        links = "".join(
            f'<Relationship Id="r{k}" Type="{rel}/worksheet" Target="worksheets/s{k}.xml"/>'
            for k in range(1, len(sheets) + 1)
        )
        file.writestr(
            "xl/_rels/workbook.xml.rels",
            f'<Relationships xmlns="{packages}relationships">{links}</Relationships>',
        )
        for k, rows in enumerate(sheets.values(), start=1):
            body = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in rows)
            file.writestr(
                f"xl/worksheets/s{k}.xml",
                f'<worksheet xmlns="{main}"><sheetData>{body}</sheetData></worksheet>',
            )
    return buffer.getvalue()


def test_drops_side_by_side_on_sheets(tmp_path):
    """The interval after the last time adds one more impact."""
    heads = ["Event time (s)", "Interval (s)", "", "Event time (s)", "Interval (s)"]
    rows = [[0.5, 0.7, "", 1.25, 0.5], [1.2, 0.6, "", 1.75, 0.25]]
    path = tmp_path / "drops.xlsx"
    path.write_bytes(workbook({"1 m ": [heads, *rows], "2 m": [heads, *rows]}))
    found = read_recordings(path)
    assert [r.group for r in found] == ["1 m", "1 m", "2 m", "2 m"]
    np.testing.assert_allclose(found[0].time, [0.5, 1.2, 1.8])
    np.testing.assert_allclose(found[3].time, [1.25, 1.75, 2.0])
    assert len(read_recordings(path, sheet="2 m")) == 2
    with pytest.raises(TrackError, match="has no sheet '3 m'; its sheets are"):
        read_recordings(path, sheet="3 m")


def test_the_list_of_a_stopwatch_is_on_its_sheet(tmp_path):
    path = tmp_path / "watch.xls"
    path.write_bytes(
        workbook(
            {
                "Simple": [["Start (s)", "Stop (s)"], [2.0, 2.5]],
                "All": [["Event time (s)", "Interval (s)"], [2.0, 0.5], [2.5, 0.4], [2.9, 0.0]],
                "Metadata Time": [["event", "experiment time"], ["START", 0.0], ["PAUSE", 9.0]],
            }
        )
    )
    (found,) = read_recordings(path)
    assert found.height is None
    np.testing.assert_allclose(found.time, [2.0, 2.5, 2.9])


def test_tracks_on_several_sheets_are_chosen_by_the_sheet(tmp_path):
    rows = [["t", "y"], [0.0, 0.1], [0.1, 0.2]]
    path = tmp_path / "drops.xlsx"
    path.write_bytes(workbook({"one": rows, "two": rows}))
    with pytest.raises(TrackError, match="several tracks with the same name; choose one by its sh"):
        read_tracks(path)
    same(read_tracks(path, sheet="two"), np.array([[0.1], [0.2]]), np.array([0.0, 0.1]))


def read(tmp_path, text, **options):
    path = tmp_path / "table.csv"
    path.write_text(text, "utf-8")
    return read_recordings(path, **options)


def test_long_tables_of_times_and_ambiguous_columns(tmp_path):
    text = "recording,impact,first_s,next_s\n" + "".join(
        f"drop_{d},{k},{d + 0.5 * k},{d + 0.5 * k + 0.001}\n" for d in (1, 2) for k in range(4)
    )
    with pytest.raises(TrackError, match=r'times of impacts: "first_s", "next_s"; choose'):
        read(tmp_path, text)
    found = read(tmp_path, text, column="next_s")
    assert [r.label for r in found] == ["drop_1", "drop_2"]
    np.testing.assert_allclose(found[1].time, [2.001, 2.501, 3.001, 3.501])
    with pytest.raises(TrackError, match="has the columns recording, impact, first_s, next_s"):
        read(tmp_path, text, column="last")


def test_drops_under_each_other(tmp_path):
    for between in ("", "times", "second drop"):
        found = read(tmp_path, f"times\n0.1\n0.9\n1.4\n{between}\n0.2\n1.0\n1.5\n")
        assert len(found) == 2, between
        np.testing.assert_allclose(found[1].time, [0.2, 1.0, 1.5])
    with pytest.raises(TrackError, match=r"line 4: the time 0\.2 s is not after the one before"):
        read(tmp_path, "times\n0.1\n0.9\n0.2\n1.0\n")


TRACKMATE = """LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME
Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame
Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame
,,,(quality),(micron),(micron),(micron),(sec),
"""


def test_trackmate_has_four_lines_of_heading_and_rows_in_any_order(tmp_path):
    rows = [f"ID{k},{k},0,1.5,10.0,{200.0 + 10 * k},0.0,{k / 10},{k}" for k in (2, 0, 1, 3)]
    (found,) = read(tmp_path, TRACKMATE + "\n".join(rows) + "\n")
    np.testing.assert_allclose(found.height, [-200e-6, -210e-6, -220e-6, -230e-6])
    np.testing.assert_allclose(found.time, [0.0, 0.1, 0.2, 0.3])
    assert found.scale_known


@pytest.mark.parametrize("separator", ["\t", ",", " "])
def test_mtrack_leaves_marks_out(tmp_path, separator):
    """With blanks the empty column is unknown; positions are assigned to the nearest track."""
    rows = []
    for k in range(1, 41):
        ball = [f"{50.0 + k:.2f}", f"{100.0 + 6.0 * k:.3f}", "*" if k % 7 == 0 else " "]
        mark = ["400.5", "300.25", " "] if k % 5 else [" "] * 3
        cells = [str(k), *mark, *ball]
        if separator == " ":
            cells = [c for c in cells if c.strip()]
        rows.append(separator.join(cells))
    head = separator.join(["Frame", *(f"{n}{k}" for k in (1, 2) for n in ("X", "Y", "Flag"))])
    tail = separator.join(["Track ", "Length", "Distance traveled", "Nr of Frames"])
    text = "\n".join(
        [head, "Tracks 1 to 2", *rows, "", tail, f"1{separator}9.5{separator}1{separator}32"]
    )
    (found,) = read(tmp_path, text)
    np.testing.assert_allclose(found.height, -(100.0 + 6.0 * np.arange(1, 41)), rtol=1e-12)
    assert not found.rate_known
    assert not found.scale_known
    assert "taken for marks" in found.remarks[-1]
    (timed,) = read(tmp_path, text, frame_rate=240.0, scale=1e-3)
    np.testing.assert_allclose(timed.time, np.arange(1, 41) / 240.0)
    assert timed.scale_known


@pytest.mark.parametrize("lost", [0, -1])
def test_positions_that_were_lost_are_named(tmp_path, lost):
    time, height = fall(200)
    rows = [
        f"{t:.6f},{lost if k % 20 == 3 else round(y, 6)}"
        for k, (t, y) in enumerate(zip(time, height, strict=True))
    ]
    (found,) = read(tmp_path, "time,height\n" + "\n".join(rows))
    assert np.isnan(found.height).sum() == 10
    assert f"10 heights are {lost}" in found.remarks[0]


def test_a_ball_on_the_floor_at_zero_is_not_lost(tmp_path):
    time = np.arange(300) / 240.0
    first = np.sqrt(0.2 / 4.9)
    since = time - first
    height = np.where(
        since < 0.0, 0.2 - 4.9 * time**2, np.maximum(1.2 * since - 4.9 * since**2, 0.0)
    )
    (found,) = read(
        tmp_path, "t,y\n" + "".join(f"{t:.6f},{y:.4f}\n" for t, y in zip(time, height, strict=True))
    )
    assert (found.height == 0.0).sum() > 10
    assert not found.remarks


def test_clicks_of_a_sound(tmp_path):
    rate, truth = 44100, np.array([0.31, 1.02, 1.65, 2.21, 2.72])
    rng = np.random.default_rng(1)
    sound = 3.0 * rng.standard_normal(3 * rate)
    for k, at in enumerate(truth):
        since = np.arange(2000) / rate
        click = 12000.0 * 0.8**k * np.exp(-since / 0.004) * np.sin(2 * np.pi * 3000 * since)
        sound[round(at * rate) : round(at * rate) + 2000] += click
    path = tmp_path / "drop.wav"
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes(sound.astype("<i2").tobytes())
    (found,) = read_recordings(path)
    assert np.ptp(found.time - truth) < 2e-4
    np.testing.assert_allclose(found.time, truth, atol=5e-4)
    assert (np.diff(found.peaks) < 0.0).all()


def shaken(time, rate=20.0):
    return 1e-3 * np.sin(2.0 * np.pi * rate * time + 0.3)


@pytest.mark.parametrize(("share", "clock"), [(0.01, 0.0), (0.2, 1_764_194_400.0)])
def test_gaps_and_far_clocks_do_not_change_a_trace(tmp_path, share, clock):
    time = np.arange(0.0, 3.0, 1.0 / 480.0)
    valid = np.random.default_rng(2).uniform(size=time.size) > share
    path = tmp_path / "base.csv"
    rows = [
        f"{clock + t:.6f},{y:.7f}" if keep else f"{clock + t:.6f},"
        for t, y, keep in zip(time, shaken(time), valid, strict=True)
    ]
    path.write_text("time,height\ns,m\n" + "\n".join(rows) + "\n\n")
    trace = read_trace(path)
    assert trace.numbers == (1,)
    sine, cosine, frequency = trace.values
    assert frequency == pytest.approx(20.0, abs=1e-5)
    # the velocity of sin(w t + 0.3) is proportional to cos(w t + 0.3)
    assert np.arctan2(cosine, sine) == pytest.approx(0.3 + np.pi / 2.0, abs=2e-4)
    assert trace.origin == clock
    later = trace.since(clock + 1.0)
    size = np.sqrt(np.diag(later.covariance))
    assert size[:2].min() > 0.0
    np.testing.assert_allclose(trace.values[:2], later.values[:2], atol=1e-4)  # 20 whole periods


def test_a_trace_in_g_states_its_unit_or_is_refused(tmp_path):
    time = np.arange(0.0, 2.0, 1e-3)
    path = tmp_path / "base.csv"

    def write(name, values):
        rows = "".join(f"{t:.4f},{a:.6f},0.5\n" for t, a in zip(time, values, strict=True))
        path.write_text(f"Time (s),{name},temperature\n{rows}")

    acceleration = np.sin(40.0 * np.pi * time)
    write("acceleration (g)", 1.0 + acceleration)
    in_g = read_trace(path)
    write("acceleration (m/s^2)", 9.80665 * acceleration)
    np.testing.assert_allclose(read_trace(path).values, in_g.values, atol=1e-6)
    np.testing.assert_allclose(
        read_trace(path, column="acceleration").values, in_g.values, atol=1e-6
    )
    write("acceleration", 1.0 + acceleration)
    with pytest.raises(TrackError, match="states multiples of g; write its unit"):
        read_trace(path)


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    how=table_formats(),
    edits=st.lists(
        st.tuples(st.floats(0, 1), st.binary(max_size=4), st.integers(0, 30)),
        min_size=1,
        max_size=4,
    ),
)
def test_spoiled_files_raise_only_errors_of_the_reader(tmp_path, how, edits):
    time, height = fall(12)
    content = text_of(how, time + how["clock"], height).encode()
    for place, added, removed in edits:
        k = int(place * len(content))
        content = content[:k] + added + content[k + removed :]
    path = tmp_path / "spoiled.csv"
    path.write_bytes(content)
    for reader in (read_recordings, read_tracks, read_trace):
        message = refusal(reader, path)
        assert message is None or "spoiled" in message


def refusal(reader, path):
    """Message of the only error that a reader may raise; None if it reads the file."""
    try:
        reader(path)
    except TrackError as error:
        return str(error)
    return None


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    edits=st.lists(
        st.tuples(st.floats(0, 1), st.binary(max_size=4), st.integers(0, 30)),
        min_size=1,
        max_size=4,
    )
)
def test_spoiled_workbooks_and_sounds(tmp_path, edits):
    book = workbook({"a": [["t", "y"], [0.0, 1.0], [0.5, 0.25]], "b": [["time"], [1.0], [2.0]]})
    sound = (
        b"RIFF\x2c\0\0\0WAVEfmt \x10\0\0\0\x01\0\x01\0\x40\x1f\0\0\x40\x1f\0\0\x01\0\x08\0"
        b"data\x08\0\0\0" + bytes(8)
    )
    for whole in (book, sound):
        content = whole
        for place, added, removed in edits:
            k = 4 + int(place * (len(content) - 4))
            content = content[:k] + added + content[k + removed :]
        path = tmp_path / "spoiled"
        path.write_bytes(content)
        message = refusal(read_recordings, path)
        assert message is None or "spoiled" in message


# --- Tracks of one recording, as datasets ---

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


def long(order="particle"):
    """One row for each position, by particle or by time."""
    wide = pd.DataFrame({"time": TIME, 0: HEIGHT[:, 0], 1: HEIGHT[:, 1]})
    rows = wide.melt("time", var_name="particle", value_name="height")
    return rows.sort_values([order, "particle", "time"])


@pytest.mark.parametrize("order", ["particle", "time"])
def test_plain_csv_by_particle_or_by_frame(write, order):
    same(read_tracks(write(long(order).to_csv(index=False))))


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
    table = long()
    table["time"] *= 8.0  # 240 frames per second, played and exported at 30
    path = write(table.to_csv(index=False))
    tracks = read_tracks(path, frame_rate=240.0)
    same(tracks)
    assert tracks.attrs["frame_rate"] == 240.0


def test_scale_axis_and_base(write):
    path = write(long().to_csv(index=False))
    same(read_tracks(path, scale=1e-3, axis="down", base=0.1), -1e-3 * (HEIGHT - 0.1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no table of numbers"),
        ("time,particle,height\n", "holds no table of numbers"),
        ("time,particle,height\n0.0,1,0.1\n0.1,,0.2\n", "line 3 has no particle"),
        ("time,particle,height\n0.0,1,0.1\n,1,0.2\n", "line 3 has no time"),
        ("time,particle,height\n0.0,7,1\n0.2,7,1\n0.1,7,1\n", r"line 4: the time 0\.1 s is not af"),
        ("time,particle,height\n0.0,7,1\n0.1,7,1\n0.1,7,1\n", r"line 4: the time 0\.1 s is not af"),
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
    path = write(long().to_csv(index=False))
    with pytest.raises(TrackError, match="particle 0 is in each of them"):
        read_tracks([path, path])


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *[(name, one) for name in ("base", "scale", "frame_rate") for one in ("x", np.nan, 1e300)],
        *[("scale", 0.0), ("scale", (1, 2)), ("axis", 3), ("axis", "x")],
        *[(name, one) for name in ("column", "particle", "sheet") for one in (3, "")],
    ],
)
def test_options_of_another_kind_are_refused(write, option, value):
    path = write(long().to_csv(index=False))
    readers = [read_tracks] if option == "base" else [read_tracks, read_recordings]
    for reader in readers:
        with pytest.raises(TrackError, match=rf"^{option} = .*: must be "):
            reader(path, **{option: value})
    for reader in (read_tracks, read_recordings):
        with pytest.raises(TrackError, match=r"^paths = 5: must be a file"):
            reader(5)
    with pytest.raises(TrackError, match=r"the table: must be a pandas\.DataFrame, not str"):
        tracks_from_frame("x")
