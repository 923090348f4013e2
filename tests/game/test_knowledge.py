"""The expert knowledge base sends the ally to one of the points that the rules allow."""

from __future__ import annotations

import numpy as np
import yaml

from fpg_bench.game.knowledge import EXPERT_FILE

from .playing import BROADBAND, COMB, TONE, ally, at_mhz, begin, opponent, still, to_point

POINT_MHZ = 150 + np.arange(15) * 100 / 14


def chosen(jam_kind: int, jam_mhz: float, point: int, scores=(0, 0, 0, 0), games=400, **changes) -> set[int]:
    """Return the points to which games of other chance hop from ``point``, after sensing a jammer."""
    batch = begin(still(**changes), games=games)
    jam = opponent(jam_kind, tuning=at_mhz(jam_mhz), in_band=True).repeat(games, 0)
    batch.step(ally(hop=True, preference=to_point(point)).repeat(games, 0), jam)
    assert (batch.games["point"] == point).all()
    batch.step(ally(hop=True, expert=True, preference=-1, scores=scores).repeat(games, 0), jam)
    counts = np.bincount(batch.games["point"], minlength=15)
    found = set(np.flatnonzero(counts).tolist())
    assert counts[sorted(found)].min() > 0.4 * games / len(found), "uniform over the candidates"
    return found


def outside(half: float, centre: float, point: int) -> set[int]:
    """The points farther than a footprint and its guard of 2.5 MHz, but the present one."""
    return {i for i in range(15) if abs(POINT_MHZ[i] - centre) > half + 2.5 + 1e-6} - {point}


def test_no_candidate_at_all_is_any_other_point():
    found = chosen(BROADBAND, 200, 7, band_low_mhz=180, band_high_mhz=220, frequency_points=15)
    assert found == set(range(15)) - {7}


def test_the_score_of_the_sensed_type_is_one():
    """A tone is sensed; another strategy needs more than one point to win, ties go to the lowest."""
    tone = outside(2.5, 200, 7)
    broad = chosen(BROADBAND, 200, 7)
    assert chosen(TONE, 200, 7, scores=(0, 0, 0.9, 0)) == tone
    assert chosen(TONE, 200, 7, scores=(0, 0, 1.0, 0)) == tone, "1 against 1: the lowest index"
    assert chosen(TONE, 200, 7, scores=(-0.1, 0, 1.0, 0)) == broad
    assert chosen(COMB, 200, 7, scores=(0, 0, 1.0, 0)) == broad, "1 against 1: the lowest index"


def test_a_knowledge_base_of_ones_own(tmp_path):
    """Answer broadband with the single farthest point, and keep 30 MHz from a tone."""
    content = yaml.safe_load(EXPERT_FILE.read_text())
    content["broadband"]["candidates"] = 1
    content["tone"]["guard_mhz"] = 30.0
    path = tmp_path / "mine.yml"
    path.write_text(yaml.safe_dump(content))
    assert chosen(BROADBAND, 150, 0, knowledge=path) == {14}
    assert chosen(TONE, 200, 7, knowledge=path) == outside(2.5 + 27.5, 200, 7)
