"""The methods that `work_precision.py` compares, their scenes and the proved orbits."""
