"""Upload of an agent to the Hub, with its records, a model card and a replay of a round."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from fpg_bench.common.canvas import write_figure
from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import read_results
from fpg_bench.evaluation.play import match_of
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.rounds import begin_round, finish_round
from fpg_bench.evaluation.run_description import CURVE
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.store import RECORDS, Store
from fpg_bench.evaluation.suite import Suite, load_suite, suite_of
from fpg_bench.evaluation.summary import TrainingCost, summarise
from fpg_bench.players.agent import agent_folder, load_agent
from fpg_bench.players.card import AgentCard
from fpg_bench.players.player import Player
from fpg_bench.products.hub.card import model_card
from fpg_bench.products.hub.download import (
    PUSHED_FILES,
    TIMEOUT_S,
    client,
    hub_errors,
    hub_name,
    split_name,
)
from fpg_bench.products.hub.pull import copy_checked
from fpg_bench.products.rendering.curves import draw_training
from fpg_bench.products.rendering.recording import Recording
from fpg_bench.products.rendering.replay import write_replay
from fpg_bench.products.sandbox.client import AGENT_FILES
from fpg_bench.products.zoo.zoo import load_zoo


def push(
    source: str,
    repository: str,
    *,
    private: bool = False,
    revision: str | None = None,
    results: Path | None = None,
) -> str:
    """Upload an agent in one commit, and create its repository if there is none.

    What an earlier push left and this one has not, records for instance, is removed in the same commit.

    Args:
        source: a finished run's folder, an agent's folder, or a shipped agent.
        repository: ``owner/name``.
        private: create the repository as a private one.
        revision: the branch, which is created if there is none; None: ``main``.
        results: a results folder with records of this agent; None: ``results`` in the run's folder, and of a
            shipped agent its own records.

    Returns:
        The player's name of the uploaded agent, with its commit.

    Raises:
        UserError: no such agent, one that fails the checks of submissions, no records of it in ``results``,
            no token, no right, or a Hub that cannot be reached.
    """
    name = hub_name(repository, revision)
    repository, branch = split_name(name)
    api = client()
    if not api.token:
        raise UserError(
            "hub push: set HF_TOKEN to a token with write access (huggingface.co/settings/tokens)"
        )
    files = agent_files(source, repository, results)
    from huggingface_hub import CommitOperationAdd, CommitOperationDelete
    from huggingface_hub.errors import RepositoryNotFoundError

    with hub_errors(name):
        try:
            is_public = not api.model_info(repository, timeout=TIMEOUT_S).private
        except RepositoryNotFoundError:
            is_public = False
            api.create_repo(repository, private=private or None, exist_ok=True)
        if private and is_public:
            raise UserError(f"{name}: is already public; make it private on the Hub, or omit --private")
        if branch != "main":
            api.create_branch(repository, branch=branch, exist_ok=True)
        files_there = {file.rfilename for file in api.model_info(repository, revision=branch).siblings or ()}
        there = files_there & set(PUSHED_FILES) - {".gitattributes"}
        commit = api.create_commit(
            repository,
            [
                *(CommitOperationAdd(file, content) for file, content in files.items()),
                *(CommitOperationDelete(file) for file in sorted(there - set(files))),
            ],
            commit_message="Upload an agent of fpg-bench",
            revision=branch,
        )
    return hub_name(repository, commit.oid)


def agent_files(source: str, repository: str, results: Path | None = None) -> dict[str, bytes]:
    """Return the files of an agent's repository, by name; arguments and errors as in :func:`push`."""
    run = _run_of(Path(source))
    inside = Path(source) / "agent"
    folder = agent_folder(inside if (inside / "agent.json").is_file() else source)
    with tempfile.TemporaryDirectory() as temporary:
        copy_checked(folder, Path(temporary) / "agent", f"agent {folder}")
    player = load_agent(folder)
    card = player.card
    assert card is not None
    side, suite = card.side, load_suite(suite_of(card.game, card.side))
    records = list(_records(folder, card, run, results))
    files = {file: (folder / file).read_bytes() for file in AGENT_FILES}
    files["replay.html"] = _replay(player, side, suite, repository)
    if records:
        rows = (json.dumps(record.row(), separators=(",", ":")) for _, of in records for record in of)
        files["records.jsonl"] = "".join(f"{row}\n" for row in rows).encode()
    if run is not None and (curve := _curve(run)) is not None:
        files[CURVE] = curve
    training = TrainingCost(card.played_steps, card.seconds)
    summaries = [
        dataclasses.replace(each, training=training) for suite, of in records for each in summarise(of, suite)
    ]
    files["README.md"] = model_card(card, repository, suite.name, summaries, files).encode()
    return files


def _curve(run: Path) -> bytes | None:
    """Return the picture of a run's scores, drawn here for one of several seeds; None if it has no scores."""
    if (run / CURVE).is_file():
        return (run / CURVE).read_bytes()
    if (figure := draw_training(run)) is None:
        return None
    with tempfile.TemporaryDirectory() as temporary:
        write_figure(figure, Path(temporary) / CURVE)
        return (Path(temporary) / CURVE).read_bytes()


def _run_of(source: Path) -> Path | None:
    """Return the folder of the run that a folder is or that an agent's folder belongs to."""
    return next((f for f in (source, *source.absolute().parents[:2]) if (f / "run.json").is_file()), None)


def _records(
    folder: Path, card: AgentCard, run: Path | None, results: Path | None
) -> Iterable[tuple[Suite, list[Record]]]:
    """Yield the suites that an agent was evaluated on, each with the records of this policy."""

    def own(records: Iterable[Record]) -> list[Record]:
        return [record for record in records if record.fingerprint == card.policy_sha256[:16]]

    home = run / "results" if results is None and run is not None else results
    if home is not None and (results is not None or (home / RECORDS).is_file()):
        _, suite = read_results(home)
        records = own(Store(home / RECORDS).records())
        if results is not None and not records:
            raise UserError(f"results {results}: hold no record of this agent's policy")
        if records:
            yield suite, records
        return
    zoo = load_zoo()
    for agent in zoo.members():
        if agent.folder == folder:
            for suite in map(load_suite, agent.group.suites):
                if records := own(zoo.read_records(agent.group, suite)):
                    yield suite, records


def _replay(player: Player, side: str, suite: Suite, repository: str) -> bytes:
    """Return a page that replays a round against the last rival of a suite, on its first evaluation seed."""
    rival = suite.rivals[-1]
    match = match_of(player, suite, rival, matches=1)
    begin_round(match, seeds=np.array(evaluation_seeds(1, suite.season)))
    recording = Recording(match.duel.batch)
    finish_round(match, on_step=recording.add)
    names = [repository, " or ".join(rival.players)]
    ally, opponent = names if side == "ally" else reversed(names)
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "replay.html"
        write_replay([recording], page, f"{ally} against {opponent}", ally, opponent)
        return page.read_bytes()
