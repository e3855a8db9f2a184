"""Scenes that tests share, since a new combination needs machine code of its own.

Over the high-bounce and the moving base: a sine with constant restitution, two tones with constant
restitution, a sine with plastic restitution, and noise of all kinds that the base allows.  Over a
base of finite mass: a sine with constant restitution, and plastic restitution with noise.
"""

from vibrosweep.model.parameters import NOISE, RELATIVE_NOISE

KINDS_OF_NOISE = tuple(name for name in NOISE if name != RELATIVE_NOISE)  # each in one unit
TWO_TONES = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
# the machine code of noise, which changes no bit here; a base that moves has no noise of its drive
STILL = dict.fromkeys(KINDS_OF_NOISE, 1e-300)
STILL_MOVING = {name: value for name, value in STILL.items() if name != "drive_noise"}
# the machine code of a law of restitution, at speeds at which nothing yields
RIGID = {"restitution_law": "plastic", "restitution_speed": 1e6}
