"""Run the command ``vibrosweep`` as ``python -m vibrosweep``."""

import sys

from vibrosweep.cli import main

sys.exit(main())
