"""The command ``vibrosweep``, also ``python -m vibrosweep``.

A signal ends it with one message and exit code 130, from here on.  Before `vibrosweep.cli`, whose
imports take most of the time of ``--help``, handles signals itself, there is nothing to tidy.
"""

import os
import signal
import sys
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130


def main() -> int:
    """Run the command that the process was given; return its exit code."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # Windows has no SIGHUP
        number = getattr(signal, name, None)
        # ignored signals stay ignored, as under nohup
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _leave)
    from vibrosweep import cli

    try:
        return cli.main()
    except KeyboardInterrupt:  # in the moment between the command and its end
        os._exit(INTERRUPTED)


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    os.write(2, b"vibrosweep: interrupted before it began\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
