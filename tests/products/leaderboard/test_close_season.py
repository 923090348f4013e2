"""Closing a season, from entries to a folder that others can check."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import logging
import re
import shutil
from collections import Counter
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import yaml

from fpg_bench import UserError
from fpg_bench.evaluation.store import Store
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.agent import load_agent
from fpg_bench.players.player import SIDES
from fpg_bench.players.registry import as_player
from fpg_bench.players.trust import remember_exported
from fpg_bench.products.leaderboard.season import closing as closing_module
from fpg_bench.products.leaderboard.season.audit import check_entries, describe_season, late_entries
from fpg_bench.products.leaderboard.season.candidates import (
    PROFILE,
    against_candidate,
    earned,
    play_candidate,
)
from fpg_bench.products.leaderboard.season.checks import Evidence, check_members
from fpg_bench.products.leaderboard.season.closing import close_season, make_closing
from fpg_bench.products.leaderboard.season.entries import SeasonEntry, read_entries, season_seed
from fpg_bench.products.leaderboard.season.recipes import (
    ALGORITHMS,
    STEPS,
    STRANGERS,
    assign_balanced,
    draw_number,
    draw_recipes,
    hyperparameters,
    shuffled,
)
from fpg_bench.products.leaderboard.season.season import FILE, load_season, target_pool
from fpg_bench.products.leaderboard.season.selection import limit_influence, select_representative
from fpg_bench.products.leaderboard.verdicts import Verdict
from tests.logged import logged
from tests.policies import dividing_by_zero, model, node, through, weights, write_seed
from tests.products.leaderboard.making import write_submission
from tests.programs import held_elsewhere

ALLIES = [
    SeasonEntry(f"ally/{name}", "ally", None, tuple(f"{name}/seed_{k}" for k in range(5))) for name in "abcd"
]
ALLIES += [SeasonEntry(f"ally/{name}", "ally", None, (name,)) for name in ("expert", "idle")]
OPPONENTS = [
    SeasonEntry("opponent/pursuer", "opponent", "pursuit", ("p/seed_0", "p/seed_1")),
    SeasonEntry("opponent/flyer", "opponent", "learned", ("f/seed_0", "f/seed_1")),
    SeasonEntry("opponent/tone", "opponent", "pursuit", ("tone",)),
]

# Three entries against five candidates: 0 is weak, 1 to 3 hurt one entry each, 4 is the strongest.
RETURNS = np.array([[20.0, 0, 9, 9, 1], [20.0, 9, 0, 9, 1], [20.0, 9, 9, 0, 1]])


def test_draws_are_the_same_everywhere_and_values_are_balanced():
    assert shuffled("abcdef", "seed") == list("edbfca")
    assert [draw_number(100, "seed", i) for i in range(5)] == [79, 20, 87, 63, 35]
    assert Counter(assign_balanced("abc", 8, "seed")) == {"a": 3, "b": 3, "c": 2}
    assert assign_balanced("abc", 8, "seed") != assign_balanced("abc", 8, "other")


@pytest.mark.parametrize(("side", "entries"), [("opponent", ALLIES), ("ally", OPPONENTS)])
def test_seeds_change_only_how_properties_are_combined(side, entries):
    a, b = (draw_recipes(seed, side, 24, entries) for seed in ("a", "b"))
    for kind in ("algorithm", "gamma"):
        counts = Counter(getattr(recipe, kind) for recipe in a)
        assert counts == Counter(getattr(recipe, kind) for recipe in b)
        assert kind == "algorithm" or counts == {None: 12, 0.9: 6, 0.95: 3, 0.8: 3}  # None: searched
    assert {recipe.reward for recipe in a} == {"own"}
    assert all(recipe.steps in STEPS[recipe.algorithm] for recipe in a)
    assert [(r.gamma, r.targets) for r in a] != [(r.gamma, r.targets) for r in b]
    assert not {r.training_seed for r in a} & {r.training_seed for r in b}
    assert draw_recipes("a", side, 24, entries) == a


def test_every_player_is_the_first_target_equally_often_and_paths_are_never_mixed():
    recipes = draw_recipes("a", "opponent", 24, ALLIES)
    firsts = Counter(recipe.targets[0].partition("/")[0] for recipe in recipes)
    assert firsts == dict.fromkeys((*"abcd", "expert", "idle"), 4)
    assert {len(recipe.targets) for recipe in recipes} == {3, 6}
    assert all(len({t.partition("/")[0] for t in r.targets}) == len(r.targets) for r in recipes)

    for recipe in draw_recipes("a", "ally", 24, OPPONENTS):
        paths = {"p": "pursuit", "f": "learned"}
        assert {paths[t[0]] for t in recipe.targets if "/" in t} <= {recipe.path}


@pytest.mark.parametrize(("scenario", "others"), [("standard", "training-1"), ("link", "training-link-1")])
def test_members_of_earlier_suites_that_are_paid_by_the_rules_are_targets(scenario, others):
    pool = target_pool([], "ally", scenario, "season-4")
    members = load_season(others).members["ally"]
    names = {entry.name for entry in pool}
    assert names >= {f"suite:{others}/{member.name}" for member in members if member.reward == "own"} != set()
    assert not names & {f"suite:{others}/{member.name}" for member in members if member.reward != "own"}
    assert not any(others in entry.name for entry in target_pool([], "ally", scenario, others))
    as_player(pool[0].players[0], "ally", STANDARD)  # which loads it


def test_scripts_are_targets_where_nobody_was_trained():
    recipes = draw_recipes("a", "opponent", 4, ALLIES[-2:])
    assert {recipe.targets[0] for recipe in recipes} == {"expert", "idle"}
    with pytest.raises(UserError, match="no entries to train candidates of the ally against"):
        draw_recipes("a", "ally", 4, [])


@pytest.mark.parametrize("algorithm", [*ALGORITHMS[::2], *STRANGERS])
def test_hyperparameters_follow_the_recipe(algorithm):
    recipe = draw_recipes("a", "opponent", 24, ALLIES, [algorithm])[0]
    values = hyperparameters(recipe)
    assert (values["gamma"], values["n_timesteps"]) == (recipe.gamma, recipe.steps)


def test_the_strongest_candidate_is_selected_first_and_invalid_returns_are_refused():
    assert select_representative(RETURNS, 1) == [4]
    assert sorted(select_representative(RETURNS, 5)) == list(range(5))
    with pytest.raises(UserError, match="cannot select 6 members from 5 candidates"):
        select_representative(RETURNS, 6)
    invalid = RETURNS.copy()
    invalid[1, 2] = np.nan
    with pytest.raises(UserError, match="season: an entry has a return that is not finite"):
        select_representative(invalid, 2)


def test_a_representative_selection_has_the_mean_of_all_candidates():
    rng = np.random.default_rng(0)
    returns = rng.normal(0, 8, (10, 24))

    def distance(selected):
        return np.linalg.norm(returns[:, selected].mean(axis=1) - returns.mean(axis=1))

    representative = distance(select_representative(returns, 12))
    random = [distance(rng.choice(24, 12, replace=False)) for _ in range(50)]
    assert representative < 0.5 * np.median(random)


def test_an_entry_that_loses_against_candidates_of_its_choice_does_not_steer_the_selection():
    rng = np.random.default_rng(0)
    honest = rng.normal(8, 4, (20, 1)) + rng.normal(0, 2, (1, 24)) + rng.normal(0, 1, (20, 24))
    hostile = np.where(np.arange(24) % 2, -35.8, rng.normal(8, 1, 24))
    returns = limit_influence(np.vstack([honest, hostile]))
    assert np.ptp(returns[-1]) < np.ptp(honest) < np.ptp(hostile)


SKILL = np.arange(12.0)[:, None]


def evidence(rng, **changes):
    """Returns where all holds: twelve entries of clear skill, eight members and six strangers."""
    whole = {
        "side": "opponent",
        "tables": {"allies": range(12), "few": range(3)},
        "scripts": {0, 1},
        "members": SKILL + rng.normal(0, 1, (12, 8)),
        "kinds": ["ppo", "ppo", "ppo", "ppo", "rule", "rule", "table", "table"],
        "strangers": SKILL + rng.normal(0, 1, (12, 6)),
        "oracle": np.full(8, 20.0),
        "earned": {f"o{i}": 10.0 + i for i in range(8)},
        "floor": ("tone", 9.0),
    }
    return Evidence(**whole | changes)


def within_chance(rng):
    """An oracle that is ahead on average and on three quarters of the members, but not significantly."""
    return {"members": SKILL + np.zeros(8), "oracle": 11.0 + np.array(6 * [2] + 2 * [-5])}


def of_another_kind(rng):
    """Two members of a kind that order the entries the other way round, which the mean hardly shows."""
    members = 4 * SKILL + rng.normal(0, 0.1, (12, 8))
    members[:, 6:] = -SKILL / 10
    return {"members": members, "oracle": np.full(8, 60.0)}


@pytest.mark.parametrize(
    ("failing", "change"),
    [
        (None, lambda rng: {}),
        ("an oracle ranks first", lambda rng: {"oracle": np.full(8, 9.0)}),
        ("an oracle ranks first", lambda rng: {"oracle": np.array([9.0, 9, 9] + 5 * [40.0])}),  # 5 of 8
        ("an oracle ranks first", within_chance),
        ("no script leads allies", lambda rng: {"scripts": {11}}),
        ("kinds agree on the best of allies", of_another_kind),
        ("members are above the floor", lambda rng: {"floor": ("tone", 10.5)}),
        ("strangers agree on allies", lambda rng: {"strangers": rng.normal(0, 1, (12, 6))}),
        ("strangers agree on allies", lambda rng: {"strangers": np.zeros((12, 6))}),  # it says nothing
        ("halves agree on the best of allies", lambda rng: {"members": rng.normal(0, 12, (12, 8)) + SKILL}),
    ],
)
def test_the_check_that_fails_is_named(failing, change):
    rng = np.random.default_rng(0)
    verdicts = list(check_members(evidence(rng, **change(rng))))
    assert len(verdicts) == 6  # a table of three entries has no order to compare
    failed = {verdict.name for verdict in verdicts if not verdict.is_good}
    assert (f"opponent: {failing}" in failed) if failing else not failed


ROOT = Path(__file__).parents[3]
PACKAGE = "fpg_bench.products.leaderboard.season"
ENTRIES = (
    "ally/ally-scripted-td3",
    "ally/expert",
    "opponent/opponent-pursuit-td3",
    "opponent/tone",
    "planner/circle",
)
TINY_STEPS = {algorithm: tuple(max(1, n // 2000) for n in steps) for algorithm, steps in STEPS.items()}


def run_here(jobs, workers=1):
    """Run jobs one after the other, as workers do."""
    for job in jobs:
        if not job.done():
            logging.getLogger("fpg_bench").info(f"{job.name}: begins")
            job.keep(job.run())
    return {}


@contextlib.contextmanager
def few_steps(checks=()):
    """Two rounds against each candidate, short trainings that beat no script, and few others."""
    scripts = {"ally": ("idle",), "opponent": ("tone",)}
    with contextlib.ExitStack() as patches:
        for name, value in (
            ("candidates.ROUNDS", 2),
            ("recipes.STEPS", TINY_STEPS),
            ("closing.N_STRANGERS", 1),
            ("closing.N_VARIANTS", 1),
            ("closing.SCRIPTS", scripts),
            ("closing.SCRIPTED", scripts),
            ("closing._floor", lambda side, profiles: ("nobody", -1e9)),
            ("closing.check_members", lambda evidence: checks if evidence.side == "ally" else ()),
        ):
            patches.enter_context(patch(f"{PACKAGE}.{name}", value))
        yield


def close_tiny(board, work, out, number=1, scenario="standard", checks=(), **options):
    """Close a season of two candidates per side; returns it and the messages."""
    with few_steps(checks), patch(f"{PACKAGE}.closing.run_jobs", run_here), logged() as messages:
        closing = make_closing(number, board, work, candidates=2, size=2, scenario=scenario)
        season = close_season(closing, out, **options)
    return season, messages


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """A leaderboard of a few shipped entries, and one that answers NaN or dies."""
    folder = tmp_path_factory.mktemp("board")
    for name in ENTRIES:
        shutil.copytree(ROOT / "leaderboard/submissions" / name, folder / "submissions" / name)
    broken = write_submission(folder / "submissions/ally/broken", seeds=(0, 1), name="Broken")
    write_seed(broken / "seed_0", 0, through("Abs", "Neg", "Log"))  # NaN or infinity
    write_seed(broken / "seed_1", 1, dividing_by_zero())
    return folder


@pytest.fixture(scope="module")
def closed(board, tmp_path_factory):
    """A closed season and the folder of its candidates."""
    folder = tmp_path_factory.mktemp("closed")
    season, _ = close_tiny(board, folder / "work", folder / "season-1")
    return season, folder / "work"


@pytest.fixture
def season(closed):
    return closed[0]


@pytest.fixture
def copied(closed, tmp_path):
    """A copy of both folders, to be damaged."""
    season, work = closed
    shutil.copytree(season.folder, tmp_path / "season-1")
    shutil.copytree(work, tmp_path / "work")
    return tmp_path


def policies(season):
    return [(side, member.name, member.policy_sha256) for side, member in season.all_members()]


@pytest.mark.full
@pytest.mark.slow
def test_a_season_has_members_of_both_sides_with_their_recipes(season):
    loaded = load_season(season.folder)
    assert (loaded, loaded.hash) == (season, season.hash)
    suite = yaml.safe_load((season.folder.parent / "ally-season-1.yml").read_text())
    assert [rival["name"] for rival in suite["rivals"]] == [m.name for m in loaded.members["opponent"]]
    for side, member in loaded.all_members():
        agent = load_agent(loaded.agent(side, member), side)
        assert agent.card.training_seed == member.training_seed
        assert agent.card.game.reward == member.reward


@pytest.mark.full
@pytest.mark.slow
def test_a_killed_candidate_is_trained_again_with_the_same_result(season, board, copied):
    (copied / "season-1" / FILE).unlink()  # killed while it was published
    run = copied / "work/opponent/o00"
    about = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps(about | {"finished": False}))
    shutil.rmtree(run / "agent")
    rows = copied / "work/ally/a01" / PROFILE
    rows.write_text(rows.read_text()[:-20])  # killed while it was played
    again, messages = close_tiny(board, copied / "work", copied / "season-1")
    assert policies(again) == policies(season)
    assert (again.folder / FILE).read_text() == (season.folder / FILE).read_text()
    assert messages[0] == f"season-1, seed {season.seed[:16]}: 10 rivals, 8 of them done"
    begun = [line for line in messages if line.endswith(": begins")]
    assert begun == ["ally/a01: begins", "opponent/o00: begins"]


@pytest.mark.full
@pytest.mark.slow
def test_an_entry_that_answers_nan_or_dies_holds_up_no_closing(closed):
    season, work = closed
    assert season.entries["ally/broken"]
    profile = Store(work / "opponent/o00" / PROFILE).records()
    lost = [earned(record, "ally")["ally"] for record in profile if record.entry == "ally/broken"]
    assert lost == [pytest.approx(load_suite("ally-v2").scale.lost, rel=0.01)] * 2


@pytest.mark.full
@pytest.mark.slow
def test_each_scenario_is_closed_by_itself(season, tmp_path):
    board = tmp_path / "board"
    for name in (*ENTRIES, "ally/sulk-link", "ally/ally-link-dqn", "opponent/herd-link"):
        shutil.copytree(ROOT / "leaderboard/submissions" / name, board / "submissions" / name)
    link, _ = close_tiny(board, tmp_path / "work", tmp_path / "season-1-link", scenario="link")
    assert (link.name, link.number, link.scenario) == ("season-1-link", 1, "link")
    assert sorted(link.entries) == ["ally/ally-link-dqn", "ally/sulk-link", "opponent/herd-link"]
    assert link.seed == season_seed("1", "1-link", read_entries(board, scenario="link")) != season.seed
    for side, member in link.all_members():
        assert load_agent(link.agent(side, member)).card.game.scenario == "link"
    made = {file.stem: yaml.safe_load(file.read_text()) for file in tmp_path.glob("*.yml")}
    assert sorted(made) == ["ally-link-season-1", "opponent-link-season-1"]
    assert {suite["scenario"] for suite in made.values()} == {"link"}
    check_entries(link, read_entries(board, scenario="link"))
    assert late_entries(link, read_entries(board)) == []  # those of the other scenario were not asked
    with pytest.raises(UserError, match="scenario: expected standard or link, got 'paper'"):
        make_closing(1, board, tmp_path, scenario="paper")


@pytest.mark.full
@pytest.mark.slow
def test_a_season_that_fails_a_check_stays_open_and_keeps_what_was_trained(season, board, copied):
    shutil.rmtree(copied / "season-1")
    good, bad = Verdict("ally: halves agree", True, ""), Verdict("ally: an oracle ranks first", False, "")
    with pytest.raises(UserError, match=r"does not close, .*/work: ally: an oracle ranks first; --acc"):
        close_tiny(board, copied / "work", copied / "season-1", checks=[good, bad])
    assert not (copied / "season-1").exists()
    again, messages = close_tiny(board, copied / "work", copied / "season-1")
    assert "10 rivals, 10 of them done" in messages[0]
    assert policies(again) == policies(season)
    shutil.rmtree(copied / "season-1")
    close_tiny(board, copied / "work", copied / "season-1", checks=[good, bad], accept_failures=True)
    assert [check.holds for check in load_season(copied / "season-1").checks] == [True, False]
    lines = list(describe_season(copied / "season-1", board))
    assert "FAILS: ally: an oracle ranks first: " in lines


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize(
    ("competent", "missing"),
    [((), "0 of 2 candidates"), (("a00",), "1 of 2 candidates"), (("a00", "a01"), "0 of 2 strangers")],
)
def test_rivals_that_a_script_beats_neither_rank_nor_check(competent, missing, board, copied, monkeypatch):
    shutil.rmtree(copied / "season-1")
    find_floor = closing_module._floor
    read = closing_module._read_profile

    def beaten(closing, side, rival):
        name = rival if isinstance(rival, str) else rival.name
        own = 2.0 if side == "opponent" or name in competent else float(name == "idle")
        return dataclasses.replace(read(closing, side, rival), own=own)

    def floor(side, profiles):
        return find_floor(side, profiles) if side == "ally" else ("tone", 0.0)

    monkeypatch.setattr(f"{PACKAGE}.closing._read_profile", beaten)
    monkeypatch.setattr(f"{PACKAGE}.closing.run_jobs", run_here)
    with few_steps(), patch(f"{PACKAGE}.closing._floor", floor):
        closing = make_closing(1, board, copied / "work", candidates=2, size=2)
        with pytest.raises(UserError, match=rf"{missing} of the ally earn more than idle \(1.00\), [12] are"):
            close_season(closing, copied / "season-1")
    assert not (copied / "season-1").exists()


@pytest.mark.full
@pytest.mark.slow
def test_a_season_has_all_competent_candidates_where_they_are_few(board, copied, monkeypatch):
    """At least ``FEWEST``; here one of two is asked, and one is competent."""
    shutil.rmtree(copied / "season-1")
    read = closing_module._read_profile

    def beaten(closing, side, rival):
        own = 0.0 if getattr(rival, "name", "") == "a00" else 2.0
        return dataclasses.replace(read(closing, side, rival), own=own)

    monkeypatch.setattr(f"{PACKAGE}.closing._read_profile", beaten)
    monkeypatch.setattr(f"{PACKAGE}.closing.run_jobs", run_here)
    monkeypatch.setattr(f"{PACKAGE}.closing.FEWEST", 1)
    with few_steps(), patch(f"{PACKAGE}.closing._floor", lambda side, profiles: ("idle", 1.0)):
        season = close_season(
            make_closing(1, board, copied / "work", candidates=2, size=2), copied / "season-1"
        )
    assert {side: len(season.members[side]) for side in SIDES} == {"ally": 1, "opponent": 2}


@pytest.mark.full
@pytest.mark.slow
def test_a_policy_that_was_found_twice_is_selected_once(board, copied):
    shutil.rmtree(copied / "season-1")
    shutil.rmtree(copied / "work/ally/a01/agent")
    shutil.copytree(copied / "work/ally/a00/agent", copied / "work/ally/a01/agent")
    season, _ = close_tiny(board, copied / "work", copied / "season-1")
    assert [member.name for member in season.members["ally"]] == ["a00"]


@pytest.mark.full
@pytest.mark.slow
def test_one_side_can_be_trained_first(board, copied):
    shutil.rmtree(copied / "season-1")
    shutil.rmtree(copied / "work/ally")
    season, messages = close_tiny(board, copied / "work", copied / "season-1", sides=["opponent"])
    assert season is None
    assert messages[-1] == "season-1: not closed yet: candidates of the ally are missing"


@pytest.mark.full
@pytest.mark.slow
def test_a_season_is_closed_once_and_in_a_folder_of_its_own(closed, board, tmp_path):
    season, work = closed
    with pytest.raises(UserError, match="is closed already; choose another number"):
        close_tiny(board, work, season.folder)
    with pytest.raises(UserError, match=r"holds candidates of another closing .seed"):
        close_tiny(board, work, tmp_path / "season-2", number=2)


@pytest.mark.process
def test_two_closings_at_once_in_one_folder_are_refused(board, tmp_path):
    message = "season: .*, opponent: another process is writing there; wait until it ends"
    with held_elsewhere(tmp_path / "at-work-opponent"), pytest.raises(UserError, match=message):
        close_tiny(board, tmp_path, tmp_path / "season")
    assert not (tmp_path / "season").exists()


@pytest.mark.process
@pytest.mark.full
@pytest.mark.slow
def test_two_processes_with_a_side_each_publish_a_season_once(season, board, copied, monkeypatch):
    out, work = copied / "season-1", copied / "work"
    shutil.rmtree(out)
    message = "season: .*/work: another process is writing there; wait until it ends"
    with held_elsewhere(work / "at-work-publish"), pytest.raises(UserError, match=message):
        close_tiny(board, work, out, sides=["ally"])
    assert not out.exists()

    def finish_other_side(jobs, *_):
        monkeypatch.setattr(f"{PACKAGE}.closing.run_jobs", run_here)
        close_season(closing, out, sides=["opponent"])
        (out / "ally" / "kept").touch()
        return {}

    monkeypatch.setattr(f"{PACKAGE}.closing.run_jobs", finish_other_side)
    closing = make_closing(1, board, work, candidates=2, size=2)
    with few_steps():
        assert close_season(closing, out, sides=["ally"]) == season.model_copy(update={"folder": out})
    assert (out / "ally" / "kept").exists()


def test_the_seed_depends_on_all_entries_in_any_order(board):
    entries = read_entries(board)
    seed = season_seed("1", 1, entries)
    assert season_seed("1", 1, entries[::-1]) == seed
    others = [season_seed("1", 2, entries), season_seed("2", 1, entries)]
    others += [season_seed("1", 1, entries[:i] + entries[i + 1 :]) for i in range(len(entries))]
    assert len({seed, *others}) == len(others) + 1


def test_missing_and_invalid_entries_are_refused(board, tmp_path):
    shutil.copytree(board, tmp_path / "board")
    (tmp_path / "board/submissions/opponent/tone/submission.yaml").write_text("name: x\n")
    with pytest.raises(UserError, match=r"entry opponent/tone: submission.yaml: lacks"):
        read_entries(tmp_path / "board")


@pytest.mark.full
@pytest.mark.slow
def test_missing_and_late_entries_are_named(season, board):
    entries = read_entries(board)
    check_entries(season, entries)
    assert late_entries(season, entries) == []
    with pytest.raises(
        UserError,
        match="the entry ally/expert, which it was closed over, is missing; look at it at the commit",
    ):
        check_entries(season, [entry for entry in entries if entry.name != "ally/expert"])
    changed = [dataclasses.replace(entry, hashes=("0" * 64,)) for entry in entries]
    with pytest.raises(UserError, match="which it was closed over, has changed; look at it at the commit"):
        check_entries(season, changed)
    others = {name: hashes for name, hashes in season.entries.items() if name != "ally/expert"}
    other = season.model_copy(update={"entries": others})
    assert late_entries(other, entries) == ["ally/expert"]
    with pytest.raises(UserError, match="its seed does not follow from its entries"):
        check_entries(other, entries)


@pytest.mark.full
@pytest.mark.slow
def test_what_is_wrong_in_a_season_s_folder_is_one_line(copied):
    def problem():
        with pytest.raises(UserError) as error:
            load_season(copied / "season-1")
        return str(error.value)

    policy, file = copied / "season-1/opponent/o00/policy.onnx", copied / "season-1" / FILE
    policy.write_bytes(policy.read_bytes()[:-1])
    assert re.search(r"member o00: .*policy.onnx is not the file of season.yml", problem())
    policy.unlink()
    assert re.search(r"member o00: .*policy.onnx is missing", problem())
    for change, message in (
        (lambda c: c["members"]["ally"][0].update(more=1), "members.ally[0]: unknown key 'more'"),
        (lambda c: c["members"].pop("ally"), "members: expected members of ally and opponent, got opponent"),
        (lambda c: c.pop("seed"), "season.yml: lacks seed"),
    ):
        content = yaml.safe_load(file.read_text())
        change(content)
        file.write_text(yaml.safe_dump(content))
        assert message in problem()


@pytest.mark.full
@pytest.mark.slow
def test_a_member_that_answers_nan_is_named(season, tmp_path):
    shutil.copytree(season.agent("opponent", season.members["opponent"][0]), tmp_path / "agent")
    policy = model([node("MatMul", ["observation", "w"], ["action"])], [weights(scale=float("nan"))])
    (tmp_path / "agent/policy.onnx").write_bytes(policy)
    about = json.loads((tmp_path / "agent/agent.json").read_text())
    about["policy_sha256"] = hashlib.sha256(policy).hexdigest()
    (tmp_path / "agent/agent.json").write_text(json.dumps(about))
    remember_exported(about["policy_sha256"])  # by the closing itself; others would play in a sandbox
    with pytest.raises(UserError, match=r"expert against .*agent: opponent action of game 0: index 0 is nan"):
        play_candidate(*against_candidate("expert", "ally", str(tmp_path / "agent"), "pursuit", "seed"))
