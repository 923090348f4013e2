"""The one match runner: player x panel x seeds, in large batches, one row per round, resumable."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.envs.duel import Duel
from fpg_bench.errors import UserError
from fpg_bench.evaluation.panel import Entry, Panel
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.game.state import TALLY
from fpg_bench.planning import as_planner
from fpg_bench.players.naming import as_player, policy_hash
from fpg_bench.players.player import Player
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.players.seat import Seat
from fpg_bench.rows import Row, RowFile

TALLIES = tuple(TALLY.names or ())
Seeds = Callable[[int], list[int]]  # gives so many


@dataclass(frozen=True)
class Contestant:
    """Who is measured: what rows call it, what it is, and which training seed it came from, if any."""

    name: str
    spec: Any
    training_seed: int | None = None

    def fingerprint(self, player: Player) -> str:
        """What tells two players of one name apart: the hash of a policy or source file, else the word."""
        return policy_hash(player) or code_fingerprint(str(self.spec))


def code_fingerprint(name: str) -> str:
    """The hash of the file that ``package.module:object`` came from; the name itself where there is none."""
    module = sys.modules.get(name.partition(":")[0])
    file = getattr(module, "__file__", None) if ":" in name else None
    return name if file is None else hashlib.sha256(Path(file).read_bytes()).hexdigest()


def contestant(spec: Any, side: str, panel: Panel, name: str | None = None) -> Contestant:
    """A contestant from a player's name; agents of one algorithm are one contestant over training seeds.

    Raises:
        UserError: no such player, one of the other side, or an oracle.
    """
    player = as_player(spec, side, panel.scenario)
    if name in SCRIPTED[side] and spec != name:
        raise UserError(f"name {name!r}: is a script's; call {spec!r} otherwise")
    if getattr(player, "sees", "") == "state":
        raise UserError(f"{side} {spec!r}: sees the full state, which no panel allows")
    about = getattr(player, "about", None)
    if isinstance(about, dict):
        return Contestant(name or str(about["algorithm"]), spec, about["training_seed"])
    return Contestant(name or str(spec), spec)


def play_panel(
    who: Contestant, panel: Panel, file: RowFile, progress: Callable[[Entry], None] = lambda entry: None
) -> None:
    """Play a contestant against every entry of a panel whose rows are not there yet.

    Args:
        who: the contestant.
        panel: the pairings and how many rounds of each.
        file: where rows go; entries that are complete there are skipped.
        progress: called before each entry, played or skipped.

    Raises:
        UserError: the file holds rows of another panel, or of another player under the same name.
    """
    for entry, head, known in rounds_known(who, panel, file):
        progress(entry)
        if len(known) < panel.rounds:
            for rows in play_entry(who.spec, panel, entry, panel.rounds):
                append_fresh(file, head, known, rows)


def rounds_known(
    who: Contestant, panel: Panel, file: RowFile
) -> Iterator[tuple[Entry, Row, set[tuple[int, int]]]]:
    """Per entry: how its rows begin, and which rounds (seed, round) the file holds already.

    Raises:
        UserError: the file holds rows of another panel, or of another player under the same name.
    """
    player = as_player(who.spec, panel.side, panel.scenario)
    head: Row = {"panel": panel.name, "panel_hash": panel.hash[:16], "player": who.name}
    head |= {"training_seed": who.training_seed, "fingerprint": who.fingerprint(player)[:16]}
    done = rounds_done(file, head, who=("player", "training_seed"), entry="entry")
    for entry in panel.entries:
        yield entry, head | {"entry": entry.name}, done.get(entry.name, set())


def append_fresh(file: RowFile, head: Row, known: set[tuple[int, int]], rows: Iterable[Row]) -> None:
    """Append the rows of an entry that are not known yet."""
    file.append({**head, **row} for row in rows if (row["seed"], row["round"]) not in known)


def rounds_done(
    file: RowFile, head: dict[str, Any], who: tuple[str, ...], entry: str
) -> dict[str, set[tuple[int, int]]]:
    """Which rounds (seed, round) of each entry the file holds of a contestant.

    Args:
        file: the rows.
        head: what all rows of this contestant say.
        who: the keys of the head that name the contestant.
        entry: the key that names what it is played against.

    Raises:
        UserError: a line that is no such row, or rows of another panel or another contestant of this name.
    """
    done: dict[str, set[tuple[int, int]]] = {}
    for number, row in enumerate(file.read(), 1):
        if not head.keys() | {entry, "seed", "round"} <= row.keys():
            raise UserError(f"rows {file.path}: line {number} is no row of a round")
        if row["panel_hash"] != head["panel_hash"]:
            raise UserError(
                f"rows {file.path}: hold rows of another panel or scenario "
                f"({row['panel']} {row['panel_hash']}); write to another folder"
            )
        if any(row[key] != head[key] for key in who):
            continue
        if row["fingerprint"] != head["fingerprint"]:
            raise UserError(
                f"rows {file.path}: hold rows of another {head[who[0]]!r} (another policy, or its file has "
                "changed); give this one another name or write to another folder"
            )
        done.setdefault(row[entry], set()).add((row["seed"], row["round"]))
    return done


def play_entry(
    spec: Any,
    panel: Panel,
    entry: Entry,
    rounds: int,
    seeds: Seeds | None = None,
) -> Iterator[list[Row]]:
    """Play a player against an entry as one batch of matches; gives the rows of each round as it ends.

    Args:
        spec: the player.
        panel: what the entry belongs to.
        entry: what is played against.
        rounds: at least how many; whole matches are played.
        seeds: gives the seeds of so many matches; None: the evaluation seeds of the panel's season.
    """
    scenario = panel.entry_scenario(entry)
    matches = -(-rounds // scenario.rounds_per_match)
    planner = None if entry.planner is None else as_planner(entry.planner, scenario)
    duel = Duel(scenario, matches, planner)
    seats = {
        panel.side: Seat(panel.side, [as_player(spec, panel.side, scenario)], duel.arena),
        panel.other_side: Seat(
            panel.other_side, [as_player(entry.other, panel.other_side, scenario)], duel.arena
        ),
    }
    first: Any = np.array(evaluation_seeds(matches, panel.season) if seeds is None else seeds(matches))
    for _ in range(scenario.rounds_per_match):
        play_round(duel, seats["ally"], seats["opponent"], first)
        yield [round_row(duel, game) for game in range(matches)]
        first = None


def play_round(duel: Duel, ally: Seat, opponent: Seat, seeds: Any = None) -> None:
    """Play one round of every game to its end: of new matches where seeds are given, else the next one."""
    mask = duel.reset(seeds=seeds)
    ally.begin(mask)
    opponent.begin(mask)
    while not duel.arena.games["truncated"].all():
        duel.arena.step(ally.act(), opponent.act())


def tally_row(duel: Duel, game: int) -> Row:
    """What happened in one game's round: its chance and the sums of its tally."""
    played, tally = duel.arena.games[game], duel.arena.tallies[game]
    row: Row = {"seed": int(played["seed"]), "round": int(played["round"])}
    return row | dict(zip(TALLIES, tally.item(), strict=True))


def round_row(duel: Duel, game: int) -> Row:
    """One round of an entry: its tally, and the steps per frequency point of both sides."""
    ally_points, jam_points = duel.arena.histograms[game].tolist()
    return tally_row(duel, game) | {"ally_points": ally_points, "jam_points": jam_points}
