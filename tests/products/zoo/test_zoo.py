import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.spec import GameSpec
from fpg_bench.products.zoo.zoo import load_zoo, mixture
from tests.training.making import ZOO, make_agent


@pytest.fixture
def zoo(tmp_path):
    (tmp_path / "zoo.yml").write_text(ZOO)
    return load_zoo(tmp_path)


def test_members_by_group_algorithm_and_seed(zoo):
    names = [member.name for member in zoo.members()]
    assert names == [f"small/{algorithm}/seed_{k}" for algorithm in ("ppo", "td3") for k in (0, 1, 2)]
    assert [m.steps for m in zoo.members("small/td3")] == [1000] * 3
    assert [m.name for m in zoo.members("small/ppo/seed_2")] == ["small/ppo/seed_2"]
    assert zoo.members("small/") == zoo.members()


def test_unknown_members_suggest(zoo):
    for only, hint in (("smal", "did you mean 'small'"), ("small/pp", "'small/ppo'")):
        with pytest.raises(UserError, match=hint):
            zoo.members(only)


def test_an_agent_is_shipped_once_it_lies_there(zoo):
    member = zoo.members()[0]
    assert not member.shipped
    make_agent(member)
    assert member.shipped


def test_the_mixture_of_rivals_is_that_of_the_agents_of_an_id():
    groups = {group.name: group for group in load_zoo().groups}
    for name in ("ally-scripted", "ally-population", "opponent-pursuit", "opponent-discrete"):
        game = groups[name].game
        assert mixture(GameSpec(game.id, actions=game.actions)) == game
    learned, link = groups["opponent-learned"].game, groups["opponent-link"].game
    assert mixture(GameSpec(learned.id, path="learned")) == learned
    assert mixture(GameSpec(link.id, scenario="link")).ally == link.ally
    game = groups["ally-scripted"].game
    assert mixture(GameSpec(game.id, scenario="paper")) == GameSpec.of(game, scenario="paper")
    assert mixture(GameSpec(game.id, path="circle")) == GameSpec.of(game, path="circle")
    with pytest.raises(UserError, match="no mixture for FPG/AllyVsPlanner-v0, but for FPG/AllyVsScripted-v0"):
        mixture(GameSpec("FPG/AllyVsPlanner-v0"))


def test_learners_of_papers_play_the_games_of_ally_link():
    groups = {group.name: group for group in load_zoo().groups}
    ours, waterfall = groups["ally-link"], groups["ally-link-waterfall"]
    assert "dueling-ddqn" in ours.steps
    assert waterfall.game == GameSpec.of(ours.game, observation="waterfall")
    assert waterfall.suites == ours.suites


def test_a_training_is_scored_on_the_usual_suite_of_its_game():
    groups = {group.name: group for group in load_zoo().groups}
    assert groups["ally-scripted"].training_suite == "ally-v2"
    assert groups["ally-planner"].training_suite == "ally-planner-v1"
    assert groups["opponent-learned"].training_suite == "opponent-learned-v2"


def test_bad_zoo_files(tmp_path):
    for old, new, message in (
        ("seeds: [0, 1, 2]", "seeds: 5", "seeds: expected a list"),
        ("seeds: [0, 1, 2]", "seeds: [0, true]", r"seeds\[1\]: expected a whole number"),
        ("AllyVsScripted", "AlyVsScripted", "did you mean 'FPG/AllyVsScripted-v0'"),
        ("    suites: [SUITE]\n", "", "small: lacks suites"),
        ("ppo: 2000", "ppo: 2M", "steps.ppo: expected a whole number above 0"),
    ):
        assert old in ZOO
        (tmp_path / "zoo.yml").write_text(ZOO.replace(old, new))
        with pytest.raises(UserError, match=message):
            load_zoo(tmp_path)
    (tmp_path / "zoo.yml").unlink()
    with pytest.raises(UserError, match="cannot be read"):
        load_zoo(tmp_path)


def test_an_agent_of_a_suite_counts_by_its_policy_and_not_by_its_name(tmp_path, zoo):
    member = zoo.members()[0]
    hashes = set()
    for folder, seed in (("one", 1), ("two", 1), ("three", 2)):
        agent = make_agent(member, tmp_path / folder, seed=seed)
        content = f"side: opponent\nscenario: standard\nmatches: 2\nrivals: [{{ally: {agent}, name: it}}]"
        file = tmp_path / "suite.yml"
        file.write_text(content)
        hashes.add((seed, load_suite(str(file)).hash))
    assert len(hashes) == 2
