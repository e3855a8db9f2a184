"""Bounces of all drops, pooled: restitution, its dependence on the speed, its scatter."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.lab.components import Fit, Rows, fit_components, odd_row, solve, stack, without
from vibrosweep.lab.drop_inputs import DRAG, BallInputs, Bounces, Input, from_range
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
TERMINAL: Final = 20.0  # m s-1, a terminal speed whose effect is stated
SMOOTH: Final = 1e4  # precision that stands for an input without error


class Pool:
    """Drops with the columns of the inputs that matter to them."""

    def __init__(self, drops: list[Bounces], inputs: BallInputs) -> None:
        self.drops = drops
        every: dict[str, Input] = {"contact": inputs.contact, "gravity": inputs.gravity}
        filmed = any(drop.gravity for drop in drops)
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
        self.reference = float(np.median(self.speed))
        self.rows = self._rows()
        self.odd: list[tuple[int, int]] = []

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

    def fit(self, rows: Rows, slope: bool) -> Fit:
        """Fit with or without a slope, which a precision then holds at 0."""
        bounces = int(rows.bounce.sum())
        heard, many = bool(rows.timing.any()), int((rows.bounce.sum(1) > 0.0).sum()) > 1
        free = (heard and bounces > 2, bounces > 1 + slope, many)
        return fit_components(rows, np.array([0.0, 0.0 if slope else 1e12, *self.prior]), free)

    def _without_odd(self) -> Fit:
        limit = MOST_ODD * self.rows.bounce.sum()
        slope = self.rows.bounce.sum() > 3 and float(np.ptp(self.speed)) > 0.0
        fit = self.fit(self.rows, slope)
        while len(self.odd) + 1 <= limit:
            far, drop, row = odd_row(self.rows, fit)
            if far < ODD:
                break
            self.odd.append((drop, row))
            self.rows = without(self.rows, drop, row)
            fit = self.fit(self.rows, slope)
        return fit

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

    def _budget(self, fit: Fit, covariance: Array) -> dict[str, Any]:
        """State each input as the data leave it, and what it contributes to the error of e."""
        mean = fit.moments()[0]
        names = list(self.inputs)
        ones = list(self.inputs.values())
        scales = np.array([self._unit(one) for one in ones])
        after = np.sqrt(np.diag(covariance))[2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = covariance[0, 2:] / after
            spread = np.sqrt(np.diag(covariance))
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
            "drag_effect": float(bare.mean()) / TERMINAL**2
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
