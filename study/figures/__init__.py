"""Figures that only the judgement of the study draws."""
