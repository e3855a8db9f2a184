"""Noise in the vector kernel: what is random in the next impact of each lane."""

from __future__ import annotations

from vibrosweep.kernels._jit import Floats, jit, wide_vectors
from vibrosweep.kernels.impact import land
from vibrosweep.kernels.lanes import ROW
from vibrosweep.kernels.noise import (
    OF_DRIVE,
    OF_KICK,
    OF_RESTITUTION,
    Key,
    Noise,
    Source,
    Word,
    deviate,
    deviates,
    period_of,
)


@jit
def load_noise(
    noise: Noise | None, source: Source, s: Floats, j: int, particle: float, n_end: float
) -> None:
    """Put the noise of a realization into lane j, for a particle whose counts begin at n_end."""
    if noise is not None:
        s[ROW.STREAM + j], s[ROW.PARTICLE + j] = source.stream, particle
        s[ROW.ORIGIN + j], s[ROW.ASLEEP + j] = n_end, 0.0
        s[ROW.SLIP_SIZE + j], s[ROW.PUSH_SIZE + j] = source.restitution, source.kick
        s[ROW.DRIVE_SIZE + j] = source.drive


@jit
def draw_all(noise: Noise | None, s: Floats, lanes: int, since: int, together: float) -> None:
    """Draw what is random in the next impact of the first lanes, `since` after the last look.

    Where lanes are `together`, 1, a pair of deviates is drawn for two impacts in turn: each has had
    an even number of them at the last look.  Else, 0, each lane counts its own.
    """
    if noise is not None:
        if together == 0.0:
            _draw_slips_apart(noise.restitution, noise.key, s, lanes)
            _draw_pushes_apart(noise.kick, noise.key, s, lanes)
        else:
            _draw_slips(noise.restitution, noise.key, s, lanes, since)
            _draw_pushes(noise.kick, noise.key, s, lanes, since)
            _draw_drives(noise.drive, noise.key, s, lanes)


@jit
def _draw_slips(on: int | None, key: Key, s: Floats, lanes: int, since: int) -> None:
    if on is not None:
        wide_vectors()
        if since % 2 == 0:
            for j in range(lanes):
                first, second = _pair(key, s, j, since, OF_RESTITUTION)
                s[ROW.SLIP + j] = s[ROW.SLIP_SIZE + j] * first
                s[ROW.SLIP_NEXT + j] = s[ROW.SLIP_SIZE + j] * second
        else:
            for j in range(lanes):
                s[ROW.SLIP + j] = s[ROW.SLIP_NEXT + j]


@jit
def _draw_pushes(on: int | None, key: Key, s: Floats, lanes: int, since: int) -> None:
    if on is not None:
        wide_vectors()
        if since % 2 == 0:
            for j in range(lanes):
                first, second = _pair(key, s, j, since, OF_KICK)
                s[ROW.PUSH + j] = s[ROW.PUSH_SIZE + j] * first
                s[ROW.PUSH_NEXT + j] = s[ROW.PUSH_SIZE + j] * second
        else:
            for j in range(lanes):
                s[ROW.PUSH + j] = s[ROW.PUSH_NEXT + j]


@jit
def _pair(key: Key, s: Floats, j: int, since: int, purpose: Word) -> tuple[float, float]:
    pair = 0.5 * (s[ROW.AGE + j] + since)
    return deviates(key, s[ROW.STREAM + j], s[ROW.PARTICLE + j], pair, purpose)


@jit
def _draw_slips_apart(on: int | None, key: Key, s: Floats, lanes: int) -> None:
    if on is not None:
        wide_vectors()
        for j in range(lanes):
            stream, particle = s[ROW.STREAM + j], s[ROW.PARTICLE + j]
            xi = deviate(key, stream, particle, s[ROW.AGE + j], OF_RESTITUTION)
            s[ROW.SLIP + j] = s[ROW.SLIP_SIZE + j] * xi


@jit
def _draw_pushes_apart(on: int | None, key: Key, s: Floats, lanes: int) -> None:
    if on is not None:
        wide_vectors()
        for j in range(lanes):
            stream, particle = s[ROW.STREAM + j], s[ROW.PARTICLE + j]
            xi = deviate(key, stream, particle, s[ROW.AGE + j], OF_KICK)
            s[ROW.PUSH + j] = s[ROW.PUSH_SIZE + j] * xi


@jit
def _draw_drives(on: int | None, key: Key, s: Floats, lanes: int) -> None:
    if on is not None:
        wide_vectors()
        for j in range(lanes):
            x, passed = land(s[ROW.X + j], s[ROW.U + j])
            period = period_of(s[ROW.N + j] + passed + s[ROW.ORIGIN + j], x)
            drawn = deviate(key, s[ROW.STREAM + j], 0.0, period, OF_DRIVE)
            s[ROW.DRIVE + j] = s[ROW.DRIVE_SIZE + j] * drawn


@jit
def note_sleep(noise: Noise | None, s: Floats, j: int, asleep: bool) -> None:
    """Note whether lane j has come to rest, and is to be woken."""
    if noise is not None:
        s[ROW.ASLEEP + j] = 1.0 if asleep else 0.0
