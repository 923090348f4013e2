"""The map of the regimes: how a point is solved, its page, its rows, and the radios that both name."""

from functools import partial

import map_regimes
import numpy as np
import pytest
from lineage import filled
from map_regimes import COLUMNS, COPIES, KNOWING, LEVERS, Meetings, of_mixture, read_rows, with_copies, worth

from fpg_bench.evaluation.statistics import nash
from fpg_bench.game.actions import HOP_GATE, KNOWLEDGE_GATE, TYPE_SCORES
from fpg_bench.game.scenario import preset
from fpg_bench.players.player import SIDES
from tests.programs import ROOT

PAGE = ROOT / "docs/results/regimes.md"
ROWS = read_rows(PAGE.with_suffix(".csv"))
LINK = preset("link")
TOLD = {column: str(k) for k, column in enumerate(COLUMNS)}


class Tabled(Meetings):
    """Meetings whose rewards a function of the names has."""

    def __init__(self, of):
        super().__init__(LINK, matches=2)
        self.of = of

    def rewards(self, ally, opponent):
        return np.full(self.matches, float(self.of(ally, opponent)))


def test_a_double_oracle_ends_in_the_equilibrium_of_the_whole_pool():
    values = np.random.default_rng(1).normal(size=(12, 12))
    pools = {side: [f"{side} {k}" for k in range(12)] for side in SIDES}
    game = Tabled(lambda *names: values[tuple(int(name.split()[1]) for name in names)])
    met = game.solve(pools)
    assert met.value == pytest.approx(-nash(-values).value, abs=map_regimes.TOLERANCE)
    assert len(met.joined["ally"]) < 12
    for side, sign in zip(SIDES, (1, -1), strict=True):
        assert sum(met.shares[side].values()) == pytest.approx(1)
        best = max(game.answer(side, met, name) for name in pools[side])
        assert best <= sign * met.value + map_regimes.TOLERANCE


def test_a_player_that_joins_lowers_the_value_to_what_it_leaves():
    """The reported row: one jammer that the pool lacks took half a point."""
    found = {"a": [1, -1], "b": [-1, 1], "c": [-0.5, -0.5]}
    game = Tabled(lambda ally, opponent: found[opponent]["ab".index(ally)])
    met = game.solve({"ally": ["a", "b"], "opponent": ["a", "b"]})
    assert met.value == pytest.approx(0)
    assert game.answer("opponent", met, "c") == pytest.approx(0.5)
    assert game.solve({"ally": ["a", "b"], "opponent": ["a", "b", "c"]}, met).value == pytest.approx(-0.5)


def test_a_lever_is_what_a_side_loses_whose_players_all_lack_it_and_the_best_copy_counts():
    lost = {"no hops": 2, "10 m/s": 0.5, "17.5 m/s": 0.25, "tone only": -3, "comb only": -0.75}
    lost |= {f"{kind} only": -3 for kind in ("narrowband", "broadband")}
    game = Tabled(lambda *names: 5 - sum(lost.get(name.partition(": ")[2], 0) for name in names))
    whole = game.solve({side: ["a"] for side in SIDES})
    found = worth(game, with_copies({side: ["a"] for side in SIDES}, whole), whole)
    expected = {"hop": 2, "speed": 0.25, "type": 0.75}
    assert found == pytest.approx({name: expected.get(name, 0) for name in LEVERS})


def test_copies_are_those_of_the_usual_players_and_of_the_equilibrium():
    pools = {side: [*"abcdefg"] for side in SIDES}
    whole = Tabled(lambda ally, opponent: (ally == "g") - (opponent == "f")).solve(pools)
    wide = with_copies(pools, whole)
    for side, other in zip(SIDES, ("g", "f"), strict=True):
        copied = {name.partition(": ")[0] for name in wide[side] if ": " in name}
        assert copied == {"a", "b", "c", "d", other}
        assert len(wide[side]) == len({*wide[side]}) == 7 + 5 * sum(map(len, COPIES[side].values()))
    assert with_copies(wide, whole) == wide


def test_a_copy_lacks_its_ability_and_else_acts_as_the_player():
    game, seen = Meetings(LINK), np.zeros((3, 15), np.float32)
    (plain, _), (copy, _) = (game.player(name, "ally").predict(seen) for name in ("idle", "idle: no hops"))
    assert (copy[:, HOP_GATE] == -1).all()
    assert (np.delete(copy, HOP_GATE, 1) == np.delete(plain, HOP_GATE, 1)).all()
    assert (game.player(KNOWING, "ally").predict(seen)[0][:, KNOWLEDGE_GATE] == 1).all()
    types = game.player("alternate: comb only", "opponent").predict(seen)[0][:, TYPE_SCORES : TYPE_SCORES + 4]
    assert (types.argmax(axis=1) == 3).all()


def test_a_search_meets_the_rivals_of_a_mixture_by_their_shares():
    met = []

    def play(options, rival, first_seed, matches):
        met.append([rival] * matches)
        return np.full((len(options), matches), float(rival))

    shares = (0.5, 0.3, 0.2)
    for seed in range(200):
        assert of_mixture(play, shares)(np.zeros((2, 1)), 0, seed, 4).shape == (2, 4)
    assert np.bincount(np.concatenate(met)) / 800 == pytest.approx(shares, abs=0.03)


def test_a_point_is_measured_and_what_is_there_is_not_measured_again(tmp_path, monkeypatch):
    players = {"ally": ["always-hop", "idle"], "opponent": ["tone", "broadband"]}
    for name, value in {"PLAYERS": players, "USUAL": 1, "SEARCHES": 1, "GENERATIONS": 1}.items():
        monkeypatch.setattr(map_regimes, name, value)
    monkeypatch.setattr(map_regimes, "Meetings", partial(Meetings, matches=2))
    monkeypatch.setattr(map_regimes, "REACTIONS", ((3, 5),))
    monkeypatch.setattr(map_regimes, "POWERS_DBM", (39.0,))
    monkeypatch.setattr(map_regimes, "HOPS", (0.3,))
    file = tmp_path / "map.csv"
    map_regimes.main(file)
    (row,) = read_rows(file).values()
    assert tuple(row) == COLUMNS
    assert all(float(row[name]) >= 0 for name in ("half", "ally may gain", "opponent may gain"))
    assert all(
        float(row[f"{name} least"]) <= float(row[name]) <= float(row[f"{name} most"]) for name in LEVERS
    )
    monkeypatch.setattr(map_regimes, "HOPS", (0.3, 0.5))
    of_season = COLUMNS[-2:]
    new = {column: TOLD[column] for column in COLUMNS[:-2]}
    monkeypatch.setattr(
        map_regimes, "measure", lambda point, seed: {**new, "hop_dwell": f"{point.hop_s} {seed}"}
    )
    monkeypatch.setattr(map_regimes, "attacked", lambda point, row: {name: TOLD[name] for name in of_season})
    map_regimes.main(file)
    assert [*read_rows(file).values()] == [row, {**TOLD, "hop_dwell": "0.5 1"}]


def test_members_of_a_season_attack_the_mixtures_that_a_row_states(monkeypatch):
    """The reported row: a member took 0.18 from a value whose interval had 0.08."""
    met = []

    def answer(self, side, solution, name=None):
        met.append(solution.shares)
        return {None: 5.0, "suite:season-5-link/o02": 5.2, "suite:season-5-link/a01": 4.9}.get(name, 0.0)

    monkeypatch.setattr(Meetings, "answer", answer)
    found = map_regimes.attacked(map_regimes.Point(0.1, (3, 5), 39.0), ROWS["0.1", "4", "39"])
    assert found == {"ally of season 5 may gain": "0.000", "opponent of season 5 may gain": "0.200"}
    assert [sum(shares.values()) for shares in met[0].values()] == pytest.approx([1, 1])
    assert {"always-hop", "rule 0", f"ally-link/{map_regimes.AGENTS}"} <= {*met[0]["ally"]}
    assert {"rule 1", f"opponent-link/{map_regimes.AGENTS}: broadband only"} <= {*met[0]["opponent"]}


def test_an_interval_of_the_table_has_sampling_and_what_may_be_gained():
    row = {**dict.fromkeys(COLUMNS, "0"), "value": "5", "half": "0.1", "free": "9", "power_dbm": "39"}
    row |= {
        "ally may gain": "0.2",
        "opponent may gain": "0.3",
        "ally of season 5 may gain": "0.1",
        "opponent of season 5 may gain": "0.4",
        "hop": "1",
        "hop most": "2",
        "hop least": "0.5",
    }
    table = map_regimes.table({("0", "0", "39"): row})
    assert "| +3 | 5.00 [4.50, 5.30] | 0.20 | 0.40 | 0% | 20 (10 to 40) | 0 |" in table


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
    for row in ROWS.values():
        value, mixed = float(row["value"]), [";" in row["allies"], ";" in row["opponents"]]
        levers = [float(row[name]) / value for name in ("hop", "spread", "speed", "type", "tuning")]
        if min(levers) >= 0.03 and all(mixed) and float(row["idle"]) <= float(row["free"]) / 2:
            meet.append((row["hop_dwell"], row["reaction_dwell"], row["power_dbm"]))
    assert meet == [("0.5", "4", "39"), ("0.3", "2", "39"), ("0.5", "4", "45")]
    text = PAGE.read_text().partition("all but meets the three demands")[2]
    named = "(0.3, 2, +3 dB) and (0.5, 4, +3 dB) meet them, so does (0.5, 4, +9 dB), and no other point"
    assert named in text


def test_of_two_rows_of_a_point_one_is_read(tmp_path):
    path = tmp_path / "map.csv"
    lines = PAGE.with_suffix(".csv").read_text().splitlines()
    path.write_text("\n".join([*lines, lines[1]]))
    assert read_rows(path) == ROWS
