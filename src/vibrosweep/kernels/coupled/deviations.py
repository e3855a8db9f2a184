"""Small deviations from the joint state of all particles and a base of finite mass.

The rows of a deviation are the height of each particle, the velocity of each particle, and height
and velocity of the base.  Between impacts it follows the linear flow.  An impact changes it by the
saltation matrix (Aizerman & Gantmakher 1958): the impact is delayed by (dy - dY) / c, where c is
the speed of approach.  Riders have the deviation of the base.  When all riders lift off together,
accelerations are continuous and the deviation does not change; neither does it at a corner of the
drive, whose time does not deviate.
"""

from __future__ import annotations

from vibrosweep.kernels._jit import Floats, Integers, jit, part
from vibrosweep.kernels.bases.drives import forcing, side_of
from vibrosweep.kernels.bases.sprung import Load, Mount, free_motion, loaded, recoil_share
from vibrosweep.kernels.coupled.events import next_event
from vibrosweep.kernels.coupled.state import (
    EVENT,
    MODE,
    NOW,
    Event,
    System,
    acceleration,
    phase_now,
)
from vibrosweep.kernels.restitution import ratio, slope


@part
def _ride(mode: Integers, deviations: Floats) -> None:
    """Give the riders the deviation of the base."""
    particles = mode.size
    for j in range(particles):
        if mode[j] == MODE.RIDING:
            for column in range(deviations.shape[1]):
                deviations[j, column] = deviations[2 * particles, column]
                deviations[particles + j, column] = deviations[2 * particles + 1, column]


@part
def propagate(load: Load, t: float, mode: Integers, deviations: Floats) -> None:
    """Let deviations follow the flow for the time t, during which particles have this `mode`."""
    particles = mode.size
    rise, gain, _, _ = free_motion(load, 1.0, load.slow, t)
    rise_v, gain_v, _, _ = free_motion(load, 0.0, 1.0, t)
    for column in range(deviations.shape[1]):
        deviation = deviations[:, column]
        for j in range(particles):
            deviation[j] += t * deviation[particles + j]
        y, v = deviation[2 * particles], deviation[2 * particles + 1]
        deviation[2 * particles] = y * (1.0 + rise) + v * (t + rise_v)
        deviation[2 * particles + 1] = y * gain + v * (1.0 + gain_v)
    _ride(mode, deviations)


@jit
def _pull(state: System, fixed: Mount, load: Load, speed: float) -> float:
    """Acceleration of the base now, at this velocity and under a load."""
    bare, count = loaded(fixed, 0, side_of(load.drive)), load.riders
    driven = forcing(bare.drive, phase_now(state), bare.stiffness, bare.drag)
    free = driven - 2.0 * bare.drag * speed - bare.stiffness * state.now[NOW.HEIGHT]
    return float((free - 2.0 * count * fixed.mu) / (1.0 + count * fixed.mu))


@part
def _impact(
    state: System,
    fixed: Mount,
    before: Load,
    after: Load,
    event: Event,
    rode: Integers,
    deviations: Floats,
) -> None:
    """Change deviations by an impact that has happened.

    `before`, `after`, `rode`: the base before and after it, and the modes before it.
    """
    particles, j, c = state.mode.size, event.who, event.speed
    count, speed = before.riders, state.now[NOW.SPEED]
    (pulls, _), sticks = acceleration(state, after), event.kind == EVENT.STICK
    taking = 0 if event.dropped else count
    q = slope(fixed.law, fixed.e, fixed.scale, c)
    kept = ratio(fixed.law, fixed.e, fixed.scale, c)
    share = recoil_share(fixed, taking, q, sticks)  # of a change of c that the base loses
    gain = 1.0 - share if sticks else 1.0 + q - share  # and that the particle gains
    kick = recoil_share(fixed, taking, kept, sticks) * c
    was = speed + kick  # velocity of the base before the impact; that of the particle was c less
    pulled = _pull(state, fixed, before, was)
    for column in range(deviations.shape[1]):
        deviation = deviations[:, column]
        dy, dv = deviation[j], deviation[particles + j]
        base_y, base_v = deviation[2 * particles], deviation[2 * particles + 1]
        delay = (dy - base_y) / c if c > 0.0 else 0.0
        y = base_y + was * delay  # both are at this height at the moment of the impact
        v, w = dv - 2.0 * delay, base_v + pulled * delay
        approach = w - v
        for i in range(particles):
            if event.dropped and rode[i] == MODE.RIDING:  # it keeps its velocity
                deviation[particles + i] = w + 2.0 * delay
        leaves = speed if sticks else speed + kept * c
        deviation[j] = y - leaves * delay
        deviation[particles + j] = v + gain * approach + 2.0 * delay
        deviation[2 * particles] = y - speed * delay
        deviation[2 * particles + 1] = w - share * approach - pulls * delay


@part
def follow_event(
    state: System,
    fixed: Mount,
    load: Load,
    launch_speed: float,
    until: float,
    rode: Integers,
    deviations: Floats,
) -> tuple[Event, Load]:
    """Advance the state to its next event, and deviations with it; see `next_event`.

    Without an event, only bounds of future times change.  `rode` is overwritten with the modes
    before the event.
    """
    particles = state.mode.size
    for j in range(particles):
        rode[j] = state.mode[j]
    event, after = next_event(state, fixed, load, launch_speed, until)
    if event.kind <= EVENT.LOST:
        return event, after
    propagate(load, event.time, rode, deviations)
    if event.kind == EVENT.LAUNCH:
        for column in range(deviations.shape[1]):
            deviations[event.who, column] = deviations[2 * particles, column]
            deviations[particles + event.who, column] = 0.0
    elif event.kind == EVENT.BOUNCE or event.kind == EVENT.STICK:
        _impact(state, fixed, load, after, event, rode, deviations)
    _ride(state.mode, deviations)
    return event, after
