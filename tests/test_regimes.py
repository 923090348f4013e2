"""The map of the regimes: its page, its rows, and the radios that both name."""

import map_regimes
import pytest
from lineage import filled

from tests.programs import ROOT

PAGE = ROOT / "docs/results/regimes.md"
ROWS = map_regimes.read_rows(PAGE.with_suffix(".csv"))


def test_the_page_has_the_map_of_the_rows():
    text = PAGE.read_text()
    assert filled(text, {"map": map_regimes.table(ROWS)}) == text


@pytest.mark.parametrize("mark", map_regimes.RADIOS)
def test_a_radio_of_the_figure_stands_in_the_table_with_its_numbers(mark):
    name, hop, reaction, _ = map_regimes.RADIOS[mark]
    (line,) = (line for line in PAGE.read_text().splitlines() if f", **{mark}** |" in line)
    _, radio, _, hops, reactions, *_ = (cell.strip() for cell in line.split("|"))
    assert radio.startswith(name)
    assert f"{hop:g}" in hops.split()
    assert f"{reaction:g}" == reactions


def test_the_points_that_meet_the_three_demands_are_those_that_the_page_names():
    meet = []
    for row in ROWS:
        value, mixed = float(row["value"]), [";" in row["allies"], ";" in row["opponents"]]
        levers = [float(row[name]) / value for name in ("hop", "spread", "speed", "type", "tuning")]
        if min(levers) >= 0.03 and all(mixed) and float(row["idle"]) <= float(row["free"]) / 2:
            meet.append((row["hop_dwell"], row["reaction_dwell"], row["power_dbm"]))
    assert meet == [("0.3", "4", "39"), ("0.5", "4", "39")]
    said = PAGE.read_text().partition("meets the three demands")[2]
    assert "(0.5, 4, +3 dB), and no other point" in said


def test_of_two_rows_of_a_point_one_is_read(tmp_path):
    path = tmp_path / "map.csv"
    lines = PAGE.with_suffix(".csv").read_text().splitlines()
    path.write_text("\n".join([*lines, lines[1]]))
    keys = [tuple(row[name] for name in map_regimes.COLUMNS[:3]) for row in map_regimes.read_rows(path)]
    assert len(keys) == len({*keys}) == len(lines) - 1
