"""Restitution of a ball on a floor: bounces of all drops, pooled, with variance components."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import brentq
from scipy.special import ndtr

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, TrackError
from vibrosweep.lab.ballistics import (
    DRAG,
    POWER,
    BallInputs,
    Bounces,
    Input,
    ball_inputs,
    from_range,
)
from vibrosweep.lab.clicks import bounces_of_clicks
from vibrosweep.lab.films import FilmFit, bounces_of_film
from vibrosweep.lab.recordings import Recording, recordings_in
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    LEAST_VISCOELASTIC,
    PLASTIC,
    VISCOELASTIC,
    restitution_at,
)

__all__ = ["restitution"]

# -----------------------------------------------------------------------------
# Mean and scatter of bounces: a linear model with variance components.
#
# A drop gives rows z = X b + errors, whose covariance is
#
#     fixed + timing^2 T + scatter^2 I + drop_scatter^2 1 1'
#
# Restricted likelihoods on a grid of the three components are weighted with a prior and averaged,
# so that the errors of b include the uncertainty of the components, which is large for a few
# bounces or drops.  Inputs known within a range are columns of X with a prior of variance 1.

NODES: Final = 8  # of the grid, along each component
FIRST_NODES: Final = (32, 4, 4)  # of the first grid: error of a bounce, share of timing, drops
ERRORS: Final = (1e-6, 0.5)  # range of the error of a bounce, and of the scatter of drops
ZOOMS: Final = 4
NEGLIGIBLE: Final = 9.0  # nodes whose log density is lower than the maximum by this are ignored
CLICK: Final = 2e-5  # s: about a sample of a sound recording, the finest timing
# Scale of the Cauchy prior of the scatter between drops, which two drops hardly determine
DROP_SCALE: Final = 0.01
DEVIATES: Final = np.linspace(-4.0, 4.0, 25)  # nodes of a column, in standard deviations
LEAST: Final = 1e-6  # negligible error of e
QUANTILES: Final = (0.025, 0.1587, 0.8413, 0.975)
COMPONENTS: Final = ("timing", "scatter", "drop_scatter")


class Rows(NamedTuple):
    """Rows of all drops, padded with rows without information."""

    value: Array  # (drop, row)
    design: Array  # (drop, row, column)
    fixed: Array  # (drop, row, row), 1 on the diagonal of padding
    timing: Array  # (drop, row, row)
    bounce: Array  # (drop, row), 1 for a bounce, 0 for other rows


class Fit(NamedTuple):
    """Posterior of the components on a grid: nodes with weights."""

    weight: Array  # (node,)
    nodes: Array  # (node, component)
    mean: Array  # (node, column)
    covariance: Array  # (node, column, column)
    evidence: float  # logarithm of the marginal likelihood

    @property
    def components(self) -> Array:
        """Means of the three components."""
        return np.asarray(self.weight @ self.nodes)

    def moments(self) -> tuple[Array, Array]:
        """Return mean and covariance of the columns."""
        mean = self.weight @ self.mean
        off = self.mean - mean
        inner = np.einsum("m,mij->ij", self.weight, self.covariance)
        return mean, inner + np.einsum("m,mi,mj->ij", self.weight, off, off)

    def share_below(self, column: int, value: float) -> float:
        """Return the probability that a column lies below a value."""
        sd = np.sqrt(self.covariance[:, column, column])
        return float(self.weight @ ndtr((value - self.mean[:, column]) / sd))

    def quantile(self, column: int, share: float) -> float:
        """Return a quantile of a column."""
        sd = np.sqrt(self.covariance[:, column, column])
        low, high = (self.mean[:, column] - 60 * sd).min(), (self.mean[:, column] + 60 * sd).max()
        return float(brentq(lambda x: self.share_below(column, x) - share, low, high))

    def reweighted(self, column: int, log_factor: Callable[[Array], Array]) -> Fit:
        """Multiply the prior of a column by a factor, on a grid of its values."""
        mean, sd = self.mean[:, column], np.sqrt(self.covariance[:, column, column])
        seen = self.weight > np.exp(-NEGLIGIBLE) * self.weight.max()
        at = mean[seen, None] + sd[seen, None] * DEVIATES
        density = np.log(self.weight[seen, None]) - 0.5 * DEVIATES**2 + log_factor(at)
        weight = np.exp(density - density.max())
        slope = self.covariance[seen, :, column] / sd[seen, None]
        means = self.mean[seen, None] + slope[:, None] * DEVIATES[:, None]
        left = self.covariance[seen] - slope[:, :, None] * slope[:, None, :]
        n, size = means.shape[:2]
        relevant = (weight > np.exp(-NEGLIGIBLE) * weight.max()).ravel()
        return Fit(
            weight.ravel()[relevant] / weight.ravel()[relevant].sum(),
            np.repeat(self.nodes[seen], size, axis=0)[relevant],
            means.reshape(n * size, -1)[relevant],
            np.repeat(left, size, axis=0)[relevant],
            self.evidence,
        )

    def component_quantile(self, which: int, share: float) -> float:
        """Return a quantile of a component."""
        values, place = np.unique(self.nodes[:, which], return_inverse=True)
        between = (values[1:] + values[:-1]) / 2.0
        # the first and the last cell are symmetric about their nodes
        edges = [2.0 * values[0] - between[:1], between, 2.0 * values[-1] - between[-1:]]
        total = np.cumsum(np.bincount(place, self.weight))
        if not between.size:
            return float(values[0])
        return float(np.interp(share, np.append(0.0, total), np.concatenate(edges)))


def covariance_of(rows: Rows, nodes: Array) -> Array:
    """Return covariances, shape (node, drop, row, row)."""
    t, s, d = (nodes[:, k, None, None, None] ** 2 for k in range(3))
    own = np.eye(rows.value.shape[1]) * rows.bounce[:, :, None]
    shared = rows.bounce[:, :, None] * rows.bounce[:, None, :]
    return np.asarray(rows.fixed + t * rows.timing + s * own + d * shared)


def solve(rows: Rows, nodes: Array, prior: Array) -> tuple[Array, ...]:
    """Return restricted log likelihoods, estimates, covariances and chi-squares at nodes."""
    lower = np.linalg.cholesky(covariance_of(rows, nodes))
    right = np.concatenate([rows.design, rows.value[:, :, None]], axis=2)
    scaled = np.linalg.solve(lower, np.broadcast_to(right, (len(nodes), *right.shape)))
    x, z = scaled[..., :-1], scaled[..., -1]
    normal = np.einsum("mdri,mdrj->mij", x, x) + np.diag(prior)
    covariance = np.linalg.inv(normal)
    top = np.einsum("mdri,mdr->mi", x, z)
    mean = np.einsum("mij,mj->mi", covariance, top)
    square = np.einsum("mdr,mdr->m", z, z) - np.einsum("mi,mi->m", mean, top)
    logs = 2.0 * np.log(np.einsum("mdrr->mdr", lower)).sum((1, 2))
    return -0.5 * (logs + np.linalg.slogdet(normal)[1] + square), mean, covariance, square


def fit_components(
    rows: Rows, prior: Array, free: tuple[bool, bool, bool], zooms: int = ZOOMS
) -> Fit:
    """Average over the `free` components; `prior` holds the precision of each column.

    Data determine the error of a bounce, the sum of timing and scatter, far better than the share
    of the timing.  The grid is therefore in both: uniform in the logarithm of the error, and in the
    square roots of an angle for the share and of the scatter between drops, so that it resolves 0.
    """
    by_timing = _typical(rows)[1]
    box = np.array([np.log(ERRORS), [0.0, (np.pi / 2.0) ** 0.5], [0.0, ERRORS[1] ** 0.5]])
    kinds = np.array([free[1], free[0], free[2]])
    for zoom in range(zooms):
        counts = np.where(kinds, NODES if zoom else FIRST_NODES, 1)
        edges = [
            np.linspace(low, high, count + 1)
            for (low, high), count in zip(box, counts, strict=True)
        ]
        middles = [
            (e[1:] + e[:-1]) / 2.0 if k else np.zeros(1) for e, k in zip(edges, kinds, strict=True)
        ]
        place = np.stack(np.meshgrid(*middles, indexing="ij"), -1).reshape(-1, 3)
        error = np.exp(place[:, 0]) if kinds[0] else np.zeros(1)
        angle, drops = place[:, 1] ** 2, place[:, 2] ** 2
        clicks, scatter = error * np.sin(angle) / by_timing, error * np.cos(angle)
        nodes = np.stack([clicks, scatter, drops], axis=1)
        parts = [solve(rows, part, prior) for part in np.array_split(nodes, len(nodes) // 64 + 1)]
        loglik, mean, covariance, _ = (np.concatenate(p) for p in zip(*parts, strict=True))
        # volumes of the cells: d log(error), d(error) d(error angle), and those of the square roots
        sizes = place[:, 0] * (int(free[0]) + int(free[1]))
        sizes += np.log(np.where(kinds[1:], place[:, 1:], 1.0)).sum(1)
        density = loglik + _log_prior(rows, nodes, free) + sizes
        seen = density > density.max() - NEGLIGIBLE
        for k in np.flatnonzero(kinds):
            # the first grid of the error is too coarse to judge shares
            if zoom or k == 0:
                near = np.flatnonzero(np.isin(middles[k], place[seen, k]))
                # plus a cell on either side, because the density may peak between the nodes
                box[k] = edges[k][[max(near[0] - 1, 0), min(near[-1] + 2, counts[k])]]
    weight = np.exp(density - density.max())
    evidence = float(density.max() + np.log(weight.sum()))
    return Fit(weight / weight.sum(), nodes, mean, covariance, evidence)


def _typical(rows: Rows) -> tuple[float, float]:
    """Return typical standard deviations of a bounce: from `fixed`, and from a unit of timing."""
    used = rows.bounce > 0.0
    return tuple(  # type: ignore[return-value]
        max(float(np.sqrt(np.median(np.einsum("drr->dr", part)[used]))), LEAST)
        for part in (rows.fixed, rows.timing)
    )


def _log_prior(rows: Rows, nodes: Array, free: tuple[bool, bool, bool]) -> Array:
    """Scale-free priors: for timing down to `CLICK`, for scatter down to the other errors.

    A uniform prior favours the largest values of a component that the data allow, at the expense of
    the others.  The prior of the scatter between drops, which two drops hardly determine, falls off
    like a Cauchy distribution.
    """
    by_fixed, by_timing = _typical(rows)
    (clicks, scatter, drops), bounces = nodes.T, rows.bounce.sum(1)
    single = by_fixed**2 + scatter**2 + (by_timing * clicks) ** 2
    of_drop = single / max(float(bounces[bounces > 0.0].mean()), 1.0) + drops**2
    parts = np.stack(
        [CLICK**2 + clicks**2, single, of_drop * (1.0 + (drops / DROP_SCALE) ** 2) ** 2]
    )
    return np.asarray(-0.5 * np.array(free) @ np.log(parts))


def component_variables(fit: Fit) -> dict[str, Any]:
    """Return median, quantiles and 95 % limit of each component, NaN if it is not determined."""
    found: dict[str, Any] = {}
    for k, name in enumerate(COMPONENTS):
        given = fit.nodes[:, k].any()
        values = [
            fit.component_quantile(k, q) if given else np.nan for q in (0.5, *QUANTILES, 0.95)
        ]
        found[name] = values[0]
        found[f"{name}_quantile"] = ("quantile", values[1:5])
        found[f"{name}_limit"] = values[5]
    return found


def weighted_residuals(rows: Rows, fit: Fit) -> tuple[Array, Array]:
    """Return residuals multiplied by the inverse of their covariance, and the inverse."""
    inverse = np.linalg.inv(covariance_of(rows, fit.components[None])[0])
    left = rows.value - rows.design @ fit.moments()[0]
    return np.einsum("drs,ds->dr", inverse, left), inverse


def largest_outlier(rows: Rows, fit: Fit) -> tuple[float, int, int]:
    """Return the largest deviation of a bounce from the fit to the others, its drop and row."""
    pulled, inverse = weighted_residuals(rows, fit)
    far = pulled / np.sqrt(np.einsum("drr->dr", inverse))
    far = np.abs(far) * rows.bounce
    drop, row = np.unravel_index(far.argmax(), far.shape)
    return float(far[drop, row]), int(drop), int(row)


def without_row(rows: Rows, drop: int, row: int) -> Rows:
    """Return the rows with one of them masked."""
    parts = [np.array(part) for part in rows]
    for part in (0, 1, 4):
        parts[part][drop, row] = 0.0
    for part in (2, 3):
        parts[part][drop, row, :] = parts[part][drop, :, row] = 0.0
    parts[2][drop, row, row] = 1.0
    return Rows(*parts)


def stack(blocks: list[tuple[Array, Array, Array, Array, Array]]) -> Rows:
    """Combine blocks of value, design, fixed, timing and bounce, one for each drop."""
    longest = max(len(block[0]) for block in blocks)
    made = []
    for value, design, fixed, timing, bounce in blocks:
        n = longest - len(value)
        square = ((0, n), (0, n))
        whole = np.pad(fixed, square) + np.diag(np.repeat([LEAST**2, 1.0], [len(value), n]))
        made.append(
            (
                np.pad(value, (0, n)),
                np.pad(design, ((0, n), (0, 0))),
                whole,
                np.pad(timing, square),
                np.pad(bounce, (0, n)),
            )
        )
    return Rows(*(np.stack(part) for part in zip(*made, strict=True)))


# -----------------------------------------------------------------------------
# Bounces of all drops, pooled: restitution, its dependence on the speed, its scatter.

OUTLIER: Final = 4.0  # standard deviations from which a bounce is an outlier
MOST_OUTLIERS: Final = 0.1  # largest share of outliers
FEWEST_TESTED: Final = 3  # with more bounces than this, a slope of e is tested
FALLS: Final = 0.01  # significance level of the one-sided test for an e that falls with speed
RISES: Final = 0.001  # and for one that rises, as in no law of this package
EQUAL: Final = 6.63  # difference of deviance below which laws fit equally (1 %, one parameter)
LINE: Final = "line"
EDGE: Final = 0.1  # of the logarithm: width of the smoothed ends of a range
TERMINAL: Final = 20.0  # m s-1, terminal speed for which the effect of drag is stated
LINEARIZED: Final = 3  # relinearizations about adjusted clicks
WRONG_SCALE: Final = 1.2  # apparent gravity in units of gravity, beyond which a unit is wrong
STARTS: Final = 7  # trial contact times
ROUGH: Final = 2  # zooms of an intermediate fit
SMOOTH: Final = 1e4  # precision that represents an exact input


def _log_uniform(one: Input, deviate: Array) -> Array:
    """Return the logarithm of the ratio of a log-uniform to a normal prior.

    The log-uniform prior falls off smoothly beyond the ends of its range.
    """
    low, high = one.ends or (0.0, np.inf)
    value = np.maximum(one.value + one.error * deviate, 1e-3 * low)
    logs = np.log(value)
    beyond = np.maximum(np.log(low) - logs, 0.0) + np.maximum(logs - np.log(high), 0.0)
    return np.asarray(-logs - 0.5 * (beyond / EDGE) ** 2 + 0.5 * deviate**2)


def _remark_on_energy(bounces: int, restitution: float, error: float) -> list[str]:
    """Return a remark if the bounces lose no energy, which a floor at rest does not allow."""
    if bounces <= FEWEST_TESTED or restitution + error < 1.0:
        return []
    return [
        "the bounces lose no energy on average, as over a base that shakes: for its motion and the "
        "restitution use vibrosweep lab impacts, or vs.lab.times_on_shaker"
    ]


class Pool:
    """Drops pooled, with a column for each relevant input."""

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
            if (one.error > 0.0 or any(name in drop.found for drop in drops))
            and any(np.any(drop.inputs.get(name, 0.0)) for drop in drops)
        }
        self.prior = [1.0 if one.error > 0.0 else SMOOTH for one in self.inputs.values()]
        self.speed = np.concatenate([drop.speed for drop in drops])
        self.outliers: list[tuple[int, int]] = []
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
                columns.append(slope * self._scale(one))
            value = np.concatenate([drop.restitution, [drop.found[name] for name in names]])
            bounce = np.repeat([1.0, 0.0], [n, len(names)])
            blocks.append((value, np.stack(columns, 1), drop.fixed, drop.timing, bounce))
        return stack(blocks)

    @staticmethod
    def _scale(one: Input) -> float:
        return one.error or max(abs(one.value), 1e-6) * 1e-3

    @staticmethod
    def _determined(rows: Rows, slope: bool) -> tuple[bool, bool, bool]:
        """Return which variance components the bounces determine."""
        bounces = int(rows.bounce.sum())
        timed, many = bool(rows.timing.any()), int((rows.bounce.sum(1) > 0.0).sum()) > 1
        return timed and bounces > 2, bounces > 1 + slope, many

    def fit(self, rows: Rows, slope: bool, zooms: int = ZOOMS) -> Fit:
        """Fit with or without a slope, which is fixed at 0 by its prior."""
        prior = np.array([0.0, 0.0 if slope else 1e12, *self.prior])
        fit = fit_components(rows, prior, self._determined(rows, slope), zooms)
        for k, (name, one) in enumerate(self.inputs.items()):
            if one.ends and not any(name in drop.found for drop in self.drops):
                fit = fit.reweighted(2 + k, partial(self._prior, name, one))
        return fit

    def _prior(self, name: str, one: Input, deviate: Array) -> Array:
        """Return the logarithm of the ratio of an input's prior to a normal one.

        The data are intervals, but the scatter is that of restitutions: the Jacobian of this
        transformation depends on the contact time.
        """
        factor = _log_uniform(one, deviate)
        if name == "contact":
            contact = one.value + one.error * deviate
            left = {k: set(range(drop.speed.size)) for k, drop in enumerate(self.drops)}
            for k, row in self.outliers:
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
        """Linearize about the trial contact time with the highest evidence."""
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
            fit = fit_components(held, prior, self._determined(rows, slope=True), 1)
            evidence = fit.evidence + float(self._prior("contact", one, np.array(deviate)))
            evidence -= 0.5 * deviate**2
            if evidence > best:
                best, chosen = evidence, drops
        self.drops = chosen
        self.rows = self._rows()

    def _linearize(self, fit: Fit) -> None:
        """Linearize about the clicks as adjusted by the fit.

        Ratios of noisy intervals are biased, and even more so the errors that weight them.
        """
        pulled, _ = weighted_residuals(self.rows, fit)
        off = fit.moments()[0][2:]
        at = {
            name: max(one.value + self._scale(one) * d, 0.1 * one.value)
            for (name, one), d in zip(self.inputs.items(), off, strict=True)
        }
        for k, drop in enumerate(self.drops):
            if drop.about is None or drop.clicks is None:
                continue
            variance = fit.components[0] ** 2 + drop.rounding**2 / 12.0
            shift = -variance * drop.clicks.T @ pulled[k, : len(drop.clicks)]
            self.drops[k] = drop.about(shift, at)
        self.rows = self._rows()
        for drop_row in self.outliers:
            self.rows = without_row(self.rows, *drop_row)

    def _without_outliers(self) -> Fit:
        limit = MOST_OUTLIERS * self.rows.bounce.sum()
        slope = self.rows.bounce.sum() > 3 and float(np.ptp(self.speed)) > 0.0
        timed = any(drop.about for drop in self.drops)
        if timed and slope:
            self._start()
        fit = self.fit(self.rows, slope, ROUGH)
        for _ in range(LINEARIZED if timed else 0):
            self._linearize(fit)
            fit = self.fit(self.rows, slope, ROUGH)
        while len(self.outliers) + 1 <= limit:
            far, drop, row = largest_outlier(self.rows, fit)
            if far < OUTLIER:
                break
            self.outliers.append((drop, row))
            self.rows = without_row(self.rows, drop, row)
            fit = self.fit(self.rows, slope, ROUGH)
        return self.fit(self.rows, slope)

    def result(self, remarks: list[str]) -> xr.Dataset:
        """Return the result of the pool."""
        line = self._without_outliers()
        constant = self.fit(self.rows, slope=False)
        mean, covariance = line.moments()
        bounces = int(self.rows.bounce.sum())
        tested = bounces > FEWEST_TESTED
        below = line.share_below(1, 0.0) if tested else 0.5
        falls, rises = 1.0 - below < FALLS, below < RISES
        chosen = line if falls or rises else constant
        if tested:  # the speed at which e and slope are uncorrelated, so that both fits agree
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
            **component_variables(chosen),
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
            "remarks": "\n".join(
                [*remarks, *self._remarks(), *_remark_on_energy(bounces, e, error)]
            ),
        }
        return xr.Dataset(variables, coords=coordinates, attrs=attributes)

    def _remarks(self) -> list[str]:
        texts = [f"{drop.name}: {text}" for drop in self.drops for text in drop.remarks]
        for k, row in self.outliers:
            drop = self.drops[k]
            texts.append(
                f"{drop.name}: the bounce at {drop.time[row]:.5g} s is an outlier "
                f"(e = {drop.restitution[row]:.3f}) and left out"
            )
        return texts

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
            [(k, row) not in self.outliers for row in range(drop.restitution.size)]
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
        """Return the restitution of each drop, and the prediction error for another drop."""
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
        """Return the posterior of each input, and its contribution to the error of e."""
        mean = fit.moments()[0]
        names = list(self.inputs)
        ones = list(self.inputs.values())
        scales = np.array([self._scale(one) for one in ones])
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
        timed = not any(drop.gravity for drop in self.drops)
        return {
            "input_value": ("input", np.array([one.value for one in ones]) + mean[2:] * scales)
            if names
            else ("input", [np.nan]),
            "input_error": ("input", after * scales if names else [np.nan]),
            "input_effect": ("input", np.abs(shares) if names else [np.nan]),
            "drag_effect": -float(bare.mean()) / TERMINAL**2
            if timed and "drag" not in self.inputs
            else np.nan,
            "correlation": (("parameter", "other"), correlation),
            "parameter": ("parameter", parameters),
            "other": ("other", parameters),
        }

    def _laws(
        self, line: Fit, speed: float, words: str, named: bool
    ) -> list[tuple[str, float, float, float]]:
        """Return the laws that fit, with restitution, speed, and deviance relative to the best."""
        nodes = line.components[None]
        used = np.flatnonzero(self.rows.bounce.ravel() > 0.0)
        v = self.rows.design[..., 1] + self.reference
        tried: list[tuple[str, float, float, float]] = []

        def deviance(shape: Array, slope: bool) -> tuple[float, float]:
            """Return the deviance of a multiple of a shape or of a line, and the restitution."""
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
            for _ in range(6):  # because the law is only nearly proportional to its restitution
                shape = restitution_at(
                    speeds, min(max(e, LEAST_VISCOELASTIC), 0.9999), VISCOELASTIC, speed
                )
                square, factor = deviance(shape, False)
                e *= factor
            if LEAST_VISCOELASTIC <= e < 1.0:
                tried.append((VISCOELASTIC, e, speed, square))
        least = min(law[3] for law in tried)
        fitting = [law for law in tried if law[3] - least < EQUAL]
        fitting = [law for law in fitting if law[0] != CONSTANT or words == CONSTANT]
        return [(a, b, c, d - least) for a, b, c, d in sorted(fitting, key=lambda law: law[3])]


# -----------------------------------------------------------------------------
# Restitution of a ball on a floor from recordings of its drops, pooled.


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
    """Measure the coefficient of restitution of a ball on a floor at rest.

    It is the ratio of the speeds at the end and at the beginning of a contact; gravity during the
    contact is part of it.

    Parameters
    ----------
    recordings
        Drops of one ball, as films or times of impacts, from `read_recordings`.
    contact
        Contact time in s, or its range; by default 0.2 to 5 ms.
    mass, diameter
        Mass (kg) and diameter (m) of the ball, which give its drag in air.  By default films
        determine the drag, and times are evaluated without drag.
    gravity
        Gravity in m s-2, or its range.
    drop_height
        Height (m) from which the ball was dropped, or its range; the first fall is then used too.
    scale_from_gravity
        Take the scale of films from free fall instead of from the file.
    begin, end
        Beginning and end of the part of the recordings that is used, in s.

    Returns
    -------
    xarray.Dataset
        - ``restitution`` at the impact speed ``speed``, with ``restitution_quantile`` and
          ``restitution_error``, half of the 68 % interval;
        - ``slope`` with the speed and its ``slope_error``;
        - ``scatter`` from bounce to bounce, ``drop_scatter`` from drop to drop and ``timing`` of
          clicks (s), each with ``_quantile`` and the 95 % ``_limit``; NaN: not determined;
        - along ``law``: the laws that fit, with ``law_restitution``, ``law_speed`` and
          ``law_deviance``;
        - along ``bounce``: ``bounce_restitution``, ``bounce_speed``, ``bounce_time``,
          ``bounce_error``, ``bounce_used``, ``bounce_drop``;
        - along ``drop``: ``drop_restitution`` of each single drop with its error, and the
          apparent ``drop_gravity`` in films;
        - ``prediction_error``: prediction error of the mean restitution of another drop;
        - along ``group``: restitution, error and speed of the groups named in the files;
        - along ``input``: ``input_value``, ``input_error`` and its contribution ``input_effect`` to
          the error of the restitution;
        - ``correlation`` of the parameters.

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
    for name, instant in (("begin", begin), ("end", end)):
        if instant is not None and not (isinstance(instant, int | float) and instant == instant):
            raise ParameterError(f"{name} = {instant!r}: must be a number, in s")
    inputs = ball_inputs(contact, mass, diameter, gravity, drop_height)
    inputs = replace(inputs, scale_from_gravity=scale_from_gravity)
    whole = recordings_in(recordings)
    used = [_cut(recording, begin, end) for recording in whole]
    times = np.concatenate([np.empty(0), *(recording.time for recording in whole)])
    times = times[np.isfinite(times)]
    if times.size and not any(recording.time.size for recording in used):
        low, high = (-np.inf if begin is None else begin), (np.inf if end is None else end)
        raise TrackError(
            f"nothing was recorded from {low:g} to {high:g} s; the recordings last from "
            f"{times.min():.10g} to {times.max():.10g} s"
        )
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
    remarks += [_remark_on_scale(d, inputs) for d in drops if d.speed_known and d.gravity]
    remarks = [remark for remark in remarks if remark]
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


def _remark_on_scale(drop: Bounces, inputs: BallInputs) -> str:
    """Return a remark if free fall contradicts the scale or the frame rate of a film."""
    ratio = (drop.gravity or Input(np.nan)).value / inputs.gravity.value
    if inputs.scale_from_gravity or 1.0 / WRONG_SCALE < ratio < WRONG_SCALE:
        return ""
    return (
        f"{drop.name}: falls with {ratio:.3g} times gravity, so that its unit of length or time is "
        f"wrong, and speeds with it: correct the unit or the frame rate, or use --scale gravity"
    )


def _samples(fits: list[FilmFit], first: int) -> dict[str, Any]:
    """Return the samples of flights, for a figure."""
    if not fits:
        return {}
    owner = np.repeat(np.arange(first, first + len(fits)), [fit.time.size for fit in fits])
    return {"sample_drop": ("sample", owner)} | {
        f"sample_{name}": ("sample", np.concatenate([getattr(fit, name) for fit in fits]))
        for name in ("time", "height", "fitted", "residual")
    }


def _cut(recording: Recording, begin: float | None, end: float | None) -> Recording:
    low, high = (-np.inf if begin is None else begin), (np.inf if end is None else end)
    used = (recording.time >= low) & (recording.time <= high)
    parts: dict[str, Any] = {"time": recording.time[used]}
    for name in ("height", "horizontal", "peaks"):
        values = getattr(recording, name)
        parts[name] = None if values is None else values[used]
    return replace(recording, **parts)
