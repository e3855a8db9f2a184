"""Points of a law of restitution from a table: speeds and the restitution at each."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from vibrosweep.model.restitution_laws import Points, points_of
from vibrosweep.scene.realizations import factor
from vibrosweep.scene.tables import cells_of, read_content

COLUMNS: Final = ("speed", "restitution")


def points_in(path: Path) -> Points:
    """Read the columns of speed, in m/s unless the heading has a unit, and of restitution.

    A ValueError says why the table cannot be used.
    """
    for table in cells_of(read_content(path), str(path)):
        places = [
            [k for k, heading in enumerate(table.headings) if heading.means(column)]
            for column in COLUMNS
        ]
        if all(len(place) == 1 for place in places):
            break
    else:
        raise ValueError(
            f"{path}: must have one column speed (m/s) and one column restitution (columns found: "
            f"{table.names})"
        )
    (speed,), (restitution,) = places
    unit = table.headings[speed].unit
    scale = factor(unit, "m s-1") if unit else (1.0, 1.0)
    if scale is None:
        raise ValueError(f"{path}: the unit {unit!r} of the speed is not known; give it in m/s")
    speeds = table.numbers(speed) * scale[0] / scale[1]
    try:
        return points_of(np.column_stack([speeds, table.numbers(restitution)]).tolist())
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
