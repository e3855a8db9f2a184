"""Particles that meet one base of finite mass: one event at a time in each realization."""
