"""The methods that `work_precision.py` compares, their scenes and the proved orbits."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
# `accuracy`, which writes the sections of pages, and the study
sys.path.extend([str(ROOT / "checks"), str(ROOT)])
