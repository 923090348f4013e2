"""One entry: agents that differ by their training seed alone."""

import shutil
from pathlib import Path

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import SCRIPTED
from fpg_bench.evaluation.entry import entries_of, player_entry
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.players.agent import baselines_folder, load_agent
from fpg_bench.players.scripted import OracleAlly, Scripted
from tests.training.making import make_agent, make_zoo


@pytest.fixture(scope="module")
def suite():
    return load_suite("ally-v2")


@pytest.fixture
def agent(tmp_path, monkeypatch):
    """Writes an agent folder and gives its path, relative to where the test runs."""
    member = make_zoo(tmp_path).members()[0]
    monkeypatch.chdir(tmp_path)

    def write(path, training_seed=0, policy=None, **about):
        seed = training_seed if policy is None else policy
        make_agent(member, tmp_path / path, seed=seed, training_seed=training_seed, **about)
        return path

    return write


def names(specs, suite):
    return [(entry.name, entry.training_seed) for entry in entries_of(specs, suite)]


def test_scripts_are_entries_without_training_seed(suite):
    assert names(["all-scripted"], suite) == [(name, None) for name in SCRIPTED["ally"]]
    assert names(["expert", "idle", "expert"], suite) == [("expert", None), ("idle", None)]


def test_agents_that_differ_by_their_training_seed_alone_are_one_entry(suite, agent):
    agents = [agent(f"runs/ppo_{k}/agent", k) for k in range(3)]
    assert names(agents, suite) == [("ppo", 0), ("ppo", 1), ("ppo", 2)]


def test_a_group_stands_for_all_its_training_seeds(suite, agent):
    for k in (10, 2, 0):
        agent(f"runs/ppo/seed_{k}/agent", k)
    assert names(["runs/ppo"], suite) == [("ppo", 0), ("ppo", 2), ("ppo", 10)]
    assert names(["runs/ppo/seed_2", "ally-scripted/sac"], suite) == [
        ("ppo", 2),
        *(("sac", k) for k in range(5)),
    ]
    Path("runs/ppo/seed_3").mkdir()
    with pytest.raises(UserError, match="seed_3 has no agent; is its run finished"):
        names(["runs/ppo"], suite)
    with pytest.raises(UserError, match="holds 4 training seeds; name one, seed_0 for instance"):
        load_agent("runs/ppo")


@pytest.mark.parametrize(
    "other",
    [
        {"training_steps": 5000},
        {"hyperparameters": {"gamma": 0.9}},
        {"options": {"opponent": "tone"}},
        {"scenario": "1" * 64},
        {"id": "FPG/AllyVsPolicy-v0"},
    ],
)
def test_agents_that_were_made_otherwise_are_entries_of_their_own(suite, agent, other):
    mine = [agent(f"runs/ppo_{k}/agent", k) for k in range(2)]
    theirs = [agent(f"zoo/ppo/seed_{k}", k, policy=10 + k, **other) for k in range(2)]
    entries = [(f"{folder}/ppo", k) for folder in ("runs", "zoo") for k in range(2)]
    assert names([*mine, *theirs, "expert"], suite) == [*entries, ("expert", None)]


def test_seeds_of_a_champion_are_one_entry_though_each_met_its_own_responders(suite, agent):
    recipe, met = (
        {"name": "brave", "stages": []},
        [f"runs/brave/seed_{k}/responder_0/agent" for k in range(2)],
    )
    seeds = [agent(f"b/seed_{k}", k, recipe=recipe, options={"opponent": [met[k]]}) for k in range(2)]
    other = agent("c/seed_0", 0, policy=9, recipe=recipe | {"name": "bold"})
    assert names([*seeds, other], suite) == [("b", 0), ("b", 1), ("c", 0)]


def test_folders_that_begin_alike_have_names_that_tell_them_apart(suite, agent):
    """These paths differ by more than the training seed, so that the whole path is said."""
    one = agent("runs/a/seed_0/agent", 0)
    other = agent("runs/a/seed_1/agent", 1, training_steps=5000)
    assert names([one, other], suite) == [(one, 0), (other, 1)]


def test_two_policies_of_one_training_seed_are_refused_and_one_by_two_names_is_one(suite, agent):
    one, other, same = (agent(path, 0, policy=k) for path, k in (("a/one", 1), ("b/two", 2), ("c/three", 1)))
    with pytest.raises(UserError, match=r"ppo: two different players of training seed 0; give each a name"):
        entries_of([one, other], suite)
    assert names([one, same], suite) == [("ppo", 0)]


@pytest.mark.parametrize("name", ["mine (2)", "modèle", "a(b) c"])
def test_a_name_of_ones_own_may_have_parentheses_and_accents(suite, name):
    script = "by-type(hop_below_db=3)"
    assert [each.name for each in entries_of([f"{name}=expert"], suite)] == [name]
    assert [each.name for each in entries_of([script], suite)] == [script]


def test_one_player_is_a_list_of_one_and_no_player_is_refused(suite):
    assert [each.name for each in entries_of("expert", suite)] == ["expert"]
    for none in ([], {}, {"mine": []}):
        with pytest.raises(UserError, match="players: there are none; name at least one"):
            entries_of(none, suite)


def test_a_player_may_have_a_name_of_ones_own(suite, agent):
    agents = [agent(f"runs/ppo/seed_{k}", k) for k in range(2)]
    expected = [("mine", 0), ("mine", 1), ("expert", None)]
    assert names(["mine=runs/ppo", "expert"], suite) == expected
    assert names([f"mine={agents[0]}", "expert", f"mine={agents[1]}"], suite) == expected
    variant = "sulk(patience_hops=1, rest_s=2)"
    assert names([f"hops={variant}", variant], suite) == [("hops", None), (variant, None)]
    lr = agent("lr=3", 2)
    assert names([lr], suite) == [("ppo", 2)]
    for name, message in (
        ("expert", "is a script's"),
        ("Expert", "is a script's"),
        ("=cmd|' /C calc'!A0", "begins with a letter or a digit"),
        ("a\nb", "printable"),
    ):
        for player in ("idle", agents):
            with pytest.raises(UserError, match=message):
                names({name: player}, suite)


def test_names_differ_by_more_than_case(suite, agent):
    own = agent("runs/mine", 0, algorithm="PPO")
    group = "ally-scripted/ppo"
    assert {name for name, _ in names([own, group], suite)} == {own, f"{group} (shipped)"}
    assert {name for name, _ in names([f"PPO={own}", group], suite)} == {"PPO", f"{group} (shipped)"}
    with pytest.raises(UserError, match="PPO: differs from ppo by case alone"):
        entries_of({"ppo": own, "PPO": "idle"}, suite)


def test_one_policy_is_not_several_training_seeds(suite, agent):
    copies = [agent(f"runs/ppo/seed_{k}", k, policy=0) for k in range(2)]
    for specs in (["runs/ppo"], copies, {"mine": copies}):
        with pytest.raises(UserError, match="seed_1: holds the same policy as seed_0; each seed must be"):
            entries_of(specs, suite)
    assert len(entries_of({"one": copies[0], "two": copies[1]}, suite)) == 2


def test_oracles_wrong_sides_and_unknown_players_never_enter(suite):
    for spec, message in (
        (OracleAlly(suite.scenario), "sees the full state, which no suite allows"),
        ("mine=oracle", "mine=oracle: tables tell it apart by its name; write oracle"),
        ("adaptive", "'adaptive' plays the opponent"),
        ("expertt", "did you mean 'expert'"),
        (5, "expected a player's name or an object with predict"),
    ):
        with pytest.raises(UserError, match=message):
            entries_of([spec], suite)


# Players as objects, and names for all


def test_players_as_objects_are_entries_by_their_class(suite, agent):
    one = Scripted("ally", "expert", suite.scenario)
    assert names([one, "expert"], suite) == [("Scripted", None), ("expert", None)]
    loaded = load_agent(agent("a/one", 4))
    assert names([loaded], suite) == [("ppo", 4)]
    with pytest.raises(UserError, match="Scripted: two different players"):
        entries_of([one, Scripted("ally", "idle", suite.scenario)], suite)


def test_a_mapping_names_its_entries(suite, agent):
    agents = [agent(f"runs/ppo_{k}", k) for k in range(2)]
    players = {"mine": agents, "calm": Scripted("ally", "idle", suite.scenario), "best": "expert"}
    assert names(players, suite) == [("mine", 0), ("mine", 1), ("calm", None), ("best", None)]
    with pytest.raises(UserError, match="both: expert and idle are several entries"):
        entries_of({"both": ["expert", "idle"]}, suite)


def test_an_agent_of_a_folder_is_told_by_its_policy(tmp_path):
    pytest.importorskip("fpg_bench.products.sandbox.agent")  # which plays agents of others
    shutil.copytree(baselines_folder() / "agents/ally-scripted/ppo/seed_0", tmp_path / "one")
    shutil.copytree(baselines_folder() / "agents/ally-scripted/ppo/seed_1", tmp_path / "two")
    one, two = (player_entry(str(tmp_path / name)) for name in ("one", "two"))
    assert one.fingerprint == player_entry("ally-scripted/ppo/seed_0").fingerprint != two.fingerprint
    assert one.fingerprint == load_agent(tmp_path / "one").card.policy_sha256
