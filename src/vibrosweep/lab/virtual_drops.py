"""Virtual drops of a ball on a floor, recorded as films or as sound, with known truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, require_one_of
from vibrosweep.lab.ballistics import flight_of
from vibrosweep.lab.experiment import CONTACTS, LEVEL
from vibrosweep.lab.paths import EXPONENT, Ball, LastingContact, Path, compress
from vibrosweep.lab.recordings import Recording
from vibrosweep.lab.variables import require_instance, require_number
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    range_mistake,
    require_law,
    restitution_at,
)

__all__ = ["FloorExperiment", "Truth", "film_drops", "hear_drops"]

MOST_DROPS: Final = 10_000
LEAST: Final = 0.02  # m s-1; a slower ball is at rest


ALLOWED: Final = {
    "height": (1e-3, 100.0),
    "height_spread": (0.0, 1.0),
    "restitution": (0.01, 1.0),
    "restitution_speed": (1e-3, 100.0),
    "slope": (-1.0, 1.0),
    "scatter": (0.0, 0.1),
    "drop_scatter": (0.0, 0.1),
    "contact_time": (1e-9, 0.1),
    "terminal_speed": (1.0, np.inf),
    "gravity": (0.1, 100.0),
    "incline": (-1.2, 1.2),
    "bounces": (1, 1000),
    "frame_rate": (1.0, 1e5),
    "noise": (0.0, 0.1),
    "unit": (1e-9, 1e3),
    "rounding": (0.0, 1.0),
    "lost": (0.0, 0.9),
    "timing": (0.0, 0.1),
    "missed": (0.0, 0.9),
    "false": (0.0, 10.0),
}


@dataclass(frozen=True)
class FloorExperiment:
    """A ball dropped on a floor, and its recording; lengths in m, times in s.

    Attributes
    ----------
    height, height_spread
        Drop height, and its standard deviation.
    restitution, restitution_law, restitution_speed, slope
        As in a scene; `slope` is a linear change of e with speed (s/m) about 1 m/s.
    scatter, drop_scatter
        Standard deviations of e from bounce to bounce and from drop to drop.
    contact_time, contact
        Contact time at 1 m/s, and the law of force: ``"dashpot"``, a linear spring and a dashpot,
        or ``"hertz"``, with longer contacts at low speed.
    terminal_speed
        Terminal speed in air, m/s.
    incline
        Inclination of the floor in rad; films then hold x and y, and the ball also moves along the
        floor.
    bounces
        Largest number of bounces of a drop.
    frame_rate, noise, unit, rounding, lost
        Of a film: frames per second, noise of a position in m, unit of the file in m, resolution of
        the time stamps, fraction of lost frames.
    hands
        Whether the film begins with the ball held, and ends with the ball caught.
    timing, missed, false
        Of sound: standard deviation of the time of a click, fraction of missed clicks, and number
        of false clicks per impact.

    Examples
    --------
    >>> from vibrosweep.lab import FloorExperiment, hear_drops
    >>> recordings, truth = hear_drops(FloorExperiment(restitution=0.8), 2, seed=1)
    >>> recordings[0].time.size
    9
    """

    height: float = 0.8
    height_spread: float = 0.0
    restitution: float = 0.85
    restitution_law: str = CONSTANT
    restitution_speed: float = 1.0
    slope: float = 0.0
    scatter: float = 0.0
    drop_scatter: float = 0.0
    contact_time: float = 5e-4
    contact: str = "dashpot"
    terminal_speed: float = np.inf
    incline: float = 0.0
    gravity: float = 9.81
    bounces: int = 8
    frame_rate: float = 240.0
    noise: float = 3e-4
    unit: float = 1.0
    rounding: float = 0.0
    lost: float = 0.0
    hands: bool = False
    timing: float = 1e-4
    missed: float = 0.0
    false: float = 0.0

    def __post_init__(self) -> None:
        require_one_of("contact", self.contact, CONTACTS)
        require_law("restitution_law", self.restitution_law)
        for name, (low, high) in ALLOWED.items():
            value = getattr(self, name)
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            sound = number and low <= value <= high
            if not sound or (name == "bounces" and value != int(value)):
                raise ParameterError(f"{name} = {value!r}: must be from {low:g} to {high:g}")
        if not isinstance(self.hands, bool | np.bool_):
            raise ParameterError(f"hands = {self.hands!r}: must be true or false")
        if wrong := range_mistake(self.restitution_law, np.array(self.restitution)):
            raise ParameterError(wrong)


class Truth(NamedTuple):
    """True motion in a drop: time, speed and restitution of each impact."""

    time: Array
    speed: Array
    restitution: Array
    apex: Array  # times of the apexes, starting with the release
    rise: Array  # heights of the apexes
    length: Array  # contact times


def _drop(setup: FloorExperiment, rng: np.random.Generator) -> Truth:
    g, drag = setup.gravity * np.cos(setup.incline), setup.terminal_speed**-2
    own = setup.drop_scatter * rng.standard_normal()
    height = setup.height + setup.height_spread * rng.standard_normal()
    nominal, apex, made = float(np.sqrt(2.0 * g * height)), 0.0, []
    for k in range(setup.bounces + 1):
        _, w, _, fall = (float(one) for one in flight_of(np.asarray(nominal), g, drag))
        law, reference = setup.restitution_law, setup.restitution_speed
        e = float(restitution_at(w, setup.restitution, law, reference))
        e += setup.slope * (w - 1.0) + own + setup.scatter * rng.standard_normal()
        e = float(np.clip(e, 1e-3, 1.0))
        length = setup.contact_time * w ** EXPONENT[setup.contact]
        made.append((apex + fall, w, e, apex, nominal**2 / (2.0 * g), length))
        if e * w < LEAST or k == setup.bounces:
            break
        # nominal speed of a rise with the lift-off speed e w
        nominal = float(np.sqrt(np.log1p(drag * (e * w) ** 2) / drag)) if drag else e * w
        apex += fall + length + float(flight_of(np.asarray(nominal), g, drag)[2])
    return Truth(*np.array(made, np.float64).T)


def _path(truth: Truth, setup: FloorExperiment) -> Path:
    """Return heights above the level at first contact."""
    g, drag = setup.gravity * np.cos(setup.incline), setup.terminal_speed**-2
    contacts = [
        LastingContact(begin, speed, length, compress(e, setup.contact).sol)
        for begin, speed, e, length in zip(
            truth.time, truth.speed, truth.restitution, truth.length, strict=True
        )
    ]
    start = np.append(0.0, (truth.time + truth.length)[:-1])
    ball = Ball(float, g, drag, setup.contact, setup.contact_time, 0.0)
    return Path(ball, LEVEL, start, truth.time, truth.apex, truth.rise, contacts[:-1])


def _random(setup: FloorExperiment, drops: int, seed: int) -> np.random.Generator:
    """Check the arguments of a recording, and return its random numbers."""
    require_instance("setup", setup, FloorExperiment)
    require_number("drops", drops, 1, MOST_DROPS, whole=True)
    require_number("seed", seed, 0, whole=True)
    return np.random.default_rng(seed)


def film_drops(
    setup: FloorExperiment, drops: int = 1, seed: int = 0
) -> tuple[list[Recording], list[Truth]]:
    """Film drops of a ball on a floor.

    Parameters
    ----------
    setup
        The ball, the floor and the camera.
    drops
        Number of drops, one film each.
    seed
        Seed of the random numbers.

    Returns
    -------
    list of Recording, list of Truth
        The films, and the true motion in each.

    Examples
    --------
    >>> from vibrosweep.lab import FloorExperiment, film_drops
    >>> films, truth = film_drops(FloorExperiment(bounces=3))
    >>> films[0].height.size > 200
    True
    """
    rng = _random(setup, drops, seed)
    films, truths = [], []
    for k in range(drops):
        truth = _drop(setup, rng)
        step, wait = 1.0 / setup.frame_rate, 0.3 * setup.hands
        end = truth.time[-1] - 0.4 * (truth.time[-1] - truth.apex[-1]) * setup.hands
        time = np.arange(-wait + step * rng.random(), end + wait, step)
        height = _path(truth, setup).height(np.clip(time, 0.0, end))
        if setup.hands:  # the hand catches the ball and raises it
            height += 0.3 * np.maximum(time - end, 0.0)
        horizontal = None
        if setup.incline:
            sine, cosine = np.sin(setup.incline), np.cos(setup.incline)
            along = 0.4 * time - 0.5 * setup.gravity * sine * time**2
            horizontal = (
                along * cosine - height * sine + setup.noise * rng.standard_normal(time.size)
            )
            height = along * sine + height * cosine
        height += setup.noise * rng.standard_normal(time.size) + 0.1 * rng.random()
        time = time + wait
        if setup.rounding:
            time = np.round(time / setup.rounding) * setup.rounding
        filmed = rng.random(time.size) >= setup.lost
        filmed &= np.append(True, np.diff(time) > 0.0)
        films.append(
            Recording(
                name=f"drop {k + 1}",
                group="",
                time=time[filmed],
                height=height[filmed] / setup.unit,
                horizontal=None if horizontal is None else horizontal[filmed] / setup.unit,
                scale_known=setup.unit == 1.0,
                rate_known=True,
                rounding=setup.rounding,
                peaks=None,
            )
        )
        truths.append(truth)
    return films, truths


def hear_drops(
    setup: FloorExperiment, drops: int = 1, seed: int = 0
) -> tuple[list[Recording], list[Truth]]:
    """Record the clicks of the impacts of drops.

    Parameters
    ----------
    setup
        The ball, the floor and the stopwatch.
    drops
        Number of drops.
    seed
        Seed of the random numbers.

    Returns
    -------
    list of Recording, list of Truth
        Times of clicks, and the true motion of each drop.

    Examples
    --------
    >>> from vibrosweep.lab import FloorExperiment, hear_drops
    >>> recordings, truth = hear_drops(FloorExperiment(bounces=5))
    >>> recordings[0].time.size, truth[0].speed.size
    (6, 6)
    """
    rng = _random(setup, drops, seed)
    lists, truths = [], []
    for k in range(drops):
        truth = _drop(setup, rng)
        time = truth.time + setup.timing * rng.standard_normal(truth.time.size)
        time = time[rng.random(time.size) >= setup.missed]
        extra = rng.poisson(setup.false * truth.time.size)
        time = np.sort(np.append(time, rng.uniform(truth.time[0], truth.time[-1], extra)))
        if setup.rounding:
            time = np.round(time / setup.rounding) * setup.rounding
        lists.append(
            Recording(
                name=f"drop {k + 1}",
                group="",
                time=time,
                height=None,
                horizontal=None,
                scale_known=True,
                rate_known=True,
                rounding=setup.rounding,
                peaks=None,
            )
        )
        truths.append(truth)
    return lists, truths
