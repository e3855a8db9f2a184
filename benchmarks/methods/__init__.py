"""The methods that `work_precision.py` compares, their scenes and the proved orbits."""

import sys
from pathlib import Path

# `accuracy`, which writes the sections of pages
sys.path.append(str(Path(__file__).parents[2] / "checks"))
