import io
import re
from time import sleep

import pytest

from vibrosweep.runs import progress
from vibrosweep.runs.progress import reporting, silent


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Gone(io.StringIO):
    """A log or terminal that nobody reads any more."""

    def __init__(self, terminal):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal

    def write(self, text):
        raise BrokenPipeError


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_log_gets_a_line_now_and_then(clock):
    stream = io.StringIO()
    with reporting(stream) as advance:
        for second in range(0, 31, 3):
            clock[0] = float(second)
            advance(second, 30)
    assert stream.getvalue().splitlines() == [
        "12 of 30 realizations, 1 per second, 18 s remaining",
        "24 of 30 realizations, 1 per second, 6 s remaining",
    ]


def test_a_continued_run_reports_its_own_speed(clock):
    """Its speed counts only its own work, and it reports nothing before there is some."""
    stream = io.StringIO()
    with reporting(stream) as advance:
        for second, done in ((15.0, 600), (30.0, 600), (45.0, 630), (60.0, 660)):
            clock[0] = second
            advance(done, 1000)
    assert stream.getvalue().splitlines() == [
        "630 of 1000 realizations, 1 per second, 370 s remaining",
        "660 of 1000 realizations, 1.333 per second, 255 s remaining",
    ]


def test_a_short_run_says_nothing():
    stream = io.StringIO()
    with reporting(stream) as advance:
        advance(1, 1)
    assert stream.getvalue() == ""


def test_a_terminal_gets_a_bar():
    stream = Terminal()
    with reporting(stream, delay=1e-9) as advance:
        advance(0, 4)
        sleep(0.2)  # the bar is drawn ten times a second
        advance(3, 4)
        advance(4, 4)
    assert "75%" in stream.getvalue()
    assert stream.getvalue().endswith("\r")  # wiped at the end


def test_the_bar_of_a_continued_run_shows_its_own_speed(monkeypatch):
    """What an earlier run has finished is no work of this one."""
    stream, now = Terminal(), [1000.0]
    for clock in ("time.time", "tqdm.std.time"):
        monkeypatch.setattr(clock, lambda: now[0])
    with reporting(stream, delay=1e-9) as advance:
        now[0] += 50.0  # planning
        advance(40_000, 50_000)
        for done in range(40_100, 41_001, 100):
            now[0] += 1.0
            advance(done, 50_000)
    speeds = [float(s) for s in re.findall(r"([0-9.]+) realizations/s", stream.getvalue())]
    assert speeds
    assert speeds == pytest.approx([100.0] * len(speeds), rel=0.01)


@pytest.mark.parametrize("terminal", [True, False])
def test_a_closed_stream_does_not_end_a_run(clock, terminal):
    with reporting(Gone(terminal), delay=1e-9) as advance:
        clock[0] = 100.0
        advance(1, 2)
        clock[0] = 200.0
        advance(2, 2)


def test_silence():
    silent(1, 2)
