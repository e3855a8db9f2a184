"""Machine code that the engine chooses for a scene, against that of `tests/general.py`."""

from dataclasses import replace

from tests.general import as_the_engine_chooses
from vibrosweep.engine.measure import measure


def test_special_machine_code_gives_the_bits_of_the_general(
    parameters, observe, workers, monkeypatch
):
    """Over a base that lifts nobody, without landings before a window and without cycles."""
    inputs = parameters(amplitude=[0.0, 0.4, 1.2, 2.6], restitution=[0.3, 0.6, 0.8, 0.9])
    scene = replace(observe(particles=3), base="moving")
    known = measure(inputs, scene, workers)
    as_the_engine_chooses(monkeypatch)
    found = measure(inputs, scene, workers)
    assert known["impact_count"].min() > 3
    assert found.keys() == known.keys()
    for name, values in known.items():
        assert found[name].tobytes() == values.tobytes(), name
