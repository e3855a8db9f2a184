"""Count the kernels that a run of the tests compiles, and keep their number below a limit.

Machine code takes most of the time of a run with an empty cache: every combination of base, law,
waveform, noise and statistics needs kernels of its own.  A kernel that several processes compile at
once counts once; commands that tests start as processes are not seen.  `--compilations` lists each
kernel with the test that caused it.
"""

import time

import pytest

from vibrosweep.kernels import _jit
from vibrosweep.kernels._numba import Listener, lost

LIMIT = 62


class Compilations(Listener):
    """Kernels that this process or its workers compiled, and which test caused each."""

    def __init__(self):
        self.caused, self.test, self.depth, self.began = {}, "collection", 0, 0.0

    def on_start(self, event):
        self.depth += 1
        if self.depth == 1:
            self.began = time.thread_time()

    def on_end(self, event):
        self.depth -= 1
        dispatcher = event.data["dispatcher"]
        function, kept = dispatcher.py_func, dispatcher.stats.cache_path is not None
        if self.depth == 0 and kept and function.__module__.startswith(f"{_jit.__package__}."):
            types = ", ".join(map(str, event.data["args"]))
            seconds = time.thread_time() - self.began
            self.note(f"{function.__module__}.{function.__name__}", types, self.test, seconds)

    def too_many(self, config):
        return len(self.caused) > LIMIT and not config.getoption("--machine-code")

    def note(self, function, types, test, seconds):
        self.caused.setdefault((function, types), (test, seconds))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        self.test = item.nodeid
        return (yield)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        for row in getattr(node, "workeroutput", {}).get("compilations", ()):
            self.note(*row)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session):
        if hasattr(session.config, "workeroutput"):  # a worker of pytest-xdist
            rows = [(*kernel, *cause) for kernel, cause in self.caused.items()]
            session.config.workeroutput["compilations"] = rows
        elif self.too_many(session.config):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter, config):
        write = terminalreporter.write_line
        if any("event" in name for name in lost):
            write("this numba does not say what it compiles: kernels are not counted")
            return
        count, many = len(self.caused), self.too_many(config)
        if many or config.getoption("compilations"):
            for (function, types), (test, seconds) in sorted(self.caused.items()):
                write(f"{seconds:5.1f} s {function.rpartition('.')[2]}, by {test}: {types}")
        if count:
            write(f"{count} kernels were compiled; the limit is {LIMIT}", red=many)
