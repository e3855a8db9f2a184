"""Bounces of all drops, pooled: restitution, its dependence on the speed, its scatter."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.lab.components import (
    ZOOMS,
    Fit,
    Rows,
    covariance_of,
    fit_components,
    odd_row,
    solve,
    stack,
    weighted_residuals,
    without,
)
from vibrosweep.lab.drop_inputs import DRAG, POWER, BallInputs, Bounces, Input, from_range
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    LEAST_VISCOELASTIC,
    PLASTIC,
    VISCOELASTIC,
    restitution_at,
)

QUANTILES: Final = (0.025, 0.1587, 0.8413, 0.975)
ODD: Final = 4.0  # standard deviations of a bounce that is left out
MOST_ODD: Final = 0.1  # share of bounces that may be left out
FALLS: Final = 0.01  # size of the one-sided test of an e that falls with speed
RISES: Final = 0.001  # and of one that rises, which no law of this package does
EQUAL: Final = 6.63  # deviances that differ by less fit equally (1 %, one parameter)
LINE: Final = "line"
EDGE: Final = 0.1  # of the logarithm, to which a range is exact
TERMINAL: Final = 20.0  # m s-1, a terminal speed whose effect is stated
LINEARIZED: Final = 3  # times that clicks are adjusted
STARTS: Final = 7  # contacts that are tried first
ROUGH: Final = 2  # zooms of a fit that is only a step
SMOOTH: Final = 1e4  # precision that stands for an input without error


def _even(one: Input, deviate: Array) -> Array:
    """Return the logarithm of a prior that is even in the logarithm, over a normal one.

    Beyond the ends of the range it falls off smoothly.
    """
    low, high = one.ends or (0.0, np.inf)
    value = np.maximum(one.value + one.error * deviate, 1e-3 * low)
    logs = np.log(value)
    beyond = np.maximum(np.log(low) - logs, 0.0) + np.maximum(logs - np.log(high), 0.0)
    return np.asarray(-logs - 0.5 * (beyond / EDGE) ** 2 + 0.5 * deviate**2)


class Pool:
    """Drops with the columns of the inputs that matter to them."""

    def __init__(self, drops: list[Bounces], inputs: BallInputs) -> None:
        self.drops = drops
        every: dict[str, Input] = {"contact": inputs.contact, "gravity": inputs.gravity}
        filmed = any(drop.gravity for drop in drops)
        if any(drop.about for drop in drops):
            every["contact_power"] = POWER
        if inputs.drag or filmed:
            every["drag"] = inputs.drag or from_range(*DRAG)
        if inputs.drop_height:
            every["drop_height"] = inputs.drop_height
        self.inputs = {
            name: one
            for name, one in every.items()
            if one.error > 0.0 or any(name in drop.found for drop in drops)
        }
        self.prior = [1.0 if one.error > 0.0 else SMOOTH for one in self.inputs.values()]
        self.speed = np.concatenate([drop.speed for drop in drops])
        self.odd: list[tuple[int, int]] = []
        self.reference = float(np.median(self.speed))
        self.rows = self._rows()

    def _rows(self) -> Rows:
        blocks = []
        for drop in self.drops:
            n = drop.restitution.size
            names = list(drop.found)
            size = n + len(names)
            columns = [np.ones(size), np.zeros(size)]
            columns[0][n:] = 0.0
            columns[1][:n] = drop.speed - self.reference
            for name, one in self.inputs.items():
                slope = drop.inputs.get(name, np.zeros(size))
                columns.append(slope * self._unit(one))
            value = np.concatenate([drop.restitution, [drop.found[name] for name in names]])
            bounce = np.repeat([1.0, 0.0], [n, len(names)])
            blocks.append((value, np.stack(columns, 1), drop.fixed, drop.timing, bounce))
        return stack(blocks)

    @staticmethod
    def _unit(one: Input) -> float:
        return one.error or max(abs(one.value), 1e-6) * 1e-3

    @staticmethod
    def _free(rows: Rows, slope: bool) -> tuple[bool, bool, bool]:
        """Return which components the bounces can tell."""
        bounces = int(rows.bounce.sum())
        heard, many = bool(rows.timing.any()), int((rows.bounce.sum(1) > 0.0).sum()) > 1
        return heard and bounces > 2, bounces > 1 + slope, many

    def fit(self, rows: Rows, slope: bool, zooms: int = ZOOMS) -> Fit:
        """Fit with or without a slope, which a precision then holds at 0."""
        prior = np.array([0.0, 0.0 if slope else 1e12, *self.prior])
        fit = fit_components(rows, prior, self._free(rows, slope), zooms)
        for k, (name, one) in enumerate(self.inputs.items()):
            if one.ends and not any(name in drop.found for drop in self.drops):
                fit = fit.reweighted(2 + k, partial(self._prior, name, one))
        return fit

    def _prior(self, name: str, one: Input, deviate: Array) -> Array:
        """Return the logarithm of the prior of an input over a normal one.

        Scatter is one of restitutions, which follow from intervals: with the contact changes by
        how much an interval changes a restitution, and so the probability of the interval.
        """
        factor = _even(one, deviate)
        if name == "contact":
            contact = one.value + one.error * deviate
            left = {k: set(range(drop.speed.size)) for k, drop in enumerate(self.drops)}
            for k, row in self.odd:
                left[k].discard(row)
            for k, drop in enumerate(self.drops):
                if drop.before is None:
                    continue
                before = drop.before[sorted(left[k])]
                before = before[np.isfinite(before)]
                lasting = contact[..., None] * (before / drop.middle) ** -POWER.value
                flight = np.maximum(before - lasting, 0.1 * before)
                factor = factor - np.log(flight / before).sum(-1)
        return factor

    def _start(self) -> None:
        """Linearize about the contact, of a few in its range, that describes times best."""
        one = self.inputs.get("contact")
        if one is None or not one.ends:
            return
        column, best = 2 + list(self.inputs).index("contact"), -np.inf
        first = list(self.drops)
        for contact in np.geomspace(*one.ends, STARTS):
            drops = [d.about(0.0, {"contact": contact}) if d.about else d for d in first]
            self.drops, deviate = drops, (contact - one.value) / one.error
            rows = self._rows()
            held = rows._replace(value=rows.value - rows.design[..., column] * deviate)
            prior = np.array([0.0, 0.0, *self.prior])
            prior[column] = 1e12
            fit = fit_components(held, prior, self._free(rows, slope=True), 1)
            evidence = fit.evidence + float(self._prior("contact", one, np.array(deviate)))
            evidence -= 0.5 * deviate**2
            if evidence > best:
                best, kept = evidence, drops
        self.drops = kept
        self.rows = self._rows()

    def _linearize(self, fit: Fit) -> None:
        """Linearize about the clicks as the fit adjusts them.

        Ratios of noisy intervals are biased, and more so their errors with which they are weighted.
        """
        pulled, _ = weighted_residuals(self.rows, fit)
        off = fit.moments()[0][2:]
        at = {
            name: max(one.value + self._unit(one) * d, 0.1 * one.value)
            for (name, one), d in zip(self.inputs.items(), off, strict=True)
        }
        for k, drop in enumerate(self.drops):
            if drop.about is None or drop.clicks is None:
                continue
            variance = fit.components[0] ** 2 + drop.rounding**2 / 12.0
            shift = -variance * drop.clicks.T @ pulled[k, : len(drop.clicks)]
            self.drops[k] = drop.about(shift, at)
        self.rows = self._rows()
        for drop_row in self.odd:
            self.rows = without(self.rows, *drop_row)

    def _without_odd(self) -> Fit:
        limit = MOST_ODD * self.rows.bounce.sum()
        slope = self.rows.bounce.sum() > 3 and float(np.ptp(self.speed)) > 0.0
        heard = any(drop.about for drop in self.drops)
        if heard and slope:
            self._start()
        fit = self.fit(self.rows, slope, ROUGH)
        for _ in range(LINEARIZED if heard else 0):
            self._linearize(fit)
            fit = self.fit(self.rows, slope, ROUGH)
        while len(self.odd) + 1 <= limit:
            far, drop, row = odd_row(self.rows, fit)
            if far < ODD:
                break
            self.odd.append((drop, row))
            self.rows = without(self.rows, drop, row)
            fit = self.fit(self.rows, slope, ROUGH)
        return self.fit(self.rows, slope)

    def result(self, remarks: list[str]) -> xr.Dataset:
        """Return the result of the pool."""
        line = self._without_odd()
        constant = self.fit(self.rows, slope=False)
        mean, covariance = line.moments()
        bounces = int(self.rows.bounce.sum())
        tested = bounces > 3
        below = line.share_below(1, 0.0) if tested else 0.5
        falls, rises = 1.0 - below < FALLS, below < RISES
        chosen = line if falls or rises else constant
        if tested:  # the speed at which e and slope are independent, so that both fits agree
            shift = -covariance[0, 1] / covariance[1, 1]
            low, high = self.speed.min(), self.speed.max()
            speed = float(np.clip(self.reference - shift, low, high))
        else:
            speed = self.reference
        move = np.eye(len(mean))
        move[0, 1] = speed - self.reference
        chosen = chosen._replace(
            mean=chosen.mean @ move.T, covariance=move @ chosen.covariance @ move.T
        )
        quantiles = np.array([chosen.quantile(0, q) for q in QUANTILES])
        e, full = chosen.moments()[0][0], chosen.moments()[1]
        error = float(quantiles[2] - quantiles[1]) / 2.0
        apparent = [drop.gravity or Input(np.nan, np.nan) for drop in self.drops]
        filmed = all(drop.gravity for drop in self.drops)
        words = "falls" if falls else "rises" if rises else CONSTANT
        laws = self._laws(line, speed, words, filmed)
        variables: dict[str, Any] = {
            "restitution": float(e),
            "restitution_error": error,
            "restitution_quantile": ("quantile", quantiles),
            "speed": speed,
            "slope": float(mean[1]) if tested else np.nan,
            "slope_error": float(np.sqrt(covariance[1, 1])) if tested else np.nan,
            **self._components(chosen, bounces),
            **self._bounce_variables(chosen),
            "law_restitution": ("law", [law[1] for law in laws]),
            "law_speed": ("law", [law[2] for law in laws]),
            "law_deviance": ("law", [law[3] for law in laws]),
            **self._drop_variables(chosen, error),
            "drop_gravity": ("drop", [g.value for g in apparent]),
            "drop_gravity_error": ("drop", [g.error for g in apparent]),
            **self._budget(chosen, full),
        }
        coordinates = {
            "quantile": list(QUANTILES),
            "law": [law[0] for law in laws],
            "drop": [drop.name for drop in self.drops],
            "input": list(self.inputs) or ["none"],
        }
        attributes = {
            "bounces": bounces,
            "dependence": words,
            "speed_known": int(all(drop.speed_known for drop in self.drops)),
            "filmed": int(filmed),
            "remarks": "\n".join([*remarks, *self._remarks()]),
        }
        return xr.Dataset(variables, coords=coordinates, attrs=attributes)

    def _remarks(self) -> list[str]:
        texts = [f"{drop.name}: {text}" for drop in self.drops for text in drop.remarks]
        for k, row in self.odd:
            drop = self.drops[k]
            texts.append(
                f"{drop.name}: the bounce at {drop.time[row]:.5g} s is odd "
                f"(e = {drop.restitution[row]:.3f}) and left out"
            )
        return texts

    def _components(self, fit: Fit, bounces: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        wanted = (0.5, *QUANTILES, 0.95)
        for k, name in enumerate(("timing", "scatter", "drop_scatter")):
            given = fit.nodes[:, k].any()
            values = [fit.component_quantile(k, q) if given else np.nan for q in wanted]
            found[name] = values[0]
            found[f"{name}_quantile"] = ("quantile", values[1:5])
            found[f"{name}_limit"] = values[5]
        return found

    def _bounce_variables(self, fit: Fit) -> dict[str, Any]:
        joined = {
            name: np.concatenate([getattr(drop, name) for drop in self.drops])
            for name in ("restitution", "speed", "time")
        }
        timing = fit.components[0]
        errors = [
            np.sqrt(np.diag(d.fixed + timing**2 * d.timing))[: d.restitution.size]
            for d in self.drops
        ]
        used = [
            [(k, row) not in self.odd for row in range(drop.restitution.size)]
            for k, drop in enumerate(self.drops)
        ]
        counts = [drop.restitution.size for drop in self.drops]
        return {
            **{f"bounce_{name}": ("bounce", values) for name, values in joined.items()},
            "bounce_error": ("bounce", np.concatenate(errors)),
            "bounce_used": ("bounce", np.concatenate(used).astype(np.int8)),
            "bounce_drop": ("bounce", np.repeat(np.arange(len(counts)), counts)),
        }

    def _drop_variables(self, fit: Fit, error: float) -> dict[str, Any]:
        """Return the restitution of each drop by itself, and with what error another is known."""
        mean, (timing, scatter, _) = fit.moments()[0], fit.components
        alone = covariance_of(self.rows, np.array([[timing, scatter, 0.0]]))[0]
        columns = np.stack([self.rows.bounce, self.rows.value - self.rows.design @ mean], axis=2)
        ones, left = np.moveaxis(np.linalg.solve(alone, columns), 2, 0)
        size = np.einsum("dr,dr->d", self.rows.bounce, ones)
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.einsum("dr,dr->d", self.rows.bounce, left) / size
        many = len(self.drops) > 1
        drops = float(fit.weight @ fit.nodes[:, 2] ** 2) if many else np.nan
        return {
            "drop_restitution": ("drop", np.where(size > 0.0, mean[0] + off, np.nan)),
            "drop_restitution_error": ("drop", np.where(size > 0.0, size, np.nan) ** -0.5),
            "prediction_error": float(np.sqrt(error**2 + drops)),
        }

    def _budget(self, fit: Fit, covariance: Array) -> dict[str, Any]:
        """State each input as the data leave it, and what it contributes to the error of e."""
        mean = fit.moments()[0]
        names = list(self.inputs)
        ones = list(self.inputs.values())
        scales = np.array([self._unit(one) for one in ones])
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        after = spread[2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = covariance[0, 2:] / after
            correlation = covariance / np.outer(spread, spread)
        parameters = ["restitution", "slope", *names]
        bare = np.concatenate(
            [
                drop.inputs.get("drag", np.zeros(drop.restitution.size))[: drop.restitution.size]
                for drop in self.drops
            ]
        )
        heard = not any(drop.gravity for drop in self.drops)
        return {
            "input_value": ("input", np.array([one.value for one in ones]) + mean[2:] * scales)
            if names
            else ("input", [np.nan]),
            "input_error": ("input", after * scales if names else [np.nan]),
            "input_effect": ("input", np.abs(shares) if names else [np.nan]),
            "drag_effect": -float(bare.mean()) / TERMINAL**2
            if heard and "drag" not in self.inputs
            else np.nan,
            "correlation": (("parameter", "other"), correlation),
            "parameter": ("parameter", parameters),
            "other": ("other", parameters),
        }

    def _laws(
        self, line: Fit, speed: float, words: str, named: bool
    ) -> list[tuple[str, float, float, float]]:
        """Return the laws that fit, with restitution, speed, and deviance above the best."""
        nodes = line.components[None]
        used = np.flatnonzero(self.rows.bounce.ravel() > 0.0)
        v = self.rows.design[..., 1] + self.reference
        tried: list[tuple[str, float, float, float]] = []

        def deviance(shape: Array, slope: bool) -> tuple[float, float]:
            """Fit a multiple of a shape, or a line."""
            design = self.rows.design.copy()
            design[..., 0] = self.rows.bounce * shape
            prior = np.array([0.0, 0.0 if slope else 1e12, *self.prior])
            _, mean, _, square = solve(self.rows._replace(design=design), nodes, prior)
            return float(square[0]), float(mean[0, 0])

        base, e0 = deviance(np.ones_like(v), False)
        tried.append((CONSTANT, e0, np.nan, base))
        if not named or not used.size or self.rows.bounce.sum() < 4:
            return [(CONSTANT, e0, np.nan, 0.0)] if words == CONSTANT else []
        square, e = deviance(np.ones_like(v), True)
        tried.append((LINE, e, np.nan, square))
        speeds = np.maximum(v, 1e-9)
        plastic = [
            (*deviance(np.maximum(speeds / y, 1.0) ** -0.25, False), y)
            for y in np.geomspace(0.2 * self.speed.min(), self.speed.max(), 25)
        ]
        best = min(plastic)
        tried.append((PLASTIC, best[1], best[2], best[0]))
        if LEAST_VISCOELASTIC < e0 < 1.0:
            e = e0
            for _ in range(6):  # the law is nearly proportional to its restitution
                shape = restitution_at(
                    speeds, min(max(e, LEAST_VISCOELASTIC), 0.9999), VISCOELASTIC, speed
                )
                square, factor = deviance(shape, False)
                e *= factor
            if LEAST_VISCOELASTIC <= e < 1.0:
                tried.append((VISCOELASTIC, e, speed, square))
        least = min(law[3] for law in tried)
        kept = [law for law in tried if law[3] - least < EQUAL]
        kept = [law for law in kept if law[0] != CONSTANT or words == CONSTANT]
        return [(a, b, c, d - least) for a, b, c, d in sorted(kept, key=lambda law: law[3])]
