"""Slow truth: the map in ball arithmetic with proved errors, and the study's fixed-step scheme."""
