"""Restitution of a ball on a floor from recordings of its drops, pooled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from vibrosweep.errors import TrackError
from vibrosweep.lab.clicks import bounces_of_clicks
from vibrosweep.lab.drop_inputs import ball_inputs
from vibrosweep.lab.films import FilmFit, bounces_of_film
from vibrosweep.lab.pool import Pool
from vibrosweep.lab.recording import Recording

__all__ = ["restitution"]


def restitution(
    recordings: Sequence[Recording],
    *,
    contact: float | tuple[float, float] | None = None,
    mass: float | None = None,
    diameter: float | None = None,
    gravity: float | tuple[float, float] = 9.81,
    drop_height: float | tuple[float, float] | None = None,
    scale_from_gravity: bool = False,
    begin: float | None = None,
    end: float | None = None,
) -> xr.Dataset:
    """Measure the restitution of a ball on a floor that is at rest.

    Parameters
    ----------
    recordings
        Drops of one ball: films, or times of impacts, as `read_recordings` returns them.
    contact
        Length of a contact in s, or its range; by default 0.2 to 5 ms.
    mass, diameter
        Of the ball, in kg and m, from which its drag in air follows.  Otherwise films determine
        the drag, and times are evaluated without.
    gravity
        In m s-2, or its range.
    drop_height
        Height (m) from which the ball was dropped, or its range: the first fall then counts.
    scale_from_gravity
        Whether speeds in films are computed with the scale of free fall instead of that of the
        file.
    begin, end
        Part of the recordings that is used, in s.

    Returns
    -------
    xarray.Dataset
        ``restitution`` at the impact speed ``speed`` with ``restitution_error``, half of the 68 %
        interval, and ``restitution_quantile``; its ``slope`` with the speed; ``scatter`` from
        bounce to bounce and ``drop_scatter`` from drop to drop with quantiles (NaN: not
        determined); the laws that fit, along ``law``; each bounce, along ``bounce``; each drop by
        itself, along ``drop``, and the ``prediction_error`` with which the mean restitution of
        another drop is known; the groups that files name, along ``group``; the effect of each
        input, along ``input``; ``correlation``.

    Raises
    ------
    TrackError
        There is no bounce.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> ball = vs.lab.FloorExperiment(restitution=0.8, scatter=0.004)
    >>> clicks, truth = vs.lab.hear_drops(ball, 4, seed=2)
    >>> found = vs.lab.restitution(clicks, contact=5e-4)
    >>> abs(float(found.restitution) - 0.8) < 3 * float(found.restitution_error)
    True
    """
    inputs = ball_inputs(contact, mass, diameter, gravity, drop_height)
    inputs = replace(inputs, scale_from_gravity=scale_from_gravity)
    used = [_cut(recording, begin, end) for recording in recordings]
    fits: list[FilmFit] = []
    drops, remarks = bounces_of_clicks([r for r in used if r.height is None], inputs)
    for recording in used:
        if recording.height is not None:
            filmed, fit, remark = bounces_of_film(recording, inputs)
            remarks += [*recording.remarks, *([remark] if remark else [])]
            if filmed and fit:
                drops.append(filmed)
                fits.append(fit)
    if not drops:
        raise TrackError("; ".join(remarks) or "no recordings were given")
    first = len(drops) - len(fits)
    owners = np.array([drop.group for drop in drops])
    found = Pool(list(drops), inputs).result(remarks).assign(_samples(fits, first))
    names = list(dict.fromkeys(owners.tolist()))
    parts = [
        Pool([drop for drop in drops if drop.group == name], inputs).result([])
        for name in (names if len(names) > 1 else [])
    ]
    of_groups = {
        f"group_{key}": ("group", [float(part[key]) for part in parts])
        for key in ("restitution", "restitution_error", "speed")
    }
    return found.assign(of_groups).assign_coords(group=names if parts else [])


def _samples(fits: list[FilmFit], first: int) -> dict[str, Any]:
    """Return the samples of flights, for a figure."""
    if not fits:
        return {}
    owner = np.repeat(np.arange(first, first + len(fits)), [fit.time.size for fit in fits])
    names = {"time": "time", "height": "height", "fitted": "fitted", "residual": "residual"}
    return {
        "sample_drop": ("sample", owner),
        **{
            f"sample_{name}": ("sample", np.concatenate([getattr(fit, field) for fit in fits]))
            for name, field in names.items()
        },
    }


def _cut(recording: Recording, begin: float | None, end: float | None) -> Recording:
    low, high = (-np.inf if begin is None else begin), (np.inf if end is None else end)
    kept = (recording.time >= low) & (recording.time <= high)
    parts: dict[str, Any] = {"time": recording.time[kept]}
    for name in ("height", "horizontal", "peaks"):
        values = getattr(recording, name)
        parts[name] = None if values is None else values[kept]
    return replace(recording, **parts)
