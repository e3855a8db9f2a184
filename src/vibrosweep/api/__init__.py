"""The public functions, a file for each trade; `vibrosweep` itself gives them by name."""
