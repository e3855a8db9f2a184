"""``python -m vibrosweep`` is the command ``vibrosweep``."""

import sys

from vibrosweep.cli import main

sys.exit(main())
