"""Mean and scatter of bounces: a linear model with components of variance.

A drop gives rows z = X b + errors, whose covariance is

    fixed + timing^2 T + scatter^2 I + (from drop to drop)^2 1 1'

Restricted likelihoods on a grid of the three components are weighted with a prior and averaged,
so that the uncertainty of the components, which is large for a few bounces or drops, is in the
errors of b.  Inputs that are known within a range are columns of X with a prior of variance 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from vibrosweep.arrays import Array

NODES: Final = 8  # of the grid, for each component
ZOOMS: Final = 3
FAINT: Final = 9.0  # a node whose log density is lower by as much does not matter
# Scale of the prior (Cauchy) of what differs from drop to drop, which two drops hardly determine
DROP_SCALE: Final = 0.01
DEVIATES: Final = np.linspace(-4.0, 4.0, 25)  # at which a column has nodes
LEAST: Final = 1e-6  # error of e that is as good as none
COMPONENTS: Final = ("timing", "scatter", "drop_scatter")


class Rows(NamedTuple):
    """Rows of all drops, each filled up with rows that say nothing."""

    value: Array  # (drop, row)
    design: Array  # (drop, row, column)
    fixed: Array  # (drop, row, row), 1 on the diagonal of rows that say nothing
    timing: Array  # (drop, row, row)
    bounce: Array  # (drop, row), 1 for a bounce, 0 for others


class Fit(NamedTuple):
    """Average over the grid of components: nodes with weights."""

    weight: Array  # (node,)
    nodes: Array  # (node, component)
    mean: Array  # (node, column)
    covariance: Array  # (node, column, column)
    edges: tuple[Array, ...]  # of the cells around the nodes, for each component
    evidence: float  # logarithm of the likelihood, averaged over the prior

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
        """Return the value below which a column lies with this probability."""
        sd = np.sqrt(self.covariance[:, column, column])
        low, high = (self.mean[:, column] - 60 * sd).min(), (self.mean[:, column] + 60 * sd).max()
        return float(brentq(lambda x: self.share_below(column, x) - share, low, high))

    def reweighted(self, column: int, log_factor: Callable[[Array], Array]) -> Fit:
        """Multiply the prior of a column by a factor: its values become nodes."""
        mean, sd = self.mean[:, column], np.sqrt(self.covariance[:, column, column])
        seen = self.weight > np.exp(-FAINT) * self.weight.max()
        at = mean[seen, None] + sd[seen, None] * DEVIATES
        density = np.log(self.weight[seen, None]) - 0.5 * DEVIATES**2 + log_factor(at)
        weight = np.exp(density - density.max())
        slope = self.covariance[seen, :, column] / sd[seen, None]
        means = self.mean[seen, None] + slope[:, None] * DEVIATES[:, None]
        left = self.covariance[seen] - slope[:, :, None] * slope[:, None, :]
        n, size = means.shape[:2]
        kept = (weight > np.exp(-FAINT) * weight.max()).ravel()
        return Fit(
            weight.ravel()[kept] / weight.ravel()[kept].sum(),
            np.repeat(self.nodes[seen], size, axis=0)[kept],
            means.reshape(n * size, -1)[kept],
            np.repeat(left, size, axis=0)[kept],
            self.edges,
            self.evidence,
        )

    def component_quantile(self, which: int, share: float) -> float:
        """Return the value below which a component lies with this probability."""
        edges = self.edges[which]
        cell = np.searchsorted(edges, self.nodes[:, which]) - 1
        total = np.cumsum(np.bincount(cell, self.weight, edges.size - 1))
        return float(np.interp(share, np.append(0.0, total), edges))


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
    """Average over the components that are `free`; `prior` holds the precision of each column."""
    typical = _typical(rows)
    scales = np.array([0.01 / typical[1], 0.01, 0.01])  # of timing, and of e
    low, high = 1e-4 * scales, 30.0 * scales
    for zoom in range(zooms):
        # even in the logarithm at first, then in the square root, so that 0 is resolved
        steps = np.linspace(0.0, 1.0, NODES + 1) ** 2
        edges = tuple(
            np.geomspace(a, b, NODES + 1) if zoom == 0 else a + (b - a) * steps
            for a, b in zip(low, high, strict=True)
        )
        axes = [
            (e[1:] + e[:-1]) / 2.0 if f else np.zeros(1) for e, f in zip(edges, free, strict=True)
        ]
        widths = [np.diff(e) if f else np.ones(1) for e, f in zip(edges, free, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        cells = np.prod(np.meshgrid(*widths, indexing="ij"), axis=0).ravel()
        parts = [solve(rows, part, prior) for part in np.array_split(nodes, len(nodes) // 64 + 1)]
        loglik, mean, covariance, _ = (np.concatenate(p) for p in zip(*parts, strict=True))
        density = loglik + _log_prior(nodes, free, typical) + np.log(cells)
        seen = density > density.max() - FAINT
        if zoom < zooms - 1:
            for k in np.flatnonzero(free):
                near = np.flatnonzero(np.isin(axes[k], nodes[seen, k]))
                # with a cell on either side, as the density may be higher between the nodes
                first, last = max(near[0] - 1, 0), min(near[-1] + 2, axes[k].size)
                low[k] = edges[k][first] if first else (0.0 if zoom == 0 else low[k])
                high[k] = edges[k][last]
    weight = np.exp(density - density.max())
    evidence = float(density.max() + np.log(weight.sum()))
    return Fit(weight / weight.sum(), nodes, mean, covariance, edges, evidence)


def _typical(rows: Rows) -> tuple[float, float]:
    """Return typical standard deviations of a bounce: by `fixed`, and by a unit of timing."""
    used = rows.bounce > 0.0
    return tuple(  # type: ignore[return-value]
        max(float(np.sqrt(np.median(np.einsum("drr->dr", part)[used]))), LEAST)
        for part in (rows.fixed, rows.timing)
    )


def _log_prior(nodes: Array, free: tuple[bool, bool, bool], typical: tuple[float, float]) -> Array:
    """Scale-free prior of timing and scatter, down to the fixed errors; Cauchy of drops."""
    single = typical[0] ** 2 + nodes[:, 1] ** 2 + (typical[1] * nodes[:, 0]) ** 2
    number = int(free[0]) + int(free[1])
    return -0.5 * number * np.log(single) - np.log1p((nodes[:, 2] / DROP_SCALE) ** 2)


def weighted_residuals(rows: Rows, fit: Fit) -> tuple[Array, Array]:
    """Return residuals divided by their covariance, and the inverse of the covariance."""
    inverse = np.linalg.inv(covariance_of(rows, fit.components[None])[0])
    left = rows.value - rows.design @ fit.moments()[0]
    return np.einsum("drs,ds->dr", inverse, left), inverse


def odd_row(rows: Rows, fit: Fit) -> tuple[float, int, int]:
    """Return the bounce that is farthest from what the others say: how far, its drop, its row."""
    pulled, inverse = weighted_residuals(rows, fit)
    far = pulled / np.sqrt(np.einsum("drr->dr", inverse))
    far = np.abs(far) * rows.bounce
    drop, row = np.unravel_index(far.argmax(), far.shape)
    return float(far[drop, row]), int(drop), int(row)


def without(rows: Rows, drop: int, row: int) -> Rows:
    """Return rows of which one says nothing."""
    parts = [np.array(part) for part in rows]
    for part in (0, 1, 4):
        parts[part][drop, row] = 0.0
    for part in (2, 3):
        parts[part][drop, row, :] = parts[part][drop, :, row] = 0.0
    parts[2][drop, row, row] = 1.0
    return Rows(*parts)


def stack(blocks: list[tuple[Array, Array, Array, Array, Array]]) -> Rows:
    """Make rows of blocks of value, design, fixed, timing and bounce, one for each drop."""
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
