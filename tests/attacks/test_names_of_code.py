"""Files of strangers name code; none of it is imported unless the user allows it by name."""

import contextlib
import pickle
import sys

import pytest
import yaml
from typer.testing import CliRunner

from fpg_bench.cli.main import app
from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json
from fpg_bench.common.imports import check_allowed, imported
from fpg_bench.envs.sb3_vec_env import make_sb3
from fpg_bench.evaluation.evaluate import evaluate, read_results
from fpg_bench.evaluation.policy_evaluator import PolicyEvaluator
from fpg_bench.evaluation.suite import load_suite, read_suite
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.card import AgentCard
from fpg_bench.products.league.best_responses import best_responses
from fpg_bench.products.league.champions import load_champions
from fpg_bench.products.league.config import BestResponseConfig
from fpg_bench.products.tuning.export import export_values
from fpg_bench.products.tuning.study import open_storage, open_study
from fpg_bench.products.tuning.tune import tune
from fpg_bench.training.config import RunConfig
from fpg_bench.training.hyperparameters import load_hyperparameters
from fpg_bench.training.train import train
from tests.products.tuning.fake import fake_task
from tests.training.tiny import ALLY, settings

CODE = "friend.evil:Player"
REFUSED = f"would run {CODE}; if you trust it, add --allow {CODE}"


@pytest.fixture(autouse=True)
def ran(tmp_path, monkeypatch):
    """The file that the friend's code writes when it is imported; its folder is the present one."""
    (tmp_path / "friend").mkdir()
    (tmp_path / "friend/evil.py").write_text(
        "from pathlib import Path\nfrom fpg_bench.game.scenario import STANDARD\n"
        "from fpg_bench.players.registry import as_player\nPath('ran').touch()\n"
        "Player = lambda: as_player('tone', 'opponent', STANDARD)\n"
    )
    monkeypatch.chdir(tmp_path)
    yield tmp_path / "ran"
    for name in ("friend", "friend.evil"):
        sys.modules.pop(name, None)


def suite(side="ally", **changes):
    """A suite's file, with the friend's code as a rival, as a planner, or as the jamming player."""
    rival = {"opponent" if side == "ally" else "ally": "tone" if side == "ally" else "expert"}
    return {"side": side, "scenario": "standard", "matches": 1, "rivals": [rival | changes]}


SUITES = {
    "rival": suite(opponent=CODE, path="pursuit"),
    "rivals": suite(opponent=["tone", CODE], path="pursuit"),
    "planner": suite(planner=CODE),
    "jamming player": suite("planner") | {"opponent": CODE},
}


@pytest.mark.parametrize("content", SUITES.values(), ids=SUITES)
def test_a_suite_runs_no_code_that_is_not_allowed(content, tmp_path, ran):
    (tmp_path / "suite.yml").write_text(yaml.safe_dump(content))
    for load in (load_suite, PolicyEvaluator, lambda file: evaluate(["expert"], file)):
        with pytest.raises(UserError, match=REFUSED):
            load("suite.yml")
    with pytest.raises(UserError, match="of the package alone"):
        load_suite("suite.yml", shipped=True)
    assert read_suite("suite.yml").rivals
    assert not ran.exists()


def test_code_that_is_allowed_plays_and_the_table_of_its_results_runs_nothing(tmp_path, ran):
    (tmp_path / "suite.yml").write_text(yaml.safe_dump(SUITES["rival"]))
    arguments = ["evaluate", "expert", "--suite", "suite.yml", "--out", "out"]
    result = CliRunner().invoke(app, [*arguments, "--allow", CODE])
    assert result.exit_code == 0, result.output
    assert ran.exists()
    ran.unlink()
    sys.modules.pop("friend.evil")
    for verb in (["table", "out"], ["suites", "suite.yml"]):
        result = CliRunner().invoke(app, verb)
        assert result.exit_code == 0, result.output
    assert read_results("out")[0][0].entry == "expert"
    assert not ran.exists()


HYPERPARAMETERS = {
    "teacher": settings("ppo", imitate={"teacher": CODE}),
    "feature extractor": settings("ppo", policy_kwargs={"features_extractor_class": CODE}),
}


@pytest.mark.parametrize("entry", HYPERPARAMETERS.values(), ids=HYPERPARAMETERS)
def test_hyperparameters_run_no_code_that_is_not_allowed(entry, tmp_path, ran):
    file = tmp_path / "ppo.yml"
    file.write_text(
        yaml.safe_dump(dict.fromkeys((ALLY, "FPG/AllyVsPolicy-v0", "FPG/OpponentVsPolicy-v0"), entry))
    )
    for use in (
        lambda: load_hyperparameters("ppo", ALLY, file),
        lambda: train(RunConfig("ppo", ALLY, hyperparams=file), "run"),
        lambda: best_responses(BestResponseConfig(agent="expert", hyperparams=file), "responses"),
        lambda: tune("ppo", ALLY, "study", hyperparams=file),
    ):
        with pytest.raises(UserError, match=REFUSED):
            use()
    assert not ran.exists()
    assert load_hyperparameters("ppo", ALLY, file, allow=[CODE])


def test_a_search_space_and_a_study_run_no_code_that_is_not_allowed(tmp_path, ran):
    choice = {"policy_kwargs.features_extractor_class": {"kind": "choice", "choices": [CODE]}}
    (tmp_path / "space.yml").write_text(yaml.safe_dump(choice))
    with pytest.raises(UserError, match=REFUSED):
        tune("ppo", ALLY, "study", space="space.yml")
    for number, changes in enumerate(
        ({"algorithm": CODE}, {"game": {"id": "FPG/AllyVsPolicy-v0", "opponent": ["tone", CODE]}})
    ):
        folder = tmp_path / str(number)
        open_study(open_storage(folder), "mine", fake_task(**changes))
        with pytest.raises(UserError, match=REFUSED):
            export_values(folder, tmp_path / "new.yml")
    assert not ran.exists()


def test_a_file_of_champions_runs_no_code(tmp_path, ran):
    (tmp_path / "champions.yml").write_text(yaml.safe_dump({"mine": {"options": {"planner": CODE}}}))
    with pytest.raises(UserError, match=REFUSED):
        load_champions(tmp_path / "champions.yml")
    assert not ran.exists()


GAMES = {
    "opponent": {"id": "FPG/AllyVsPolicy-v0", "opponent": CODE},
    "opponents": {"id": "FPG/AllyVsPolicy-v0", "opponent": ["tone", CODE]},
    "planner": {"id": "FPG/AllyVsPlanner-v0", "planner": CODE},
    "planner of the duel": {"id": "FPG/duel_v0", "planner": CODE},
}


@pytest.mark.parametrize("content", GAMES.values(), ids=GAMES)
def test_a_game_out_of_a_file_runs_no_code_that_is_not_allowed(content, ran):
    shipped = read_json(baselines_folder() / "agents/ally-scripted/ppo/seed_0/agent.json", "agent")
    card = AgentCard.parse({**shipped, "format": 2, "game": content}, "agent")
    for game in (GameSpec.from_dict(content), card.game, pickle.loads(pickle.dumps(card.game))):
        for use in (
            make_sb3,
            lambda game: make_sb3(GameSpec.of(game, path=game.path), allow=["mine:Player"]),
            lambda game: RunConfig("ppo", game),
        ):
            with pytest.raises(UserError, match=f"game: {REFUSED}"):
                use(game)
    assert not ran.exists()
    with contextlib.suppress(UserError):  # as a planner it has no plan
        make_sb3(card.game, allow=[CODE])
    assert ran.exists()


def test_a_name_that_the_caller_gives_takes_the_place_of_a_file_s(ran):
    game = GameSpec.from_dict(GAMES["opponent"])
    make_sb3(game, opponent="tone")
    assert not ran.exists()
    for mine in (GameSpec(game.id, opponent=CODE), GameSpec.of(game, opponent=CODE)):
        make_sb3(mine)
        assert ran.exists()
        ran.unlink()
        sys.modules.pop("friend.evil")


def test_names_of_data_need_no_leave():
    content = {
        "device": "cuda:0",
        "features_extractor_class": "fpg_bench.training.waterfall_cnn:WaterfallCNN",
        "opponent": ["suite:season-4", "suite:mine", "tone"],
        "url": "http://a:1/b",
    }
    check_allowed(content, (), "file")
    for name in ("evil:0", "suite:mine", "evil:", ":Player", "evil"):
        with pytest.raises(UserError, match=r"expected package\.module:object"):
            imported(name, "player")


def test_an_algorithm_of_the_package_is_not_searched_in_the_present_folder(tmp_path, monkeypatch):
    from fpg_bench.training.algorithms import find_algorithm

    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    find_algorithm("ppo")
    assert "" not in sys.path
