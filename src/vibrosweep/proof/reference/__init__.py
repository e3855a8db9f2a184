"""The proved reference: trajectories over every base in ball arithmetic."""
