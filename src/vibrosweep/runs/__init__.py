"""A sweep from its description to its file: plan, chunks, resume, cluster, progress."""
