"""Figures of the laboratory: fitted tracks, errors beside those of the study, drops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.figures import style
from vibrosweep.figures.style import Panels

if TYPE_CHECKING:
    import xarray as xr

# Flights that can be distinguished across a page.
SHOWN_FLIGHTS: Final = 10
CURVE_POINTS: Final = 60


@style.styled
def fitted_track(flights: xr.Dataset, *, ax: Sequence[Axes] | Panels | None = None) -> Panels:
    """Draw the track with most time in flight and its fit, and the residuals of all flights.

    Takes the result of `vibrosweep.lab.lines.flights_of`, and three axes or none.
    """
    names, index = np.unique(flights["owner"].values, return_inverse=True)
    flying = np.bincount(index, flights["end"].values - flights["start"].values)
    ratios = {"height_ratios": (1.3, 1.0), "width_ratios": (1.6, 1.0)}
    panels = style.panels_on(ax, style.PAGE, 4.4, [[0, 0], [1, 2]], **ratios)
    _draw_track(panels[0], flights, names[flying.argmax()])
    _draw_residuals(panels[1], flights)
    _draw_distribution(panels[2], flights)
    return panels


def _draw_track(axes: Axes, flights: xr.Dataset, particle: object) -> None:
    flown = flights["owner"].values == particle
    start, end = flights["start"].values[flown], flights["end"].values[flown]
    shown = min(SHOWN_FLIGHTS, start.size)
    low, high = float(start[0]), float(end[shown - 1])
    for k in range(shown):
        since = np.linspace(0.0, end[k] - start[k], CURVE_POINTS)
        speed = flights["speed"].values[flown][k]
        rise = since * (speed - 0.5 * flights.attrs["curvature"] * since)
        rise += flights["rise"].values[flown][k]
        name = "fitted flight" if k == 0 else None
        axes.plot(start[k] + since, 1e3 * rise, color=style.OKABE_ITO[0], label=name)

    def within(name: str) -> NDArray[np.bool_]:
        time: Array = flights[name].values
        return (time >= low) & (time <= high)

    seen = (flights["particle"].values == particle) & within("time")
    axes.plot(
        flights["time"].values[seen],
        1e3 * flights["height"].values[seen],
        "o",
        markersize=2.2,
        color=style.OKABE_ITO[6],
        label="tracked position",
    )
    landed = (flights["landing_owner"].values == particle) & within("landing_time")
    axes.errorbar(
        flights["landing_time"].values[landed],
        1e3 * flights["landing_height"].values[landed],
        xerr=flights["landing_error"].values[landed],
        linestyle="none",
        marker="|",
        markersize=7.0,
        color=style.OKABE_ITO[1],
        capsize=2.0,
        label="landing and its standard error",
        zorder=4,
    )
    if "base_height" in flights:
        near = within("base_time")
        level = flights["level"].values[flights["name"].values == particle]
        axes.plot(
            flights["base_time"].values[near],
            1e3 * (level + flights["base_height"].values[near]),
            color=style.GREY,
            linewidth=1.2,
            label="base",
        )
    axes.set(xlim=(low, high), xlabel="time $t$ (s)", ylabel="height $y$ (mm)")
    style.head(axes, f"particle {particle}, {flights.attrs['frame_rate']:.4g} frames per second")


def _draw_residuals(axes: Axes, flights: xr.Dataset) -> None:
    """Draw residuals against the place in the flight: blur and rests would show at its ends."""
    used = np.isfinite(flights["residual"].values)
    place, residual = flights["within"].values[used], flights["residual"].values[used]
    axes.plot(
        place,
        residual,
        ".",
        markersize=1.5,
        alpha=0.3,
        color=style.GREY,
        rasterized=True,
        label="sample",
    )
    edges = np.linspace(0.0, 1.0, 21)
    inside = (place >= 0.0) & (place <= 1.0)
    cell = np.clip(np.digitize(place[inside], edges) - 1, 0, 19)
    count = np.bincount(cell, minlength=20)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(cell, residual[inside], 20) / count
    axes.plot((edges[1:] + edges[:-1]) / 2.0, mean, color=style.OKABE_ITO[1], label="mean")
    axes.axhline(0.0, color="black", linewidth=0.5)
    axes.set(xlim=(-0.05, 1.05), ylim=(-5.0, 5.0))
    axes.set(xlabel="place in the flight", ylabel="residual / standard error")
    style.head(axes, "")


def _draw_distribution(axes: Axes, flights: xr.Dataset) -> None:
    residual = flights["residual"].values
    residual = residual[np.isfinite(residual)]
    axes.hist(
        residual,
        bins=np.linspace(-5.0, 5.0, 51).tolist(),
        density=True,
        color=style.OKABE_ITO[5],
        label="samples",
    )
    grid = np.linspace(-5.0, 5.0, 201)
    axes.plot(grid, np.exp(-(grid**2) / 2.0) / np.sqrt(2.0 * np.pi), color="black", label="normal")
    axes.set(xlim=(-5.0, 5.0), xlabel="residual / standard error", ylabel="density")
    style.head(axes, "")


@style.styled
def errors_by_case(table: xr.Dataset, *, ax: Sequence[Axes] | Panels | None = None) -> Panels:
    """Draw the errors that `vibrosweep.lab.compare_tracks` finds, case by case, on two axes.

    Attributes ``study_height`` and ``study_period``, which the caller may set, hold the ranges
    of errors that a study found.
    """
    panels = style.panels_on(ax, style.PAGE, 3.0, [[0, 1]])
    for axes, q in zip(panels, table["quantity"].values, strict=True):
        error = table["error"].sel(quantity=q)
        cases = np.arange(table.sizes["case"])
        most = float(np.max(error.values, initial=0.0, where=np.isfinite(error.values)))
        if f"study_{q}" in table.attrs:
            low, high = table.attrs[f"study_{q}"]
            axes.axhspan(low, high, color="0.9", label=f"study: {low:g} to {high:g} %")
            most = max(most, high)
        for k, reading in enumerate(table["reading"].values):
            axes.plot(
                cases + 0.12 * (k - 1.5),
                error.sel(reading=reading).values,
                "osD^"[k],
                markersize=4.5,
                color=style.OKABE_ITO[k],
                label=str(reading),
                clip_on=False,
                zorder=3,
            )
        axes.set_xticks(cases, [str(case) for case in table["case"].values])
        axes.set(xlim=(-0.6, cases.size - 0.4), ylabel=f"error of {q} (%)")
        axes.set_ylim(0.0, 1.15 * (most or 1.0))
        style.head(axes, "", columns=2)
    return panels


@style.styled
def restitution_by_speed(found: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw each bounce with its error, and the restitution that all of them show."""
    axes = style.axes_on(ax, style.MEDIUM, 3.3)
    used = found["bounce_used"].values > 0
    speed, e = found["bounce_speed"].values, found["bounce_restitution"].values
    error = found["bounce_error"].values
    for chosen, color, name in (
        (used, style.OKABE_ITO[0], "bounce, error of the measurement"),
        (~used, style.GREY, "outlier, left out"),
    ):
        if chosen.any():
            axes.errorbar(
                *(speed[chosen], e[chosen], error[chosen]),
                linestyle="none",
                marker="o",
                markersize=3.0,
                elinewidth=0.7,
                color=color,
                label=name,
            )
    line = np.linspace(speed[used].min(), speed[used].max(), 50)
    slope = float(found["slope"]) if found.attrs["dependence"] != "constant" else 0.0
    middle = float(found["restitution"]) + slope * (line - float(found["speed"]))
    low, high = found["restitution_quantile"].values[[0, 3]] - float(found["restitution"])
    axes.fill_between(
        line, middle + low, middle + high, color=style.OKABE_ITO[1], alpha=0.3, label="95 %"
    )
    axes.plot(line, middle, color=style.OKABE_ITO[1], label="restitution")
    unit = "m/s" if found.attrs["speed_known"] else "relative"
    axes.set(xlabel=f"impact speed ({unit})", ylabel="restitution $e$")
    style.head(axes, "")
    return axes


@style.styled
def film_of_drop(found: xr.Dataset, *, ax: Sequence[Axes] | Panels | None = None) -> Panels:
    """Draw the heights of the first film in flight, and their residuals, on two axes."""
    panels = style.panels_on(ax, style.PAGE, 4.0, [[0], [1]], height_ratios=(2.0, 1.0))
    first = found["sample_drop"].values == found["sample_drop"].values.min()
    time = found["sample_time"].values[first]
    panels[0].plot(
        time,
        found["sample_height"].values[first],
        "o",
        markersize=2.2,
        color=style.OKABE_ITO[6],
        label="tracked position",
    )
    panels[0].plot(
        time,
        found["sample_fitted"].values[first],
        ".",
        markersize=1.5,
        color=style.OKABE_ITO[0],
        label="fitted flight",
    )
    panels[0].set(ylabel="height (unit of the file)")
    style.head(panels[0], str(found["drop"].values[found["sample_drop"].values.min()]))
    panels[1].plot(time, found["sample_residual"].values[first], ".", color=style.GREY)
    panels[1].axhline(0.0, color="black", linewidth=0.5)
    panels[1].set(xlabel="time $t$ (s)", ylabel="residual", xlim=panels[0].get_xlim())
    return panels
