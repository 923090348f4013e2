"""The zoo as it is shipped: every agent is loaded and played, and compared with the committed figures.

A zoo of tiny agents is trained here by the script itself, so that all of it is tried even where
nothing is shipped.
"""

import dataclasses
import re
import shutil
from pathlib import Path

import pytest
import zoo_page

from fpg_bench.common.output import csv_text
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.players.agent import load_agent
from fpg_bench.products.league.champions import load_champions
from fpg_bench.products.zoo.verbs import zoo as list_zoo
from fpg_bench.products.zoo.zoo import load_zoo
from tests.programs import python
from tests.training.making import add_missing_records, make_agent, make_zoo, page, write_scores

ROOT = Path(__file__).parents[3]
SHIPPED = load_zoo()
LARGEST_MB = 40
TINY = """\
seeds: [0]
groups:
  small:
    id: FPG/AllyVsScripted-v0
    options: {path: circle}
    suites: [SUITE]
    steps: {td3: 16}
  duel-ally:
    id: FPG/duel_v0
    suites: [SUITE]
    steps: {maddpg: 48}
  duel-opponent:
    id: FPG/duel_v0
    suites: [OTHER]
    steps: {maddpg: 48}
"""
OTHER = """\
side: opponent
scenario: standard
matches: 2
rivals:
  - {ally: idle, path: pursuit}
  - {ally: expert, path: pursuit}
"""


def script(*words, folder):
    return python(ROOT / "scripts" / "train_zoo.py", *words, folder=folder)


def shipped_agents():
    return [member.name for member in SHIPPED.members() if member.shipped]


def first_returns(member, suite, rival, matches=2):
    """The returns of an agent's first matches."""
    few = dataclasses.replace(suite, matches=matches)
    return play(member.entry(), few, rival).returns


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize("group", SHIPPED.groups, ids=lambda group: group.name)
def test_every_shipped_agent_plays_as_its_records_say(group):
    suites = [load_suite(name) for name in group.suites]
    assert {suite.side for suite in suites} == {group.side}
    records = {
        (suite.name, record.entry, record.training_seed, record.rival): record
        for suite in suites
        for record in SHIPPED.read_records(group, suite)
    }
    for member in SHIPPED.members(group.name):
        if not member.shipped:
            continue
        card = load_agent(member.name).card
        assert (card.game.id, card.training_seed) == (group.id, member.seed), member.name
        assert card.training_steps == member.steps, member.name
        for suite in suites if not member.seed else ():  # the first seed of each algorithm is played
            rival = suite.rivals[-1]
            returns = first_returns(member, suite, rival, 1)
            known = records[suite.name, member.algorithm, member.seed, rival.name].returns[: len(returns)]
            assert returns == pytest.approx(known, abs=2e-3), (member.name, suite.name)


def test_every_folder_of_an_agent_is_a_member_and_all_together_are_small():
    folder = SHIPPED.folder / "agents"
    folders = {str(path.parent.relative_to(folder)) for path in folder.glob("*/*/*/agent.json")}
    champions = load_champions(SHIPPED.folder / "champions.yml")
    others = folders - set(shipped_agents())
    assert {name.partition("/")[0] for name in others} == set(champions)
    assert {name for name in others if not isinstance(champions[name.partition("/")[0]], str)} == {
        f"{champion.name}/{champion.config.algorithm}/seed_{seed}"
        for champion in champions.values()
        if not isinstance(champion, str)
        for seed in range(champion.seeds)
    }
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    assert size < LARGEST_MB * 1e6


@pytest.mark.full
@pytest.mark.slow
def test_the_page_is_what_the_records_give():
    text = page(SHIPPED)
    assert (SHIPPED.folder / "README.md").read_text() == text
    for group in SHIPPED.groups:
        summaries = [
            summarise(SHIPPED.read_records(group, suite), suite) for suite in map(load_suite, group.suites)
        ]
        rows = zoo_page.table(SHIPPED, group, summaries[0], summaries[1:])
        assert (SHIPPED.scores(group) / zoo_page.TABLE).read_text() == csv_text(rows)
    for link in re.findall(r"\]\(([^)]+)\)", text):
        assert (SHIPPED.folder / link.partition("#")[0]).is_file(), link


def test_the_list_tells_scores_and_what_has_changed(tmp_path, monkeypatch, capsys):
    zoo = make_zoo(tmp_path)
    monkeypatch.setattr("fpg_bench.players.agent.baselines_folder", lambda: tmp_path)
    list_zoo()
    assert capsys.readouterr().out.startswith("no agents are shipped")
    scored, changed, _, unscored, *_ = zoo.members()
    make_agent(scored)
    add_missing_records(zoo, scored.group)
    make_agent(changed)
    make_agent(unscored)
    shutil.copytree(SHIPPED.folder / "agents/opponent-champion", tmp_path / "agents/opponent-champion")
    write_scores(zoo)
    (changed.folder / "policy.onnx").write_bytes(b"torn")
    list_zoo()
    head, suite, ppo, td3, bad, last, *champions = capsys.readouterr().out.splitlines()
    assert head.split() == ["agent", "seeds", "steps", "score", "95", "%", "interval"]
    assert suite == "on small-v1"
    assert ppo.split()[:3] == ["small/ppo", "2", "2,000"]
    assert td3.split() == ["small/td3", "1", "1,000", "-", "-"]
    assert bad == "CHANGED: small/ppo/seed_1: not the policy that was scored"
    assert last.startswith("3 agents, ")
    assert last.endswith("1 policies are changed")
    assert "opponent-champion/ppo/seed_{0,1,2}" in "".join(champions)
    list_zoo(every=True)
    _, _, one, two, three, *_ = capsys.readouterr().out.splitlines()
    assert one.split()[:2] == ["small/ppo/seed_0", "2,000"]
    assert float(one.split()[2]) < 100
    assert two.split()[2] == "-"
    assert three.split() == ["small/td3/seed_0", "1,000", "-"]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiny")
    make_zoo(folder)
    (folder / "other-v1.yml").write_text(OTHER)
    zoo = TINY.replace("SUITE", str(folder / "small-v1.yml")).replace("OTHER", str(folder / "other-v1.yml"))
    (folder / "zoo.yml").write_text(zoo)
    done = script("--zoo", folder, "--runs", folder / "runs", "--n-jobs", 1, folder=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.process
def test_the_script_trains_ships_scores_and_writes_the_page(tiny):
    zoo = load_zoo(tiny)
    assert [(agent.name, agent.steps) for agent in zoo.members() if agent.shipped] == [
        ("small/td3/seed_0", 16),
        ("duel-ally/maddpg/seed_0", 48),
        ("duel-opponent/maddpg/seed_0", 48),
    ]
    assert (tiny / "README.md").read_text() == page(zoo)
    assert (tiny / "scores/small/curves.svg").is_file()
    assert (tiny / "scores/small" / zoo_page.TABLE).read_text().startswith("player,seeds,steps,")
    for member in zoo.members():
        suite = load_suite(member.group.suites[0])
        assert load_agent(member.folder).card.side == member.group.side == suite.side
        records = [x for x in zoo.read_records(member.group, suite) if x.training_seed == member.seed]
        played = [first_returns(member, suite, rival) for rival in suite.rivals]
        assert played == [record.returns[:2] for record in records]
