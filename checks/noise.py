"""Noise compared with its closed forms, at 10^6 impacts or more, and its effect on locks.

    python checks/noise.py [--impacts 1000000] [--seed 1] [--write]

With --write the tables go into checks/README.md.  Pictures go into noise, or where --pictures says.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from PIL import Image
from scipy.stats import chi2

import vibrosweep as vs
from accuracy import options_of, provenance, show, table
from vibrosweep.figures import style

PAGE = Path(__file__).parent / "README.md"
# Speeds in units of g / (2 f), at which flights last one forcing period
UNITS = {"gravity": 2.0, "frequency": 1.0, "phase": 0.0}
TREMBLING = {**UNITS, "amplitude": 0.0, "contact_time": 1e-30}


class Compared(NamedTuple):
    """A closed form: its name and value, the measured value, and the standard error of that."""

    words: str
    known: float
    found: float
    error: float

    @property
    def row(self) -> tuple[str, ...]:
        apart = (self.found - self.known) / self.error
        return self.words, f"{self.known:.5g}", f"{self.found:.5g}", f"{apart:+.2f}"


def square(landing):
    return landing.rebound * landing.rebound


def lock(totals, landing):
    """Landings until a particle loses the lock on one flight per period, and whether it has."""
    if totals[1] == 0.0:
        if landing.rests or abs(landing.flight_time - 1.0) > 0.25:
            totals[1] = 1.0
        else:
            totals[0] += 1.0


def bounces(totals, landing):
    """Landings until the first rest."""
    if totals[1] == 0.0:
        if landing.rests:
            totals[1] = 1.0
        else:
            totals[0] += 1.0


def of_each(function, **how):
    """An observable with separate totals for each particle."""
    return vs.Observable(function.__name__, function, function.__name__, particles="each", **how)


PAIR = {"along": "part", "values": (0.0, 1.0)}


def stationary(impacts, seed):
    """Mean square of the speed under noise without a drive, from the means of particles."""
    for e, sigma_e in ((0.9, 0.0), (0.8, 0.05)):
        found = vs.sweep(
            **TREMBLING, restitution=e, restitution_noise=sigma_e, kick_noise=1.0 / (1.0 + e),
            rebound="reflect", launch_velocity=2.0, launch=[0.0] * 2000, noise_seed=seed,
            transient=100.0, duration=100.0 + 2.0 * impacts / 2000, per_particle=True,
            observables=[of_each(square, landings="sum")],
        )  # fmt: skip
        # a ratio of means, because slow particles land more often
        total, count = found.square.values[0], found.particle_impact_count.values[0]
        mean = total.sum() / count.sum()
        error = np.std(total - mean * count) / (math.sqrt(total.size) * count.mean())
        known = 1.0 / (1.0 - e**2 - sigma_e**2)
        yield Compared(rf"mean square, $e = {e}$, $\sigma_e = {sigma_e}$", known, mean, error)


def surviving(impacts, seed):
    """Share of particles that have not rested after n impacts, C(2n, n) / 4^n."""
    particles = impacts // 20
    found = vs.sweep(
        **TREMBLING, restitution=1.0, kick_noise=0.5, launch_velocity=1e-20, noise_seed=seed,
        launch=[0.0] * particles, duration=1e12, impact_budget=60,
        observables=[of_each(bounces, **PAIR)],
    )  # fmt: skip
    count = found.bounces.values[0, :, 0]
    for n in (1, 2, 3, 4, 10, 50):
        known = math.comb(2 * n, n) / 4**n
        error = math.sqrt(known * (1.0 - known) / particles)
        yield Compared(f"share still bouncing after {n} impacts", known, (count >= n).mean(), error)


def covariances(impacts, seed):
    """Covariance of phase and speed about a locked orbit, S = J S J^T + Q."""
    e, a, k, sigma = 0.9, 0.4, 1.0, 1e-3
    phase = 0.5 - math.asin((1.0 - e) * k / a) / (2.0 * math.pi)
    slope = 2.0 * math.pi * a * math.cos(2.0 * math.pi * phase)
    jacobian = np.array([[1.0, 1.0], [slope, e + slope]])
    replicas = impacts // 500
    for kind, strength, q in (
        ("kick_noise", sigma / (1.0 + e), sigma),
        ("drive_noise", sigma, (1.0 - e) * k * sigma),
    ):
        through = np.eye(4) - np.kron(jacobian, jacobian)
        known = np.linalg.solve(through, [0.0, 0.0, 0.0, q * q]).reshape(2, 2)
        found = vs.simulate(
            **UNITS, **{kind: strength}, restitution=e, amplitude=a, launch_velocity=k,
            launch_time=phase, duration=600.0, noise_stream=np.arange(replicas), noise_seed=seed,
        )  # fmt: skip
        names = ("landing_time", "rebound_velocity")
        times, left = (found[name].values[:, 0, 80:580] for name in names)
        x, u = times - np.rint(times - phase) - phase, left - k
        for words, one, other, value in (
            ("xx", x, x, known[0, 0]), ("xu", x, u, known[0, 1]), ("uu", u, u, known[1, 1]),
        ):  # fmt: skip
            means = (one * other).mean(axis=1)
            error = means.std() / math.sqrt(replicas)
            yield Compared(f"covariance $S_{{{words}}}$, `{kind}`", value, means.mean(), error)


def lifetime(noise, seed, replicas=500, duration=2000.0):
    """Mean lifetime of the lock of mode 1 at Table 1, in periods, with its interval of 95 %.

    A particle of each replica is launched on the locked orbit.  One that is locked at the end
    counts with the time until then: for exponential lifetimes, total time over losses is the
    maximum-likelihood estimate.
    """
    ((kind, values),) = noise.items()
    phase = 0.5 - math.asin(0.1 * 9.81 / (2.0 * 1.2)) / (2.0 * math.pi)
    found = vs.sweep(
        design={kind: np.repeat(values, replicas)}, restitution=0.9, amplitude=1.2,
        launch_velocity=4.905, launch=[phase], duration=duration, noise_seed=seed,
        observables=[of_each(lock, **PAIR)],
    )  # fmt: skip
    kept, lost = found.lock.values[:, 0].reshape(-1, replicas, 2).sum(axis=1).T
    low = 2.0 * kept / chi2.ppf(0.975, 2 * lost + 2)
    with np.errstate(divide="ignore"):
        high = np.where(lost > 0, 2.0 * kept / chi2.ppf(0.025, 2 * lost), np.inf)
        return kept / lost, low, high


def blurred(amplitude, seed, noise, particles=100):
    """Share of particles, launched on the stable orbit of mode 1, that stay there 500 periods."""
    sine = np.clip(0.1 * 9.81 / (2.0 * amplitude), None, 1.0)
    design = {
        "amplitude": np.repeat(amplitude, len(noise)),
        "phase": np.repeat(2.0 * math.pi * (0.5 - np.arcsin(sine) / (2.0 * math.pi)), len(noise)),
        "kick_noise": np.tile(noise, amplitude.size),
    }
    found = vs.sweep(
        design=design, restitution=0.9, launch_velocity=4.905, launch=[0.0] * particles,
        duration=500.0, noise_seed=seed, observables=[of_each(lock, **PAIR)],
    )  # fmt: skip
    kept = 1.0 - found.lock.values[..., 1].mean(axis=1)
    return kept.reshape(amplitude.size, len(noise))


def mean_squares(a, e, seed, sigma):
    """Mean square of the speed under the law `reflect` against the amplitude of the kick."""
    found = vs.sweep(
        **UNITS, amplitude=list(a), restitution=e, kick_noise=sigma / (1.0 + e),
        rebound="reflect", contact_time=1e-12, launch_velocity=1.0, particles=200,
        transient=500.0, duration=4000.0, noise_seed=seed,
        observables=[vs.Observable("square", square, "square", landings="sum")],
    )  # fmt: skip
    return found.square.values / found.impact_count.values


def apart(noise, seed, replicas=400, duration=500.0):
    """Share of replicas whose two particles, launched in both slots of mode 2, never meet."""
    ((kind, values),) = noise.items()
    phase = 0.5 - math.asin(0.2 * 9.81 / (2.0 * 1.2)) / (2.0 * math.pi)
    found = vs.sweep(
        design={kind: np.repeat(values, replicas)}, launch_velocity=9.81,
        launch=[phase, 1.0 + phase], duration=duration, separation=True, noise_seed=seed,
        restitution=0.9, amplitude=1.2,
    )  # fmt: skip
    return found.collision_free.values.reshape(-1, replicas).mean(axis=1)


def save(name, figure, folder):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    figure.savefig(path, dpi=150)
    Image.open(path).convert("RGB").quantize(64).save(path, optimize=True)


# Pictures of docs/noise.md, checks/README.md and study/claims.md.

WORDS = {
    "kick_noise": r"kick, $\sigma_V$ (m s$^{-1}$)",
    "drive_noise": r"drive, $\sigma_A$ (relative)",
    "restitution_noise": r"restitution, $\sigma_e$",
}


def against_strength(axes, kind):
    """Label an axis of the strength of a noise, whose range is too short for powers of ten."""
    axes.set(xscale="log", xlabel=WORDS[kind])
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


@mpl.rc_context(style.RC)
def lifetimes(lives):
    """Mean lifetime of a lock against the strength of each kind of noise, with its interval."""
    figure = Figure(figsize=(style.PAGE, 2.6), layout="constrained")
    for axes, (kind, (values, (life, low, high))) in zip(
        figure.subplots(1, 3, sharey=True), lives.items(), strict=True
    ):
        known = np.isfinite(life)
        ends = [life[known] - low[known], high[known] - life[known]]
        axes.errorbar(
            values[known], life[known], ends,
            fmt="o", color=style.OKABE_ITO[0], markersize=3.0, capsize=2.0,
        )  # fmt: skip
        if not known.all():
            axes.plot(values[~known], low[~known], "^", color=style.GREY, label="at least")
        axes.set_yscale("log")
        against_strength(axes, kind)
        style.head(axes, "")
    figure.axes[0].set_ylabel("mean lifetime (periods)")
    return figure


@mpl.rc_context(style.RC)
def windows(amplitude, strengths, kept, ends):
    """Share of particles still locked against the amplitude, with the window without noise."""
    figure = Figure(figsize=(style.PAGE, 2.8), layout="constrained")
    axes = figure.subplots()
    for share, strength, colour in zip(kept.T, strengths, style.OKABE_ITO, strict=False):
        axes.plot(amplitude, share, color=colour, label=rf"$\sigma_V = {strength:g}$ m s$^{{-1}}$")
    for end, name in zip(ends, ("window without noise", ""), strict=True):
        axes.axvline(end, color="k", linewidth=0.8, linestyle="--", label=name)
    axes.set(xlabel=r"amplitude $A$ (m s$^{-1}$)", ylabel="share locked for 500 periods")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8.0)
    return figure


@mpl.rc_context(style.RC)
def energy(a, e, squares):
    """Mean square of the speed against the amplitude, with the random-phase approximation."""
    figure = Figure(figsize=(style.PAGE, 3.0), layout="constrained")
    axes = figure.subplots()
    for (sigma, found), colour in zip(squares.items(), style.OKABE_ITO, strict=False):
        axes.plot(a, found, ".", color=colour, label=rf"$\sigma = {sigma:g}$")
        axes.plot(a, (a * a / 2.0 + sigma**2) / (1.0 - e * e), color=colour, linewidth=0.8)
    axes.plot([], [], color="black", linewidth=0.8, label="random phases")
    axes.set(xscale="log", yscale="log", xlabel=r"amplitude $a$ ($g/2f$)")
    axes.set_ylabel(r"mean square speed $\langle u^2 \rangle$ ($(g/2f)^2$)")
    axes.legend(fontsize=8.0)
    return figure


@mpl.rc_context(style.RC)
def staggering(free):
    """Share of staggered pairs that never meet, against the strength of each kind of noise."""
    figure = Figure(figsize=(style.PAGE, 2.6), layout="constrained")
    for axes, (kind, (values, share)) in zip(
        figure.subplots(1, 3, sharey=True), free.items(), strict=True
    ):
        axes.plot(values, share, "o-", color=style.OKABE_ITO[0], markersize=3.0)
        axes.set_ylim(-0.05, 1.05)
        against_strength(axes, kind)
    figure.axes[0].set_ylabel("share of pairs that never meet")
    return figure


def main() -> None:
    folder = (Path("noise"), "where pictures go")
    options = options_of(__doc__, impacts=1_000_000, seed=1, pictures=folder)
    began, seed = time.time(), options.seed
    every = [
        one
        for compare in (stationary, surviving, covariances)
        for one in compare(options.impacts, seed)
    ]
    head = ("what", "closed form", "measured", "standard errors apart")
    text = table(head, [one.row for one in every])
    if worst := [one for one in every if abs(one.found - one.known) > 3.0 * one.error]:
        raise SystemExit(f"beyond three standard errors: {worst}")
    kicks, drives = np.geomspace(0.08, 0.5, 10), np.geomspace(0.1, 1.0, 8)
    slips = np.geomspace(0.02, 0.3, 8)
    lives = {
        "kick_noise": (kicks, lifetime({"kick_noise": kicks}, seed)),
        "drive_noise": (drives, lifetime({"drive_noise": drives}, seed)),
        "restitution_noise": (slips, lifetime({"restitution_noise": slips}, seed)),
    }
    strengths = (0.01, 0.02, 0.04, 0.08)
    amplitude = np.linspace(0.45, 3.4, 120)
    kept = blurred(amplitude, seed, strengths)
    a = np.geomspace(0.02, 50.0, 40)
    squares = {sigma: mean_squares(a, 0.9, seed, sigma) for sigma in (0.0, 0.3, 3.0)}
    ranges = {"kick_noise": (0.01, 0.2), "drive_noise": (0.01, 0.5)}
    ranges["restitution_noise"] = (0.002, 0.05)
    free = {kind: np.geomspace(*ends, 10) for kind, ends in ranges.items()}
    free = {kind: (values, apart({kind: values}, seed)) for kind, values in free.items()}
    rows = [
        (kind, f"{value:.3g}", f"{life:.4g}", f"{low:.4g} to {high:.4g}")
        for kind, (values, found) in lives.items()
        for value, life, low, high in zip(values, *found, strict=True)
    ]
    head = ("noise", "strength", "lifetime (periods)", "95 %")
    origin = provenance(time.time() - began, seed)
    show(options, "closed forms", f"{text}\n\n{origin}", PAGE)
    show(options, "lifetimes", f"{table(head, rows)}\n\n{origin}", PAGE)
    save("noise_lifetime", lifetimes(lives), options.pictures)
    ends = (0.4905, 3.00677)
    save("noise_windows", windows(amplitude, strengths, kept, ends), options.pictures)
    save("noise_energy", energy(a, 0.9, squares), options.pictures)
    save("noise_staggering", staggering(free), options.pictures)


if __name__ == "__main__":
    main()
