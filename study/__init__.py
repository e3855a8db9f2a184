"""Every claim of the study judged by computation: numbers, verdicts, one page."""
