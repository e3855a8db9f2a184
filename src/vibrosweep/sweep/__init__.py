"""Sweeps: a TOML file becomes a validated spec, a design, a plan and a run."""
