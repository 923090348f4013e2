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

from fpg_bench.common.errors import UserError, other_content
from fpg_bench.common.files import read_json, read_yaml, write_whole
from fpg_bench.common.ids import other_side, policy_env
from fpg_bench.common.parallel import Job, check_all_done, folder_job, run_jobs
from fpg_bench.common.rows import RowFile
from fpg_bench.evaluation.entry import EvaluatedPlayer
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.record import Record
from fpg_bench.evaluation.seeds import PROTOCOL, season_label
from fpg_bench.evaluation.store import RECORDS, Pairing, Store
from fpg_bench.evaluation.suite import Rival, Scale, Suite, load_suite
from fpg_bench.game.scenario import as_scenario
from fpg_bench.game.spec import GameSpec
from fpg_bench.leaderboard.season import (
    FILE,
    Recipe,
    Season,
    SeasonEntry,
    SeasonMember,
    entries_of_side,
    load_season,
    read_entries,
    season_seed,
    write_season,
    write_suites,
)
from fpg_bench.leaderboard.tracks import SCENARIOS, track_of
from fpg_bench.players.agent import read_card
from fpg_bench.players.player import SIDES, Player
from fpg_bench.players.registry import as_player, named_card
from fpg_bench.training.config import RunConfig
from fpg_bench.training.run_folder import RunFolder
from fpg_bench.training.train import train

_logger = logging.getLogger(__name__)

CANDIDATES, SIZE = 24, 12
ROUNDS = 60  # of each entry against each candidate
PROFILE, PLAN, PROBE = RECORDS, "plan.yml", "probe"
# Groups of each side's candidates. Against the first, the first script of PROBES leads the second by more.
# Herders keep an ally hopping, so the best answer is to stay; aimers jam where it is, so it has to hop.
# Herdable allies hop into a jammer that alternates between both halves of the band; evasive ones do not.
GROUPS = {"opponent": ("herders", "aimers"), "ally": ("herdable", "evasive")}
PROBES = {"opponent": ("idle", "expert"), "ally": ("alternate", "tone")}

# Rewards of candidates. Allies have no ally_cost: trained to save cost they never hop, like the script idle.
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
FIRST_SEED, SEEDS = 300_000, 700_000  # candidates have the training seeds from 300,000 to 999,999
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
_DECILES = (0.1, 0.9)
T = TypeVar("T")


def draw_number(below: int, *key: object) -> int:
    """Draw a whole number in [0, below) from the hash of a key."""
    return int(_digest(*key), 16) % below


def shuffled(items: Sequence[T], *key: object) -> list[T]:
    """Return the items in an order drawn from a key."""
    order = sorted(range(len(items)), key=lambda i: _digest(*key, i))
    return [items[i] for i in order]


def assign_balanced(values: Sequence[T], count: int, *key: object) -> list[T]:
    """Assign values to ``count`` places in an order drawn from a key.

    Each value is assigned equally often; if they do not divide evenly, the first ones once more.
    """
    return shuffled([values[i % len(values)] for i in range(count)], *key)


def _digest(*key: object) -> str:
    return hashlib.sha256("/".join(map(str, key)).encode()).hexdigest()


def draw_recipes(seed: str, side: str, count: int, entries: Sequence[SeasonEntry]) -> list[Recipe]:
    """Draw the recipes of a side's candidates.

    Algorithms take turns. The values of all other properties are balanced over the candidates of an
    algorithm, so the seed decides only how they are combined.

    Args:
        seed: the season's seed.
        side: the candidates' side.
        count: number of candidates.
        entries: entries of the other side, to be trained against.

    Raises:
        UserError: no entries to train against.
    """
    if not entries:
        raise UserError(f"season: no entries to train candidates of the {side} against")
    algorithms = [ALGORITHMS[i % len(ALGORITHMS)] for i in range(count)]

    def assign(name: str, choices: Mapping[str, Sequence[T]] | Sequence[T]) -> list[T]:
        """Return a property's value for each candidate; choices may depend on the algorithm."""
        per_algorithm = {}
        for algorithm, number in Counter(algorithms).items():
            values = choices[algorithm] if isinstance(choices, Mapping) else choices
            per_algorithm[algorithm] = iter(assign_balanced(values, number, seed, side, name, algorithm))
        return [next(per_algorithm[algorithm]) for algorithm in algorithms]

    rewards, gammas, steps = assign("reward", REWARDS[side]), assign("gamma", GAMMAS), assign("steps", STEPS)
    log_stds = assign("log_std", LOG_STDS[side])
    targets = _draw_targets(seed, side, assign("size", TARGETS), entries)
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

    The first target is a trained entry if there is any, and each trained entry is the first target equally
    often. Opponents with different paths are never mixed; scripts fit either path.
    """
    trained = [entry for entry in entries if not entry.is_script] or list(entries)
    targets = []
    for i, (first, size) in enumerate(
        zip(assign_balanced(trained, len(sizes), seed, side, "first"), sizes, strict=True)
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
    """Train a candidate and keep only its agent, its run's rows, and who has met it.

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
        GameSpec.of(
            policy_env(recipe.side).id,
            against=recipe.targets,
            reward=recipe.reward,
            path=recipe.path,
            scenario=None if scenario == "standard" else scenario,
        ),
        recipe.training_seed,
        recipe.steps,
        hyperparameters(recipe),
    )
    if not RunFolder(folder).is_finished():
        (folder / PROFILE).unlink(missing_ok=True)
        train(run, folder, evaluations=0, progress=False, restart=True)
    for path in folder.iterdir():
        if path.name not in ("agent", "run.json", "evaluations.jsonl", PROFILE):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def entry_returns(profiles: Sequence[Sequence[Mapping[str, Any]]], side: str) -> np.ndarray:
    """Return what each entry earns against each candidate, ``(entries, candidates)``.

    Entries have one row each, the mean over their training seeds.

    Args:
        profiles: the rows of each candidate's profile.
        side: the side of the entries.
    """
    columns = []
    for rows in profiles:
        by_entry: dict[str, list[float]] = {}
        for row in rows:
            if row["entry"] != PROBE:
                by_entry.setdefault(row["entry"], []).append(row[side])
        columns.append([statistics.fmean(values) for _, values in sorted(by_entry.items())])
    return np.array(columns).T


def limit_influence(returns: np.ndarray) -> np.ndarray:
    """Return the returns with those against each candidate clipped to their first and last decile.

    An entry that loses its rounds against candidates of its choice would otherwise decide which are alike.
    """
    _check_finite(returns)
    low, high = np.quantile(returns, _DECILES, axis=0)
    limited: np.ndarray = np.clip(returns, low, high)
    return limited


def group_candidates(returns: np.ndarray, leads: np.ndarray, side: str) -> list[str]:
    """Cluster the candidates of a side into two groups by the returns against them, and name the groups.

    Ward's hierarchical clustering of the candidates' standardised profiles of returns. Their distance
    follows from their correlation, so it depends on which players do well, not on how well all do. The
    groups may differ in size.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``; see
            :func:`entry_returns`.
        leads: for each candidate, by how much the first script of :data:`PROBES` earns more than the second.
        side: the candidates' side.

    Returns:
        The name of each candidate's group; the group with the larger mean lead has the first name in
        :data:`GROUPS`.

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


def select_by_group(returns: np.ndarray, groups: Sequence[str], size: int) -> list[int]:
    """Select equally many candidates from each group, which represent it.

    The mean over the suite then gives the groups equal weight, whatever their shares of the candidates.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``; see
            :func:`entry_returns`.
        groups: the group of each candidate.
        size: number of candidates to select. Fewer are selected, with a warning, if the smallest group does
            not have enough candidates, or if the groups do not divide it.

    Returns:
        Their indices, group by group.

    Raises:
        UserError: see :func:`select_representative`.
    """
    by_group = {name: [i for i, group in enumerate(groups) if group == name] for name in sorted(set(groups))}
    per_group = min(size // len(by_group), *map(len, by_group.values()))
    if per_group * len(by_group) < size:
        counts = ", ".join(f"{len(members)} {name}" for name, members in by_group.items())
        _logger.warning(
            f"season: selected {per_group * len(by_group)} members instead of {size}, from {counts}"
        )
    return [
        members[index]
        for members in by_group.values()
        for index in select_representative(returns[:, members], per_group)
    ]


def select_representative(returns: np.ndarray, size: int) -> list[int]:
    """Select candidates against which players earn about what they earn against all candidates.

    Starts with the strongest candidate, against which players earn least. Each further one brings the mean
    returns against the selection nearest to those against all candidates.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``; see
            :func:`entry_returns`.
        size: number of candidates to select.

    Returns:
        Their indices in the order of selection.

    Raises:
        UserError: too few candidates, or returns that are not finite.
    """
    _check_selection(returns, size)
    selected = [_strongest(returns)]
    overall = returns.mean(axis=1)
    while len(selected) < size:
        sums = returns[:, selected].sum(axis=1)[:, None] + returns
        distances = np.linalg.norm(sums / (len(selected) + 1) - overall[:, None], axis=0)
        distances[selected] = np.inf
        selected.append(int(distances.argmin()))
    return selected


def select_diverse(returns: np.ndarray, size: int) -> list[int]:
    """Select a training population whose members differ in the returns against them.

    Starts with the strongest candidate. Each further one has the profile of returns that is farthest from
    all selected ones (greedy max-min distance). Arguments, result and errors are those of
    :func:`select_representative`.
    """
    _check_selection(returns, size)
    selected = [_strongest(returns)]
    distances = np.linalg.norm(returns[:, :, None] - returns[:, None, :], axis=0)
    while len(selected) < size:
        nearest = distances[:, selected].min(axis=1)
        nearest[selected] = -1.0
        selected.append(int(nearest.argmax()))
    return selected


def _check_selection(returns: np.ndarray, size: int) -> None:
    count = returns.shape[1]
    if size > count:
        raise UserError(f"season: cannot select {size} members from {count} candidates")
    _check_finite(returns)


def _strongest(returns: np.ndarray) -> int:
    """Return the index of the candidate against which players earn least."""
    return int(returns.mean(axis=0).argmin())


def _check_finite(returns: np.ndarray) -> None:
    if not np.isfinite(returns).all():
        raise UserError("season: an entry has a return that is not finite")


@dataclass(frozen=True)
class Closing:
    """Settings of the closing of a season.

    Attributes:
        name: name of the season suite, such as ``season-1``.
        number: the season's number; None for a training population.
        entries: the entries that the season is closed over.
        work: folder of the candidates, which is kept so that an interrupted closing can be resumed.
        candidates, size: number of trained and of selected candidates per side.
        scenario: the preset that entries and candidates play.
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
        """The season's seed; for a training population, it follows from the name instead of a number."""
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
    """Return the settings for closing a season (by number) or a training population (by name).

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
        closing: settings of the closing.
        out: the season's folder; ``season.yml`` is written last.
        sides: train candidates of these sides only; the season is closed once those of both are trained.
        n_jobs, backend, address: see :func:`fpg_bench.common.parallel.run_jobs`.

    Returns:
        The season; None while candidates of the other side are missing.

    Raises:
        UserError: the season is closed already, a side has no entries, another process is closing the
            season, the folder holds candidates of another closing, a candidate could not be trained, or its
            actions are not finite.
        KeyboardInterrupt: stopped by the user.
    """
    if (out / FILE).exists():
        raise UserError(f"season: {out} is closed already; choose another number, name or folder")
    with contextlib.ExitStack() as locks:
        for side in sides:  # otherwise two processes would both fill a profile, which never becomes complete
            locks.enter_context(_lock(closing.work, side, f"is training candidates of the {side}"))
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
            _logger.info(f"{closing.name}: not closed yet: candidates of the {sides_missing} are missing")
            return None
        locks.enter_context(_lock(closing.work, "publish", f"is publishing {closing.name}"))
        if (out / FILE).exists():  # by a process that trained the other side
            return load_season(out)
        return _publish(closing, out, {side: _select_members(closing, side) for side in SIDES})


@contextlib.contextmanager
def _lock(work: Path, task: str, doing: str) -> Iterator[None]:
    """Lock one task of a closing for this process.

    Args:
        work: folder of the candidates.
        task: a side, or ``publish``.
        doing: text for the error: what another process is doing.

    Raises:
        UserError: another process holds the lock.
    """
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(RowFile(work / f"at-work-{task}").locked())
        except UserError as error:
            raise UserError(f"season: another process {doing} in {work}; wait until it ends") from error
        yield


def _check_plan(closing: Closing) -> None:
    """Store the closing's seed and settings in its folder; raise UserError if it belongs to another one."""
    file = closing.work / PLAN
    plan = {"seed": closing.seed, "candidates": closing.candidates, "scenario": closing.scenario}
    if not file.exists():
        write_whole(file, "".join(f"{key}: {value}\n" for key, value in plan.items()))
    stored = read_yaml(file, "closing")
    for key, value in plan.items():
        if stored.get(key) != value:
            raise other_content(
                f"season: {closing.work}",
                f"candidates of another closing ({key}: {stored.get(key)}, now {value}; a seed changes with "
                "the entries)",
            )


def _candidate_job(closing: Closing, recipe: Recipe) -> Job:
    folder = closing.folder(recipe)
    make, done = partial(_make_candidate, closing, recipe), partial(_is_complete, closing, recipe)
    return folder_job(f"{recipe.side}/{recipe.name}", folder, make, done)


def _make_candidate(closing: Closing, recipe: Recipe, folder: Path) -> None:
    """Train a candidate and play all entries and probes against it; skips what is done already."""
    train_candidate(recipe, folder, closing.scenario)
    side = other_side(recipe.side)

    def against(player: str, path: str, name: str, number: int | None = None) -> Pairing:
        where = str(folder / "agent"), path, closing.seed, closing.scenario
        return against_candidate(player, side, *where, name=name, number=number)

    wanted = [
        against(player, recipe.path if recipe.side == "opponent" else entry.path, entry.name, number)
        for entry in closing.rival_entries(recipe.side)
        for number, player in enumerate(entry.players)
    ]
    wanted += [against(script, recipe.path, PROBE) for script in PROBES[recipe.side]]
    Store(folder / PROFILE).fill(wanted, play_candidate)


def _is_complete(closing: Closing, recipe: Recipe) -> bool:
    folder, entries = closing.folder(recipe), closing.rival_entries(recipe.side)
    count = sum(len(entry.players) for entry in entries) + len(PROBES[recipe.side])
    return RunFolder(folder).is_finished() and len(Store(folder / PROFILE).records()) == count


def against_candidate(
    player: str,
    side: str,
    candidate: str,
    path: str,
    seed: str,
    scenario: str = "standard",
    *,
    name: str | None = None,
    number: int | None = None,
) -> Pairing:
    """Return the pairing of a player of an entry with a candidate.

    Args:
        player: its name.
        side: the player's side.
        candidate: the candidate's name, or the folder of its agent.
        path: the opponent's path.
        seed: the season's seed, from which the evaluation seeds follow.
        scenario: the preset.
        name: the entry's name; None: the player's.
        number: of the entry's players; None: it has a single one.

    Raises:
        UserError: an unknown player, or one of the wrong side.
    """
    preset = as_scenario(scenario)
    rival = Rival("season", (candidate,), as_scenario(preset, opponent_path=path))
    suite = Suite("season", side, preset, ROUNDS, (rival,), season=seed, scale=_scale(side, scenario))
    card = named_card(player, side)
    fingerprint = player if card is None else card.policy_sha256
    entry = EvaluatedPlayer(name or player, number, fingerprint, partial(_load, player, side))
    return Pairing(entry, suite, rival)


def _load(player: str, side: str, rival: Rival) -> Player:
    """Return a player when its turn has come: all of a board's policies at once would fill the memory."""
    return as_player(player, side, rival.scenario)


def play_candidate(entry: EvaluatedPlayer, suite: Suite, rival: Rival, **more: Any) -> Record:
    """Play a pairing of :func:`against_candidate`; the error of one that cannot be played names both."""
    try:
        return play(entry, suite, rival, **more)
    except UserError as error:
        raise UserError(f"{entry.name} against {rival.players[0]}: {error}") from error


def earned(record: Record, side: str, scenario: str = "standard") -> dict[str, float]:
    """Return the mean return per step of both sides, by side, where a player of a side met a candidate.

    In the player's own mean, rounds that it lost by an invalid answer count as in
    :func:`fpg_bench.evaluation.play.play`.
    """
    means = {name: record.tally[f"{name}_return"] / record.tally["steps"] for name in SIDES}
    if record.lost:
        means[side] = statistics.fmean(record.returns) / as_scenario(scenario).steps_per_round
    return {name: round(value, 6) for name, value in means.items()}


@cache
def _scale(side: str, scenario: str) -> Scale:
    """Return the scale of a side's public suite, which gives a lost round its return."""
    path = "pursuit" if side == "opponent" else None
    return load_suite(track_of(side, path, scenario).public).scale


def _profile(closing: Closing, recipe: Recipe) -> list[dict[str, Any]]:
    """Return a row of each player that met a candidate: its entry, and what both sides earned."""
    side = other_side(recipe.side)
    return [
        {"entry": record.entry, "player": record.fingerprint} | earned(record, side, closing.scenario)
        for record in Store(closing.folder(recipe) / PROFILE).records()
    ]


def _select_members(closing: Closing, side: str) -> tuple[SeasonMember, ...]:
    recipes = closing.recipes(side)
    profiles = [_profile(closing, recipe) for recipe in recipes]
    other = other_side(side)
    returns = entry_returns(profiles, other)
    limited = limit_influence(returns)
    probes = [{row["player"]: row[other] for row in rows if row["entry"] == PROBE} for rows in profiles]
    first, second = PROBES[side]
    groups: list[str] | None = None
    size = min(closing.size, len(recipes))
    if closing.number is None:
        selected = select_diverse(limited, size)
    else:
        groups = group_candidates(
            limited, np.array([earned[first] - earned[second] for earned in probes]), side
        )
        selected = select_by_group(limited, groups, size)
    members = []
    for index in selected:
        card = read_card(closing.folder(recipes[index]) / "agent")
        earn = round(statistics.fmean(returns[:, index]), 3)
        member = dict(recipes[index]) | {"policy_sha256": card.policy_sha256, "entries_earn": earn}
        member |= {} if groups is None else {"group": groups[index]}
        members.append(SeasonMember(**member))
    return tuple(members)


def _publish(closing: Closing, out: Path, members: dict[str, tuple[SeasonMember, ...]]) -> Season:
    """Copy the members and write the suites of the season's tracks; ``season.yml`` is written last."""
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
