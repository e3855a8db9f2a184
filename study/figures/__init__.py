"""Figures of the claims of the study."""
