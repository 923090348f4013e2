"""The game in the browser beside the game itself: rules, scripts and policies give the same numbers."""

import base64
import dataclasses
import json
from itertools import cycle, islice
from pathlib import Path

import numpy as np
import pytest

from fpg_bench.common.ids import ALLIES, OPPONENTS
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.products.leaderboard.site import page_data
from fpg_bench.products.leaderboard.tracks import SCENARIOS
from tests.products.leaderboard.browsing import chromium

pytestmark = pytest.mark.browser

STATIC = Path(page_data.__file__).parent / "static"
CODE = ("draws", "flight", "link", "rules", "knowledge", "scripts", "policy", "sight", "onnx")
PATHS = ("pursuit", "circle", "triangle", "rectangle", "learned")
GAMES = 10  # of each path and kind of actions: 100 rounds
STEPS = 300

# Plays given actions and gives the greatest difference in observations and rewards.
REPLAY = """({ rules, seeds, actions, seen, rewards, games, steps }) => {
  const floats = (text, Kind) => new Kind(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const [given, expected] = [floats(actions, Float32Array), floats(seen, Float32Array)];
  const paid = floats(rewards, Float64Array);
  let worst = 0;
  const far = (x, y) => (worst = Math.max(worst, Number.isFinite(x) ? Math.abs(x - y) : Infinity));
  for (let g = 0; g < games; g++) {
    const game = fpgRules.begin(rules, seeds[g]);
    for (let k = 0; k <= steps; k++) {
      const at = k * games + g;
      if (k) {
        const from = (at - games) * 18;
        fpgRules.step(game, given.subarray(from, from + 9), given.subarray(from + 9, from + 18));
        [game.allyReward, game.opponentReward].forEach((x, i) => far(x, paid[2 * at + i]));
      }
      [...game.allySees, ...game.opponentSees].forEach((x, i) => far(x, expected[30 * at + i]));
    }
  }
  return worst;
}"""

# Plays scripts and gives both returns.
SCRIPTED = """({ rules, seed, ally, opponent }) => {
  const game = fpgRules.begin(rules, seed), total = [0, 0];
  const make = (side, name) => fpgScripts.make(side, name, rules, game.key);
  const players = [make("ally", ally), make("opponent", opponent)];
  while (!game.over) {
    fpgRules.step(game, players[0](game.allySees), players[1](game.opponentSees));
    total[0] += game.allyReward; total[1] += game.opponentReward;
  }
  return total;
}"""

# Plays a round of scripts; gives all that a side is shown, its 15 numbers, and the truth.
SIGHT = """({ rules, side, tampered }) => {
  const game = fpgRules.begin(rules, 5), make = (one, name) => fpgScripts.make(one, name, rules, game.key);
  const players = [make("ally", "expert-spread"), make("opponent", "adaptive")], steps = [];
  while (!game.over) {
    fpgRules.step(game, players[0](game.allySees), players[1](game.opponentSees));
    const truth = fpgSight.truth(game), seen = fpgSight.seen({ ...game, ...tampered }, side);
    steps.push({ seen, truth, numbers: [...game[side + "Sees"]], heard: truth.check === 1 });
  }
  return steps;
}"""

# Asks a policy again and again, with a memory of its own.
ASKED = """({ policy, seen }) => {
  const play = fpgPolicy.make(policy);
  return seen.map((one) => play(one));
}"""

# The same of an ONNX file.
FILE = """({ file, seen }) => {
  const play = fpgPolicy.make(fpgOnnx.read(Uint8Array.from(atob(file), c => c.charCodeAt(0))));
  return seen.map((one) => play(one));
}"""


@pytest.fixture(scope="module")
def page():
    with chromium() as browser:
        page = browser.new_page()
        for name in CODE:
            page.add_script_tag(path=STATIC / f"game_{name}.js")
        yield page


def text(values, kind):
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def played(scenario, seeds, actions_of):
    """Rounds of these seeds: actions (k, n, 2, 9), observations (k + 1, n, 2, 15), rewards (k + 1, n, 2)."""
    batch = make_duel(len(seeds), scenario=scenario).batch
    batch.reset(seeds=seeds)
    actions, seen, rewards = [], [], []
    for k in range(STEPS + 1):
        seen.append(np.stack([batch.ally_observations, batch.opponent_observations], 1))
        rewards.append(np.stack([batch.games["ally_reward"], batch.games["opponent_reward"]], 1))
        if k < STEPS:
            both = actions_of(batch, k)
            actions.append(np.stack(both, 1))
            batch.step(*both)
    return np.array(actions), np.array(seen), np.array(rewards)


def randomly(batch, k):
    return np.random.default_rng(k).uniform(-1.2, 1.2, (2, batch.count, 9)).astype(np.float32)


class Agents:
    """The champions of both sides, each seeing its own side."""

    def __init__(self):
        names = ("ally-champion/ppo-stack8/seed_0", "opponent-champion/ppo/seed_0")
        self.players, self.memories = [load_agent(name) for name in names], [None, None]

    def __call__(self, batch, k):
        starts, both = np.full(batch.count, k == 0), []
        for i, seen in enumerate((batch.ally_observations, batch.opponent_observations)):
            actions, self.memories[i] = self.players[i].predict(seen.copy(), self.memories[i], starts)
            both.append(actions)
        return both


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("actions_of", [lambda: randomly, Agents], ids=["random", "agents"])
def test_the_rules_are_the_same(page, path, actions_of, name):
    scenario = dataclasses.replace(preset(name), opponent_path=path)
    seeds = np.arange(GAMES) * 7919 + 2**40
    actions, seen, rewards = played(scenario, seeds, actions_of())
    options = {
        "rules": page_data.rules_data(scenario),
        "seeds": seeds.tolist(),
        "games": GAMES,
        "steps": STEPS,
    }
    options |= {"actions": text(actions, "<f4"), "seen": text(seen, "<f4"), "rewards": text(rewards, "<f8")}
    assert page.evaluate(REPLAY, options) < 1e-6


PAIRS = [*zip(ALLIES, islice(cycle(OPPONENTS), len(ALLIES)), strict=True)]
PAIRS += [*zip(islice(cycle(ALLIES[::-1]), len(OPPONENTS)), OPPONENTS, strict=True)]


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize(("ally", "opponent"), PAIRS)
def test_the_scripts_are_the_same(page, ally, opponent, name):
    scenario = preset(name)
    match, total = make_match(make_duel(1, scenario=scenario), ally, opponent), np.zeros(2)
    game = match.duel.batch.games[0]

    def add():
        total[:] += game["ally_reward"], game["opponent_reward"]

    play_round(match, seeds=np.array([12]), on_step=add)
    options = {"rules": page_data.rules_data(scenario), "seed": 12, "ally": ally, "opponent": opponent}
    np.testing.assert_allclose(page.evaluate(SCRIPTED, options), total, atol=1e-4)


# What the page does not offer to play: convolutions, and the mean of advantages.
LACKING = ("ally-link-waterfall/dqn", "ally-link/dueling-ddqn")
AGENTS = sorted(
    str(path.parent.parent.relative_to(baselines_folder() / "agents"))
    for path in baselines_folder().glob("agents/*/*/seed_0/policy.onnx")
    if not load_agent(path.parent).noise_size  # the page refuses them, and says why
)


def test_the_page_plays_all_shipped_policies_but_these():
    played = {name for name in AGENTS if page_data.policy_data(load_agent(f"{name}/seed_0").model)}
    assert set(AGENTS) - played == set(LACKING)


@pytest.mark.parametrize("name", sorted({*AGENTS} - {*LACKING}))
def test_policies_answer_as_onnxruntime_does(page, name):
    agent = load_agent(f"{name}/seed_0")
    seen = np.random.default_rng(0).uniform(-1, 1, (40, 15)).astype(np.float32)
    memory, expected = None, []
    for k, one in enumerate(seen):
        action, memory = agent.predict(one[None], memory, np.array([k == 0]))
        expected.append(action[0])
    policy = page_data.policy_data(agent.model)
    assert policy is not None
    answers = page.evaluate(ASKED, {"policy": json.loads(json.dumps(policy)), "seen": seen.tolist()})
    np.testing.assert_allclose(answers, expected, atol=1e-5)
    file = base64.b64encode(agent.model).decode()
    assert page.evaluate(FILE, {"file": file, "seen": seen.tolist()}) == answers


# Operators that other frameworks export, and those that are broadcast.
OTHERS = """<ir_version: 9, opset_import: ["" : 20]>
policy (float[n, 15] observation) => (float[n, 9] action)
<float[1, 9] row = {0.5, -1, 2, 0.25, -0.5, 1, 3, -2, 0.125}, int64[3] wide = {0, 3, 3}>
{
  two = Constant <value = float {2.0}> ()
  starts = Constant <value_ints = [0]> ()
  ends = Constant <value_ints = [-6]> ()
  axes = Constant <value_ints = [1]> ()
  nine = Slice (observation, starts, ends, axes)
  shifted = Sub (nine, row)
  scaled = Div (shifted, two)
  squares = Reshape (scaled, wide)
  shares = Softmax <axis = -1> (squares)
  flat = Flatten (shares)
  grown = Exp (flat)
  turned = Neg (grown)
  low = Min (turned, scaled, row)
  bent = Elu <alpha = 0.5> (low)
  leaking = LeakyRelu <alpha = 0.125> (bent)
  total = Add (leaking, row)
  action = Identity (total)
}"""


def test_operators_of_other_frameworks_answer_as_in_onnxruntime(page):
    import onnxruntime
    from onnx import parser

    model = parser.parse_model(OTHERS).SerializeToString()
    seen = np.random.default_rng(0).uniform(-1, 1, (20, 15)).astype(np.float32)
    (expected,) = onnxruntime.InferenceSession(model).run(None, {"observation": seen})
    file = base64.b64encode(model).decode()
    np.testing.assert_allclose(
        page.evaluate(FILE, {"file": file, "seen": seen.tolist()}), expected, atol=1e-6
    )


def test_the_pages_operators_are_those_that_entries_are_chosen_by(page):
    assert set(page.evaluate("fpgPolicy.OPERATORS")) - {"Constant"} == page_data._OPERATORS


def test_the_game_offers_the_champions_and_knows_who_flies():
    agents = {name: about for name, (about, _) in page_data.zoo_policies().items()}
    assert agents["ally-champion/ppo-stack8"] == {"side": "ally", "flies": False, "game": "standard"}
    for name in ("opponent-champion/ppo", "opponent-champion-2/ppo-stack8", "opponent-learned/ppo"):
        assert agents[name] == {"side": "opponent", "flies": True, "game": "standard"}
    assert agents["opponent-pursuit/ppo"] == {"side": "opponent", "flies": False, "game": "standard"}
    assert agents["ally-link/ppo-stack8"]["game"] == "link"


# What is no part of a side's 15 numbers.
SECRET = {
    "ally": {"cleanSnr": -99, "covered": 7, "type": 2, "centre": 1, "known": 1, "age": 99, "lastCheck": 7},
    "opponent": {"snr": -99, "cleanSnr": -99, "covered": 7, "allyReward": 7, "opponentReward": 7}
    | {"frequency": 1, "spreadingS": 99, "hopped": True, "spreading": True, "sensedType": 3, "sensedMhz": 1},
}


def sight(page, side, tampered=None):
    rules = page_data.rules_data(Scenario())
    return page.evaluate(SIGHT, {"rules": rules, "side": side, "tampered": tampered or {}})


@pytest.mark.parametrize("side", SECRET)
def test_a_visitor_is_shown_nothing_that_a_player_of_the_side_does_not_observe(page, side):
    def seen(tampered):
        return [str(sorted(step["seen"].items())) for step in sight(page, side, tampered)]

    assert seen(SECRET[side]) == seen({})


def test_the_opponent_sees_neither_the_link_nor_an_unheard_frequency(page):
    steps = sight(page, "opponent")
    hidden = ("snr", "clean_snr", "ally_reward", "opponent_reward")
    assert all(np.isnan([step["seen"][name] for name in hidden]).all() for step in steps)
    assert not any(step["seen"][name] for step in steps for name in ("covered", "spreading", "hopped"))
    assert [np.isfinite(step["seen"]["frequency"]) for step in steps] == [step["heard"] for step in steps]
    assert any(step["truth"]["covered"] for step in steps)
    assert sum(step["heard"] for step in steps) > 3


def test_the_ally_sees_what_its_monitor_senses_errors_included(page):
    steps, scenario = sight(page, "ally"), Scenario()
    middle = (scenario.band_low_mhz + scenario.band_high_mhz) / 2
    half = (scenario.band_high_mhz - scenario.band_low_mhz) / 2
    for step in steps:
        seen, numbers = step["seen"], np.array(step["numbers"])
        assert seen["type"] == numbers[10:14].argmax()
        assert seen["centre"] == pytest.approx(middle + half * numbers[9])
        assert seen["covered"] == (numbers[14] > 0)
        assert seen["snr"] == pytest.approx(numbers[8] * scenario.snr_scale_db, rel=1e-6)
        assert np.isnan([seen["clean_snr"], seen["known"]]).all()
    wrong = np.mean([step["seen"]["type"] != step["truth"]["type"] for step in steps])
    assert 0.04 < wrong < 0.2
    assert np.std([s["seen"]["centre"] - s["truth"]["centre"] for s in steps]) == pytest.approx(1, abs=0.2)
