"""What drops on a floor show, in sentences."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.lab.variables import with_error
from vibrosweep.mistakes import toml
from vibrosweep.model.restitution_laws import CONSTANT, SPEED

SHOWN: Final = 20  # remarks


def restitution_lines(found: xr.Dataset) -> list[str]:
    """Describe the restitution of a ball on a floor, or over a shaken base."""
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
    lines += [f"  {remark}" for remark in remarks[:SHOWN]]
    if len(remarks) > SHOWN:
        lines.append(f"  and {len(remarks) - SHOWN} more remarks")
    return lines


def _shaken_lines(found: xr.Dataset) -> list[str]:
    """Describe what times tell of a ball over a shaken base."""
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
            f"  contacts are taken as instantaneous: for each ms that they last e would be "
            f"{of_e:+.2g} and the acceleration {gamma:+.2g} different; state --contact"
        )
    return lines + [f"  {text}" for text in attributes["remarks"].split("\n") if text]


def _dependence(found: xr.Dataset) -> list[str]:
    per = "per m/s" if found.attrs["speed_known"] else "per unit of speed"
    slope, error = float(found["slope"]), float(found["slope_error"])
    if not np.isfinite(slope):
        return ["a dependence on the speed is not determined by so few bounces"]
    words = found.attrs["dependence"]
    lines = [f"slope of e {with_error(slope, error)} {per}"]
    if words == CONSTANT:
        lines[0] += ": no dependence on the speed is seen"
    else:
        lines[0] += f": e {words} with the speed"
        if not found.sizes["law"]:
            lines[0] += "; which law, or whether drag, these recordings do not determine"
    shown = []
    for name in found["law"].values:
        law = found.sel(law=name)
        keys: dict[str, Any] = {"restitution": float(f"{float(law['law_restitution']):.5g}")}
        if name in ("plastic", "viscoelastic"):
            speed = float(f"{float(law['law_speed']):.4g}")
            keys |= {"restitution_law": str(name), SPEED: speed}
        if name == "line":
            shown.append(f"a line of this slope, {keys['restitution']} at the median speed")
        else:
            shown.append(", ".join(f"{key} = {toml(value)}" for key, value in keys.items()))
    if shown:
        lines.append(f"fit equally, as in a sweep file: {'; or '.join(shown)}")
    return lines


def _scatter(found: xr.Dataset, drops: int) -> list[str]:
    lines = []
    for name, words in (("scatter", "bounce to bounce"), ("drop_scatter", "drop to drop")):
        value, limit = float(found[name]), float(found[f"{name}_limit"])
        low = float(found[f"{name}_quantile"][0])
        if not np.isfinite(value):
            few = "one drop" if drops == 1 and name == "drop_scatter" else "so few bounces"
            lines.append(f"scatter from {words} is not determined by {few}, and not in the error")
        elif low < 0.2 * value:
            lines.append(f"scatter from {words} not determined, at most {limit:.2g} (95 %)")
        else:
            low, high = found[f"{name}_quantile"].values[[1, 2]]
            lines.append(f"scatter from {words} {value:.2g} (68 %: {low:.2g} to {high:.2g})")
    another = float(found["prediction_error"])
    if np.isfinite(another):
        lines.append(f"the mean restitution of another drop is known to ± {another:.2g}")
    if np.isfinite(float(found["timing"])):
        lines.append(f"times of clicks are off by {1e3 * float(found['timing']):.2g} ms")
    return lines


def _inputs(found: xr.Dataset) -> list[str]:
    units = {"contact": (1e3, "ms"), "drag": (1.0, "s2/m2"), "gravity": (1.0, "m/s2")}
    lines = []
    for name in found["input"].values:
        if name == "none":
            continue
        factor, unit = units.get(str(name), (1.0, "m"))
        one = found.sel(input=name)
        value, error = factor * float(one["input_value"]), factor * float(one["input_error"])
        lines.append(
            f"{str(name).replace('_', ' ')} {value:.3g} ± {error:.2g} {unit}: contributes "
            f"{float(one['input_effect']):.2g} to the error of e"
        )
    effect = float(found["drag_effect"])
    if np.isfinite(effect):
        lines.append(
            f"drag is not corrected: with a terminal speed of 20 m/s e would be {effect:+.2g} "
            f"higher; state mass and diameter of the ball"
        )
    return lines


def numbers_of(found: xr.Dataset) -> dict[str, Any]:
    """Return the numbers of a result as JSON holds them: None where nothing is determined."""

    def plain(value: Any) -> Any:
        values = np.asarray(value).tolist()
        if isinstance(values, list):
            return [plain(one) for one in values]
        return None if isinstance(values, float) and not np.isfinite(values) else values

    numbers = {str(name): plain(one.values) for name, one in found.variables.items()}
    numbers |= {name: plain(value) for name, value in found.attrs.items()}
    return {name: value for name, value in numbers.items() if not name.startswith("sample_")}
