"""Noise of a realization: random numbers of an impact, their effects and their roundings.

The deviates are those of `vibrosweep.kernels.deviates`.  Each function does nothing where its first
argument, the field `noise` of a base, or the kind of noise that it needs, is None.  These are known
when a kernel is compiled, and a function that does nothing leaves no machine code.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from vibrosweep.kernels._jit import Floats, fma, jit
from vibrosweep.kernels.deviates import (
    LARGEST,
    OF_DRIVE,
    OF_KICK,
    OF_RESTITUTION,
    Key,
    deviate,
    key_of,
)
from vibrosweep.kernels.lanes import ROW
from vibrosweep.kernels.rounding import HALF_ULP
from vibrosweep.model.parameters import Strengths


class Noise(NamedTuple):
    """The field `noise` of a base: which quantities are random, each 1 or None, and the seed."""

    restitution: int | None
    kick: int | None
    drive: int | None
    key: Key


class Source(NamedTuple):
    """Noise of one realization, in its constants; zeros where nothing is random."""

    restitution: float
    kick: float
    drive: float
    stream: float
    end: float  # whole periods at the end of the observation, from which n may count
    turns: float  # whole turns in the phase of the forcing at t = 0, which n leaves out


class Draw(NamedTuple):
    """Random numbers of one impact; zeros where nothing is random."""

    slip: float  # added to the restitution
    push: float  # added to the speed of the rebound
    drive: float  # relative change of the amplitude


SILENT: Final = Source(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
STILL: Final = Draw(0.0, 0.0, 0.0)


def noise_of(strengths: Strengths | None, seed: int) -> Noise | None:
    """Return the noise of a base with such strengths in its realizations; None if it has none."""
    if strengths is None:
        return None
    restitution, kick, drive = (None if values is None else 1 for values in strengths[:3])
    return Noise(restitution, kick, drive, key_of(seed))


@jit
def source_of(strengths: Strengths | None, end_count: Floats, i: int) -> Source:
    """Noise of realization i."""
    if strengths is None:
        return SILENT
    return Source(
        _entry(strengths.restitution, i),
        _entry(strengths.kick, i),
        _entry(strengths.drive, i),
        strengths.stream[i],
        end_count[i],
        strengths.turns[i],
    )


@jit
def _entry(values: Floats | None, i: int) -> float:
    if values is None:
        return 0.0
    return values[i]  # type: ignore[no-any-return]


@jit
def period_of(n: float, x: float) -> float:
    """Return the number of the forcing period of the instant (n, x), x from -1/2 to 1/2."""
    return n - (1.0 if x < 0.0 else 0.0)


@jit
def draw_of(
    noise: Noise | None, source: Source, particle: float, number: float, period: float
) -> Draw:
    """Random numbers of an impact of a particle, counted from 0, in a forcing period."""
    if noise is None:
        return STILL
    key, stream, slip, push, drive = noise.key, source.stream, 0.0, 0.0, 0.0
    if noise.restitution is not None:
        slip = source.restitution * deviate(key, stream, particle, number, OF_RESTITUTION)
    if noise.kick is not None:
        push = source.kick * deviate(key, stream, particle, number, OF_KICK)
    if noise.drive is not None:
        drive = source.drive * deviate(key, stream, 0.0, period, OF_DRIVE)
    return Draw(slip, push, drive)


@jit
def together(noise: Noise | None) -> float:
    """Return 1 where each lane has an impact in every pass, 0 where some may wait in a rest."""
    if noise is None:
        return 1.0
    return 1.0 if noise.drive is None else 0.0


@jit
def lands(noise: Noise | None, s: Floats, j: int) -> bool:
    """Return whether lane j lands in this pass; with noise of the drive it may be at rest."""
    if noise is None:
        return True
    return bool(noise.drive is None or s[ROW.ASLEEP + j] == 0.0)


@jit
def count_impact(noise: Noise | None, s: Floats, j: int, landed: bool) -> None:
    """Count an impact of lane j, where not every pass is one."""
    if noise is not None and noise.drive is not None:
        s[ROW.AGE + j] += 1.0 if landed else 0.0


@jit
def drawn_in(noise: Noise | None, s: Floats, j: int) -> Draw:
    """Random numbers of the next impact of lane j."""
    if noise is None:
        return STILL
    return Draw(
        0.0 if noise.restitution is None else s[ROW.SLIP + j],
        0.0 if noise.kick is None else s[ROW.PUSH + j],
        0.0 if noise.drive is None else s[ROW.DRIVE + j],
    )


@jit
def slipped(noise: Noise | None, e: float, slip: float) -> float:
    """Restitution of an impact, from 0 to 1."""
    if noise is None:
        return e
    moved = e + slip
    moved = moved if moved > 0.0 else 0.0
    return moved if moved < 1.0 else 1.0


@jit
def slipped_slope(noise: Noise | None, share: float, q: float, slip: float) -> float:
    """Slope of the speed after an impact, whose law leaves a share of v with the slope q."""
    if noise is None:
        return q
    moved = share + slip
    within = q + slip if moved > 0.0 else 0.0
    return within if moved < 1.0 else 1.0


@jit
def pushed(noise: Noise | None, kick: float, push: float) -> float:
    """Kick of an impact."""
    if noise is None:
        return kick
    return kick + push


@jit
def thrown(noise: Noise | None, w: float, push: float) -> float:
    """Speed relative to a moving base, which a particle cannot enter, after a rebound with w."""
    if noise is None:
        return w
    return abs(w + push)


@jit
def slope_of(noise: Noise | None, share: float, q: float, draw: Draw, v: float) -> float:
    """Derivative of the speed of `thrown` by the speed v of arrival.

    The law leaves a share of v, with the slope q.
    """
    if noise is None:
        return q
    moved = slipped_slope(noise, share, q, draw.slip)
    return -moved if slipped(noise, share, draw.slip) * v + draw.push < 0.0 else moved


@jit
def driven(noise: Noise | None, a: float, drive: float) -> float:
    """Amplitude of the kick in a forcing period."""
    if noise is None:
        return a
    return fma(a, drive, a)


@jit
def swing(noise: Noise | None, a: float, drive: float) -> float:
    """Modulus of the change by noise of the drive that turned the nominal amplitude into a."""
    if noise is None:
        return 0.0
    return 0.0 if noise.drive is None else abs(a * (drive / (1.0 + drive)))


@jit
def rounding(noise: Noise | None, share: float, v: float, draw: Draw, kick: float = 0.0) -> float:
    """Bound of the rounding that noise adds to the speed after an impact, apart from the amplitude.

    The random parts of restitution and kick are products, and the strength of the kick has five
    roundings; each part is added to the number that it changes.
    """
    if noise is None:
        return 0.0
    of_share = 3.0 * abs(draw.slip) + 2.0 * share
    return HALF_ULP * (of_share * abs(v) + 8.0 * abs(draw.push) + abs(kick))


@jit
def clip_is_doubtful(noise: Noise | None, share: float, slip: float, error: float) -> bool:
    """Return whether the relative error of a speed may decide if its restitution is clipped.

    The relative change of the restitution of a law does not exceed that of the speed.
    """
    if noise is None:
        return False
    moved = share + slip
    return noise.restitution is not None and not min(abs(moved), abs(moved - 1.0)) > 4.0 * error


@jit
def period_is_doubtful(noise: Noise | None, x: float, error: float) -> bool:
    """Return whether an error of a phase decides in which forcing period it lies."""
    if noise is None:
        return False
    return noise.drive is not None and abs(x) <= error


@jit
def exceeds(noise: Noise | None, kick: float, r: float) -> bool:
    """Return whether the kick of a particle that has come to rest lifts it at once.

    Without noise such a particle would not have come to rest.
    """
    if noise is None:
        return False
    return kick > r


@jit
def strongest(noise: Noise | None, up: float, down: float, source: Source) -> float:
    """Largest kick of any forcing period, where without noise they are between -down and up."""
    if noise is None:
        return up
    change = LARGEST * source.drive
    return max(fma(up, change, up), fma(down, change, -down))


@jit
def lifted(
    noise: Noise | None, known: tuple[float, float], n: float, x: float
) -> tuple[float, float]:
    """Return the instant at which a particle that comes to rest at (n, x) lifts off.

    This is `known`, unless the amplitude is random: then it is the instant of the landing, from
    which `vibrosweep.kernels.bases.wake` searches.  A rest for good has an infinite count, or the
    phase NaN.
    """
    if noise is None:
        return known
    return known if noise.drive is None else (n, x)
