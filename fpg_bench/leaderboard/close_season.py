"""Close a season: draw recipes, train candidates, let all entries play them, and select the season suite.

All draws follow from the season's seed by SHA-256, so they are the same on every machine and version.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import re
import shutil
import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_json, read_yaml, write_whole
from fpg_bench.common.ids import other_side, policy_env
from fpg_bench.common.parallel import Job, check_all_done, folder_job, run_jobs
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.seeds import PROTOCOL, season_label
from fpg_bench.evaluation.suite import Rival, Scale, Suite, load_suite
from fpg_bench.game.scenario import as_scenario
from fpg_bench.leaderboard.season import (
    FILE,
    Recipe,
    Season,
    SeasonEntry,
    SeasonMember,
    entries_of_side,
    read_entries,
    season_seed,
    write_season,
    write_suites,
)
from fpg_bench.leaderboard.tracks import SCENARIOS, track_of
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.registry import as_player
from fpg_bench.training.config import GameOptions, RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train

_logger = logging.getLogger(__name__)

CANDIDATES, SIZE = 24, 12
ROUNDS = 60  # of each entry against each candidate
PROFILE, PLAN, PROBE = "profile.jsonl", "plan.yml", "probe"
# Groups of a side's candidates: first those against which the first of two scripts is ahead of the second.
# Opponents that drive an ally to hop on and on are met best by staying, those that aim at it by hopping;
# allies that can be driven so by jamming both halves of the band in turn, those that evade it by aiming.
GROUPS = {"opponent": ("herders", "aimers"), "ally": ("herdable", "evasive")}
PROBES = {"opponent": ("idle", "expert"), "ally": ("alternate", "tone")}

# Rewards of candidates. An ally that is rewarded for spending little never hops, as the script idle.
REWARDS = {
    "opponent": ("zero_sum", "jamming", "overlap", "own", "ally_cost"),
    "ally": ("zero_sum", "jamming", "own", "overlap"),
}
# TD3 twice: it finds opponents that herd, which beat most entries and which PPO seldom finds on this budget.
ALGORITHMS = ("td3", "ppo", "td3", "ppo-stack8")
STEPS = {
    "ppo": (500_000, 250_000),
    "ppo-stack8": (500_000, 250_000),
    "td3": (40_000,),
}
GAMMAS = (0.9, 0.95, 0.8)
# PPO's initial spread decides what an opponent learns: with a wide one, it learns to jam broadly.
LOG_STDS = {"opponent": (-2.5, -1.5, -3.5), "ally": (-0.2, -1.0)}
TARGETS = (1, 3, 1, 5)  # number of entries that a candidate is trained against
FIRST_SEED, SEEDS = 300_000, 700_000  # training seeds reserved for candidates
_PPO = {
    "policy": "MlpPolicy",
    "n_envs": 128,
    "n_steps": 64,
    "batch_size": 4096,
    "n_epochs": 4,
    "learning_rate": 0.002,
    "gae_lambda": 0.8,
    "normalize": {"norm_obs": False, "norm_reward": True},
}
_TD3 = {
    "policy": "MlpPolicy",
    "n_envs": 8,
    "learning_starts": 2000,
    "buffer_size": 100_000,
    "batch_size": 256,
    "train_freq": 1,
    "gradient_steps": 1,
    "learning_rate": 0.002,
    "tau": 0.01,
    "noise_type": "normal",
    "noise_std": 0.1,
    "normalize": {"norm_obs": False, "norm_reward": True},
}
T = TypeVar("T")


def draw_number(below: int, *key: object) -> int:
    """Draw a whole number in [0, below) from the hash of a key."""
    return int(_digest(*key), 16) % below


def shuffled(items: Sequence[T], *key: object) -> list[T]:
    """Return the items in an order drawn from a key."""
    order = sorted(range(len(items)), key=lambda i: _digest(*key, i))
    return [items[i] for i in order]


def dealt(levels: Sequence[T], count: int, *key: object) -> list[T]:
    """Deal levels evenly over ``count`` places in a drawn order; the first levels once more if necessary."""
    return shuffled([levels[i % len(levels)] for i in range(count)], *key)


def _digest(*key: object) -> str:
    return hashlib.sha256("/".join(map(str, key)).encode()).hexdigest()


def draw_recipes(seed: str, side: str, count: int, entries: Sequence[SeasonEntry]) -> list[Recipe]:
    """Draw the recipes of a side's candidates.

    Algorithms take turns. All other properties are dealt evenly over the candidates of an algorithm, so the
    seed decides only their combinations.

    Args:
        seed: the season's seed.
        side: the candidates' side.
        count: number of candidates.
        entries: entries of the other side, to be trained against.

    Raises:
        UserError: no entries to train against.
    """
    if not entries:
        raise UserError(f"season: there is no entry that candidates of the {side} could be trained against")
    algorithms = [ALGORITHMS[i % len(ALGORITHMS)] for i in range(count)]

    def deal(name: str, levels_of: Mapping[str, Sequence[T]] | Sequence[T]) -> list[T]:
        """Deal a property's levels, which may depend on the algorithm, over each algorithm's candidates."""
        hands = {}
        for algorithm, number in Counter(algorithms).items():
            levels = levels_of[algorithm] if isinstance(levels_of, Mapping) else levels_of
            hands[algorithm] = iter(dealt(levels, number, seed, side, name, algorithm))
        return [next(hands[algorithm]) for algorithm in algorithms]

    rewards, gammas, steps = deal("reward", REWARDS[side]), deal("gamma", GAMMAS), deal("steps", STEPS)
    log_stds = deal("log_std", LOG_STDS[side])
    targets = _draw_targets(seed, side, deal("size", TARGETS), entries)
    return [
        Recipe(
            name=f"{side[0]}{i:02d}",
            side=side,
            algorithm=algorithm,
            steps=steps[i],
            reward=rewards[i],
            gamma=gammas[i],
            log_std=None if algorithm == "td3" else log_stds[i],
            targets=targets[i][0],
            path=targets[i][1],
            training_seed=FIRST_SEED + draw_number(SEEDS, seed, side, "seed", i),
        )
        for i, algorithm in enumerate(algorithms)
    ]


def _draw_targets(
    seed: str, side: str, sizes: Sequence[int], entries: Sequence[SeasonEntry]
) -> list[tuple[tuple[str, ...], str]]:
    """Draw the players that each candidate is trained against, and the opponent's path.

    The first target is a trained entry where there is one; each of them comes first equally often. Opponents
    with different paths are never mixed; scripts go with either path.
    """
    trained = [entry for entry in entries if not entry.is_script] or list(entries)
    targets = []
    for i, (first, size) in enumerate(
        zip(dealt(trained, len(sizes), seed, side, "first"), sizes, strict=True)
    ):
        flight = None if first.is_script else first.flight
        others = [e for e in entries if e.name != first.name and (e.is_script or e.flight in (None, flight))]
        chosen = [first, *shuffled(others, seed, side, "mixture", i)[: size - 1]]
        players = tuple(
            e.players[draw_number(len(e.players), seed, side, "player", i, e.name)] for e in chosen
        )
        targets.append((players, flight or "pursuit"))
    return targets


def hyperparameters(recipe: Recipe) -> dict[str, Any]:
    """Return a recipe's hyperparameters for :class:`fpg_bench.training.config.RunConfig`."""
    policy_kwargs: dict[str, Any] = {"net_arch": [64, 64]}
    own = {"n_timesteps": recipe.steps, "gamma": recipe.gamma, "policy_kwargs": policy_kwargs}
    if recipe.algorithm == "td3":
        policy_kwargs["optimizer_kwargs"] = {"fused": True}
        return _TD3 | own
    policy_kwargs |= {"activation_fn": "ReLU", "log_std_init": recipe.log_std}
    return _PPO | own


def train_candidate(recipe: Recipe, folder: Path, scenario: str = "standard") -> None:
    """Train a candidate and keep only its agent and its run's records.

    A finished run is not trained again; an unfinished one starts anew, so the result is always the same.

    Args:
        recipe: the recipe.
        folder: the run's folder.
        scenario: the preset.

    Raises:
        UserError: the folder holds an unfinished run of another kind, or training diverged.
    """
    run = RunConfig(
        recipe.algorithm,
        policy_env(recipe.side).id,
        recipe.training_seed,
        recipe.steps,
        hyperparameters(recipe),
        against=list(recipe.targets),
        game=GameOptions(
            reward=recipe.reward,
            path=recipe.path,
            scenario=None if scenario == "standard" else scenario,
        ),
    )
    if not RunFolder(folder).is_finished():
        train(run, folder, evaluations=0, progress=False, restart=True)
    for path in folder.iterdir():
        if path.name not in ("agent", "run.json", "evaluations.jsonl"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def halves(returns: np.ndarray, leads: np.ndarray, side: str) -> list[str]:
    """Group the candidates of a side by what they do to entries, and name the groups.

    Two groups by Ward's hierarchical clustering of the candidates' profiles of returns, each standardised, so
    that their distance follows from their correlation: what counts is who fares well, not how well all fare.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``.
        leads: by how much the first script of :data:`PROBES` earns more than the second, per candidate.
        side: the candidates' side.

    Returns:
        The group of each candidate: that with the larger lead is called first in :data:`GROUPS`.

    Raises:
        UserError: a return that is not finite.
    """
    from scipy.cluster.hierarchy import fcluster, linkage

    _check_finite(returns)
    spread = returns.std(axis=0)
    profiles = (returns - returns.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    labels = fcluster(linkage(profiles.T, "ward"), 2, "maxclust")
    order = sorted(set(labels), key=lambda label: -leads[labels == label].mean())
    return [GROUPS[side][order.index(label)] for label in labels]


def select_by_halves(returns: np.ndarray, groups: Sequence[str], size: int) -> list[int]:
    """Select as many candidates of each group, each half representative of its group.

    So the mean over the suite weighs both abilities alike, whatever their share among the candidates.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``.
        groups: the group of each candidate.
        size: number of candidates to select; fewer where a group has not half as many.

    Returns:
        Their indices, group by group.

    Raises:
        UserError: see :func:`select_representative`.
    """
    of_group = {name: [i for i, group in enumerate(groups) if group == name] for name in sorted(set(groups))}
    each = min(size // len(of_group), *map(len, of_group.values()))
    return [
        members[index]
        for members in of_group.values()
        for index in select_representative(returns[:, members], each)
    ]


def select_representative(returns: np.ndarray, size: int) -> list[int]:
    """Select candidates against which entries earn about what they earn against all candidates.

    Starts with the strongest candidate, against which entries earn least. Each next one brings the suite's
    mean returns nearest to those of all candidates.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``.
        size: number of candidates to select.

    Returns:
        Their indices in the order of selection.

    Raises:
        UserError: too few candidates, or returns that are not finite.
    """
    selected = _strongest(returns, size)
    overall = returns.mean(axis=1)
    while len(selected) < size:
        sums = returns[:, selected].sum(axis=1)[:, None] + returns
        distances = np.linalg.norm(sums / (len(selected) + 1) - overall[:, None], axis=0)
        distances[selected] = np.inf
        selected.append(int(distances.argmin()))
    return selected


def select_diverse(returns: np.ndarray, size: int) -> list[int]:
    """Select a training population: entries fare differently against each member.

    Starts with the strongest candidate; each next one has the profile of returns farthest from all selected
    (greedy max-min distance). Arguments, result and errors are those of :func:`select_representative`.
    """
    selected = _strongest(returns, size)
    distances = np.linalg.norm(returns[:, :, None] - returns[:, None, :], axis=0)
    while len(selected) < size:
        nearest = distances[:, selected].min(axis=1)
        nearest[selected] = -1.0
        selected.append(int(nearest.argmax()))
    return selected


def _strongest(returns: np.ndarray, size: int) -> list[int]:
    count = returns.shape[1]
    if size > count:
        raise UserError(f"season: a suite of {size} needs as many candidates, got {count}")
    _check_finite(returns)
    return [int(returns.mean(axis=0).argmin())]


def _check_finite(returns: np.ndarray) -> None:
    if not np.isfinite(returns).all():
        raise UserError("season: a return of an entry is not a number")


@dataclass(frozen=True)
class Closing:
    """A season that is being closed.

    Attributes:
        name: the season suite's name, such as ``season-1``.
        number: the season's number; None for a training population.
        entries: the entries it is closed over.
        work: folder of the candidates; it is kept, so that a stopped closing can be resumed.
        candidates, size: trained and selected candidates per side.
        scenario: the preset that is played, by entries and candidates.
    """

    name: str
    number: int | None
    entries: tuple[SeasonEntry, ...]
    work: Path
    candidates: int = CANDIDATES
    size: int = SIZE
    scenario: str = "standard"

    @property
    def seed(self) -> str:
        """The season's seed; a training population's follows from its name instead of a number."""
        label = self.name if self.number is None else season_label(self.number, self.scenario)
        return season_seed(PROTOCOL, label, self.entries)

    def rival_entries(self, side: str) -> list[SeasonEntry]:
        """Return the entries that play against the candidates of a side."""
        return entries_of_side(self.entries, other_side(side))

    def recipes(self, side: str) -> list[Recipe]:
        """Return the recipes of a side's candidates."""
        return draw_recipes(self.seed, side, self.candidates, self.rival_entries(side))

    def folder(self, recipe: Recipe) -> Path:
        """Return the folder of a candidate."""
        return self.work / recipe.side / recipe.name


def make_closing(
    name: str,
    board: str | Path,
    work: Path,
    candidates: int = CANDIDATES,
    size: int = SIZE,
    scenario: str = "standard",
) -> Closing:
    """Return the closing of a season (by number) or a training population (by name) over a board.

    Args:
        name: the number or name.
        board: the leaderboard's folder.
        work, candidates, size, scenario: see :class:`Closing`.

    Raises:
        UserError: an invalid name, or an invalid entry.
    """
    if not re.fullmatch(r"[1-9]\d{0,3}|[a-z][a-z0-9-]{0,39}", name) or name.startswith("season"):
        raise UserError(f"season: expected a number, or a word for a training population, got {name!r}")
    number = int(name) if name.isdigit() else None
    if scenario not in SCENARIOS:
        raise UserError(f"scenario: expected {' or '.join(SCENARIOS)}, got {scenario!r}")
    entries = tuple(read_entries(board, scenario=scenario))
    if number is not None:
        name = f"season-{season_label(number, scenario)}"
    return Closing(name, number, entries, work, candidates, size, scenario)


def close_season(
    closing: Closing,
    out: Path,
    sides: Sequence[str] = SIDES,
    *,
    n_jobs: int = 2,
    backend: str = "loky",
    address: str | None = None,
) -> Season | None:
    """Close a season, or resume its closing with the same result.

    Args:
        closing: what to close.
        out: the season's folder; ``season.yml`` is written last.
        sides: train the candidates of these sides only; the season is closed once both are there.
        n_jobs, backend, address: see :func:`fpg_bench.common.parallel.run_jobs`.

    Returns:
        The season; None while candidates of the other side are missing.

    Raises:
        UserError: the season is closed already, a side without entries, a folder with candidates of another
            closing, a candidate that failed, or one whose actions are not numbers.
        KeyboardInterrupt: stopped by the user.
    """
    if (out / FILE).exists():
        raise UserError(f"season: {out} is closed already; the next one has another number")
    with _at_work(closing.work, sides):
        _check_plan(closing)
        jobs = [_candidate_job(closing, recipe) for side in sides for recipe in closing.recipes(side)]
        done = sum(job.done() for job in jobs)
        _logger.info(f"{closing.name}, seed {closing.seed[:16]}: {len(jobs)} candidates, {done} of them done")
        check_all_done(run_jobs(jobs, n_jobs, backend, address))
        missing = [
            side
            for side in SIDES
            if not all(_candidate_job(closing, recipe).done() for recipe in closing.recipes(side))
        ]
        if missing:
            sides_missing = " and ".join(missing)
            _logger.info(
                f"{closing.name}: candidates of the {sides_missing} are not there yet; it is not closed"
            )
            return None
        return _publish(closing, out, {side: _select_members(closing, side) for side in SIDES})


@contextlib.contextmanager
def _at_work(work: Path, sides: Sequence[str]) -> Iterator[None]:
    """Hold the candidates of these sides for this process.

    Two processes would both play the entries against a candidate, which then would never be complete.

    Raises:
        UserError: another process holds them.
    """
    with contextlib.ExitStack() as held:
        for side in sides:
            try:
                held.enter_context(RowFile(work / f"at-work-{side}").locked())
            except UserError as error:
                raise UserError(
                    f"season: another process trains candidates of the {side} in {work}; wait for its end"
                ) from error
        yield


def _check_plan(closing: Closing) -> None:
    """Store the plan in the working folder; raise UserError where the folder belongs to another closing."""
    file = closing.work / PLAN
    plan = {"seed": closing.seed, "candidates": closing.candidates, "scenario": closing.scenario}
    if not file.exists():
        write_whole(file, "".join(f"{key}: {value}\n" for key, value in plan.items()))
    stored = read_yaml(file, "closing")
    for key, value in plan.items():
        if stored.get(key) != value:
            raise UserError(
                f"season: {closing.work} holds candidates of another closing ({key}: {stored.get(key)}, "
                f"now {value}; a seed changes with the entries); choose another folder"
            )


def _candidate_job(closing: Closing, recipe: Recipe) -> Job:
    folder = closing.folder(recipe)
    players = [
        (entry.name, recipe.path if recipe.side == "opponent" else entry.path, player)
        for entry in closing.rival_entries(recipe.side)
        for player in entry.players
    ]
    players += [(PROBE, recipe.path, script) for script in PROBES[recipe.side]]
    make = partial(_make_candidate, closing, recipe, players)
    return folder_job(
        f"{recipe.side}/{recipe.name}", folder, make, partial(_is_complete, folder, len(players))
    )


def _make_candidate(
    closing: Closing, recipe: Recipe, players: list[tuple[str, str, str]], folder: Path
) -> None:
    """Train a candidate and play all entries against it; finished parts are kept."""
    train_candidate(recipe, folder, closing.scenario)
    file = RowFile(folder / PROFILE)
    played = {(row["entry"], row["player"]) for row in file.read()}
    for entry, path, player in players:
        if (entry, player) not in played:
            means = play_candidate(
                player,
                other_side(recipe.side),
                str(folder / "agent"),
                path,
                closing.seed,
                closing.scenario,
            )
            file.append([{"entry": entry, "player": player, "n": ROUNDS, **means}])


def _is_complete(folder: Path, n_players: int) -> bool:
    return RunFolder(folder).is_finished() and len(RowFile(folder / PROFILE).read()) == n_players


def play_candidate(
    player: str | Player,
    side: str,
    other: str,
    path: str,
    season: str,
    scenario: str = "standard",
) -> dict[str, float]:
    """Play a player against one of the other side.

    Args:
        player: a name, or an object with ``predict``.
        side: its side.
        other: the name of its rival.
        path: the opponent's path.
        season: the season's seed, which gives the evaluation seeds.
        scenario: the preset.

    Returns:
        Mean return per step of both sides, by side. The player's own counts rounds that it lost by an invalid
        answer as :func:`fpg_bench.evaluation.play.play` does.

    Raises:
        UserError: an unknown player, or one of the wrong side.
    """
    preset = as_scenario(scenario)
    rival = Rival("season", (other,), as_scenario(preset, opponent_path=path))
    suite = Suite("season", side, preset, ROUNDS, (rival,), season=season, scale=_scale(side, scenario))
    try:
        record = play(player_entry(as_player(player, side, rival.scenario)), suite, rival)
    except UserError as error:
        raise UserError(f"{player} against {other}: {error}") from error
    means = {name: record.tally[f"{name}_return"] / record.tally["steps"] for name in SIDES}
    if record.lost:
        means[side] = statistics.fmean(record.returns) / preset.steps_per_round
    return {name: round(value, 6) for name, value in means.items()}


@cache
def _scale(side: str, scenario: str) -> Scale:
    """Return the scale of a side's public suite, on which a lost round has its score."""
    path = "pursuit" if side == "opponent" else None
    return load_suite(track_of(side, path, scenario).public).scale


def _select_members(closing: Closing, side: str) -> tuple[SeasonMember, ...]:
    recipes = closing.recipes(side)
    profiles = [RowFile(closing.folder(recipe) / PROFILE).read() for recipe in recipes]
    other = other_side(side)
    returns = np.array([[row[other] for row in rows if row["entry"] != PROBE] for rows in profiles]).T
    probes = [{row["player"]: row[other] for row in rows if row["entry"] == PROBE} for rows in profiles]
    first, second = PROBES[side]
    groups: list[str] | None = None
    size = min(closing.size, len(recipes))
    if closing.number is None:
        selected = select_diverse(returns, size)
    else:
        groups = halves(returns, np.array([earned[first] - earned[second] for earned in probes]), side)
        selected = select_by_halves(returns, groups, size)
    members = []
    for index in selected:
        about = read_json(closing.folder(recipes[index]) / "agent" / "agent.json", "agent")
        earn = round(statistics.fmean(returns[:, index]), 3)
        member = dict(recipes[index]) | {"policy_sha256": about["policy_sha256"], "entries_earn": earn}
        member |= {} if groups is None else {"group": groups[index]}
        members.append(SeasonMember(**member))
    return tuple(members)


def _publish(closing: Closing, out: Path, members: dict[str, tuple[SeasonMember, ...]]) -> Season:
    """Copy the members, write the suites of a season's tracks, and ``season.yml`` last."""
    first = closing.folder(members["opponent"][0])
    season = Season(
        folder=out,
        name=closing.name,
        number=closing.number,
        protocol=PROTOCOL,
        seed=closing.seed,
        candidates=dict.fromkeys(SIDES, closing.candidates),
        entries={entry.name: list(entry.hashes) for entry in closing.entries},
        members=members,
        versions=read_json(first / "run.json", "run")["versions"],
        scenario=closing.scenario,
    )
    for side in SIDES:
        shutil.rmtree(out / side, ignore_errors=True)  # left by a closing that was killed here
    for side, member in season.all_members():
        for file in ("agent.json", "policy.onnx"):
            data = (closing.folder(member) / "agent" / file).read_bytes()
            write_whole(season.agent(side, member) / file, data)
    if closing.number is not None:
        write_suites(season, closing.number)
    write_season(season)
    return season
