"""Judge every claim of the study by computation: numbers, verdicts, one page."""

import vibrosweep.figures  # noqa: F401  (before matplotlib: it looks at the environment)
