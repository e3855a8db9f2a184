"""The public functions that `vibrosweep` exports."""
