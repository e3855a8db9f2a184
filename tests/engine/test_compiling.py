"""The notice of a compilation: on terminals only, and only if it takes long."""

import gc
import io
import sys
import time
from types import SimpleNamespace

import pytest

from vibrosweep import waiting
from vibrosweep.engine import workers
from vibrosweep.engine.workers import Notice


class Terminal(io.StringIO):
    def isatty(self):
        return True


def event(function, module="vibrosweep.kernels.advance"):
    named = SimpleNamespace(__name__=function, __module__=module)
    return SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=named)})


@pytest.fixture
def told(monkeypatch):
    """Announce a kernel and a function inside it to a notice; return the text of the stream."""
    monkeypatch.delenv("TQDM_DISABLE", raising=False)
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)

    def tell(stream, seconds, module="vibrosweep.kernels.advance"):
        monkeypatch.setattr(sys, "stderr", stream)
        notice = Notice(0.02)
        notice.on_start(event("advance", module))
        notice.on_start(event("fly", module))
        notice.on_end(event("fly", module))
        time.sleep(seconds)
        notice.on_end(event("advance", module))
        return stream.getvalue()

    return tell


def test_a_long_compilation_is_announced_and_the_line_is_removed(told):
    lines = told(Terminal(), 0.2).split("\r")
    assert lines[1].startswith("vibrosweep: compiling advance (first use only")
    assert lines[-2].strip() == lines[-1] == ""
    assert len(lines[-2]) == len(lines[-3])


def test_the_time_of_compiling_is_that_of_whole_kernels_of_this_package():
    """Pieces within a kernel are not counted twice, nor what others compile."""
    notice = Notice()
    for module, taken in (("vibrosweep.kernels.advance", 0.1), ("scipy.stats", 0.0)):
        before = notice.seconds
        notice.on_start(event("advance", module))
        notice.on_start(event("fly", module))
        time.sleep(0.1)
        notice.on_end(event("fly", module))
        notice.on_end(event("advance", module))
        assert (notice.seconds - before >= 0.1) == (taken > 0.0)
        assert taken > 0.0 or notice.seconds == before


def test_loading_is_announced_and_the_line_is_removed(monkeypatch):
    stream = Terminal()
    monkeypatch.delenv("TQDM_DISABLE", raising=False)
    monkeypatch.setattr(sys, "stderr", stream)
    with waiting.Line("loading", 0.02):
        time.sleep(0.2)
    first, *_, last = stream.getvalue().split("\r")[1:]
    assert first == "vibrosweep: loading: 0 s"
    assert last == ""


def test_files_other_modules_and_fast_compilations_get_no_notice(told, monkeypatch):
    assert told(io.StringIO(), 0.1) == ""
    assert told(Terminal(), 0.1, "elsewhere.module") == ""
    assert told(Terminal(), 0.0) == ""
    monkeypatch.setenv("TQDM_DISABLE", "1")
    assert told(Terminal(), 0.1) == ""


@pytest.mark.parametrize("often", [700, 10**6, 0])
def test_the_garbage_collector_runs_less_often_during_compilation(often):
    before = gc.get_threshold()
    gc.set_threshold(often, 10, 10)
    try:
        notice = Notice()
        notice.on_start(event("advance"))
        notice.on_start(event("fly"))
        notice.on_end(event("fly"))
        meanwhile = gc.get_threshold()
        notice.on_end(event("advance"))
        after = gc.get_threshold()
    finally:
        gc.set_threshold(*before)
    assert meanwhile == (max(often, workers.COLLECT_AFTER) if often else 0, 10, 10)
    assert after == (often, 10, 10)
