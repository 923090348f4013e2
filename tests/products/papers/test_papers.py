"""Reproductions of published results: their games, learners, claims, rows and pages."""

import json
import re
from typing import get_type_hints

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from scipy.optimize import linprog

from fpg_bench import make_sb3
from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.statistics import nash
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.products.papers import ali_2023, firouzbakht_2013, liu_2018, verbs
from fpg_bench.products.papers.firouzbakht_2013 import RateGame
from fpg_bench.products.papers.learners import (
    DuelingNetwork,
    PrioritisedBuffer,
    fictitious_play,
    minimax_q,
    q_learning,
)
from fpg_bench.products.papers.page import write_page
from fpg_bench.products.papers.reproduce import BUDGETS, GameStudy, read_rows, reproduce
from fpg_bench.products.papers.reproduction import (
    FAILS,
    HOLDS,
    NOT_RUN,
    ONE_SEED,
    OPEN,
    Facts,
    Paper,
    PaperClaim,
    PaperResults,
    verdict,
    verdict_of,
)
from fpg_bench.products.papers.verbs import reproduce as reproduce_verb
from fpg_bench.products.papers.yang_2026 import experiment as yang
from fpg_bench.training.export import export_onnx
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.models import make_model
from tests.programs import ROOT

PAPERS = (ali_2023.PAPER, firouzbakht_2013.PAPER, liu_2018.PAPER)
NAMES = [paper.facts.name for paper in PAPERS]
COMMITTED = ROOT / "docs/results/papers"


@pytest.mark.parametrize(
    ("name", "jammers"),
    [
        ("Ali2023", (*ali_2023.JAMMERS, "dynamic")),
        ("Firouzbakht2013", firouzbakht_2013.JAMMERS),
        ("Liu2018", liu_2018.JAMMERS),
    ],
)
def test_games_are_environments_of_gymnasium(name, jammers):
    made = gymnasium.make(f"fpg_bench.products.papers:FPG-papers/{name}-v0")
    for jammer in jammers:
        check_env(type(made.unwrapped)(jammer), skip_render_check=True)
    vectorised = gymnasium.make_vec(made.spec, num_envs=2, vectorization_mode="sync")
    observations, _ = vectorised.reset(seed=[1, 1])
    assert (observations[0] == observations[1]).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ali_2023.ProactiveJammerEnv("reactive"), "jammer: expected one of constant, sweeping"),
        (lambda: ali_2023.ProactiveJammerEnv(cost=2.0), "cost: expected 0 to 1, got 2.0"),
        (
            lambda: liu_2018.WaterfallEnv("dynamic"),
            "jammer: expected one of sweep, comb, random, intelligent",
        ),
        (lambda: firouzbakht_2013.RateEnv("sweep"), "jammer: expected one of equilibrium, constant"),
        (lambda: firouzbakht_2013.RateEnv(mean_power=1.5), "mean_power: expected a share above 0, up to 1"),
    ],
)
def test_an_option_that_a_paper_lacks_is_refused(make, message):
    with pytest.raises(UserError, match=message):
        make()


@pytest.mark.parametrize("action", [-1, 30, 1.5, np.array([0, 1]), None])
@pytest.mark.parametrize(
    "make", [ali_2023.ProactiveJammerEnv, firouzbakht_2013.RateEnv, liu_2018.WaterfallEnv]
)
def test_an_action_that_a_game_lacks_is_refused_and_earns_nothing(make, action):
    env = make()
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.step(np.array(1))  # as a policy of Stable-Baselines3 returns it
    with pytest.raises(UserError, match=r"action: expected one of Discrete\(\d+\), got"):
        env.step(action)


def received(channels, jammer):
    """The share of each slot in which these channels, one for each slot, are received."""
    env = liu_2018.WaterfallEnv(jammer)
    env.reset(seed=0)
    return np.array([env.step(np.int64(channel))[4]["throughput"] for channel in channels])


def test_signals_have_the_power_and_the_bandwidth_of_the_paper():
    for centre in liu_2018.CHANNELS_MHZ:
        signal = liu_2018.spectrum(np.array(centre), 30.0)
        assert signal.sum() == pytest.approx(1000.0, rel=1e-3)
        assert (signal > 1e-9).sum() == 40  # bins of 100 kHz


def test_the_jammers_of_the_waterfall_do_what_the_paper_says():
    assert [received([channel] * 9, "comb").mean() for channel in range(9)] == [0, 0, 1, 0, 0, 0, 1, 0, 0]
    assert received([0] * 40, "sweep").mean() == pytest.approx(0.7)  # jammed for 6 ms of 20
    assert received([8, 0] * 20, "sweep").min() == 1.0  # 1 GHz/s: half of the band in each slot
    assert received([0] * 2_000, "random").mean() == pytest.approx(0.8, abs=0.05)  # one of five places
    assert np.ptp(received([0] * 40, "random").reshape(-1, 2), axis=1).max() == 0  # for 20 ms
    # The intelligent one stays where the sender was most often in the last 20 slots.
    assert (
        received([0] * 20 + [8] * 10 + [8] * 10, "intelligent")[-25:].tolist() == [0] * 5 + [1] * 11 + [0] * 9
    )


def test_who_leaves_a_random_jammer_after_the_slot_that_it_was_met_in_reaches_the_optimum():
    env = liu_2018.WaterfallEnv("random")
    env.reset(seed=0)
    got = []
    for slot in range(4_000):
        channel = 8 if slot % 2 and got[-1] == 0 else 0
        got.append(env.step(np.int64(channel))[4]["throughput"])
    assert np.mean(got) == pytest.approx(liu_2018.OPTIMUM["random"], abs=0.02)


def test_a_sender_that_stays_is_swept_as_often_as_in_the_published_data():
    """0.87 is the published throughput of each agent that stays: 13 of 100 slots are jammed."""
    played = ali_2023.play("stay", "sweeping, cost 0.15", 0, 1.0)
    assert played == {"throughput": pytest.approx(0.87), "sent": pytest.approx(0.87), "hops": 0.0}


def test_the_rule_is_never_jammed_and_pays_for_each_change():
    played = ali_2023.play("leave if jammed", "dynamic, cost 0.1", 0, 1.0)
    assert played["sent"] == 1.0
    assert played["throughput"] == pytest.approx(1 - 0.1 * played["hops"])


def test_q_learning_finds_the_free_channels_of_the_comb():
    played = liu_2018.play("Q-learning", "comb", 0, 1.0)
    assert played["throughput"] > 0.95 > 0.5 > liu_2018.play("random", "comb", 0, 1.0)["throughput"]


def games(count=40):
    """Games of random rates, levels and mean powers."""
    generator = np.random.default_rng(0)
    for _ in range(count):
        levels, signal, jammer = generator.integers(2, 30), *10 ** generator.uniform(-1, 3, 2)
        rates = np.log2(1 + signal / (1 + np.linspace(0, jammer, levels + 1))) / 2
        yield RateGame(rates, generator.uniform(0.01, 1))


def best_jammer(game, sender):
    """The pay-off against the best jammer, by linear programming over powers with their mean limited."""
    levels = np.arange(len(game.rates))
    costs = [sum(sender[i] * game.rates[i] for i in levels if power <= i) for power in levels]
    limit, one = [game.mean_power * levels[-1]], np.ones((1, len(levels)))
    return linprog(costs, A_ub=levels[None], b_ub=limit, A_eq=one, b_eq=[1.0]).fun


def test_the_closed_form_is_the_equilibrium_of_rates_and_powers():
    for game in games():
        sender, jammer = game.equilibrium()
        for strategy in (sender, jammer):
            assert strategy.sum() == pytest.approx(1)
            assert strategy.min() >= 0
        assert jammer @ np.arange(len(jammer)) <= game.mean_power * (len(jammer) - 1) + 1e-6
        value = -nash(-(game.payoffs @ game.mixes.T)).value
        best_rate = max(rate * jammer[: i + 1].sum() for i, rate in enumerate(game.rates))
        assert best_jammer(game, sender) == pytest.approx(value, rel=1e-6)
        assert best_rate == pytest.approx(value, rel=1e-6) == pytest.approx(game.ceiling(jammer))


def test_guarantees_are_those_against_the_best_jammer():
    generator = np.random.default_rng(1)
    for game in games(20):
        sender = generator.dirichlet(np.ones(len(game.rates)))
        assert game.guarantee(sender) == pytest.approx(best_jammer(game, sender))
        assert game.guarantee(sender) <= game.guarantee(game.equilibrium()[0]) + 1e-9


def test_above_the_threshold_and_not_below_the_mean_power_does_not_matter():
    for game in games(20):
        above, full = (RateGame(game.rates, share) for share in (min(game.threshold + 1e-3, 1), 1.0))
        assert above.guarantee(above.equilibrium()[0]) == pytest.approx(full.rates[-1])
        below = RateGame(game.rates, game.threshold * 0.9)
        assert below.guarantee(below.equilibrium()[0]) > full.rates[-1] + 1e-9


def test_simple_strategies_keep_to_the_mean_power_and_lose_to_the_equilibrium():
    for rule in firouzbakht_2013.RULES.values():
        game = RateGame(firouzbakht_2013.RATES, 0.1)
        sender, jammer = rule(game)
        assert jammer @ np.linspace(0, 1, len(jammer)) <= 0.1 + 1e-9
        assert game.guarantee(sender) <= game.ceiling(game.equilibrium()[1]) + 1e-9
        assert game.ceiling(jammer) >= game.guarantee(game.equilibrium()[0]) - 1e-9


def test_packets_meet_the_powers_of_the_equilibrium_and_pay_their_rate():
    env, rate = firouzbakht_2013.RateEnv(mean_power=0.2), 3
    env.reset(seed=0)
    steps = [env.step(np.int64(rate)) for _ in range(20_000)]
    levels = np.array([level for level, *_ in steps])
    assert levels.mean() / firouzbakht_2013.LEVELS == pytest.approx(0.2, abs=0.01)
    assert [reward > 0 for _, reward, *_ in steps] == (levels <= rate).tolist()
    game = RateGame(firouzbakht_2013.RATES, 0.2)
    assert np.mean([reward for _, reward, *_ in steps]) == pytest.approx(
        game.ceiling(game.equilibrium()[1]), abs=0.02
    )


MATRIX = np.array([[3.0, 0.0], [1.0, 2.0], [-1.0, -1.0]])  # the third row is the worst one
ROWS, COLUMNS = [1 / 4, 3 / 4, 0], [1 / 2, 1 / 2]


@pytest.mark.parametrize("noise", [0.0, 30.0])
def test_fictitious_play_and_hedge_come_near_the_equilibrium_of_a_matrix(noise):
    early, late = fictitious_play(MATRIX, [10, 20_000], 0, noise=noise)
    assert early[0].sum() == pytest.approx(1)
    assert late[0] == pytest.approx(ROWS, abs=0.05)
    assert late[1] == pytest.approx(COLUMNS, abs=0.05)
    again = fictitious_play(MATRIX, [10, 20_000], 0, noise=noise)[1]
    assert (again[0] == late[0]).all()


def test_minimax_q_solves_a_matrix_once_it_has_met_all_of_it():
    (first, _), (rows, columns) = minimax_q(MATRIX, [1, 200], 0, exploration=0.5)
    assert rows == pytest.approx(ROWS, abs=1e-9)
    assert columns == pytest.approx(COLUMNS)
    assert first != pytest.approx(rows)


def test_self_play_learns_and_a_single_rate_is_exploited():
    played = {
        player: firouzbakht_2013.play(player, "mean power 0.2", 0, 1.0)
        for player in (*firouzbakht_2013.SELF_PLAY, firouzbakht_2013.Q_LEARNING)
    }
    for player in firouzbakht_2013.SELF_PLAY:
        _, _, first, *_, last = played[player].values()
        assert last < 0.05 < first
    assert played["Q-learning"]["guarantee"] < 0.8 * played["minimax-Q"]["guarantee"]


def test_q_learning_bootstraps_at_the_end_of_time_and_not_at_the_end_of_a_task():
    class Corridor(gymnasium.Env):
        action_space, observation_space = gymnasium.spaces.Discrete(1), gymnasium.spaces.Discrete(1)

        def __init__(self, terminates):
            self.terminates = terminates

        def reset(self, *, seed=None, options=None):
            return 0, {}

        def step(self, action):
            return 0, 1.0, self.terminates, not self.terminates, {}

    for terminates, value in ((True, 1.0), (False, 2.0)):
        table = q_learning(
            Corridor(terminates), int, 1, 500, 0, rate=0.5, gamma=0.5, exploration=lambda share: 0.0
        )
        assert table == pytest.approx(np.array([[value]]))


def test_a_prioritised_buffer_draws_great_errors_and_weighs_them_less():
    box = gymnasium.spaces.Box(-1, 1, (1,))
    buffer = PrioritisedBuffer(10, box, gymnasium.spaces.Discrete(2), "cpu")
    for index in range(4):
        state = np.full((1, 1), index / 4, np.float32)
        buffer.add(state, state, np.array([[0]]), np.array([0.0]), np.array([False]), [{}])
    np.random.seed(0)  # noqa: NPY002 (SB3 draws from it)
    buffer.sample(4)
    buffer.drawn = np.arange(4)
    buffer.update(np.array([0.0, 0.0, 0.0, -5.0]))
    batch = buffer.sample(200)
    assert (buffer.drawn == 3).mean() > 0.95
    assert batch.observations[buffer.drawn == 3].unique().tolist() == [0.75]
    assert buffer.weights.max() == 1.0 or (buffer.drawn == 3).all()


def test_a_dueling_network_has_a_value_and_advantages_that_cancel_out():
    env = ali_2023.ProactiveJammerEnv()
    variant = ali_2023.VARIANTS["dueling DDQN"]
    network = ali_2023.train(variant, env, 1, 0).q_net
    assert isinstance(network, DuelingNetwork)
    scans = torch.zeros(2, 8)
    values = network(scans)
    assert values.shape == (2, 8)
    output = network.q_net[:-1](network.extract_features(scans, network.features_extractor))
    assert output.shape == (2, 9)
    assert values.mean(1).detach().numpy() == pytest.approx(output[:, -1].detach().numpy(), abs=1e-4)


def dueling_ddqn(**changes):
    """The learner of the zoo in games of link, with weights that differ from those of its target."""
    games = make_sb3("FPG/AllyVsScripted-v0", 4, seed=1, scenario="link", actions="discrete")
    entry = (
        load_hyperparameters("dueling-ddqn", games.game_spec).entry()
        | {"learning_starts": 0, "target_update_interval": 4}
        | changes
    )
    model = make_model("dueling-ddqn", games, load_hyperparameters("dueling-ddqn", games.game_spec, entry), 0)
    generator = torch.Generator().manual_seed(1)
    for parameter in model.q_net.parameters():
        parameter.data += 0.1 * torch.randn(parameter.shape, generator=generator)
    return model


@pytest.mark.slow
def test_a_dueling_network_is_exported_with_its_value_and_advantages():
    model = dueling_ddqn()
    assert isinstance(model.q_net, DuelingNetwork)
    model.q_net.q_net[-2].bias.data[-1] = 100.0  # greater than all advantages: a value is no choice
    player, games = OnnxPlayer(export_onnx(model)), model.get_env()
    seen, chosen = games.reset(), set()
    for _ in range(30):
        choices, _ = model.predict(seen, deterministic=True)
        expected = games.unwrapped.core.choices.decode(choices, seen)
        assert np.abs(player.predict(seen)[0] - expected).max() < 1e-5
        chosen |= {*choices.tolist()}
        seen, *_ = games.step(np.array([games.action_space.sample() for _ in seen]))
    assert len(chosen) > 1


@pytest.mark.parametrize(("double", "n_steps"), [(True, 1), (False, 1), (True, 3)])
def test_targets_are_those_of_the_variant_with_the_rewards_as_they_are_normalized(double, n_steps):
    model = dueling_ddqn(n_steps=n_steps, gamma=0.9, learning_rate=1e-9)
    model.double = double
    model.learn(4 * 40)
    np.random.seed(0)  # noqa: NPY002 (SB3 draws from it)
    batch = model.replay_buffer.sample(64, env=model.get_vec_normalize_env())
    with torch.no_grad():
        values = model.q_net_target(batch.next_observations)
        best = (model.q_net(batch.next_observations) if double else values).argmax(1)
        discounts = 0.9 if n_steps == 1 else batch.discounts[:, 0]
        targets = batch.rewards[:, 0] + (1 - batch.dones[:, 0]) * discounts * values[range(64), best]
        errors = model.q_net(batch.observations)[range(64), batch.actions[:, 0].long()] - targets
    np.random.seed(0)  # noqa: NPY002
    model.train(1, 64)
    assert model.logger.name_to_value["train/loss"] == pytest.approx(float(errors.square().mean()), rel=1e-4)


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize("variant", ali_2023.VARIANTS)
def test_the_same_seed_trains_the_same_network(variant):
    first, second = (ali_2023.play(variant, "dynamic, cost 0.1", 3, 0.02) for _ in range(2))
    assert first == second != ali_2023.play(variant, "dynamic, cost 0.1", 4, 0.02)


@pytest.mark.slow
def test_the_waterfall_is_enough_to_evade_the_comb():
    assert liu_2018.play("DQN", "comb", 0, 1.0)["throughput"] > 0.9


def test_verdicts_follow_from_intervals():
    assert verdict_of(np.array([0.1, 0.2, 0.3])) == OPEN
    assert verdict_of(np.array([0.1, 0.11, 0.12])) == HOLDS
    assert verdict_of(np.array([-0.1, -0.11, -0.12])) == FAILS
    assert verdict_of(np.array([0.1])) == ONE_SEED
    assert verdict_of(np.array([])) == NOT_RUN
    assert [verdict_of(np.full(count, 0.1)) for count in (2, 5, 6, 10)] == [OPEN, OPEN, HOLDS, HOLDS]
    assert [verdict_of(np.full(count, -0.1)) for count in (5, 6)] == [OPEN, FAILS]
    parts = {"a": np.array([1.0, 1.1]), "b": np.array([-1.0, -1.1])}
    both = PaperClaim("both", "", lambda results: parts)
    assert verdict(both, PaperResults({})) == FAILS


@pytest.mark.parametrize("paper", PAPERS, ids=NAMES)
def test_published_values_are_those_of_players_and_conditions(paper):
    for player, values in paper.facts.published.items():
        assert player in paper.players
        assert {*values} <= {*paper.conditions}
    sources = {number.source for number in paper.facts.numbers}
    assert "assumption" in sources
    assert len(sources) > 1


def small(play):
    facts = Facts(
        name="small",
        title="Small",
        citation="Nobody",
        about="Nothing.",
        published_in="nowhere",
        published={"a": {"c": 0.5}},
        numbers=(),
        missing=(),
    )
    better = PaperClaim(
        "a beats b", "text", lambda results: {"a - b": results.difference("m", ("a", "c"), ("b", "c"))}
    )
    return Paper(facts, ("a", "b"), ("c",), {"m": "measure", "n": "other"}, (better,), play)


def test_rows_are_kept_and_only_missing_ones_are_run(tmp_path):
    played = []

    def play(player, condition, seed, share):
        played.append((player, seed))
        return {"m": 0.8 + 0.001 * seed if player == "a" else 0.2, "n": share}

    rows, page, figure = reproduce(GameStudy(small(play)), tmp_path, n_seeds=2)
    assert played == [("a", 0), ("b", 0), ("a", 1), ("b", 1)]
    rows.write_bytes(rows.read_bytes()[:-20])  # as if it was stopped while it wrote
    reproduce(GameStudy(small(play)), tmp_path, n_seeds=3)
    assert played[4:] == [("b", 1), ("a", 2), ("b", 2)]
    text = page.read_text()
    assert "| a | 0.801 ± 0.002 | 0.500 |" in text
    assert "| a beats b | text | 1 of 1 | 0.601 [0.599, 0.603] | holds |" in text
    assert "[`small-quick.jsonl`](small-quick.jsonl) also has `n`." in text
    assert "**Trainings have 2 % of the full length.**" in text
    assert "`fpg-bench reproduce small --budget quick --n-seeds 3`: seeds 0, 1, 2" in text
    assert figure.stat().st_size > 1000
    assert all(json.loads(line)["versions"].startswith("fpg-bench") for line in rows.open())


def test_a_failed_run_is_named_and_the_others_are_kept(tmp_path):
    def play(player, condition, seed, share):
        if player == "b":
            raise UserError("no")
        return {"m": 1.0, "n": 0.0}

    with pytest.raises(UserError, match="small b c seed 0"):
        reproduce(GameStudy(small(play)), tmp_path, n_seeds=1)
    assert [row["player"] for row in RowFile(tmp_path / "small-quick.jsonl").read()] == ["a"]


def test_without_a_name_the_papers_are_listed(capsys):
    reproduce_verb(None)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["yang-2026", *NAMES]
    assert all(len(line) <= 80 for line in lines)


def test_the_help_names_the_budgets_and_no_other():
    (option,) = get_type_hints(reproduce_verb, include_extras=True)["budget"].__metadata__
    of_all, of_yang = (re.findall(r"\w+", text) for text in option.help.split(verbs.YANG))
    assert {*yang.BUDGETS} & {*of_all} == {*BUDGETS}
    assert {*BUDGETS, *of_yang} >= {*yang.BUDGETS}


@pytest.mark.parametrize("paper", PAPERS, ids=NAMES)
def test_committed_pages_follow_from_committed_rows(paper, tmp_path):
    name = f"{paper.facts.name}-full"
    rows = read_rows(COMMITTED / f"{name}.jsonl")
    seeds = {seed for *_, seed in rows}
    assert len(rows) == len(paper.players) * len(paper.conditions) * len(seeds)
    assert len(seeds) >= 5
    command = f"fpg-bench reproduce {paper.facts.name} --budget full --n-seeds {len(seeds)}"
    page, *figures = write_page(paper, PaperResults(rows), 1.0, command, tmp_path / f"{name}.md")
    assert page.read_text() == (COMMITTED / f"{name}.md").read_text()
    assert {each.name for each in figures} == {each.name for each in COMMITTED.glob(f"{name}.*svg")}
