"""The engine, which measures one batch in memory from arrays of parameters on all threads."""
