"""Upload of an agent to the Hub, with its records and a model card."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from collections.abc import Iterable
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import read_results
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.run_description import CURVE
from fpg_bench.evaluation.store import RECORDS, Store
from fpg_bench.evaluation.suite import Suite, load_suite, suite_of
from fpg_bench.evaluation.summary import TrainingCost, summarise
from fpg_bench.players.agent import agent_folder, read_card
from fpg_bench.players.card import AgentCard
from fpg_bench.products.hub.card import model_card
from fpg_bench.products.hub.download import PUSHED_FILES, TIMEOUT_S, client, hub_errors, hub_name, split_name
from fpg_bench.products.hub.pull import copy_checked
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
    places = (Path(source), *Path(source).absolute().parents[:2])  # it, or the run of an agent's folder
    run = next((place for place in places if (place / "run.json").is_file()), None)
    inside = Path(source) / "agent"
    folder = agent_folder(inside if (inside / "agent.json").is_file() else source)
    with tempfile.TemporaryDirectory() as temporary:
        copy_checked(folder, Path(temporary) / "agent", f"agent {folder}")
    card = read_card(folder)
    records = list(_records(folder, card, run, results))
    files = {file: (folder / file).read_bytes() for file in AGENT_FILES}
    if records:
        rows = (json.dumps(record.row(), separators=(",", ":")) for _, of in records for record in of)
        files["records.jsonl"] = "".join(f"{row}\n" for row in rows).encode()
    if run is not None and (run / CURVE).is_file():
        files[CURVE] = (run / CURVE).read_bytes()
    training = TrainingCost(card.played_steps, card.seconds)
    summaries = [
        dataclasses.replace(each, training=training) for suite, of in records for each in summarise(of, suite)
    ]
    suite_name = suite_of(card.game, card.side)
    files["README.md"] = model_card(card, repository, suite_name, summaries, files).encode()
    return files


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
