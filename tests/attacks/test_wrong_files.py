"""Files of every kind in which one thing is wrong: refused in a line that names it, or read and played.

What is said of each place is that of ``golden/wrong_files.json``, which
``python -m tests.attacks.test_wrong_files`` writes again.
"""

from __future__ import annotations

import copy
import gzip
import json
import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.schema import parse
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.record import read_record
from fpg_bench.evaluation.suite import load_suite, read_suite
from fpg_bench.game.knowledge import EXPERT_FILE
from fpg_bench.game.scenario import STANDARD, Scenario, as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import baselines_folder
from fpg_bench.players.card import AgentCard
from fpg_bench.products.language_models.servers import SERVER_FOLDER, load_server
from fpg_bench.products.language_models.transcript import Attempt
from fpg_bench.products.leaderboard.about import read_about
from fpg_bench.products.leaderboard.crossplay import Pair
from fpg_bench.products.league.champions import load_champions
from fpg_bench.products.offline.spec import load_spec
from fpg_bench.products.tuning.space import load_space
from fpg_bench.products.tuning.study import Task, make_task
from tests.attacks.mutations import misspelt, mutations
from tests.products.leaderboard.making import FIELDS

BASELINES = baselines_folder()
GOLDEN = Path(__file__).parents[1] / "golden" / "wrong_files.json"
BOARD = BASELINES.parent / "leaderboard"
# What is refused in other words than by its key: no finite number, half a letter, another format
ELSEWHERE = (
    "a number is too large",  # its line is named
    "not finite",
    "invalid Unicode character escape code",
    "lacks game",
    "lacks id",
    "made for the id None",
    "last_rounds: at most",
)


def _written(content: Any, name: str = "file.yml") -> str:
    Path(name).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return name


def _play(scenario: Scenario) -> None:
    """Play a few steps; what is observed and earned is finite."""
    if "waypoints" in scenario.paths:
        return
    duel = make_duel(2, scenario=scenario)
    duel.reset(seeds=0)
    for _ in range(10):
        duel.batch.step(np.full((2, 9), 0.3, np.float32), np.full((2, 9), 0.2, np.float32))
    for values in (
        duel.batch.ally_observations,
        *(duel.batch.games[f"{s}_reward"] for s in ("ally", "opponent")),
    ):
        assert np.isfinite(values).all()


def _knowledge(content: Any) -> None:
    _play(as_scenario("standard", knowledge=_written(content)))


def _scenario(content: Any) -> None:
    _play(Scenario.from_dict(content))


def _card(content: Any) -> None:
    card = AgentCard.parse(content, "agent")
    assert AgentCard.parse(card.to_dict(), "agent").to_dict() == card.to_dict()
    str(card), card.flies, card.fits(STANDARD)
    card.game.resolve()


def _submission(content: Any) -> None:
    if lines := read_about(content)[1]:
        raise UserError("; ".join(lines))


def _game(content: Any) -> None:
    assert len(GameSpec.from_dict(content, "game").hash) == 64


def _suite(content: Any) -> None:
    assert load_suite(_written(content)) == read_suite("file.yml")


def _dataset(content: Any) -> None:
    load_spec(_written(content, "ally-mine-v0.yml")).recipe()


def _pair(content: Any) -> None:
    pair = parse(Pair, content, "pair")
    assert np.isfinite([*pair.ally_rewards, *pair.opponent_rewards]).all()


def _yaml(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def _fields(name: str) -> Any:
    as_scenario(name).to_yaml("scenario.yml")
    return _yaml(Path("scenario.yml"))


def _shipped_suite(name: str) -> Any:
    content = _yaml(BASELINES / "suites" / f"{name}.yml")
    return content | {"rivals": content["rivals"][:2]}


def _row(pattern: str) -> Any:
    row = json.loads(next(BOARD.glob(pattern)).read_text().splitlines()[1])
    return row | {"returns": row["returns"][:5]}


def _first_pair() -> Any:
    row = json.loads((BOARD / "results/crossplay.jsonl").open().readline())
    return {name: value for name, value in row.items() if name != "sha256"}


def _attempt() -> Any:
    file = BOARD / "submissions/planner/smollm2-135m/transcripts/expert.jsonl.gz"
    with gzip.open(file) as lines:
        return json.loads([next(lines) for _ in range(2)][1])


def _agent() -> Any:
    return json.loads((BASELINES / "agents/ally-scripted/ppo/seed_0/agent.json").read_text())


FILES: dict[str, tuple[Callable[[], Any], Callable[[Any], object]]] = {
    "knowledge": (lambda: _yaml(EXPERT_FILE), _knowledge),
    "scenario": (lambda: _fields("standard"), _scenario),
    "scenario of link": (lambda: _fields("link"), _scenario),
    "agent": (lambda: _agent() | {"policies": {"a": "ab"}, "offline": {"dataset": "fpg/a-v0"}}, _card),
    "submission": (lambda: FIELDS | {"zoo": None, "script": None, "scenario": "standard"}, _submission),
    "game": (lambda: {"id": "FPG/AllyVsScripted-v0", "opponent": ["tone"], "history": 8,
                      "observation": "waterfall", "scenario": {"hop_cost": 60.0}}, _game),
    "suite": (lambda: _shipped_suite("opponent-shifted-v2"), _suite),
    "suite of planners": (lambda: _shipped_suite("planner-v1"), _suite),
    "data set": (lambda: _without_name(_yaml(BASELINES / "datasets/ally-mixed-v0.yml")), _dataset),
    "server": (lambda: _yaml(SERVER_FOLDER / "openai.yml"), lambda c: load_server(_written(c))),
    "search space": (
        lambda: _yaml(BASELINES / "search/ppo.yml"), lambda c: load_space("ppo", Path(_written(c))),
    ),
    "champions": (
        lambda: dict([*_yaml(BASELINES / "champions.yml").items()][:1]),
        lambda c: load_champions(Path(_written(c))),
    ),
    "record": (lambda: _row("results/ally/*.jsonl"), lambda c: read_record(c, "record")),
    "record of a planner": (lambda: _row("results/planner/*.jsonl"), lambda c: read_record(c, "record")),
    "pair": (_first_pair, _pair),
    "attempt": (_attempt, lambda c: Attempt.read(c, "attempt")),
    "study": (
        lambda: make_task("ppo", "FPG/AllyVsScripted-v0", n_seeds=1, steps=1000).model_dump(mode="json"),
        lambda c: parse(Task, c, "study"),
    ),
}  # fmt: skip


def _without_name(content: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in content.items() if key != "name"}


def answers(kind: str) -> dict[str, dict[str, str]]:
    """All that is said of each place in a file of a kind, with what was wrong there; "" of what is read."""
    make, read = FILES[kind]
    content, found = make(), {}
    read(copy.deepcopy(content))
    for what, place, wrong in mutations(content):
        where, said = ".".join(map(str, place)), ""
        try:
            read(wrong)
        except UserError as error:
            said = str(error)
            assert said.isprintable(), (where, what)
            assert len(said) <= 1500, (where, what)
            keys = [part for part in place if isinstance(part, str)]
            named = [*keys, *([misspelt(keys[-1])] if what == "misspelt" else [])]
            assert any(name in said for name in [*named, *ELSEWHERE]), f"{where}, {what}: {said}"
            said = said.replace(f"{Path.cwd()}/", "").replace(str(Path.cwd()), "").replace(what, "...")
            said = re.sub(r"(; (did you mean|known:)|, got |x{50}).*", "", said)
        found.setdefault(where, {}).setdefault(said, []).append(what)
    return {place: {said: " | ".join(cases) for said, cases in each.items()} for place, each in found.items()}


@pytest.mark.parametrize("kind", FILES)
def test_what_is_wrong_in_a_file_is_named_in_one_line_as_it_was(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert answers(kind) == json.loads(GOLDEN.read_text())[kind], "python -m tests.attacks.test_wrong_files"


def test_a_message_is_one_printable_line_whatever_a_file_put_into_it():
    line = str(UserError(f"unknown player '\x1b[2J\n\ud800{'x' * 5000}'; known: tone"))
    assert line.isprintable()
    assert line.startswith("unknown player '�[2J �xxx")
    assert line.endswith("xxx'; known: tone")
    assert len(line) < 400


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        GOLDEN.write_text(
            json.dumps({kind: answers(kind) for kind in FILES}, indent=1, ensure_ascii=False) + "\n"
        )
