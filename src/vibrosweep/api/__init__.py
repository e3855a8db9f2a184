"""The public functions, which `vibrosweep` exports."""
