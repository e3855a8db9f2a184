"""The comparison with peers: what the page shows is the stored table."""

from pathlib import Path

import numpy as np
import pytest

from methods.ensembles import _numpy_block
from methods.peers_report import NAMES, bare_sentence, peers_table, read_rows
from methods.scenes import table
from methods.sweeps import Sweep
from methods.truth import prove, worst

ROOT = Path(__file__).parents[1]
ROWS = read_rows(ROOT / "benchmarks" / "peers.csv")
PAGE = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("<!-- begin peers -->")[2].partition("<!-- end peers -->")[0]


def test_the_page_shows_the_stored_table():
    assert peers_table(ROWS) in SECTION
    assert bare_sentence(ROWS) != ""
    assert " ".join(bare_sentence(ROWS).split()) in " ".join(SECTION.split())


def test_every_peer_has_a_time_and_an_error_in_both_scenes():
    for scene in ("short", "long"):
        found = {row["method"]: row for row in ROWS if row["scene"] == scene}
        assert set(found) == set(NAMES)
        for row in found.values():
            assert float(row["ns_per_impact"]) > 0.0
            assert 0.0 < float(row["largest_error_s"]) < 1e-6


def test_the_written_table_shows_the_rows():
    rows = [dict(row) for row in ROWS]
    changed = next(row for row in rows if (row["scene"], row["method"]) == ("long", "numpy"))
    changed["ns_per_impact"] = "12345"
    written, changed_to = (peers_table(r).count("| 12,000 |") for r in (ROWS, rows))
    assert changed_to == written + 1


@pytest.fixture(scope="module")
def sweep():
    return Sweep("tiny", "Tiny", 12, 4, 6.0, 6, (1e-12,))


def test_trajectories_of_a_sweep_are_all_pairs(sweep):
    rows = sweep.table
    assert rows.shape == (48, 8)
    assert np.array_equal(rows[:, 0], np.repeat(sweep.arrays["restitution"], 4))
    assert np.array_equal(rows[:4, -1], [0.0, 0.25, 0.5, 0.75])
    assert np.array_equal(table(sweep.cases), rows[sweep.chosen])
    assert len(set((sweep.chosen // 4).tolist())) == 6
    assert set((sweep.chosen % 4).tolist()) == {0, 1, 2, 3}


def test_numpy_follows_the_proved_orbits(sweep):
    orbits = prove(sweep)
    times = np.full((6, 200), np.nan)
    landings = _numpy_block(table(sweep.cases), sweep.duration, times)
    error, missing = worst(orbits, list(times))
    assert landings == sum(orbit.size for orbit in orbits)
    assert missing == ""
    assert error < 1e-10
