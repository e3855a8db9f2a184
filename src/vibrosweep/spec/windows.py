"""The [windows] table of a sweep file; the names of conditions are known to the analysis."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WindowsTable:
    """[windows], for stability windows: the forcing axis of a grid is their coarse scan."""

    conditions: tuple[str, ...] = ("locked(1)",)  # names of conditions, each once
    # Whether orbits are continued along the forcing, up and down, instead of launched at each
    continuation: bool = False
    tolerance: float = 1e-9  # width of the bracket around an edge, relative to the edge


def condition_names(value: object) -> tuple[str, ...]:
    """Check the value of the key ``conditions``; raise ValueError with what is allowed."""
    if isinstance(value, list) and value and all(isinstance(v, str) for v in value):
        return tuple(dict.fromkeys(value))
    raise ValueError('must be a list of one or more names of conditions, as in ["locked(1)"]')


def tolerance(value: object) -> float:
    """Check the value of the key ``tolerance``; raise ValueError with what is allowed."""
    if isinstance(value, float) and 1e-14 <= value < 1.0:
        return value
    raise ValueError("must be a number, at least 1e-14 and below 1")
