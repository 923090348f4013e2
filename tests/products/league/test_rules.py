"""Rules: the graph against rules in plain Python, the search, resumption, and the exported agent."""

import math

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import other_side
from fpg_bench.common.rows import RowFile
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.game.scenario import as_scenario, preset
from fpg_bench.players.agent import OnnxPlayer, load_agent
from fpg_bench.players.policy_runner import PolicyRunner
from fpg_bench.players.registry import as_player
from fpg_bench.products.league import categorical
from fpg_bench.products.league.candidates import Candidates
from fpg_bench.products.league.categorical import CategoricalSearch
from fpg_bench.products.league.config import RuleSearchConfig
from fpg_bench.products.league.rule_search import rule_of
from fpg_bench.products.league.rule_search import rule_search as search_rule
from fpg_bench.products.league.rules import NUMBERS, OFF, describe_rule, rule_graph, rule_values

STEPS = 150


class PlainRule:
    """One rule in one game, from the words of its numbers."""

    def __init__(self, side, rule, scenario):
        self.side, self.rule, self.scenario = side, rule, scenario
        self.hits, self.quiet, self.since_hop, self.place = 0.0, 0, 0, None
        self.known, self.left, self.turn, self.phase, self.step = None, 0, 0, 0, 0

    def off(self, name, otherwise):
        value = self.rule[name]
        return otherwise if value == OFF else value

    def answer(self, seen):
        away = [
            math.copysign(x * x, x) * size for x, size in zip(seen[3:6], self.scenario.box_m, strict=True)
        ]
        apart = math.hypot(*away)
        answer = self.ally(seen, away, apart) if self.side == "ally" else self.opponent(seen, apart)
        self.step += 1
        return answer

    def ally(self, seen, away, apart):
        """Return whether it hops, spreads, asks the knowledge base, and its speed."""
        scenario, snr = self.scenario, seen[8] * self.scenario.snr_scale_db - self.scenario.snr_threshold_db
        if seen[14] > 0:
            names = [f"{name}_hits" for name in ("tone", "narrowband", "broadband", "comb")]
            count = self.rule[names[int(np.argmax(seen[10:14]))]]
            self.hits += 0 if count == OFF else 1 / count
            self.quiet = 0
        else:
            self.quiet += 1
            if self.quiet >= self.off("forget_s", 0):
                self.hits = 0
        self.since_hop += 1
        hop = self.hits > 0.99 and snr < self.off("below_db", math.inf)
        hop = hop or self.since_hop >= self.off("hop_every_s", math.inf)
        hop = hop and self.since_hop >= self.off("pause_s", 0)
        if hop:
            self.hits, self.since_hop = 0, 0
        spread = apart > self.off("spread_beyond_m", math.inf)
        spread &= round(seen[7] * scenario.spreading_scale_s) < self.off("spread_s", math.inf)
        spread &= self.off("spread_after_s", 0) <= self.quiet < self.off("spread_until_s", math.inf)
        spread &= snr > self.off("spread_above_db", -math.inf)
        place = [x * size for x, size in zip(seen[:3], scenario.box_m, strict=True)]
        before, self.place = self.place, place
        flees = before is None or sum((a - b) * c for a, b, c in zip(place, before, away, strict=True)) < 0
        sprint = apart < self.off("sprint_m", -1) and (flees or self.rule["fleeing"] == OFF)
        return hop, spread, self.rule["drawn"] == OFF, 1.0 if sprint else self.off("cruise", 0.0)

    def opponent(self, seen, apart):
        """Return the jamming type, whether it jams the known point, and else the centre in the band."""
        age = round(seen[7] * self.scenario.age_scale_s)
        if self.step == 0:
            self.left = self.rule["finds"] if self.rule["distrust"] != OFF else 0
        elif age == 0:
            self.left = max(self.left - 1, 0) if seen[6] == self.known else self.rule["finds"]
        self.known = seen[6]
        hold = self.off("moved_hold_s" if self.left else "hold_s", math.inf)
        is_known = age < hold and not (self.rule["misses"] != OFF and seen[14] < 0)
        if self.step == 0:
            self.phase, self.turn = 0, 0
        else:
            self.phase += 1
            if self.phase >= self.rule["centre_s"]:
                self.phase, self.turn = 0, (self.turn + 1) % self.rule["centres"]
        kind = self.rule["known_type" if is_known else "blind_type"]
        if apart < self.off("near_m", -1):
            kind = self.rule["near_type"]
        return kind, is_known, (2 * self.turn + 1) / self.rule["centres"] - 1


def drawn_rules(side, count, seed=0):
    rng = np.random.default_rng(seed)
    return np.stack([rng.integers(0, len(grid), count) for grid in NUMBERS[side].values()], axis=1)


def rivals_of(side):
    return "hunter" if side == "ally" else "clock"


@pytest.mark.parametrize("side", ["ally", "opponent"])
@pytest.mark.parametrize("name", ["standard", "link"])
def test_a_rule_is_the_one_that_its_numbers_say_and_its_export_plays_the_same_bits(side, name):
    scenario, count = as_scenario(preset(name), opponent_path="learned"), 48
    options = drawn_rules(side, count)
    values = rule_values(side, options, scenario)
    batch = TwoPlayerBatch(scenario, count, threads=1)
    exported = [OnnxPlayer(rule_graph(side, scenario, numbers)) for numbers in values[:3]]
    players = [Candidates(rule_graph(side, scenario), values), *exported]
    runners = [PolicyRunner(side, [player], batch.batch) for player in players]
    runners.append(
        PolicyRunner(other_side(side), [as_player(rivals_of(side), other_side(side), scenario)], batch.batch)
    )
    plain = [PlainRule(side, rule_of(side, row), scenario) for row in options]
    started = batch.reset(seeds=3)
    for runner in runners:
        runner.begin(started)
    for _ in range(STEPS):
        seen = batch.present()[0 if side == "ally" else 1]
        mine, *alone, others = (runner.act() for runner in runners)
        for k, actions in enumerate(alone):
            np.testing.assert_array_equal(actions[k], mine[k])
        for k, rule in enumerate(plain):
            answer, action = rule.answer(seen[k]), mine[k]
            if side == "ally":
                hop, spread, asks, speed = answer
                assert (action[0] > 0, action[1] > 0, action[4] > 0, action[2]) == (hop, spread, asks, speed)
            else:
                kind, is_known, centre = answer
                assert (int(np.argmax(action[:4])), action[5] < 0) == (kind, is_known), rule.rule
                if not is_known and rule.rule["random"] == OFF:
                    assert action[4] == pytest.approx(centre, abs=1e-6)
        batch.batch.step(*((mine, others) if side == "ally" else (others, mine)))


def test_random_centres_are_even_over_the_band():
    scenario = preset("standard")
    rule = dict.fromkeys(NUMBERS["opponent"], 0) | {"hold_s": 1, "random": 1, "centres": 3}  # five centres
    options = np.array([list(rule.values())])
    player = Candidates(rule_graph("opponent", scenario), rule_values("opponent", options, scenario))
    seen, games = np.zeros((2000, 15), np.float32), 2000
    seen[:, 7] = 1.0  # what is known is old
    player.reset(np.ones(games, bool), np.arange(games, dtype=np.uint64))
    actions, _ = player.predict(seen, None, np.ones(games, bool))
    places, counts = np.unique(actions[:, 4].round(4), return_counts=True)
    assert places.tolist() == pytest.approx([-0.8, -0.4, 0, 0.4, 0.8])
    assert all(abs(counts - 400) < 70)  # four standard deviations


def separable(goal):
    """Return a search whose numbers matter by 3, 2 and 1, one that is worth nothing, and a hard rival."""
    worth = np.array([3.0, 2.0, 1.0, 0.0])

    def play(options, rival, first_seed, matches):
        noise = np.random.default_rng(first_seed).normal(0, 0.3, matches)  # the same for all candidates
        bad = (options != np.array([2, 1, 3, 0])) if rival == 0 else (options != np.array([2, 1, 0, 0]))
        return -(bad[:, :3] @ worth[:3])[:, None] + noise - 2.5 * rival

    return CategoricalSearch([4, 3, 5, 6], play, rivals=2, goal=goal)


@pytest.mark.parametrize(("goal", "third"), [("mean", (0, 3)), ("lowest", (0,))])
def test_a_search_finds_the_best_numbers_and_drops_those_that_are_worth_nothing(goal, third):
    search = separable(goal)
    while search.generation < categorical.CROSS_ENTROPY + 10:
        search.run()
    best = search.simplify().tolist()
    assert (best[:2], best[3]) == ([2, 1], 0)
    assert best[2] in third


def test_a_search_goes_on_from_its_rows(tmp_path):
    whole, part = separable("lowest"), separable("lowest")
    rows = [whole.run() for _ in range(categorical.CROSS_ENTROPY + 3)]
    for row in rows[:-2]:
        part.take(row)
    again = [part.run(), part.run()]
    assert [r.model_dump(exclude={"seconds"}) for r in again] == [
        r.model_dump(exclude={"seconds"}) for r in rows[-2:]
    ]
    assert part.rounds == whole.rounds
    with pytest.raises(UserError, match="another search"):
        part.take(rows[0])


def test_a_gain_below_a_standard_error_is_none():
    search, rng = separable("mean"), np.random.default_rng(0)
    one = rng.normal(0, 1, (2, 64))
    assert not search.gains(one, one)
    assert search.gains(one + 0.1, one)
    noisy = one + rng.normal(0.01, 1, one.shape)
    assert not search.gains(noisy - noisy.mean() + one.mean() + 0.05, one)


@pytest.fixture
def short(monkeypatch):
    """The local search begins early, and plays few rounds."""
    for name, value in (
        ("CROSS_ENTROPY", 2),
        ("CANDIDATES", 24),
        ("ELITE", 4),
        ("MUTANTS", 8),
        ("FINAL_ROUNDS", 8),
    ):
        monkeypatch.setattr(categorical, name, value)


@pytest.mark.slow
def test_a_stopped_search_goes_on_and_its_agent_says_the_rule(short, tmp_path):
    about = {"side": "opponent", "against": ["expert", "idle"], "seed": 1}
    part, whole = tmp_path / "part", tmp_path / "whole"
    search_rule(RuleSearchConfig(**about, budget=0.01), part)
    file = RowFile(part / "rule.jsonl")
    result = search_rule(RuleSearchConfig(**about, budget=2.0), part)
    search_rule(RuleSearchConfig(**about, budget=2.0), whole)
    kept = [
        [{k: v for k, v in row.items() if k != "seconds"} for row in RowFile(f / "rule.jsonl").read()]
        for f in (part, whole)
    ]
    shared = min(map(len, kept))
    assert shared > 2
    assert kept[0][:shared] == kept[1][:shared]
    assert result["generations"] == len(file.read())
    card = load_agent(part / "agent", "opponent").card
    assert (card.algorithm, card.is_search) == ("rule", True)
    assert card.recipe == {"rule": result["rule"], "words": result["words"]}
    with pytest.raises(UserError, match="another seed"):
        search_rule(RuleSearchConfig(side="opponent", against=["expert", "idle"], seed=2), part)


def test_a_search_may_be_paid_for_what_the_rivals_lose(tmp_path):
    """Its own reward has a bonus for pursuit beside them."""
    found = {}
    for reward in ("own", "zero_sum"):
        config = RuleSearchConfig(side="opponent", against=["expert"], reward=reward, budget=0.5)
        found[reward] = search_rule(config, tmp_path / reward)["earned"]
        card = load_agent(tmp_path / reward / "agent").card
        assert card.game.reward == {"own": None}.get(reward, reward)
    assert found["own"] > found["zero_sum"] + 10


def test_a_rule_reads_as_a_sentence():
    ally = {name: grid[0] for name, grid in NUMBERS["ally"].items()}
    assert describe_rule("ally", ally) == ""
    words = describe_rule(
        "ally", ally | {"tone_hits": 1, "comb_hits": 2, "below_db": 20, "spread_beyond_m": 60, "spread_s": 4}
    )
    assert words == (
        "hop by the knowledge base after hits in a row, 1 of tone or 2 of comb, while the SNR is less than "
        "20 dB above its threshold; spread for 4 s, then pause for 1 s, beyond 60 m"
    )
    opponent = {name: grid[0] for name, grid in NUMBERS["opponent"].items()}
    assert describe_rule("opponent", opponent | {"moved_hold_s": 1, "centre_s": 2}) == (
        "tone on the known point; once a check has found the ally elsewhere, broadband in turn at each of 2 "
        "centres, 2 s each from 1 s after a find, until a check finds it where it was"
    )
