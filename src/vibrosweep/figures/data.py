"""Access to datasets for figures: requirements, varying parameters, labels."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from vibrosweep.analysis.datasets import (
    completed,
    differing,
    per_realization,
    refused_ragged,
    remedy,
    require_names,
)
from vibrosweep.analysis.records import chosen, moves, recoils
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.model.forcing import ACCELERATION, FORCINGS, INPUTS
from vibrosweep.model.measures import Status, known
from vibrosweep.model.parameters import HIGH_BOUNCE, MOUNT, NOISE, OF_RESTITUTION
from vibrosweep.model.restitution_laws import CONSTANT, POINTS, law_in, name_of
from vibrosweep.model.shapes import HARMONICS_NAME, SINE_NAME, name_in
from vibrosweep.store.arranged import require_dataset

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

KICK: Final = "kick"
MINUS_INFINITY: Final = r"$-\infty$ (rests)"  # of an exponent
# Characters that fit beside the shortest colour bar, with room for symbol and units
LABEL_WIDTH: Final = 32
# Largest relative difference of equal values that were computed in two ways: a dimensionless kick
# takes three operations from an amplitude, which itself takes some from an acceleration
ROUNDING: Final = 16.0 * float(np.finfo(np.float64).eps)
# Attributes of the scene of a dataset, with the values that a dataset without them has
SCENE: Final = {
    "base": HIGH_BOUNCE,
    "rebound": "rest",
    "waveform": SINE_NAME,
    "restitution_law": CONSTANT,
}
SYMBOLS: Final = {
    "restitution": "e",
    "amplitude": "A",
    "base_velocity": "V_0",
    "base_displacement": "B",
    "base_acceleration": r"\Gamma",
    "frequency": "f",
    "phase": r"\varphi",
    "gravity": "g",
    "launch_velocity": "v_0",
    "contact_time": r"\tau_c",
    "restitution_speed": "v_r",
    "restitution_noise": r"\sigma_e",
    "restitution_noise_relative": r"\sigma_e / e",
    "kick_noise": r"\sigma_V",
    "drive_noise": r"\sigma_A",
    "mass_ratio": r"\mu",
    "particle_mass": "m",
    "base_mass": "M",
    "mount_frequency": "f_0",
    "mount_damping": r"\zeta",
    "dt_min": r"\Delta t_{\mathrm{min}}",
    "rebound_height_max": r"H_{\mathrm{max}}",
    "rebound_height_mean": r"\langle H \rangle",
}


@dataclass(frozen=True)
class Requirements:
    """Requirements of a figure."""

    variables: tuple[str, ...]  # variables or coordinates that are all needed
    one_of: tuple[str, ...] = ()  # variables of which at least one is needed
    # Parameters that must differ between realizations; ``"kick"`` is the dimensionless amplitude,
    # which also varies with frequency and gravity
    varied: tuple[str, ...] = ()
    known: tuple[str, ...] = ()  # variables that must be defined in some realization

    def lacking(self, dataset: xr.Dataset) -> str | None:
        """Return words on missing data and how to get them; None if nothing is missing."""
        absent = [name for name in self.variables if name not in dataset.variables]
        if absent:
            noun = "variable" if len(absent) == 1 else "variables"
            return f"the {noun} {' and '.join(absent)}: {remedy(absent[0])}"
        if self.one_of and not any(name in dataset.variables for name in self.one_of):
            return f"the variable {' or '.join(self.one_of)}: {remedy(self.one_of[0])}"
        for name in self.known:
            if np.isnan(measured(dataset, name)).all():
                return f"a value of {name}, which is undefined in every realization"
        for name in self.varied:
            if not (np.ptp(kick(dataset)) > 0 if name == KICK else varies(dataset, name)):
                return differing("amplitude" if name == KICK else name)
        return None

    def check(self, figure: str, dataset: xr.Dataset) -> None:
        """Raise a DataError if anything is missing."""
        if wrong := refused_ragged(dataset):
            raise DataError(f"figure {figure} {wrong}")
        require_names(f"figure {figure}", self.variables)
        reason = self.lacking(dataset)
        if reason is not None:
            raise DataError(f"figure {figure} needs {reason}")


def varies(dataset: xr.Dataset, name: str) -> bool:
    """Return whether a parameter differs between realizations."""
    return fixed(dataset, name) is None


def fixed(dataset: xr.Dataset, name: str) -> float | None:
    """Return the value that all realizations share, or None if they differ."""
    low, high = _ends(dataset, name)
    return low if low == high else None


def _ends(dataset: xr.Dataset, name: str) -> tuple[float, float]:
    values = dataset[name].values
    known = values[~np.isnan(values)]
    return (float(known.min()), float(known.max())) if known.size else (np.nan, np.nan)


def quantity(dataset: xr.Dataset, name: str) -> Array:
    """Values of a variable or parameter, one per realization, as float64.

    Numbers are NaN where they are undefined; codes have a code for that.
    """
    values = per_realization(dataset, name)
    if "flag_values" in dataset[name].attrs:
        return values
    return np.where(known(name, dataset), values, np.nan)


def measured(sweep: xr.Dataset, name: str) -> Array:
    """Values of a variable, one per realization, NaN also where a realization did not complete.

    Coordinates, which were given, and the status itself are known there.
    """
    values = quantity(sweep, name)
    given = name in sweep.coords or name == "status"
    return values if given else np.where(completed(sweep), values, np.nan)


def incomplete(dataset: xr.Dataset, what: str) -> str:
    """Words on how many realizations or particles did not complete; empty if all did."""
    if "status" not in dataset.variables:
        return ""
    status = dataset["status"].values
    lost = np.count_nonzero(status != Status.COMPLETED)
    return f"{lost} of {status.size} {what} did not complete" if lost else ""


def joined(*parts: str) -> str:
    """Join the parts of a remark, without those that are empty."""
    return ", ".join(part for part in parts if part)


def kick(dataset: xr.Dataset) -> Array:
    """Dimensionless kick 2 f A / g, one per realization; equal ones are equal bit for bit."""
    amplitude, frequency, gravity = (
        quantity(dataset, name) for name in ("amplitude", "frequency", "gravity")
    )
    return merged(2.0 * frequency * amplitude / gravity)


def merged(values: Array) -> Array:
    """Make values equal that differ only by rounding."""
    sorts, place = np.unique(values, return_inverse=True)
    apart = ~(np.diff(sorts, prepend=-np.inf) <= ROUNDING * np.abs(sorts))  # so is NaN, the last
    first = np.maximum.accumulate(np.where(apart, np.arange(sorts.size), 0))
    return np.asarray(sorts[first][place], dtype=np.float64)


def require_same_scene(
    figure: str, over: xr.Dataset, under: xr.Dataset, parameters: Sequence[str]
) -> None:
    """Raise a DataError if what is drawn over a picture contradicts the picture.

    Their scenes must be the same, and the values of those of the `parameters` that both have.
    """
    require_dataset(under)
    for name, usual in SCENE.items():
        texts = [str(one.attrs.get(name, usual)) for one in (over, under)]
        if texts[0] != texts[1]:
            raise DataError(_contradiction(figure, name, *texts))
    for name in parameters:
        if name not in over.variables or name not in under.variables:
            continue
        ends = [_ends(one, name) for one in (over, under)]
        low, high = min(e[0] for e in ends), max(e[1] for e in ends)
        if not high - low <= ROUNDING * abs(high):
            raise DataError(_contradiction(figure, name, *(_range(name, *e) for e in ends)))


def _contradiction(figure: str, name: str, over: str, under: str) -> str:
    return (
        f"figure {figure} cannot draw {name} = {over} over a picture of {name} = {under}: compute "
        f"both with the same, or draw them apart"
    )


def _range(name: str, low: float, high: float) -> str:
    """Write a parameter with its units, as a range if it varies."""
    values = f"{low:.9g}" if high - low <= ROUNDING * abs(high) else f"{low:.9g} to {high:.9g}"
    return values if _units(name) == "1" else f"{values} {_units(name)}"


def drawn_forcing(dataset: xr.Dataset) -> str | None:
    """Name of the forcing on the axis: the acceleration where it was given, else the amplitude.

    None instead of the amplitude if frequency or gravity differ between realizations, since
    amplitudes are not comparable then.
    """
    if dataset.attrs.get("forcing") == ACCELERATION:
        return ACCELERATION
    common = fixed(dataset, "frequency") is not None and fixed(dataset, "gravity") is not None
    return "amplitude" if common else None


def one_realization(record: xr.Dataset, realization: int) -> xr.Dataset:
    """Select a realization of a record by position; raises an error if it has no results."""
    one = chosen(record, realization)
    if "status" in one.variables and bool((one["status"] == Status.REFUSED).all()):
        raise DataError(f"realization {realization} of the record has no results")
    return one


def format_units(units: str) -> str:
    """Units with raised exponents, in brackets: 'm s-1' becomes '(m s$^{-1}$)'."""
    return "" if units in ("", "1") else f" ({_raised(units)})"


def _raised(units: str) -> str:
    return re.sub(r"(?<=[A-Za-z])(-?\d+)", r"$^{\1}$", units)


def symbol(name: str) -> str:
    """Symbol of a quantity in mathtext, with a leading blank; empty if it has none."""
    return f" ${SYMBOLS[name]}$" if name in SYMBOLS else ""


def label(dataset: xr.Dataset, name: str) -> str:
    """Axis label of words, symbol and units, from the attributes of the dataset if it has them."""
    words = name.replace("_", " ")
    if name in INPUTS:
        units = _units(name)
        if name in FORCINGS:
            words = FORCINGS[name].long_name.removesuffix(" in g")
    else:
        units = str(dataset[name].attrs.get("units", ""))
        words = str(dataset[name].attrs.get("long_name", words))
    return f"{textwrap.fill(words, LABEL_WIDTH)}{symbol(name)}{format_units(units)}"


def name_axes(axes: Axes, dataset: xr.Dataset, across: str, up: str) -> None:
    """Label both axes with the quantities along them."""
    axes.set(xlabel=label(dataset, across), ylabel=label(dataset, up))


def _units(name: str) -> str:
    """Units of an input as figures write them."""
    return "g" if name == ACCELERATION else INPUTS[name].units


def conditions(dataset: xr.Dataset) -> str:
    """Write in one line the laws, the base, and the parameters that are neither axis nor colour.

    A parameter that differs between realizations is given as a range, except restitution and
    forcing, which figures draw, and the axes of a grid: these are left out then.  The forcing has
    the form in which it was given, if the dataset holds that form.
    """
    parts = []
    given = str(dataset.attrs.get("forcing", "amplitude"))
    forcing = given if given in dataset.variables else "amplitude"
    for name in ("restitution", *OF_RESTITUTION, forcing, "frequency", *NOISE, *MOUNT):
        if name not in dataset.variables:
            continue
        low, high = _ends(dataset, name)
        if low < high and name in ("restitution", forcing, *dataset.dims):
            continue
        values = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        units = _units(name)
        unit = "" if units == "1" else f" {_raised(units)}"
        words = f"{name.replace('_', ' ')} " if name in NOISE else ""
        parts.append(f"{words}${SYMBOLS[name]}$ = {values}{unit}")
    if dataset.attrs.get("rebound") == "reflect":
        parts.append("reflect law")
    if (law := law_in(dataset.attrs)) != CONSTANT:
        shown = "restitution between points" if name_of(law) == POINTS else f"{law} restitution"
        parts.append(shown)
    if (shape := name_in(dataset.attrs)) != SINE_NAME:
        parts.append("base of harmonics" if shape == HARMONICS_NAME else f"{shape} base")
    if recoils(dataset):
        parts.append("sprung base")
    elif moves(dataset):
        parts.append("moving base")
    return ", ".join(parts)
