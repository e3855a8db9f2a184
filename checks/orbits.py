"""Orbits and bifurcations by independent methods.

``python checks/orbits.py digits`` (80 s of processor time) compares orbits and bifurcations with 60
digits, differences, no kernels: a flight is found by steps of 1/200 period and Newton's method on
its height, the multipliers of an orbit from differences of its p-fold impact, and a bifurcation as
a root of orbit and multiplier at once, again from differences.

``python checks/orbits.py search`` compares the stable orbits on which trajectories settle with
those that the search finds, at random parameters of random waveforms and laws.  Each waveform needs
kernels of its own, which take minutes to compile.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

import vibrosweep as vs

ctx.prec = 220  # bits
GRAVITY = 9.81
TOLERANCE = 1e-11  # relative: limited by the digits in `yielding`; parameters agree to 1e-15
TURN = 2 * arb.pi()
TURN_FLOAT = 2.0 * np.pi
State = tuple[Any, Any]
BASES = ("high-bounce", "moving")


def fly(base: str, e: Any, a: Any, x: Any, y: Any) -> State:
    """Duration of a flight from phase x with relative speed y, and relative speed of arrival."""
    if base == "high-bounce":
        return y, y
    alpha = a / (1 + e)
    u = y + alpha * (TURN * x).sin()

    def height(s: Any) -> Any:
        return s * (u - s) / 2 + alpha / (2 * TURN) * ((TURN * (x + s)).cos() - (TURN * x).cos())

    def arrival(s: Any) -> Any:
        return 2 * s - u + alpha * (TURN * (x + s)).sin()

    s = arb(1) / 200
    while height(s) > 0:
        s += arb(1) / 200
    for _ in range(12):
        s = (s + 2 * height(s) / arrival(s)).mid()
    return s, arrival(s)


def cycle(base: str, e: Any, a: Any, p: int, x: Any, y: Any) -> State:
    """Phase, not reduced, and relative speed after p impacts."""
    for _ in range(p):
        s, v = fly(base, e, a, x, y)
        x, y = (x + s).mid(), e * v
        y = (y + a * (TURN * x).sin()).mid() if base == "high-bounce" else y.mid()
    return x, y


def trace(base: str, e: Any, a: Any, p: int, x: Any, y: Any) -> Any:
    """Trace of the Jacobian of p impacts, from central differences."""
    h = arb(2) ** -70
    along = (cycle(base, e, a, p, x + h, y)[0] - cycle(base, e, a, p, x - h, y)[0]) / (2 * h)
    across = (cycle(base, e, a, p, x, y + h)[1] - cycle(base, e, a, p, x, y - h)[1]) / (2 * h)
    return along + across


def bifurcation(
    base: str, e: Any, orbit: tuple[int, int], multiplier: int, guess: Sequence[float]
) -> Any:
    """Kick at which an orbit has a multiplier, from a guess of phase, relative speed and kick."""
    p, q = orbit
    determinant = e**p if base == "high-bounce" else e ** (2 * p)

    def equations(z: list[Any]) -> list[Any]:
        x, y, a = z
        after, speed = cycle(base, e, a, p, x, y)
        off = 1 - multiplier * trace(base, e, a, p, x, y) + determinant
        return [after - x - q, speed - y, off]

    z, h = [arb(float(g)) for g in guess], arb(2) ** -50
    for _ in range(12):
        off = equations(z)
        columns = []
        for c in range(3):
            moved = [value + h if k == c else value for k, value in enumerate(z)]
            columns.append([(m - o) / h for m, o in zip(equations(moved), off, strict=True)])
        slopes = arb_mat(3, 3, [columns[c][r].mid() for r in range(3) for c in range(3)])
        step = slopes.solve(arb_mat(3, 1, [one.mid() for one in off]))
        z = [(value - step[k, 0]).mid() for k, value in enumerate(z)]
    assert all(abs(float(step[k, 0])) < 1e-20 for k in range(3)), "no bifurcation there"
    return z[2]


def compare(base: str, e: str, q: int, judge: Callable[[str, float, Any], None]) -> None:
    """Compare the saddle-node and the doubling of the orbits (2, q) at a restitution."""
    found = vs.branches(
        restitution=float(e), amplitude=[0.5, 3.0, 5.0, 8.0], impacts=2, periods=q, base=base
    )
    for i in np.flatnonzero((found.cycle_impacts == 2) & (found.cycle_periods == q)):
        _compare_events(base, float(e), found.isel(branch=int(i)), (2, q), judge)


def _compare_events(
    base: str, e: float, one: Any, orbit: tuple[int, int], judge: Callable[[str, float, Any], None]
) -> None:
    """Compare the saddle-nodes and doublings of a branch."""
    p, q = orbit
    for kind, multiplier in ((0, 1), (1, -1)):
        for k in np.flatnonzero(one.bifurcation.values == kind):
            a = float(one.bifurcation_amplitude[k]) * 2.0 / GRAVITY
            phase = float(one.bifurcation_phase.values[k, 0])
            points = one.amplitude.values * 2.0 / GRAVITY
            near = int(np.nanargmin(np.abs(points - a)))
            speed = float(one.rebound_velocity[near, 0]) * 2.0 / GRAVITY
            if base == "moving":
                speed -= a / (1.0 + e) * np.sin(2.0 * np.pi * phase)
            kick = bifurcation(base, arb(e), orbit, multiplier, (phase, speed, a))
            judge(f"{base} e = {e} ({p}, {q}) multiplier {multiplier:+d}", a, kick)


def shapes(judge: Callable[[str, float, Any], None]) -> None:
    """Compare folds and corners of orbits of one impact under other waveforms, k = 1.

    Such an orbit is a root of a w(x) = 1 - e, over both bases, so that it has folds where w'(x) = 0
    and is born at a corner of w.
    """
    tones = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
    x = np.linspace(0.0, 1.0, 100_001)
    w = np.sin(TURN_FLOAT * x) + 0.4 * np.sin(2.0 * TURN_FLOAT * x + 1.1)
    near = x[1:-1][(np.diff(w[:-1]) > 0.0) != (np.diff(w[1:]) > 0.0)]
    folds = []
    for start in near:
        y = arb(float(start))
        for _ in range(9):  # Newton's method on w'
            slope = (TURN * y).cos() + arb(0.8) * (2 * TURN * y + arb(1.1)).cos()
            bend = -(TURN * y).sin() - arb(1.6) * (2 * TURN * y + arb(1.1)).sin()
            y = (y - slope / (TURN * bend)).mid()
        top = (TURN * y).sin() + arb(0.4) * (2 * TURN * y + arb(1.1)).sin()
        if top > 0:
            folds.append((1 - arb(0.85)) / top)
    cases: list[tuple[Any, str, float, list[float], int, list[Any]]] = [
        (tones, base, 0.85, [0.12, 0.25, 0.29, 0.9], 0, folds) for base in ("high-bounce", "moving")
    ]
    cases.append(("parabolic", "high-bounce", 0.7, [0.2, 0.5, 1.0], 5, [1 - arb(0.7)] * 2))
    for waveform, base, e, kicks, kind, expected in cases:
        values = [a * GRAVITY / 2.0 for a in kicks]
        found = vs.branches(restitution=e, amplitude=values, waveform=waveform, base=base)
        met = found.bifurcation_amplitude.values[found.bifurcation.values == kind]
        name = "two tones" if waveform is tones else waveform
        pairs = zip(sorted(met), sorted(expected, key=float), strict=True)
        for at, exact in pairs:
            judge(f"{base} e = {e} (1, 1) {name}", float(at) * 2.0 / GRAVITY, exact)


def yielding(judge: Callable[[str, float, Any], None]) -> None:
    """Compare an orbit under a law of restitution with closed forms.

    Over the moving base c + E(c) = 2 k is the speed of arrival, alpha sin(2 pi x) = c - k; plastic,
    e = 0.9, v_y = 0.5 in units of g / 2f, k = 1, Gamma = 0.6.
    """
    unit = GRAVITY / 2.0
    found = vs.orbits(
        restitution=0.9,
        base_acceleration=0.6,
        base="moving",
        restitution_law="plastic",
        restitution_speed=0.5 * unit,
        impacts=1,
        periods=1,
    )
    i = int(np.argmax(found.stable.values))
    trace = float(found.multiplier_real[i].sum())
    judge("plastic, phase", float(found.impact_phase[i, 0]), arb("0.3476165567904094"))
    judge("plastic, speed", float(found.impact_speed[i, 0]) / unit, arb("1.156174619245715"))
    judge("plastic, trace", trace, arb("0.47506128917"))


def closed_forms(judge: Callable[[str, float, Any], None]) -> None:
    """Compare the ends of modes 1 to 4 with closed forms, and the products of all multipliers."""
    for base in BASES:
        for e in (0.3, 0.5, 0.7, 0.9, 0.99):
            values = [0.01, 4.0, 12.0, 20.0]
            found = vs.branches(restitution=e, amplitude=values, periods=4, base=base)
            assert sorted(found.cycle_periods.values) == [1, 2, 3, 4]
            exact, worst = arb(e), {0: (0.0, arb(1)), 1: (0.0, arb(1))}
            last = 1 + exact if base == "high-bounce" else 2 * (1 + exact**2) / (1 + exact)
            for i, k in enumerate(found.cycle_periods.values.tolist()):
                born = (1 - exact) * k
                doubles = (born**2 + (last / arb.pi()) ** 2).sqrt()
                for kind, kick in ((0, born), (1, doubles)):
                    one = found.isel(branch=i)
                    (at,) = one.bifurcation_amplitude.values[one.bifurcation.values == kind]
                    pair = float(at) * 2.0 / GRAVITY, kick
                    off = [abs(float((arb(a) - b) / b)) for a, b in (pair, worst[kind])]
                    worst[kind] = pair if off[0] >= off[1] or worst[kind][0] == 0.0 else worst[kind]
            for kind, name in ((0, "A_min"), (1, "A_max")):
                judge(f"{base} e = {e} {name}, the worst of k = 1 to 4", *worst[kind])
        found = vs.orbits(restitution=[0.5, 0.9], amplitude=3.0, base=base, impacts=3, periods=3)
        roots = (found.multiplier_real + 1j * found.multiplier_imaginary).prod("multiplier")
        power = 1 if base == "high-bounce" else 2
        ratio = roots / found.restitution ** (power * found.cycle_impacts)
        ratio = ratio.where(found.cycle_impacts > 0, 1.0)
        most = ratio.values.ravel()[np.argmax(np.abs(ratio.values - 1.0))]
        judge(f"{base} product of multipliers / e^{power}p", float(most.real), arb(1))


def cascade(base: str, judge: Callable[[str, float, Any], None]) -> None:
    """Compare the doublings of mode 1 at e = 0.5, up to that of the orbit of 32 impacts."""
    found = vs.branches(restitution=0.5, amplitude=[1.0, 5.0], base=base, doublings=5)
    assert found.cycle_impacts.values.tolist() == [1, 2, 4, 8, 16, 32]
    for i, p in enumerate(found.cycle_impacts.values.tolist()):
        _compare_events(base, 0.5, found.isel(branch=i), (p, p), judge)


def corners(judge: Callable[[str, float, Any], None]) -> None:
    """Compare curves under the parabolic waveform with a = 1 - e and a = (1 + e) / 2."""
    values = [a * GRAVITY / 2.0 for a in (0.2, 0.6, 2.0)]
    found = vs.boundaries(restitution=[0.5, 0.7], amplitude=values, waveform="parabolic")
    assert sorted(found.bifurcation.values) == [1, 5]
    for i in range(2):
        one = found.isel(curve=i).dropna("point", subset=["restitution"])
        doubles = int(one.bifurcation) == 1
        for e, a in zip(one.restitution.values, one.amplitude.values, strict=True):
            exact = (1 + arb(float(e))) / 2 if doubles else 1 - arb(float(e))
            name = "doubles" if doubles else "is born at a corner"
            if e in (one.restitution.values[0], one.restitution.values[-1]):
                judge(f"parabolic e = {e:g} {name}", float(a) * 2.0 / GRAVITY, exact)


def falling(judge: Callable[[str, float, Any], None]) -> None:
    """Compare mode 1 under the viscoelastic law with closed forms, at the landing speed v = g / 2.

    A = v - E(v) at its birth, sqrt((v - E(v))^2 + (v (1 + E'(v)) / pi)^2) where it doubles.
    """
    found = vs.branches(
        restitution=0.9,
        amplitude=[0.2, 1.5, 8.0],
        restitution_law="viscoelastic",
        restitution_speed=1.0,
    )
    n1, d2, d3, d4 = (arb(c) for c in ("0.501086", "1.15345", "0.577977", "0.532178"))

    def share(y: Any) -> Any:
        return (1 + n1 * y) / (1 + n1 * y + y * y * (d2 + y * (d3 + y * d4)))

    low, high = arb(0), arb(1)
    for _ in range(210):  # share(y) falls
        middle = ((low + high) / 2).mid()
        low, high = (middle, high) if share(middle) > arb(0.9) else (low, middle)
    v, h = arb(GRAVITY) / 2, arb(2) ** -70

    def left(v: Any) -> Any:
        return share(low * v.root(10)) * v

    slope = (left(v + h) - left(v - h)) / (2 * h)
    born = v - left(v)
    doubles = (born**2 + (v * (1 + slope) / arb.pi()) ** 2).sqrt()
    for kind, exact in ((0, born), (1, doubles)):
        (at,) = found.bifurcation_amplitude.values[found.bifurcation.values == kind]
        judge(f"viscoelastic, multiplier {1 - 2 * kind:+d}", float(at), exact)


def at_once() -> int:
    """Return how many orbits born at a doubling do not exist at one amplitude alone.

    Flights over a base of constant acceleration: the equations of two landings are linear.
    """
    of = {"base": "moving", "waveform": "parabolic", "restitution": 0.75, "amplitude": [2.5, 5.5]}
    found, wrong = vs.branches(**of, impacts=1, periods=1, doublings=1), 0
    for i in np.flatnonzero(found.parent >= 0):
        values = found.amplitude.values[i][np.isfinite(found.amplitude.values[i])]
        right = values.size > 2 and np.ptp(values) < 1e-11 and not (found.bifurcation[i] == 0).any()
        wrong += not right or found.ends.values[i, 1] != 7  # at a corner of the waveform
    print(f"born at a doubling, at one amplitude: {int((found.parent >= 0).sum())}, {wrong} wrong")
    return int(wrong) + int(not (found.parent >= 0).any())


def steep() -> int:
    """Return 1 if a stable orbit under steep harmonics is missed.

    Newton's method leads to it from a small region only; trajectories settle on it.
    """
    tones = [
        [2, -0.5632604946323857, -0.41719416078983107],
        [5, -0.055606027087918695, 1.3496419404578157],
        [6, 0.24382204464520169, 1.7694305540175774],
    ]
    point = {"restitution": 0.6166970876905427, "amplitude": 4.266485748572371}
    found = vs.orbits(base="moving", waveform={"harmonics": tones}, **point, impacts=2, periods=2)
    held = np.flatnonzero((found.stable.values == 1) & (found.admissible.values == 1))
    known = np.array([-0.124988, -0.096335])
    turns = [np.sort((found.impact_phase.values[k, :2] + 0.5) % 1.0 - 0.5) for k in held]
    missed = not any(np.abs(one - known).max() < 1e-6 for one in turns)
    print(f"stable under steep harmonics: {'MISSED' if missed else 'found'}")
    return int(missed)


TONES: dict[str, Any] = {
    "sine": "sine",
    "parabolic": "parabolic",
    "two tones": {"harmonics": [[1, 1, 0], [2, 0.4, 1.1]]},
    "three tones": {
        "harmonics": [
            [2, -0.5632604946323857, -0.41719416078983107],
            [5, -0.055606027087918695, 1.3496419404578157],
            [6, 0.24382204464520169, 1.7694305540175774],
        ]
    },
}
LAWS: tuple[dict[str, Any], ...] = (
    {},
    {},
    {"restitution_law": "viscoelastic", "restitution_speed": 1.0},
    {"restitution_law": "plastic", "restitution_speed": 2.0},
)
MOST = {"impacts": 3, "periods": 4}
SPEEDS = (1.5, 4.0, 9.0)  # m/s, of the launches
PERIODS = 4000.0  # for which trajectories are followed
TRIED = 3000.0  # by which an orbit must have repeated to the last bit


def drawn(random: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """Draw a base, a waveform and a law; return words for them, and keywords."""
    base = str(random.choice(BASES))
    name = str(random.choice([*TONES, "random", "random"]))
    if name == "random":
        orders = random.choice(np.arange(1, 8), size=random.integers(2, 4), replace=False)
        weights = random.uniform(-1.0, 1.0, orders.size)
        phases = random.uniform(-np.pi, np.pi, orders.size)
        weights /= np.abs(weights).sum()
        tones = zip(orders.tolist(), weights.tolist(), phases.tolist(), strict=True)
        waveform: Any = {"harmonics": [list(tone) for tone in sorted(tones)]}
    else:
        waveform = TONES[name]
    law = LAWS[random.integers(len(LAWS))]
    words = f"{base}, {waveform if name == 'random' else name}, {law.get('restitution_law', '')}"
    return words, {"base": base, "waveform": waveform, **law}


def simulated(scene: dict[str, Any]) -> list[list[tuple[int, int, Any]]]:
    """Impacts, periods and phases of the orbits without rests on which trajectories settle."""
    found: list[list[tuple[int, int, Any]]] = [[] for _ in range(scene["realizations"])]
    for speed in SPEEDS:
        launched = {"launch_velocity": speed, "particles": 24}
        swept = vs.sweep(**scene, **launched, duration=PERIODS, regimes=True, per_particle=True)
        p, q = swept.cycle_impacts.values, swept.cycle_periods.values
        holds = (p > 0) & (p <= MOST["impacts"]) & (q <= MOST["periods"])
        holds &= (swept.cycle_rests.values == 0) & (swept.recurrent_from.values < TRIED)
        fixed = {k: v for k, v in scene.items() if k not in ("realizations", "seed")}
        for i in np.flatnonzero(holds.any(axis=1)):
            point = {n: float(swept[n].values[i]) for n in ("restitution", "amplitude")}
            until = float(swept.recurrent_from.values[i][holds[i]].max()) + 20.0
            record = vs.simulate(**(fixed | point), **launched, duration=until)
            for k in np.flatnonzero(holds[i]):
                landed = record.landing_time.values[0, k]
                landed = landed[np.isfinite(landed)][-int(p[i, k]) :]
                one = int(p[i, k]), int(q[i, k]), np.sort(landed % 1.0)
                if not any(alike(one, other) for other in found[i]):
                    found[i].append(one)
    return found


def alike(one: tuple[int, int, Any], other: tuple[int, int, Any]) -> bool:
    """Return whether two orbits have the same numbers and phases, in any order of the impacts."""
    if one[:2] != other[:2]:
        return False
    turned = [np.roll(other[2], k) for k in range(one[0])]
    return any(np.abs((one[2] - t + 0.5) % 1.0 - 0.5).max() < 1e-6 for t in turned)


def search(rounds: int, points: int, seed: int) -> int:
    """Print how many of the orbits that trajectories hold the search misses; return the number."""
    random = np.random.default_rng(seed)
    counts = dict.fromkeys(("held", "missing", "listed", "late", "unbalanced", "judged"), 0)
    for _ in range(rounds):
        words, scene = drawn(random)
        least = 0.46 if scene.get("restitution_law") == "viscoelastic" else 0.3  # its formula's end
        scene |= {"restitution": (least, 0.97), "amplitude": (0.3, 6.0), "frequency": 1.0}
        scene |= {"realizations": points, "seed": int(random.integers(2**31))}
        found = vs.orbits(**scene, **MOST)
        e, a = found.restitution.values, found.amplitude.values
        missing = total = listed = 0
        for i, orbits in enumerate(simulated(scene)):
            one = found.isel(realization=i)
            stable = np.flatnonzero((one.stable == 1) & (one.admissible == 1))
            listing = []
            for k in stable:
                p, q = int(one.cycle_impacts[k]), int(one.cycle_periods[k])
                listing.append((p, q, np.sort(one.impact_phase.values[k, :p] % 1.0)))
            total, listed = total + len(orbits), listed + len(listing)
            for orbit in orbits:
                if not any(alike(orbit, other) for other in listing):
                    missing += 1
                    print(f"  missing: e = {e[i]!r}, amplitude = {a[i]!r}, {orbit}")
        balanced, late = found.balanced.values, int(found.late_orbits.sum())
        print(f"{words}: {total} held, {missing} missing, {listed} listed, {late} late", flush=True)
        counts["held"] += total
        counts["missing"] += missing
        counts["listed"] += listed
        counts["late"] += late
        counts["unbalanced"] += int((balanced == 0).sum())
        counts["judged"] += int((balanced >= 0).sum())
    print(", ".join(f"{number} {name}" for name, number in counts.items()))
    return counts["missing"]


def digits() -> int:
    """Compare orbits and bifurcations with 60 digits; return 1 if one is off by too much."""
    worst = 0.0

    def judge(name: str, found: float, exact: Any) -> None:
        nonlocal worst
        off = abs(float((arb(found) - exact) / exact))
        worst = max(worst, off)
        print(f"{name:44}a = {exact.str(20, radius=False)}  off by {off:.1e}")

    for base in BASES:
        for e in ("0.5", "0.8"):
            for q in (1, 3):
                compare(base, e, q, judge)
    for base in BASES:
        cascade(base, judge)
    closed_forms(judge)
    shapes(judge)
    corners(judge)
    yielding(judge)
    falling(judge)
    print(f"largest relative difference {worst:.1e}, allowed {TOLERANCE:.0e}")
    return min(1, at_once() + steep() + int(worst > TOLERANCE))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", choices=("digits", "search"))
    parser.add_argument("--rounds", type=int, default=24, help="waveforms and laws that are drawn")
    parser.add_argument("--points", type=int, default=60, help="parameters of each")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if given.campaign == "digits":
        return digits()
    return min(1, search(given.rounds, given.points, given.seed))


if __name__ == "__main__":
    sys.exit(main())
