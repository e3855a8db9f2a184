"""Running a sweep: plan, chunks, resuming, cluster, progress, and the result file."""
