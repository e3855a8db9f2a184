"""Noise in the vector kernel: random numbers of the next impact of each lane."""

from __future__ import annotations

from typing import Final, NamedTuple

from vibrosweep.kernels._jit import Floats, jit, wide_vectors
from vibrosweep.kernels.deviates import (
    OF_DRIVE,
    OF_KICK,
    OF_RESTITUTION,
    Key,
    Word,
    deviate,
    deviates,
)
from vibrosweep.kernels.impact import land
from vibrosweep.kernels.lanes import ROW
from vibrosweep.kernels.noise import Noise, Source, period_of


class Rows(NamedTuple):
    """Rows of one kind of noise: of its strength, and of the deviates of two impacts."""

    purpose: Word
    size: int
    drawn: int
    following: int


SLIPS: Final = Rows(OF_RESTITUTION, ROW.SLIP_SIZE, ROW.SLIP, ROW.SLIP_NEXT)
PUSHES: Final = Rows(OF_KICK, ROW.PUSH_SIZE, ROW.PUSH, ROW.PUSH_NEXT)


@jit
def load_noise(
    noise: Noise | None, source: Source, s: Floats, j: int, particle: float, n_end: float
) -> None:
    """Put the noise of a realization into lane j, for a particle whose counts begin at n_end."""
    if noise is not None:
        s[ROW.STREAM + j], s[ROW.PARTICLE + j] = source.stream, particle
        s[ROW.ORIGIN + j], s[ROW.ASLEEP + j] = n_end + source.turns, 0.0
        s[ROW.SLIP_SIZE + j], s[ROW.PUSH_SIZE + j] = source.restitution, source.kick
        s[ROW.DRIVE_SIZE + j] = source.drive


@jit
def draw_all(noise: Noise | None, s: Floats, lanes: int, since: int, together: float) -> None:
    """Draw the random numbers of the next impact of the first lanes, in pass `since` after a check.

    If `together` is 1, every pass is an impact of each lane, and the number of impacts at the last
    check is even: each pair of deviates serves two successive impacts.  If it is 0, each lane
    counts its own impacts.
    """
    if noise is not None:
        wide_vectors()
        if together == 0.0:
            for j in range(lanes):
                _draw_one(noise.restitution, noise.key, s, j, SLIPS)
                _draw_one(noise.kick, noise.key, s, j, PUSHES)
        elif since % 2 == 0:
            for j in range(lanes):
                _draw_two(noise.restitution, noise.key, s, j, since, SLIPS)
                _draw_two(noise.kick, noise.key, s, j, since, PUSHES)
        else:
            for j in range(lanes):
                _take_second(noise.restitution, s, j, SLIPS)
                _take_second(noise.kick, s, j, PUSHES)
        _draw_drives(noise.drive, noise.key, s, lanes)


@jit
def _draw_one(on: int | None, key: Key, s: Floats, j: int, rows: Rows) -> None:
    if on is not None:
        stream, particle, age = s[ROW.STREAM + j], s[ROW.PARTICLE + j], s[ROW.AGE + j]
        s[rows.drawn + j] = s[rows.size + j] * deviate(key, stream, particle, age, rows.purpose)


@jit
def _draw_two(on: int | None, key: Key, s: Floats, j: int, since: int, rows: Rows) -> None:
    if on is not None:
        stream, particle = s[ROW.STREAM + j], s[ROW.PARTICLE + j]
        pair = 0.5 * (s[ROW.AGE + j] + since)
        first, second = deviates(key, stream, particle, pair, rows.purpose)
        s[rows.drawn + j] = s[rows.size + j] * first
        s[rows.following + j] = s[rows.size + j] * second


@jit
def _take_second(on: int | None, s: Floats, j: int, rows: Rows) -> None:
    if on is not None:
        s[rows.drawn + j] = s[rows.following + j]


@jit
def _draw_drives(on: int | None, key: Key, s: Floats, lanes: int) -> None:
    """Draw the amplitude of the period of the next landing, or of a period that may end a rest."""
    if on is not None:
        wide_vectors()
        for j in range(lanes):
            flown = s[ROW.U + j] if s[ROW.ASLEEP + j] == 0.0 else 0.0
            x, passed = land(s[ROW.X + j], flown)
            period = period_of(s[ROW.N + j] + passed + s[ROW.ORIGIN + j], x)
            drawn = deviate(key, s[ROW.STREAM + j], 0.0, period, OF_DRIVE)
            s[ROW.DRIVE + j] = s[ROW.DRIVE_SIZE + j] * drawn


@jit
def note_sleep(noise: Noise | None, s: Floats, j: int, rests: bool) -> None:
    """Note whether lane j has come to rest; it sleeps until a forcing period lifts it."""
    if noise is not None and noise.drive is not None:
        waits = s[ROW.ASLEEP + j]
        s[ROW.ASLEEP + j] = 1.0 if rests else waits if waits > 0.0 else 0.0
