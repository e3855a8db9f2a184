"""Arrays of parameters to measured arrays: one batch in memory, on all threads."""
