"""Results of the laboratory as lines of text, and the data of its figures."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.errors import DataError
from vibrosweep.lab.base_fit import INSTANT
from vibrosweep.lab.compare import READINGS
from vibrosweep.lab.estimation import estimate
from vibrosweep.lab.fitting import FittedTracks
from vibrosweep.lab.flights import line_variance
from vibrosweep.lab.impacts import DOUBTFUL, OF_BOUNCES, STAYED
from vibrosweep.lab.regression import law_text
from vibrosweep.lab.tracks import remarks
from vibrosweep.lab.variables import with_error
from vibrosweep.mistakes import toml
from vibrosweep.model.restitution_laws import CONSTANT, NUMBERS_OF, POINTS, SPEED, points_of
from vibrosweep.model.shapes import HARMONICS_NAME, SINE
from vibrosweep.scene.scene import stored

# -----------------------------------------------------------------------------
# Reports on drops on a floor.

MOST_REMARKS: Final = 20  # in a report


def restitution_lines(found: xr.Dataset) -> list[str]:
    """Report the restitution of a ball on a floor, or over a shaken base."""
    if "frequency" in found:
        return _shaken_lines(found)
    unit = " m/s" if found.attrs["speed_known"] else " (scale or frame rate not known)"
    e, error = float(found["restitution"]), float(found["restitution_error"])
    bounces, drops = int(found.attrs["bounces"]), found.sizes["drop"]
    counted = f"{bounces} bounce{'s'[: bounces - 1]} of {drops} drop{'s'[: drops - 1]}"
    low, high = found["restitution_quantile"].values[[0, 3]]
    lines = [
        f"restitution {with_error(e, error)} at an impact speed of {float(found['speed']):.3g}"
        f"{unit}, from {counted}; 95 %: {low:.4f} to {high:.4f}",
        *(
            f"  {name or 'the other recordings'}: {with_error(float(one), float(error))} at "
            f"{float(speed):.3g}{unit}"
            for name, one, error, speed in zip(
                found["group"].values,
                *(
                    found[f"group_{k}"].values
                    for k in ("restitution", "restitution_error", "speed")
                ),
                strict=True,
            )
        ),
        *_dependence(found),
        *_scatter(found, drops),
        *_inputs(found),
    ]
    if not found.attrs["speed_known"]:
        lines.append("e needs neither scale nor frame rate; speeds need both")
    remarks = found.attrs["remarks"].split("\n") if found.attrs["remarks"] else []
    lines += [f"  {remark}" for remark in remarks[:MOST_REMARKS]]
    if len(remarks) > MOST_REMARKS:
        lines.append(f"  and {len(remarks) - MOST_REMARKS} more remarks")
    return lines


def _shaken_lines(found: xr.Dataset) -> list[str]:
    """Report the results from times of impacts over a shaken base."""
    values = {
        name: with_error(float(found[name]), float(found[f"{name}_error"]))
        for name in ("restitution", "frequency", "base_acceleration", "phase")
    }
    attributes, name = found.attrs, str(found["drop"].values[0])
    lines = [f"{name}: {attributes['bounces']} bounces over a base that moves"]
    if int(found["determined"]):
        given = " (given)" if attributes["frequency_known"] else ""
        frequency = f"{float(found['frequency']):.6g}" if given else values["frequency"]
        lines += [
            f"  frequency {frequency} Hz{given}, acceleration {values['base_acceleration']} of "
            f"gravity, phase {values['phase']} rad at t = 0; restitution {values['restitution']}",
            f"  correlation of restitution and acceleration {float(found['correlation']):.2f}",
        ]
    else:
        lines.append(f"  restitution and acceleration are not determined: {attributes['warning']}")
    lines += [f"  {line}" for line in _scatter(found, 1) if "drop to drop" not in line]
    if not attributes["contact_known"]:
        of_e, gamma = found["contact_effect"].values
        lines.append(
            f"  contacts are assumed instantaneous: each ms of contact time would change e by "
            f"{of_e:+.2g} and the acceleration by {gamma:+.2g}; give --contact"
        )
    return lines + [f"  {text}" for text in attributes["remarks"].split("\n") if text]


def _dependence(found: xr.Dataset) -> list[str]:
    per = "per m/s" if found.attrs["speed_known"] else "per unit of speed"
    slope, error = float(found["slope"]), float(found["slope_error"])
    if not np.isfinite(slope):
        return ["a dependence on speed is not determined by so few bounces"]
    words = found.attrs["dependence"]
    lines = [f"slope of e {with_error(slope, error)} {per}"]
    if words == CONSTANT:
        lines[0] += ": no significant dependence on speed"
    else:
        lines[0] += f": e {words} with speed"
        if not found.sizes["law"]:
            lines[0] += "; these recordings do not distinguish between laws of restitution and drag"
    shown = []
    for name in found["law"].values:
        law = found.sel(law=name)
        keys: dict[str, Any] = {"restitution": float(f"{float(law['law_restitution']):.5g}")}
        if name in ("plastic", "viscoelastic"):
            speed = float(f"{float(law['law_speed']):.4g}")
            keys |= {"restitution_law": str(name), SPEED: speed}
        if name == "line" and (points := _ends_of_line(found, float(law["law_restitution"]))):
            keys = {"restitution_law": POINTS, NUMBERS_OF[POINTS]: points}
        elif name == "line":
            shown.append(f"a line of this slope, {keys['restitution']} at the median speed")
            continue
        shown.append(", ".join(f"{key} = {toml(value)}" for key, value in keys.items()))
    if shown:
        lines.append(f"fit equally, as in a sweep file: {'; or '.join(shown)}")
    return lines


def _ends_of_line(found: xr.Dataset, middle: float) -> list[list[float]]:
    """Return the ends of a line over the range of impact speeds, as points of a law.

    `middle` is its restitution at the median speed.  The list is empty if a sweep does not allow
    these points, or if the unit of speed is not known.
    """
    speeds = found["bounce_speed"].values
    used = speeds[found["bounce_used"].values == 1]
    if not found.attrs["speed_known"]:
        return []
    slope, median = float(found["slope"]), float(np.median(speeds))
    ends = [
        [float(f"{v:.4g}"), float(f"{middle + slope * (v - median):.5g}")]
        for v in (used.min(), used.max())
    ]
    try:
        points_of(ends)
    except ValueError:
        return []
    return ends


def _scatter(found: xr.Dataset, drops: int) -> list[str]:
    lines = []
    for name, words in (("scatter", "bounce to bounce"), ("drop_scatter", "drop to drop")):
        value, limit = float(found[name]), float(found[f"{name}_limit"])
        low = float(found[f"{name}_quantile"][0])
        if not np.isfinite(value):
            few = "one drop" if drops == 1 and name == "drop_scatter" else "so few bounces"
            text = f"scatter from {words} is not determined by {few}"
            lines.append(f"{text}, nor included in the error")
        elif low < 0.2 * value:
            lines.append(f"scatter from {words} not determined, at most {limit:.2g} (95 %)")
        else:
            low, high = found[f"{name}_quantile"].values[[1, 2]]
            lines.append(f"scatter from {words} {value:.2g} (68 %: {low:.2g} to {high:.2g})")
    another = float(found["prediction_error"])
    if np.isfinite(another):
        lines.append(f"prediction error for the mean restitution of another drop {another:.2g}")
    if np.isfinite(float(found["timing"])):
        lines.append(f"standard deviation of click times {1e3 * float(found['timing']):.2g} ms")
    return lines


def _inputs(found: xr.Dataset) -> list[str]:
    units = {
        "contact": (1e3, "ms"),
        "contact_power": (1.0, ""),
        "drag": (1.0, "s2/m2"),
        "gravity": (1.0, "m/s2"),
    }
    lines = []
    for name in found["input"].values:
        if name == "none":
            continue
        factor, unit = units.get(str(name), (1.0, "m"))
        one = found.sel(input=name)
        value, error = factor * float(one["input_value"]), factor * float(one["input_error"])
        words = f"{str(name).replace('_', ' ')} {value:.3g} ± {error:.2g} {unit}".strip()
        lines.append(f"{words}: contributes {float(one['input_effect']):.2g} to the error of e")
    effect = float(found["drag_effect"])
    if np.isfinite(effect):
        lines.append(
            f"drag is not corrected: a terminal speed of 20 m/s would change e by {effect:+.2g}; "
            f"give mass and diameter of the ball"
        )
    return lines


def numbers_of(found: xr.Dataset) -> dict[str, Any]:
    """Return the variables and attributes of a result, without samples of films."""
    numbers = {str(name): one.values for name, one in found.variables.items()}
    return {name: value for name, value in numbers.items() if not name.startswith("sample_")} | {
        str(name): value for name, value in found.attrs.items()
    }


# -----------------------------------------------------------------------------
# Results of the laboratory as lines of text, and the data of its figures.

SEEN: Final = 3.0  # standard errors from which a contact time is reported as a value
ONE_SIDED: Final = 1.645  # standard errors of a one-sided 95 % limit
SCATTERS: Final = 0.5  # ratio to its upper limit above which a scatter is reported as a value
INSTANTS: Final = 24  # plotted points of the base per period of its highest harmonic


def impact_lines(impacts: xr.Dataset) -> list[str]:
    """Report the landings of a recording and its defects."""
    attributes = impacts.attrs
    quality = impacts["quality"].values
    error = impacts["landing_time_error"].values
    typical = float(np.nanmedian(error)) if np.isfinite(error).any() else float("nan")
    lines = [
        f"{attributes['source']}: {int(impacts['impact_count'].sum())} landings of "
        f"{impacts.sizes['particle']} particles in {attributes['end'] - attributes['begin']:.4g} s "
        f"at {attributes['frame_rate']:.4g} frames per second",
        f"  standard error of a landing time {typical:.2g} s, or "
        f"{typical * attributes['frame_rate']:.2g} frames; noise of a position "
        f"{attributes['noise']:.2g} m; base at {attributes['base']:.3g} m",
    ]
    lines += [f"  {line}" for line in _base_lines(impacts)]
    stays, doubtful = int((quality == STAYED).sum()), int((quality == DOUBTFUL).sum())
    if stays:
        lines.append(f"  {stays} stays on the base, or bounces too low or short to be seen")
    if doubtful:
        lines.append(f"  {doubtful} landings next to poorly fitted flights are doubtful")
    return lines + [f"  {remark}" for remark in remarks(impacts)]


def impact_numbers(impacts: xr.Dataset) -> dict[str, Any]:
    """Return the numbers of `impact_lines`, with their errors."""
    numbers: dict[str, Any] = {str(name): value for name, value in impacts.attrs.items()}
    numbers["landings"] = int(impacts["impact_count"].sum())
    if impacts.attrs["base_motion"] == "level":
        return numbers
    found = estimate(impacts)
    for name in found["parameter"].values:
        one = found.sel(parameter=name, other=name)
        numbers |= {name: float(one["estimate"]), f"{name}_error": float(one["error"])}
    numbers |= {str(name): one.item() for name, one in found.data_vars.items() if not one.dims}
    return numbers | found.attrs


def _base_lines(impacts: xr.Dataset) -> list[str]:
    """Report the motion of the base."""
    if impacts.attrs["base_motion"] == "level":
        favoured = _favoured(impacts)
        doubt = "; the landings do not determine whether it moves"
        return ["the base stays at its level" + ("" if favoured == "level" else doubt)]
    found = estimate(impacts)
    e, _, phase = found["estimate"].values[:3]
    de, _, dphase = found["error"].values[:3]
    size, gamma = (
        (float(found[name]), float(found[f"{name}_error"]))
        for name in ("base_displacement", "base_acceleration")
    )
    remarks_on_fit = [text for text in (law_text(found), found.attrs["warning"]) if text]
    if not int(found["determined"]):
        return ["the base moves, but its motion is not determined", *remarks_on_fit]
    return [
        f"the base moves: displacement {with_error(1e3 * size[0], 1e3 * size[1])} mm at "
        f"{float(found['frequency_used']):.6g} Hz, acceleration {with_error(*gamma)} of gravity, "
        f"phase {with_error(phase, dphase)} rad; restitution {with_error(e, de)}",
        *_harmonic_lines(found),
        *_lines_of_bounces(found),
        *remarks_on_fit,
    ]


def motion_lines(found: xr.Dataset, source: str, origin: float) -> list[str]:
    """Report the measured motion of a base, the result of `base_motion`."""
    values = dict(zip(found["parameter"].values.tolist(), found["estimate"].values, strict=True))
    errors = dict(zip(found["parameter"].values.tolist(), found["error"].values, strict=True))
    velocity, phase, frequency = (
        with_error(values[k], errors[k], 8) for k in ("base_velocity", "phase", "frequency")
    )
    size, gamma = (
        (float(found[name]), float(found[f"{name}_error"]))
        for name in ("base_displacement", "base_acceleration")
    )
    clock = f"on a clock that starts at {origin:.0f} s of the trace" if origin else "at t = 0"
    keys = {k: float(f"{values[k]:.8g}") for k in ("frequency", "base_velocity", "phase")}
    shape = _harmonic_lines(found)
    return [
        f"{source}: frequency {frequency} Hz",
        f"  displacement {with_error(1e3 * size[0], 1e3 * size[1], 5)} mm, acceleration "
        f"{with_error(*gamma, 5)} of gravity, velocity {velocity} m/s",
        f"  phase {phase} rad {clock}",
        *(f"  {line}" for line in shape[:1]),
        "in a sweep file:",
        *(f"{key} = {toml(value)}" for key, value in keys.items()),
        *(line.removeprefix("in a sweep file: ") for line in shape[1:]),
    ]


def _lines_of_bounces(found: xr.Dataset) -> list[str]:
    """Report contact time and scatter of the restitution, or their upper limits."""
    contact, error, effect, scatter, limit = (float(found[name]) for name in OF_BOUNCES)
    scattered = f"{scatter:.2g}, " if scatter > SCATTERS * limit else "not detected, "
    lines = [f"scatter of e from bounce to bounce {scattered}at most {limit:.2g} (95 %)"]
    if error > INSTANT.error:  # contacts last
        lasts = f"last {with_error(1e3 * contact, 1e3 * error)} ms"
        if contact < SEEN * error:
            lasts = f"last at most {1e3 * max(contact + ONE_SIDED * error, 0.0):.2g} ms (95 %)"
        lines.append(f"contacts {lasts}, which contributes {effect:.2g} to the error of e")
    return lines


def _harmonic_lines(found: xr.Dataset) -> list[str]:
    """Report weights and phases of the harmonics of the base, and its waveform in a sweep file."""
    shape = stored(found.attrs)
    if shape == SINE:
        return []
    errors = dict(zip(found["parameter"].values.tolist(), found["error"].values, strict=True))
    parts = []
    for h, weight, psi in shape.tones:
        part = "weight 1"
        if f"weight_{h}" in errors:
            turned = with_error(psi, errors[f"phase_{h}"])
            part = f"{with_error(weight, errors[f'weight_{h}'])}, phase {turned}"
        parts.append(f"{h} of {part}")
    rounded = [[h, float(f"{weight:.6g}"), float(f"{psi:.6g}")] for h, weight, psi in shape.tones]
    return [
        f"harmonics of its velocity: {'; '.join(parts)}",
        f"in a sweep file: waveform = {toml({HARMONICS_NAME: rounded})}",
    ]


def agreement_lines(found: xr.Dataset) -> list[str]:
    """Tabulate mean, standard deviation and coefficient of variation over the recordings."""
    repeats = found.attrs["repeats"]
    words = {1: "yes", 0: "no", -1: ""}
    lines = [
        f"{'quantity':22}{'mean':>12}{'sd':>11}{'variation':>11}{'below 8 %':>11}"
        if repeats > 1
        else f"{'quantity':22}{'value':>12}"
    ]
    for name in found["quantity"].values:
        row = found.sel(quantity=name)
        if not np.isfinite(float(row["mean"])):
            continue
        line = f"{name:22}{float(row['mean']):>12.5g}"
        if repeats > 1:
            variation = float(row["variation"])
            shown = f"{100.0 * variation:.2g} %" if np.isfinite(variation) else ""
            line += f"{float(row['sd']):>11.2g}{shown:>11}{words[int(row['accepted'])]:>11}"
        unit = str(row["units"].values)
        lines.append(f"{line}  {unit}" if unit != "1" else line)
    return lines


def table_lines(table: xr.Dataset) -> list[str]:
    """Tabulate a comparison, and list other definitions of its errors below."""
    lines = [
        f"{'case':10}{'repeats':>9}{'compared':>10}  {'quantity':10}{'measured':>11}"
        f"{'predicted':>11}{'error %':>9}{'frames %':>10}{'pixels %':>10}{'params %':>10}"
    ]
    for case in table["case"].values:
        row = table.sel(case=case)
        head = f"{case:10}{int(row['repeats']):>9}{100.0 * float(row['compared']):>8.0f} %"
        for q in table["quantity"].values:
            cell = row.sel(quantity=q, reading="particle")
            numbers = [float(cell[name]) for name in ("measured", "predicted")]
            parts = [float(cell[name]) for name in ("frames", "pixels", "parameters")]
            unit = str(cell["units"].values)
            lines.append(
                f"{head:29}  {q + ' (' + unit + ')':10}{numbers[0]:>11.5g}{numbers[1]:>11.5g}"
                f"{float(cell['error']):>9.2f}" + "".join(f"{part:>10.2f}" for part in parts)
            )
            head = ""
    lines.append(
        "error = |measured - predicted| / measured: the mean over particles; other readings:"
    )
    for case in table["case"].values:
        irregular = "irregular" in table and float(table["irregular"].sel(case=case)) > 0.0
        readings = [r for r in READINGS if not (irregular and r == "flight")]
        for q in table["quantity"].values:
            error = table["error"].sel(case=case, quantity=q)
            shown = ", ".join(f"{r} {float(error.sel(reading=r)):.2f} %" for r in readings)
            lines.append(f"  {case} {q}: {shown}")
        if irregular:
            lines += _distribution_lines(table.sel(case=case), str(case))
    moves = table.attrs["base_motion"] == "moving"
    forcing = "base_acceleration" if moves else "amplitude"
    law = str(table.attrs.get("restitution_law", CONSTANT))
    names = ["restitution", forcing, "frequency", *([SPEED] if law != CONSTANT else [])]
    parameters = [  # means over the cases
        f"{name} {with_error(float(table[name].mean()), float(table[f'{name}_error'].mean()), 5)}"
        for name in names
    ]
    base = "moves" if moves else "stays at its level"
    lines.append(f"predicted over a base that {base}, with {', '.join(parameters)}")
    if str(table.attrs.get("waveform", SINE.text)) != SINE.text:
        lines.append(f"waveform {table.attrs['waveform']}")
    if law != CONSTANT:
        lines.append(f"restitution_law {law}")
    lines.append(f"base favoured by the landings: {_favoured(table)}")
    return lines + [table.attrs[name] for name in ("law", "warning") if table.attrs.get(name)]


def _distribution_lines(row: xr.Dataset, case: str) -> list[str]:
    """Compare the distributions of flights of irregular motion."""
    share, chance = float(row["irregular"]), float(row["distribution_chance"])
    apart = ", ".join(
        f"of {name} {float(value):.2g}"
        for name, value in zip(row["quantity"].values, row["distribution_distance"], strict=True)
    )
    return [
        f"  {case}: the motion of {100.0 * share:.0f} % of the particles is irregular: errors of "
        f"the initial conditions grow, so that single flights cannot be predicted;",
        f"  largest difference of the distributions of flights {apart}; by chance up to "
        f"{chance:.2g} (95 % of pairs of predictions)",
    ]


def _favoured(found: xr.Dataset) -> str:
    """Return the base favoured by the landings."""
    if "favoured_base" not in found.attrs:
        raise DataError("was written by an earlier version of vibrosweep; compute it again")
    return str(found.attrs["favoured_base"])


def flights_of(tracks: xr.Dataset, fitted: FittedTracks) -> xr.Dataset:
    """Samples, fitted flights and landings of a recording, for its figure.

    Times are in s, heights in m.  Dim sample: ``time``, ``height``, ``particle``, ``residual`` (in
    standard errors, NaN between flights) and ``within``, the position of the sample in its flight,
    from 0 to 1.  Dim flight: ``start``, ``end``, and at the start ``speed`` (m s-1) and ``rise``,
    the height; ``owner``, its particle.  Dim landing: ``landing_time``, ``landing_error``,
    ``landing_height``, ``landing_owner``.  Dim instant: ``base_time`` and ``base_height``, of a
    moving base above its level.  Dim track: the ``level`` below the particle ``name``.  Attributes:
    ``noise``, ``base``, ``curvature``, ``frame_rate``.
    """
    samples, flights = fitted.samples, fitted.flights
    fits, joint, member = flights.fits, flights.junctions, flights.member
    up, down, _, _ = flights.ends
    curvature, used = flights.curvature, member >= 0
    flown = fits.take(member)
    with np.errstate(invalid="ignore", divide="ignore"):
        # a fit absorbs part of the noise of each sample
        left = np.sqrt(np.maximum(1.0 - line_variance(flown, samples.time), 1e-12))
        within = np.where(used, (samples.time - up[member]) / (down - up)[member], np.nan)
    off = samples.height - flown.height(samples.time, curvature)
    residual = np.where(used, off / (flights.noise * left), np.nan)
    landed = fits.take(joint.before).height(joint.landing, curvature)
    names = tracks["particle"].values
    variables = {
        "time": ("sample", samples.time),
        "height": ("sample", samples.height),
        "particle": ("sample", names[samples.particle]),
        "residual": ("sample", residual),
        "within": ("sample", within),
        "start": ("flight", up),
        "end": ("flight", down),
        "speed": ("flight", fits.slope - curvature * (up - fits.centre)),
        "rise": ("flight", fits.height(up, curvature)),
        "owner": ("flight", names[flights.particle]),
        "landing_time": ("landing", joint.landing),
        "landing_error": ("landing", joint.landing_error),
        "landing_height": ("landing", landed),
        "landing_owner": ("landing", names[flights.particle[joint.before]]),
        "level": ("track", flights.levels),
        "name": ("track", names),
    }
    if flights.base_fit is not None:
        base, length = flights.base_fit.oscillation, np.ptp(samples.time)
        number = int(length * base.frequency * max(base.numbers) * INSTANTS) + 2
        when = np.linspace(samples.time.min(), samples.time.max(), number)
        variables |= {"base_time": ("instant", when), "base_height": ("instant", base.height(when))}
    return xr.Dataset(
        variables,
        attrs={
            "noise": flights.noise,
            "base": flights.base,
            "curvature": curvature,
            "frame_rate": tracks.attrs["frame_rate"],
        },
    )
