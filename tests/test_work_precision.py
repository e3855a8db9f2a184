"""Work and precision: the references are proved, and the page shows what is stored."""

import math
from fractions import Fraction

import pytest

import vibrosweep as vs
from methods import ROOT
from methods.finals import FINALS, error_of, prove_references, read, read_references
from methods.report import report
from methods.scenes import SCENES
from vibrosweep.proof.sampling import deviates_of

REFERENCES = read_references()
ROWS = read(FINALS)
SCENE = {scene.key: scene for scene in SCENES}
TABLE = read(ROOT / "benchmarks" / "work_precision.csv")


def test_every_particle_of_every_problem_has_a_reference():
    assert list(REFERENCES) == list(SCENE)
    for key, kept in REFERENCES.items():
        assert [r.launch_time for r in kept] == SCENE[key].sample.tolist()
        assert all(float(r.radius) <= 1e-30 for r in kept)


def test_the_stored_references_are_proved_again():
    assert list(prove_references([SCENE["tones"]])) == REFERENCES["tones"]


def test_the_stored_noise_is_what_the_package_draws():
    for kept in REFERENCES["noise"]:
        drawn = deviates_of(0, 0.0, kept.particle).of_impact
        assert kept.deviates.split() == [repr(drawn(n)[1]) for n in range(kept.landings)]


def test_the_package_reproduces_the_references_of_the_locked_problem():
    scene = SCENE["locked"]
    launches = scene.sample.tolist()
    found = vs.simulate(**scene.parameters, launch=launches, duration=scene.duration)
    assert found.impact_count.values[0].tolist() == [r.landings for r in REFERENCES["locked"]]
    last = found.landing_time.values[0, :, REFERENCES["locked"][0].landings - 1]
    row = {"finals": " ".join(map(repr, last.tolist()))}
    assert error_of(row, REFERENCES["locked"]) <= 0.5 * math.ulp(scene.duration)


def test_errors_are_those_of_the_stored_times():
    kept = REFERENCES["tones"]
    exact = [float(Fraction(r.last_landing)) for r in kept]
    row = {"finals": " ".join(map(repr, [*exact[:-1], exact[-1] + 0.25]))}
    assert error_of(row, kept) == pytest.approx(0.25, rel=1e-12)
    assert math.isnan(error_of({"finals": " ".join(["nan"] * len(kept))}, kept))


def test_every_row_names_processor_versions_and_settings():
    for row in ROWS:
        for column in ("processor", "date", "versions", "setting", "threads", "precision"):
            assert row[column]
        assert "Python" in row["versions"]
        assert "numpy" in row["versions"]
    assert {row["scene"] for row in ROWS if row["method"] == "kernel"} == set(SCENE)


def test_the_page_and_its_table_show_what_is_stored():
    for row in TABLE:
        (stored,) = (r for r in ROWS if all(r[c] == row[c] for c in ("scene", "method", "setting")))
        error = error_of(stored, REFERENCES[row["scene"]])
        assert row["last_landing_error_s"] == f"{error:.3e}"
    assert len(TABLE) == len(ROWS)
    page = (ROOT / "benchmarks" / "work-precision.md").read_text(encoding="utf-8")
    assert page == report(TABLE, REFERENCES)
