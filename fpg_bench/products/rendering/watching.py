"""Watching a game of two players: as text, an interactive page, a picture or a film."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fpg_bench.common.canvas import FIGURES
from fpg_bench.common.checks import integer, one_of
from fpg_bench.common.errors import UserError, nearest, printable
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import check_target
from fpg_bench.common.ids import DUEL
from fpg_bench.common.products import load, offered
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import MatchBatch, begin_round, finish_round, make_match
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import STANDARD, Scenario
from fpg_bench.game.spec import GameSpec, game_product, other_game
from fpg_bench.players.planner import Plan, asks_language_model
from fpg_bench.players.player import PlayerSpec
from fpg_bench.players.registry import named_card, player_name, trained_game
from fpg_bench.products.rendering.recording import Recording

_logger = logging.getLogger(__name__)
FILMS = (".gif", ".mp4")
SUFFIXES = (".html", *FIGURES, *FILMS)
_HEADING = (
    " step  distance    ally    known  age  jamming        centre    SNR  clean  flags     ally  opponent",
    "    s         m     MHz      MHz    s                    MHz     dB     dB         reward    reward",
)
_FLAGS = "flags: C covered, O outage, H hop, S spreading, check + heard or - not heard"
_CLOSING = (  # measure, its name in the closing line, its format
    ("jamming_success_rate", "jamming success rate", ".1%"),
    ("outage", "outage", ".1%"),
    ("overlap_ratio", "overlap ratio", ".1%"),
    ("detection_rate", "heard", ".1%"),
    ("hop_rate", "hops", ".1%"),
    ("spread_ratio", "spreading", ".1%"),
    ("near_ratio", "near", ".1%"),
    ("snr_db", "SNR/dB", ".1f"),
    ("ally_return", "ally", "+.1f"),
    ("opponent_return", "opponent", "+.1f"),
)


def watch(
    ally: PlayerSpec = "expert",
    opponent: PlayerSpec = "adaptive",
    *,
    id: str = DUEL,
    seed: int = 0,
    rounds: int = 1,
    out: str | Path | None = None,
    every: int = 1,
    llm: Mapping[str, Any] = MappingProxyType({}),
    **game: Any,
) -> list[dict[str, float | None]]:
    """Play a game of two players, or of two teams of them, and print or film it.

    Without ``out`` every step is printed as a line of text, and each round ends with a line of measures. With
    it the rounds are written to a file, and only the lines of measures and the file's name are printed:
    ``.html`` is an interactive replay, ``.png``, ``.svg`` and ``.pdf`` are pictures of the paths, ``.gif``
    and ``.mp4`` films; all but the first need the extra ``video``. Teams are shown for one round, and not as
    a page.

    Args:
        ally, opponent: players, by the grammar of :func:`fpg_bench.players.registry.as_player`.
        id: the duel, or a product's game of both sides, as ``FPG/team_v0``; an agent that was trained in one
            plays that game, whatever is given.
        seed: seed of the match, a whole number in [0, 2^63).
        rounds: number of consecutive rounds; a match's last round is followed by the next match of its seed.
            With a planner they are the rounds of one match.
        out: the file to write, or None for text.
        every: show every n-th line or frame, and the last; a replay keeps all steps.
        llm: options of a planner that asks a language model, by name: ``record`` keeps what it was asked and
            answered in a file, ``transcript`` plays such a file again; see
            :class:`fpg_bench.products.language_models.options.PlayOptions`.
        **game: ``scenario``, ``path``, ``planner``, ``knowledge``, ``jamming_types``: those of
            :func:`fpg_bench.envs.two_player.make_duel`; of a product's game, its options.

    Returns:
        The measures of each round, by the names of :func:`fpg_bench.game.metrics.measures`.

    Raises:
        UserError: an unknown player, option or suffix, a number out of range, a file that exists
            already or cannot be written, or an extra that is not installed. Nothing has been played then.
        OSError: the file cannot be written.
    """
    for name, value in (("rounds", rounds), ("every", every)):
        integer(value, name)
    one_of(id, "id", (DUEL, *offered("game")))
    if llm:
        game["planner"] = load("language_model", "of play")(game.get("planner"), llm)
    home = trained_game(ally, "ally") or trained_game(opponent, "opponent")
    if other := other_game(GameSpec.of(home or id, **game)):
        if rounds > 1:
            raise UserError(f"rounds: {other.id} is shown for one round, got {rounds}")
        product = game_product(other.id)
        return [product.watch(ally, opponent, out, game=other, seed=seed, every=every)]
    target = None if out is None else checked_target(Path(out))
    played = _home(GameSpec.of(id, **game), ally, opponent)
    if played.planner is not None:
        played = GameSpec.of(played, scenario=replace(played.resolve(), rounds_per_match=rounds))
    duel = make_duel(game=played)
    names = {"ally": player_name(ally), "opponent": player_name(opponent)}
    match = make_match(duel, ally, opponent)
    recordings, measures = [], []
    for index in range(rounds):
        begin_round(match, seeds=seed if index == 0 else None)
        recordings.append(_print_round(match, names, every) if target is None else _record_round(match))
        measures.append(duel.measures(0))
        print(f"{_which(recordings[-1])}: {shown_measures(measures[-1])}")
        if (plan := duel.plans[0]) is not None and asks_language_model(duel.planner):
            print(f"    {_shown_plan(plan)}")
    if target is not None:
        _write(recordings, target, names, every)
        print(f"wrote {target}")
    return measures


def _home(game: GameSpec, ally: PlayerSpec, opponent: PlayerSpec) -> GameSpec:
    """Return the game with the scenario and path of its agents' training, where it names none.

    Raises:
        UserError: the agents were trained in different scenarios, or in one that cannot be played.
    """
    players = {"ally": ally, "opponent": opponent}
    cards = {side: card for side, spec in players.items() if (card := named_card(spec, side)) is not None}
    if game.scenario is None:
        homes = {}
        for side, card in cards.items():
            try:
                homes[side] = card.home()
            except UserError as error:
                raise UserError(f"{side} {player_name(players[side])}: {error}") from error
        if len(set(homes.values())) > 1:
            raise UserError("scenario: the two agents were trained in different ones; name one of them")
        if homes and (home := next(iter(homes.values()))) != STANDARD:
            trained = " and ".join(player_name(players[side]) for side in homes)
            kind = home.name or f"a scenario of its own ({', '.join(home.to_dict())})"
            _logger.info(f"scenario: {kind}, in which {trained} was trained")
            game = GameSpec.of(game, scenario=home)
    if game.path is None and game.planner is None and "opponent" in cards:
        flies = cards["opponent"].flies
        if flies == "learned":
            game = GameSpec.of(game, path=flies)
    return game


def checked_target(path: Path, suffixes: Sequence[str] = SUFFIXES) -> Path:
    """Return the path of a file to write; raise UserError if it cannot be written, nor drawn here."""
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise UserError(f"out: unknown suffix {path.suffix!r} of {str(path)!r}{nearest(suffix, suffixes)}")
    check_target(path)
    if path.exists():
        raise UserError(f"out: {path} exists already; choose another name")
    if suffix != ".html":
        require_extra("video", "matplotlib", "PIL")
    load("rendering", suffix)
    if suffix == ".mp4":
        load("rendering", "check of .mp4")()
    return path


def _record_round(match: MatchBatch) -> Recording:
    """Play a round to its end and return its recording."""
    recording = Recording(match.duel.batch)
    finish_round(match, on_step=recording.add)
    return recording


def _print_round(match: MatchBatch, names: dict[str, str], every: int) -> Recording:
    """Play a round to its end, printing each n-th step and the last; return its recording."""
    recording, game = Recording(match.duel.batch), match.duel.batch.games[0]
    print(_title(names), f"{_which(recording)}, path {recording.path}", _FLAGS, *_HEADING, sep="\n")

    def show() -> None:
        recording.add()
        if game["step"] % every == 0 or game["truncated"]:
            print(_step_line(recording.frames[-1], recording.scenario))

    finish_round(match, on_step=show)
    return recording


def _title(names: dict[str, str]) -> str:
    return f"{names['ally']} against {names['opponent']}"


def _which(recording: Recording) -> str:
    return f"seed {recording.seed}, match {recording.match}, round {recording.round}"


def _step_line(frame: np.void, scenario: Scenario) -> str:
    check = {1: "+", -1: "-"}[int(frame["last_check"])] if frame["checked"] else "."
    flags = (
        (frame["covered"], "C"),
        (frame["snr_db"] < scenario.snr_threshold_db, "O"),
        (frame["hopped"], "H"),
        (frame["spreading"], "S"),
    )
    return (
        f"{frame['step']:5d}{frame['distance_m']:10.1f}{frame['frequency_mhz']:8.2f}"
        f"{frame['known_mhz']:9.2f}{frame['age_s']:5d}  {JAMMING_TYPES[frame['jamming_type']]:<10}"
        f"{frame['jamming_mhz']:11.2f}{frame['snr_db']:7.1f}{frame['clean_snr_db']:7.1f}  "
        f"{''.join(sign if on else '.' for on, sign in flags)}{check}"
        f"{frame['ally_reward']:9.2f}{frame['opponent_reward']:10.2f}"
    )


def shown_measures(measures: dict[str, float | None]) -> str:
    """Return the measures of a round as a line of text."""
    values = (
        f"{name} {'none' if measures[key] is None else format(measures[key], style)}"
        for key, name, style in _CLOSING
    )
    return ", ".join(values)


def _shown_plan(plan: Plan) -> str:
    """Return a language model's plan as a line of text: its status, its cost, and what is wrong with it."""
    cost = f"{plan.source} flown, {plan.seconds:.3f} s, {plan.tokens or 0} tokens"
    return printable(", ".join(filter(None, [f"plan {plan.status}", cost, plan.useless, plan.problem])))


def _write(recordings: Sequence[Recording], path: Path, names: dict[str, str], every: int) -> None:
    title, suffix = _title(names), path.suffix.lower()
    more = (every,) if suffix in FILMS else (*names.values(),) if suffix == ".html" else ()
    load("rendering", suffix)(recordings, path, title, *more)
