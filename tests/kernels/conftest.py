"""Constants of single realizations, as the kernels take them."""

import pytest

from vibrosweep.kernels.bases import constants
from vibrosweep.kernels.impact import base_of
from vibrosweep.model.parameters import dimensionless


@pytest.fixture(scope="session")
def constants_of(parameters):
    """Constants of a law, restitution e, kick a and threshold of rest r."""

    def make(rebound, e, a, r=1e-4):
        # gravity 2 and frequency 1: an amplitude is its kick, and a contact time its threshold
        given = parameters(restitution=e, amplitude=a, contact_time=r, gravity=2.0, frequency=1.0)
        return constants(base_of("high-bounce", rebound), dimensionless(given, 1.0), 0)

    return make


@pytest.fixture(autouse=True, scope="module")
def _plain(plain_pieces):
    """Do so in all tests of kernels."""
