"""The game that is played as one value."""

import json
import pickle

import gymnasium
import pytest

import fpg_bench
from fpg_bench import GameSpec, Scenario, preset
from fpg_bench.common.errors import UnknownOptionError, UserError
from fpg_bench.common.ids import ENVS
from fpg_bench.common.imports import check_allowed
from fpg_bench.envs.gymnasium_vector import FPGVectorEnv
from fpg_bench.envs.pettingzoo_env import parallel_env

ALLY, OPPONENT, DUEL = "FPG/AllyVsScripted-v0", "FPG/OpponentVsPolicy-v0", "FPG/duel_v0"
SPECS = (
    GameSpec(ALLY),
    GameSpec(ALLY, opponent=["tone", "sweep"], path=["pursuit", "circle"], actions="discrete"),
    GameSpec(ALLY, scenario=Scenario(hop_cost=60), observation="waterfall", history=4),
    GameSpec(OPPONENT, ally="ally-scripted/ppo/seed_0", scenario="link", reward="zero_sum", path="learned"),
    GameSpec("FPG/AllyVsPlanner-v0", planner="random", knowledge="none", jamming_types=["tone"]),
    GameSpec(DUEL, scenario="paper", path="triangle"),
    GameSpec(DUEL, actions={"ally": "discrete"}),
)


@pytest.mark.parametrize("spec", SPECS)
def test_a_game_survives_json_and_pickling(spec):
    assert GameSpec.from_dict(json.loads(json.dumps(spec.to_dict()))) == spec
    assert pickle.loads(pickle.dumps(spec)) == spec
    assert len(spec.hash) == 64


@pytest.mark.parametrize("spec", [spec for spec in SPECS if not spec.is_duel])
def test_every_interface_gives_back_what_it_was_made_with_and_opens_it_again(spec):
    options = spec.options()
    envs = [
        gymnasium.make(spec.id, **options).unwrapped,
        FPGVectorEnv(spec.id, 2, **options),
        fpg_bench.make_sb3(spec.id, 2, **options),
    ]
    for env in envs:
        assert env.game_spec == spec
        again = fpg_bench.make_sb3(GameSpec.from_dict(env.game_spec.to_dict()), 2)
        assert again.core.scenario == env.core.scenario == spec.resolve()
        assert again.observation_space == env.core.observation_space
        assert again.core.other_specs == env.core.other_specs


def test_the_duel_is_opened_by_its_specification():
    spec = GameSpec(DUEL, scenario="paper", path="triangle")
    assert parallel_env(scenario="paper", path="triangle").game_spec == spec
    assert fpg_bench.make_duel(2, game=spec).scenario == spec.resolve()
    assert fpg_bench.make_sb3(spec, 2).observation_space.shape == (30,)
    with pytest.raises(UserError, match=f"game: expected one of {DUEL}, got {ALLY}"):
        fpg_bench.make_duel(game=GameSpec(ALLY))
    with pytest.raises(UserError, match="actions: of both sides together they are continuous"):
        fpg_bench.make_sb3(DUEL, actions="discrete")


def test_an_id_of_discrete_actions_is_the_plain_id_and_names_are_lists():
    assert GameSpec("fpg_bench:FPG/AllyVsScriptedDiscrete-v0") == GameSpec(ALLY, actions="discrete")
    assert GameSpec(ALLY, actions="continuous") == GameSpec(ALLY)
    assert GameSpec(ALLY, opponent="tone") == GameSpec(ALLY, opponent=["tone"])
    assert GameSpec(ALLY, opponent="tone").options() == {"opponent": "tone"}


def test_a_scenario_object_is_written_by_its_name_or_its_fields():
    assert GameSpec(ALLY, scenario=preset("link")).to_dict()["scenario"] == "link"
    spec = GameSpec(ALLY, scenario=Scenario(hop_cost=60))
    assert spec.to_dict()["scenario"] == {"hop_cost": 60.0}
    assert spec.hash != GameSpec(ALLY).hash


def test_the_id_decides_path_and_rounds_unless_they_are_named(tmp_path):
    (tmp_path / "mine.yml").write_text("opponent_path: circle\nrounds_per_match: 3\n")
    for spec, path, rounds in (
        (GameSpec(ALLY), "pursuit", 1),
        (GameSpec("FPG/AllyVsPlanner-v0"), "waypoints", 10),
        (GameSpec(ALLY, scenario=tmp_path / "mine.yml"), "circle", 3),
        (GameSpec(ALLY, scenario="figures"), "pursuit", 1),
        (GameSpec(DUEL, scenario="figures"), "pursuit", 40),
        (GameSpec(DUEL, planner="circle"), "waypoints", 1),
    ):
        played = spec.resolve()
        assert (played.opponent_path, played.rounds_per_match) == (path, rounds)


def test_the_other_sides_players_are_named_once():
    assert GameSpec.of(ALLY, against="tone") == GameSpec(ALLY, opponent="tone")
    assert GameSpec.of(GameSpec(OPPONENT), against=["idle", "expert"]).others == ("idle", "expert")
    assert GameSpec(ALLY).others == (ENVS[ALLY].other,)
    with pytest.raises(UserError, match="against: names the opponent, and so does opponent"):
        GameSpec.of(GameSpec(ALLY, opponent="tone"), against="sweep")
    with pytest.raises(UserError, match="both sides learn; omit it"):
        GameSpec.of(DUEL, against="tone")


def test_an_object_stays_in_its_program():
    class Mine:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            raise NotImplementedError

    spec = GameSpec("FPG/AllyVsPolicy-v0", opponent=Mine())
    assert "Mine object" in spec.describe()["opponent"]
    with pytest.raises(UserError, match="opponent: Mine is an object of this program"):
        spec.to_dict()


def test_an_unknown_option_is_also_a_type_error():
    with pytest.raises(UnknownOptionError, match="'oponent'; did you mean 'opponent'"):
        GameSpec.of(ALLY, oponent="tone")


def test_a_weight_stands_for_a_name_that_is_listed_several_times():
    spec = GameSpec("FPG/AllyVsPolicy-v0", opponent=["tone", "alternate(centres=3)*2", "idle.player:make*3"])
    assert spec.opponent == ("tone", *["alternate(centres=3)"] * 2, *["idle.player:make"] * 3)
    assert GameSpec.of("FPG/AllyVsPolicy-v0", against="tone*2") == GameSpec(
        "FPG/AllyVsPolicy-v0", opponent=["tone", "tone"]
    )
    read = GameSpec.from_dict({"id": "FPG/AllyVsPolicy-v0", "opponent": ["tone", "code.module:make*3"]})
    assert read.untrusted == {"code.module:make"}
    with pytest.raises(UserError, match=r"would run code\.module:make"):
        read.check_trusted()
    with pytest.raises(UserError, match="if you trust it"):
        check_allowed({"against": ["tone", "code.module:make*3"]}, [], "champion")
    with pytest.raises(UserError, match="a weight from 1 to 1000"):
        GameSpec("FPG/AllyVsPolicy-v0", opponent="tone*0")
