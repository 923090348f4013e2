"""The game in the browser beside the game itself: rules, scripts and policies give the same numbers."""

import base64
import dataclasses
import json
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import numpy_helper

from fpg_bench.common.ids import ALLIES, OPPONENTS
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.game.scenario import preset
from fpg_bench.players.agent import OnnxPlayer, baselines_folder, load_agent
from fpg_bench.players.onnx_file import OPERATORS, REDUCING
from fpg_bench.players.scripted import player_noise
from fpg_bench.products.leaderboard.site import page_data
from fpg_bench.products.leaderboard.tracks import SCENARIOS
from fpg_bench.products.sandbox.client import check_policies
from fpg_bench.products.sandbox.onnx_attributes import KINDS
from tests.policies import constant, model, node, whole
from tests.products.leaderboard.browsing import chromium
from tests.programs import ROOT

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
ASKED = """({ policy, seen, noise }) => {
  const play = fpgPolicy.make(policy);
  return seen.map((one, k) => play(one, noise[k]));
}"""

# The same of an ONNX file.
FILE = """({ file, form, seen, noise }) => {
  const play = fpgPolicy.make(fpgOnnx.read(Uint8Array.from(atob(file), c => c.charCodeAt(0)), form));
  return seen.map((one, k) => play(one, noise?.[k]));
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


FORM = page_data.form_data()
AGENTS = sorted(
    str(path.parent.parent.relative_to(baselines_folder() / "agents"))
    for path in baselines_folder().glob("agents/*/*/seed_0/policy.onnx")
)


@pytest.mark.parametrize("name", AGENTS)
def test_policies_answer_as_onnxruntime_does(page, name):
    agent = load_agent(f"{name}/seed_0")
    seen = np.random.default_rng(0).uniform(-1, 1, (40, 15)).astype(np.float32)
    memory, expected = None, []
    agent.reset(np.ones(1, bool), np.array([5], np.uint64))
    for k, one in enumerate(seen):
        action, memory = agent.predict(one[None], memory, np.array([k == 0]))
        expected.append(action[0])
    noise = player_noise(np.full(len(seen), 5, np.uint64), np.arange(len(seen)), agent.noise_size)
    given = {"seen": seen.tolist(), "noise": noise.tolist()}
    policy = json.loads(json.dumps(page_data.policy_data(agent.model)))
    answers = page.evaluate(ASKED, {"policy": policy, **given})
    np.testing.assert_allclose(answers, expected, atol=1e-5)
    file = base64.b64encode(agent.model).decode()
    assert page.evaluate(FILE, {"file": file, "form": FORM, **given}) == answers


@pytest.mark.full
def test_every_policy_file_of_the_repository_passes_the_check_and_plays_on_the_page(page):
    files = {
        path.read_bytes()
        for home in ("baselines", "leaderboard")
        for path in (ROOT / home).rglob("policy.onnx")
    }
    assert len(files) > 400
    assert not any(check_policies(list(files)))
    seen = np.random.default_rng(2).uniform(-1, 1, (2, 15)).astype(np.float32)
    for data in files:
        player, memory = OnnxPlayer(data), None
        player.reset(np.ones(1, bool), np.array([5], np.uint64))
        expected = []
        for one in seen:
            action, memory = player.predict(one[None], memory)
            expected.append(action[0])
        noise = player_noise(np.full(2, 5, np.uint64), np.arange(2), player.noise_size).tolist()
        policy = json.loads(json.dumps(page_data.policy_data(data)))
        answers = page.evaluate(ASKED, {"policy": policy, "seen": seen.tolist(), "noise": noise})
        np.testing.assert_allclose(answers, expected, atol=1e-5)


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
        page.evaluate(FILE, {"file": file, "form": FORM, "seen": seen.tolist()}), expected, atol=1e-6
    )


def test_the_pages_operators_are_those_of_the_form(page):
    assert set(page.evaluate("fpgPolicy.OPERATORS")) == OPERATORS


# One operator each, on x: nine numbers of a game from -3 to 3.
SINGLE: dict[str, list[dict[str, Any]]] = {
    **{name: [{}] for name in OPERATORS},
    **{name: [{"axis": 1, "keepdims": 0}, {"axis": -1}] for name in ("ArgMax", "ArgMin")},
    **{f"Reduce{name}": [{"keepdims": 0}, {}] for name in REDUCING.split()},
    **{name: [{}, {"alpha": 0.3}] for name in ("Celu", "Elu", "LeakyRelu", "ThresholdedRelu", "HardSigmoid")},
    "Cast": [{"to": kind} for kind in KINDS],
    "Constant": [
        {"value_float": 0.5},
        {"value_floats": [0.5] * 9},
        {"value_int": 3},
        {"value": constant([2.0], "")},
    ],
    "Conv": [{}, {"pads": [1, 0, 0, 1], "strides": [2, 1], "dilations": [1, 2]}, {"group": 3}],
    **{
        name: [{"kernel_shape": [2, 2], "pads": [1, 0, 0, 1], "strides": [1, 2]}]
        for name in ("AveragePool", "MaxPool")
    },
    "Concat": [{"axis": 1}, {"axis": -1}],
    "Gather": [{"axis": 1}],
    "Gelu": [{}, {"approximate": "tanh"}],
    "Gemm": [{}, {"alpha": 0.5, "beta": 2.0, "transB": 1}],
    "GRU": [{"hidden_size": 2}, {"hidden_size": 2, "linear_before_reset": 1}],
    "LSTM": [{"hidden_size": 2}],
    "RNN": [{"hidden_size": 2}],
    "Mod": [{"fmod": 1}],
    "Selu": [{}, {"alpha": 1.5, "gamma": 1.2}],
    "Shrink": [{}, {"lambd": 0.7, "bias": 0.2}],
    "Split": [{"axis": 1, "num_outputs": 2}],
    "Transpose": [{"perm": [0, 2, 1]}],
}
SHAPED = {
    "Transpose": (-1, 3, 3),
    "Conv": (-1, 3, 3, 1),
    "AveragePool": (-1, 1, 3, 3),
    "MaxPool": (-1, 1, 3, 3),
}
DRAWN = np.random.default_rng(3)
GATES = {"GRU": 3, "LSTM": 4, "RNN": 1}


def _operands(kind: str, attributes: dict[str, Any]) -> list[Any]:
    """The other inputs of an operator, as arrays."""
    row = DRAWN.normal(size=(1, 9)).astype(np.float32)
    if kind in GATES:
        gates = GATES[kind] * 2
        shapes = [(1, gates, 1), (1, gates, 2), (1, 2 * gates)]
        return [DRAWN.normal(size=shape).astype(np.float32) for shape in shapes]
    others = {
        "Gemm": [DRAWN.normal(size=(9, 9)).astype(np.float32), row],
        "MatMul": [DRAWN.normal(size=(9, 4)).astype(np.float32)],
        "Conv": [
            DRAWN.normal(size=(3, 3 // attributes.get("group", 1), 2, 1)).astype(np.float32),
            row[0, :3],
        ],
        "Clip": [np.float32(-1), np.float32(0.5)],
        "Gather": [np.array([0, 8, -2], np.int64)],
        "Slice": [np.array(of, np.int64) for of in ([-8], [2**40], [1], [3])],
        "Split": [],
        "Squeeze": [np.array([1], np.int64)],
        "Unsqueeze": [np.array([-1], np.int64)],
        "Reshape": [np.array([0, 3, -1], np.int64)],
        "LayerNormalization": [row[0], row[0]],
        "BatchNormalization": [row[0], row[0], row[0], np.abs(row[0])],
        "PRelu": [row],
    }
    if kind in TWO or kind in ("Sum", "Mean", "Max", "Min"):
        return [np.abs(row) if kind == "Pow" else row]
    return others.get(kind, [])


TWO = [
    "Add",
    "Sub",
    "Mul",
    "Div",
    "Pow",
    "Mod",
    "Less",
    "LessOrEqual",
    "Greater",
    "GreaterOrEqual",
    "Equal",
    "And",
    "Or",
    "Xor",
]
SETTINGS = [(kind, attributes) for kind in sorted(SINGLE) for attributes in SINGLE[kind]]


def of_one_operator(kind: str, attributes: dict[str, Any]) -> bytes:
    """A policy of one operator, whose numbers are its answer, as many as it has of nine."""
    nodes, constants = [node("Slice", ["observation", "zero", "nine", "one"], ["x9"])], []
    nodes.append(node("Mul", ["x9", "three"], ["x"]))
    given = "x"
    if kind in SHAPED or kind in GATES:
        shape = SHAPED.get(kind, (1, -1, 9))
        nodes.append(node("Unsqueeze" if kind in GATES else "Reshape", ["x", "shape"], ["shaped"]))
        constants.append(whole([2], "shape") if kind in GATES else whole(shape, "shape"))
        given = "shaped"
    if kind in GATES:
        nodes.append(node("Transpose", ["shaped"], ["steps"], perm=[1, 0, 2]))
        given = "steps"
    if kind in ("And", "Or", "Xor", "Not", "Where"):
        nodes.append(node("Greater", ["x", "none"], ["is"]))
        given = "is"
    if kind in ("Squeeze",):
        nodes.append(node("Unsqueeze", ["x", "one"], ["tall"]))
        given = "tall"
    names = [f"o{k}" for k in range(9)]
    operands = _operands(kind, attributes)
    if kind in ("And", "Or", "Xor"):
        operands = [operands[0] > 0]
    inputs = [given, *names[: len(operands)]]
    if kind == "Where":
        inputs, operands = ["is", "x", "none"], []
    if kind in ("Acosh", "Log", "Sqrt", "ReduceLogSum"):
        nodes.append(node("Cosh", ["x"], ["above"]))
        inputs = ["above"]
    if kind == "Constant":
        inputs = []
    if kind == "Concat":
        inputs = ["x", "x"]
    if kind.startswith("Reduce"):
        inputs.append("one")
    constants += [
        numpy_helper.from_array(np.asarray(of), name) for of, name in zip(operands, names, strict=False)
    ]
    outputs = ["made", "rest"] if kind == "Split" else ["made"]
    nodes.append(node(kind, inputs, outputs, **attributes))
    made = "made"
    if kind in GATES:
        nodes.append(node("Transpose", ["made"], ["turned"], perm=[2, 0, 1, 3]))
        made = "turned"
    nodes.append(node("Cast", [made], ["floats"], to=1))
    if kind == "Constant":
        nodes += [node("Add", ["x", "floats"], ["all"])]
    else:
        nodes += [node("Flatten", ["floats"], ["flat"]), node("Concat", ["flat", "x"], ["more"], axis=1)]
        nodes.append(node("Slice", ["more", "zero", "nine", "one"], ["all"]))
    nodes.append(node("Identity", ["all"], ["action"]))
    constants += [
        whole([0], "zero"),
        whole([9], "nine"),
        whole([1], "one"),
        constant(3.0, "three"),
        constant(0, "none"),
    ]
    return model(nodes, constants, opsets=[("", 20)])


@pytest.mark.parametrize(("kind", "attributes"), SETTINGS)
def test_each_operator_answers_as_in_onnxruntime(page, kind, attributes):
    data = of_one_operator(kind, attributes)
    seen = np.random.default_rng(1).uniform(-0.33, 0.33, (6, 15)).astype(np.float32)
    expected, _ = OnnxPlayer(data).predict(seen)
    given = {"file": base64.b64encode(data).decode(), "form": FORM, "seen": seen.tolist()}
    answers = np.array(page.evaluate(FILE, given), float)
    np.testing.assert_allclose(answers, expected, atol=2e-5, rtol=1e-5)


def test_the_check_lets_each_operator_pass():
    assert not any(check_policies([of_one_operator(kind, attributes) for kind, attributes in SETTINGS]))
