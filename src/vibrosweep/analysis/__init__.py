"""Dataset in, dataset out: one question per file."""
