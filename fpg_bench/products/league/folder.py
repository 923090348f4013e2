"""Folders of league training: their settings, and the agents that they export."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from fpg_bench.common.checks import first_difference
from fpg_bench.common.errors import UserError, other_content, shown
from fpg_bench.common.files import read_json, write_json
from fpg_bench.common.locks import own_folder
from fpg_bench.common.rows import Row, RowFile
from fpg_bench.common.schema import parse
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import read_card, write_agent
from fpg_bench.players.card import AgentCard
from fpg_bench.products.league.categorical import CategoricalSearch, Generation
from fpg_bench.products.league.config import LeagueConfig
from fpg_bench.training.run_folder import RunFolder, command, revision
from fpg_bench.version import versions

_logger = logging.getLogger(__name__)


@contextlib.contextmanager
def search_folder(folder: Path, about: str, rows: str, what: str) -> Iterator[None]:
    """Hold a folder; a UserError that comes before its first run and its first row leaves nothing in it."""
    with own_folder(folder, about, what):
        try:
            yield
        except UserError:
            held = {name for name in os.listdir(folder) if not name.startswith(".")}
            if held <= {about, rows} and not (rows in held and (folder / rows).stat().st_size):
                for name in held:
                    (folder / name).unlink()
            raise


def run_search(
    search: CategoricalSearch, folder: Path, name: str, about: Row, budget: float, progress: bool
) -> tuple[float, float]:
    """Run a search in a held folder until a budget of CPU seconds is spent, over all calls.

    Args:
        search: the search, which has not begun.
        folder: the folder.
        name: of its files, the rows ``<name>.jsonl`` and the settings ``<name>.json``.
        about: the settings.
        budget: the generation that it ends in is finished.
        progress: log a line for each quarter of the budget.

    Returns:
        What the last generation's best earned per step, and the CPU seconds.

    Raises:
        UserError: the folder has another search.
    """
    file, settings = RowFile(folder / f"{name}.jsonl"), folder / f"{name}.json"
    rows = [parse(Generation, row, f"rows {file.path}") for row in file.read()]
    if settings.exists():
        check_same(settings, f"a {name} search", about)
    else:
        write_json(settings, about)
    for row in rows:
        search.take(row, file.path.name)
    seconds = sum(row.seconds for row in rows)
    while seconds < budget:
        row, quarters = search.run(), 4 * seconds // budget
        seconds += row.seconds
        rows.append(row)
        file.append([row.model_dump()])
        if progress and 4 * seconds // budget > quarters:
            _logger.info(f"generation {row.generation}: {row.earned:.2f} per step; {seconds:.0f} CPU s")
    return rows[-1].earned, round(seconds, 1)


def write_found(
    folder: Path,
    model: bytes,
    search: CategoricalSearch,
    game: GameSpec,
    algorithm: str,
    seconds: float,
    recipe: JsonObject,
) -> None:
    """Write what a search found as an agent.

    Args:
        folder: the agent's folder.
        model: the policy as ONNX.
        search: the search, which has ended.
        game: the game that it was searched in.
        algorithm: its name.
        seconds: CPU seconds of the search.
        recipe: the numbers that were found.
    """
    scenario = game.resolve()
    write_agent(
        folder,
        model,
        algorithm=algorithm,
        game=game.describe(),
        scenario=scenario.hash,
        scenario_fields=scenario.to_dict(),
        training_seed=search.seed,
        training_steps=search.rounds * scenario.steps_per_round,
        seconds=seconds,
        recipe=recipe,
        command=command(),
        versions=versions(),
        revision=revision(),
    )


def settings_of(config: LeagueConfig, *without: str) -> JsonObject:
    """Return the fields of a configuration but the game, what is allowed, and those named."""
    fields = {each.name: getattr(config, each.name) for each in dataclasses.fields(config)}
    return {name: value for name, value in fields.items() if name not in ("game", "allow", *without)}


def as_json(content: Mapping[str, object]) -> JsonObject:
    """Return a mapping as it is read from JSON."""
    read: JsonObject = json.loads(json.dumps(content, default=str))
    return read


def check_same(file: Path, kind: str, about: Mapping[str, object]) -> JsonObject:
    """Return the content of a file; raise UserError if it was made with settings other than ``about``."""
    content = read_json(file, kind)
    if found := first_difference(about, {key: content.get(key) for key in about}):
        key, now, before = found
        raise other_content(file, f"{kind} with another {key} ({shown(before)}, now {shown(now)})")
    return content


def export_agent(runs: Sequence[RunFolder], folder: Path, name: str, update: JsonObject) -> Path:
    """Copy the agent of the last of a series of runs in a folder; ``agent.json`` describes all of them.

    Names of the folder's own agents begin at the folder, wherever it was when they were trained.

    Args:
        runs: the runs, each from the weights of the one before.
        folder: the folder of all of them.
        name: folder of the agent in it.
        update: further attributes of the agent's card.
    """
    last, budget = runs[-1].agent, sum(run.read().training_steps for run in runs)
    card = _named_within(read_card(last), folder)
    card = card.model_copy(update={"training_steps": budget} | update)
    card.write(folder / name, (last / "policy.onnx").read_bytes())
    return folder / name


def _named_within(card: AgentCard, folder: Path) -> AgentCard:
    """Return a card in which the names of agents and runs in a folder begin at the folder."""

    def within(name: str) -> str:
        tails = (Path(*Path(name).parts[start:]) for start in range(1, len(Path(name).parts) - 1))
        return next((tail.as_posix() for tail in tails if (folder / tail).is_dir()), name)

    other = card.game.config.other_side
    update: JsonObject = {}
    if (players := getattr(card.game, other)) is not None:
        update["game"] = GameSpec.of(card.game, **{other: list(map(within, players))})
    if "start" in card.options:
        update["options"] = {**card.options, "start": within(card.options["start"])}
    if card.policies:
        update["policies"] = {within(player): sha256 for player, sha256 in card.policies.items()}
    return card.model_copy(update=update)
