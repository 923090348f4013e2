"""Agents: trained policies as folders of ``agent.json`` and ``policy.onnx``, played and written."""

from __future__ import annotations

import hashlib
import logging
import os
import re
from collections.abc import Iterable, Iterator
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fpg_bench.common.errors import UserError, first_line, meant, nearest, one_line
from fpg_bench.common.extras import has, require_extra
from fpg_bench.common.files import as_path, read_bounded, read_json
from fpg_bench.common.imports import SUITE
from fpg_bench.common.products import files_of_products, load
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.spec import GameSpec, OtherGame, kind_of, observation_size, option_names
from fpg_bench.players.card import FILE, AgentCard
from fpg_bench.players.onnx_file import check_signature, plain_model, read_form, unplayable
from fpg_bench.players.player import SIDES, Memory, Player, PlayerSpec, Prediction
from fpg_bench.players.remote import fetch, is_remote
from fpg_bench.players.seeded import SeededPolicy
from fpg_bench.players.trust import is_exported_here, remember_exported

_MOST_POLICY = 2**28  # bytes
_ROWS, _STEPS, _NEAR = 8, 4, 1e-4  # of observations that check an answer, and how far it may be off
_SEED = re.compile(r"seed_(\d+)")
_logger = logging.getLogger(__name__)


class AgentPlayer(Player, Protocol):
    """Player of an agent: an :class:`OnnxPlayer`, or one in the sandbox.

    Attributes:
        model: the bytes of ``policy.onnx``.
        card: the agent's card.
    """

    model: bytes
    card: AgentCard | None


class OnnxPlayer(SeededPolicy):
    """Plays a policy through onnxruntime on one thread, with the same bits for any batch size.

    The operators must show that games are independent of each other; see
    :mod:`fpg_bench.players.onnx_file`. Without ``onnx`` (extra ``evaluate``), which reads them, a file is
    played as it is. A file of the user's own may have others, and is then played game by game.

    Inputs ``observation`` (n, 15), of a seat of a team as many as its game has, optional ``state`` (n, S),
    optional ``noise`` (n, k), standard normal numbers of the round's own stream; outputs ``action`` (n, 9)
    and, with a state, ``next_state`` (n, S); float32.

    Args:
        model: the bytes of ``policy.onnx``.
        card: the agent's card; None for a policy without one.
        size: how many numbers it observes; None: as many as the card's game has.
        is_own: whether the file is the user's own.

    Attributes:
        state_size, noise_size: 0 where the policy has none.
        outside: why games are played one by one; None: they are not.

    Raises:
        UserError: not an ONNX file, one in another form or that onnxruntime cannot read, or one with other
            inputs or outputs.
    """

    outside: UserError | None = None

    def __init__(
        self, model: bytes, card: AgentCard | None = None, size: int | None = None, is_own: bool = False
    ) -> None:
        self.model, self.card, self._is_own = model, card, is_own
        self.size = size or observation_size(None if card is None else card.game)
        if card is not None and isinstance(card.game, OtherGame):
            self.sees, self.skills = card.game.sees, card.skills
        read, self.outside = _read(model) if has("onnx") else (model, None)
        if self.outside is not None and not is_own:
            raise self.outside
        inputs, outputs = self._open(read)
        check_signature(inputs, outputs, self.size)

    def _open(self, model: bytes) -> tuple[dict[str, list[Any]], dict[str, list[Any]]]:
        """Open a session; returns the shapes of its inputs and outputs."""
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        options.add_session_config_entry("session.load_model_format", "ONNX")  # no bytes choose another
        try:
            self._session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises many kinds, none documented
            raise UserError(f"policy.onnx: onnxruntime cannot read it: {first_line(error)}") from error
        inputs = {i.name: i.shape for i in self._session.get_inputs()}
        outputs = {o.name: o.shape for o in self._session.get_outputs()}
        self.state_size = inputs["state"][1] if "state" in inputs else 0
        self.noise_size = inputs["noise"][1] if "noise" in inputs else 0
        self._outputs = ["action", "next_state"] if self.state_size else ["action"]
        return inputs, outputs

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        count = len(seen)
        memory, steps = (None, np.zeros(count, np.int64)) if state is None else state
        feeds = {"observation": np.ascontiguousarray(seen, np.float32)}
        if self.state_size:
            memory = np.zeros((count, self.state_size), np.float32) if memory is None else memory.copy()
            if starts is not None:
                memory[starts] = 0
            feeds["state"] = memory
        if self.noise_size:
            steps = steps.copy() if starts is None else np.where(starts, 0, steps)
            feeds["noise"] = self._noise(steps)
        actions, *memory = self.run(feeds)
        if not self.state_size and not self.noise_size:
            return actions, None
        return actions, (memory[0] if self.state_size else None, steps + 1)

    def run(self, feeds: dict[str, np.ndarray]) -> list[np.ndarray]:
        """Return the outputs of the policy by the names of its inputs."""
        if self.outside is None:
            return list(self._session.run(self._outputs, feeds))
        rows = zip(*(np.split(of, len(of)) for of in feeds.values()), strict=True)
        answers = (self._session.run(self._outputs, dict(zip(feeds, row, strict=True))) for row in rows)
        return [np.concatenate(each) for each in zip(*answers, strict=True)]

    def check_answers(self) -> None:
        """Answer drawn observations in one batch and one by one, over a few steps.

        Raises:
            UserError: the policy fails, or its answer to a game depends on the other games of a batch.
        """
        rng = np.random.default_rng(0)
        feeds = {"state": np.zeros((_ROWS, self.state_size), np.float32)} if self.state_size else {}
        for _ in range(_STEPS):
            feeds["observation"] = rng.uniform(-1, 1, (_ROWS, self.size)).astype(np.float32)
            feeds["observation"][:3] = np.array([[-1], [0], [1]])
            if self.noise_size:
                feeds["noise"] = rng.standard_normal((_ROWS, self.noise_size), np.float32)
            try:
                together = self._session.run(self._outputs, feeds)
                alone = [self.run({name: of[k : k + 1] for name, of in feeds.items()}) for k in range(_ROWS)]
            except Exception as error:  # onnxruntime's, of any kind
                raise UserError(f"policy.onnx: fails in play: {one_line(error)}") from error
            for answers, other in zip(together, zip(*alone, strict=True), strict=True):
                if not np.allclose(answers, np.concatenate(other), _NEAR, _NEAR, equal_nan=True):
                    raise UserError("policy.onnx: its answer to one game depends on the batch that it is in")
            feeds |= {"state": together[1]} if self.state_size else {}

    def _noise(self, steps: np.ndarray) -> np.ndarray:
        from fpg_bench.players.scripted import fill_noise  # its compiler is slow to load, and few draw

        noise = np.empty((len(steps), self.noise_size), np.float32)
        fill_noise(noise, self.keys(len(steps)), steps)
        return noise

    def __reduce__(self) -> tuple[type[OnnxPlayer], tuple[bytes, AgentCard | None, int, bool]]:
        return type(self), (self.model, self.card, self.size, self._is_own)

    def __repr__(self) -> str:
        return "OnnxPlayer()" if self.card is None else f"OnnxPlayer({self.card})"


def load_agent(
    name: str | os.PathLike[str], side: str | None = None, *, trusted: bool | None = None
) -> AgentPlayer:
    """Load a trained agent as a player, without torch or Stable-Baselines3.

    >>> agent = load_agent("ally-scripted/ppo/seed_0")
    >>> actions, state = agent.predict(np.zeros((2, 15), np.float32))
    >>> actions.shape
    (2, 9)

    Args:
        name: a shipped agent (``ally-scripted/ppo/seed_0``), an agent folder, or ``hf://owner/name@revision``.
        side: the side that it is to play; None: whichever it was trained for.
        trusted: True: its policy plays in this process. False: in a sandbox, with the same results. None:
            agents of the package and those that this user exported are trusted; see
            :mod:`fpg_bench.players.trust`.

    Raises:
        UserError: no such agent, a file missing, truncated or changed, another format, id, size or side; for
            the Hub also as :func:`fpg_bench.products.hub.download.download`.
    """
    folder = agent_folder(name)
    where = f"agent {name if is_remote(name) else folder}"
    card = AgentCard.parse(read_json(folder / FILE, "agent"), where, side)
    model = read_bounded(folder / "policy.onnx", "agent", _MOST_POLICY)
    if not card.describes(model):
        raise UserError(f"{where}: policy.onnx is not the file that agent.json describes (sha256)")
    if trusted is None:
        trusted = is_shipped(folder) or is_exported_here(card.policy_sha256)
    if not trusted and isinstance(card.game, OtherGame):
        raise UserError(
            f"{where}: plays {card.game.id}, and agents of others play the duel alone, in a sandbox; if "
            "you trust it, load_agent(..., trusted=True)"
        )
    try:
        if trusted:
            return OnnxPlayer(model, card, is_own=True)
        sandboxed: AgentPlayer = load("agent", "untrusted")(model, card)
        return sandboxed
    except UserError as error:
        raise UserError(f"{where}: {error}") from error


def read_card(name: str | os.PathLike[str]) -> AgentCard:
    """Return the card of an agent, by its name or folder, without its policy.

    Raises:
        UserError: no such agent, or an invalid ``agent.json``.
    """
    return AgentCard.read(agent_folder(name) / FILE)


def agent_folder(name: str | os.PathLike[str]) -> Path:
    """Return the folder of a shipped agent or of a path; an agent on the Hub is downloaded.

    Raises:
        UserError: neither exists.
    """
    as_path(name, "agent")
    where = f"agent {(home := os.fspath(name))!r}"
    if is_remote(name):
        return fetch(home).folder
    if home.endswith(".zip"):
        raise UserError(f"{where}: SB3's zip holds pickled code; name the run's agent folder")
    for folder in _places(name):
        for inside in (folder / "agent", folder):
            if all((inside / side).is_dir() for side in SIDES):
                both = " and ".join(str(inside / side) for side in SIDES)
                raise UserError(f"{where}: holds agents of both sides, {both}; name one")
        if (folder / "agent" / "agent.json").is_file():
            raise UserError(f"{where}: is a run's folder; the agent is {folder / 'agent'}")
        if seeds := seed_folders(folder):
            example = f"{seeds[0].name} for instance"
            raise UserError(f"{where}: holds {len(seeds)} training seeds; name one, {example}")
        if groups := [path.name for path in sorted(folder.glob("*")) if seed_folders(path)]:
            example = f"{home.rstrip('/')}/{groups[0]} for instance"
            raise UserError(f"{where}: is a group of {', '.join(groups)}; name one, {example}")
        if folder.is_dir():
            if not (folder / FILE).exists():
                raise UserError(f"{where}: the folder holds none; is its run finished?")
            return folder
    agents = baselines_folder() / "agents"
    seeds = [path.parent.relative_to(agents) for path in agents.glob(f"*/*/*/{FILE}")]
    near = meant(home, {path.as_posix() for seed in seeds for path in (seed, seed.parent)})
    raise UserError(f"{where}: neither a shipped agent nor a folder{near}")


def agents_of(side: str) -> list[str]:
    """Return the names of the shipped agents of a side, with training seeds grouped: ``seed_{0,1}``."""
    agents = baselines_folder() / "agents"
    groups = {
        folder.parent
        for pattern in (f"{side}-*", f"duel*-{side}")
        for folder in agents.glob(f"{pattern}/*/seed_*")
    }
    names = []
    for group in sorted(groups):
        seeds = ",".join(folder.name.removeprefix("seed_") for folder in seed_folders(group))
        names.append(f"{group.relative_to(agents).as_posix()}/seed_{{{seeds}}}")
    return names


def is_shipped(name: str | os.PathLike[str]) -> bool:
    """Return True if a player is an agent of the package."""
    place = next(filter(Path.is_dir, _places(name)), None)
    return place is not None and baselines_folder().resolve() in place.resolve().parents


def agents_named(name: str, side: str) -> list[str]:
    """Return the agents that a name stands for: those of all training seeds of a group or of a list of runs.

    Args:
        name: a shipped group (``ally-scripted/sac``), a folder with ``seed_0``, ``seed_1`` and so on, a run's
            folder, or any other player, which is returned as it is.
        side: the side to choose where a run trained both.

    Raises:
        UserError: a training seed has no agent yet.
    """
    for folder in _places(name):
        home = name.rstrip("/")
        if seeds := seed_folders(folder):
            found = {seed.name: _agent_within(seed, side) for seed in seeds}
            if missing := [seed for seed, inside in found.items() if inside is None]:
                raise UserError(f"agents {name!r}: {', '.join(missing)} has no agent; is its run finished?")
            return [f"{home}/{seed}{inside}" for seed, inside in found.items()]
        if folder.is_dir():
            return [f"{home}{_agent_within(folder, side) or ''}"]
    return [name]


def _places(name: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield the folders that a name may mean."""
    yield from (Path(name), baselines_folder() / "agents" / name, suites_folder() / name)


def seed_folders(folder: Path) -> list[Path]:
    """Return the folders of training seeds in a folder that is not an agent, in their order."""
    if (folder / "agent.json").exists() or (folder / "agent").exists():
        return []
    seeds = [path for path in folder.glob("seed_*") if _SEED.fullmatch(path.name) and path.is_dir()]
    return sorted(seeds, key=lambda path: int(path.name.removeprefix("seed_")))


def _agent_within(folder: Path, side: str) -> str | None:
    """Return where the agent of a side lies in its own folder or a run's; None if there is none."""
    for inside in ("", "/agent", f"/{side}", f"/agent/{side}"):
        if Path(f"{folder}{inside}", "agent.json").is_file():
            return inside
    return None


def baselines_folder() -> Path:
    """Return the folder of hyper-parameters and shipped agents, installed or in the repository."""
    package = Path(str(resources.files("fpg_bench")))
    installed = package / "baselines"
    return installed if installed.is_dir() else package.parent / "baselines"


def shipped_files(folder: str) -> dict[str, Path]:
    """Return the YAML files of a folder of the products and of the baselines, which prevail, by name."""
    files = (*files_of_products(f"{folder}/*.yml"), *(baselines_folder() / folder).glob("*.yml"))
    return {path.stem: path for path in files}


def suites_folder() -> Path:
    """Return the folder of the suites and of their trained rivals."""
    return baselines_folder() / "suites"


def _read(model: bytes) -> tuple[bytes, UserError | None]:
    """Return the normalised model for a session, and why it is not in the form of a policy."""
    outside = None
    try:
        plain = plain_model(model)
        for line in unplayable(plain):
            raise UserError(line)
        try:
            read_form(plain)
        except UserError as error:
            outside = UserError(f"policy.onnx: {error}")
    except UserError as error:
        raise UserError(f"policy.onnx: {error}") from error
    return bytes(plain.SerializeToString(deterministic=True)), outside


def write_agent(folder: str | os.PathLike[str], model: bytes | str | os.PathLike[str], **about: Any) -> None:
    """Write an agent folder: ``policy.onnx`` and ``agent.json``.

    >>> import tempfile
    >>> policy = agent_folder("ally-scripted/ppo/seed_0") / "policy.onnx"
    >>> about = {"algorithm": "PPO", "id": "FPG/AllyVsScripted-v0", "training_seed": 0, "training_steps": 10}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_agent(folder, policy, **about)
    ...     load_agent(folder).card.algorithm
    'PPO'

    Args:
        folder: the folder to write.
        model: the policy as ONNX, its bytes or its file, with the inputs and outputs of
            :class:`fpg_bench.players.agent.OnnxPlayer`. Notes of the exporter on this machine are removed;
            weights in files beside the given one are put into it.
        **about: attributes of :class:`fpg_bench.players.card.AgentCard`: ``algorithm``, ``game``,
            ``training_seed`` and ``training_steps`` at least; of ``FPG/duel_v0`` also ``side``. In place of
            ``game`` its ``id``, with ``actions``, and of a product's game, as ``FPG/team_v0``, all options
            that only such games have (``side``, ``allies``). ``scenario`` is by default that of the game.

    Raises:
        UserError: a field missing, a policy with other inputs or outputs, one that fails or whose rows depend
            on each other, or a file that is not ONNX.
    """
    where = f"agent {as_path(folder, 'folder')}"
    if isinstance(model, bytes):
        data = stripped(model)
    else:
        data = stripped((file := as_path(model, "model")).read_bytes(), file.parent)
    content: JsonObject = {**about, "policy_sha256": hashlib.sha256(data).hexdigest()}
    if "id" in content:
        own = {*option_names(kind_of(content["id"]))} - {*option_names()} | {"actions"}
        options = {name: content.pop(name) for name in own & content.keys()}
        content["game"] = GameSpec.of(content.pop("id"), **options)
    elif "game" not in content:
        raise UserError(f"{where}: lacks id")
    if "scenario" not in content:
        game = content["game"]
        played = (game if isinstance(game, GameSpec) else GameSpec.from_dict(game, "game")).resolve()
        content |= {"scenario": played.hash, "scenario_fields": played.to_dict()}
    card = AgentCard.parse(content, where)
    try:
        player = OnnxPlayer(data, card, is_own=True)
        player.check_answers()
    except UserError as error:
        raise UserError(f"{where}: {error}") from error
    if player.outside is not None:
        _logger.warning(f"{where}: {player.outside}; it plays here game by game, and no board takes it")
    remember_exported(card.policy_sha256)
    card.write(Path(folder), data)


def stripped(model: bytes, folder: Path | None = None) -> bytes:
    """Return a policy without its exporter's notes on the machine: paths, stack traces, module names.

    Args:
        model: the policy.
        folder: where files lie that it keeps weights in, which are then part of it; None: nowhere.

    Raises:
        UserError: not an ONNX file, one whose weights cannot be read, or the package ``onnx`` is missing.
    """
    require_extra("evaluate", "onnx")
    import onnx

    try:
        proto = onnx.load_model_from_string(model)
    except Exception as error:  # protobuf's own kinds
        raise UserError("policy.onnx: is not an ONNX file, or is truncated") from error
    try:
        if folder is not None:
            onnx.load_external_data_for_model(proto, os.fspath(folder))
    except Exception as error:  # its checker's, and those of reading
        raise UserError(f"policy.onnx: its weights in another file: {first_line(error)}") from error
    del proto.metadata_props[:]
    proto.doc_string = proto.graph.doc_string = ""
    del proto.graph.metadata_props[:]
    for item in (*proto.graph.node, *proto.graph.value_info, *proto.graph.input, *proto.graph.output):
        item.doc_string = ""
        del item.metadata_props[:]
    del proto.graph.value_info[:]
    return bytes(proto.SerializeToString(deterministic=True))


class SuiteMember(OnnxPlayer):
    """An agent that flies as in its training: an opponent that never learned to fly pursues the ally.

    Under the path ``learned`` such an opponent's rounds are bit-identical to those of the path
    ``pursuit``, so one game can draw opponents of both kinds.
    """

    @property
    def flies(self) -> str:
        """``learned`` if the opponent flew itself in its training, otherwise ``pursuit``."""
        assert self.card is not None
        return self.card.flies


def member_from_folder(folder: str | os.PathLike[str], side: str | None = None) -> SuiteMember:
    """Load a member from its agent folder; raises as :func:`fpg_bench.players.agent.load_agent`."""
    agent = load_agent(folder, side)
    return SuiteMember(agent.model, agent.card)


def expand_suites(specs: Iterable[PlayerSpec], side: str) -> list[PlayerSpec]:
    """Replace each suite in a list of players by its members of a side.

    Any other player is returned as it is, also one that does not exist; loading it raises.

    Args:
        specs: players as :func:`fpg_bench.players.registry.as_player` takes them, and suites: ``suite:NAME``,
            a folder of ``baselines/suites`` or any other with ``ally/<member>/`` or ``opponent/<member>/``.
        side: ``ally`` or ``opponent``.

    Raises:
        UserError: a suite has no members of this side.
    """
    players: list[PlayerSpec] = []
    for spec in specs:
        if isinstance(spec, str) and spec.startswith(SUITE) and _folder(spec.removeprefix(SUITE)):
            players += _members(spec, side)
        else:
            players.append(spec)
    return players


def member_folder(spec: str, side: str) -> str:
    """Return the name of a member's folder, ``NAME/SIDE/MEMBER``, and any other player's name as it is.

    Raises:
        UserError: no such suite or member, or a whole suite.
    """
    if not spec.startswith(SUITE):
        return spec
    name = spec.removeprefix(SUITE)
    if _folder(name) is not None:
        raise UserError(f"{spec}: names a whole suite; expected a single player")
    suite, _, member = name.rpartition("/")
    known = _members(SUITE + (suite or name), side)
    if spec not in known:
        raise UserError(f"{side} {spec!r}: the suite has no such member{nearest(spec, known)}")
    return f"{suite}/{side}/{member}"


def load_member(spec: str, side: str) -> SuiteMember:
    """Load the player that ``suite:NAME/MEMBER`` names.

    Raises:
        UserError: no such suite or member, a whole suite, or an agent that cannot be loaded as this side.
    """
    return member_from_folder(member_folder(spec, side), side)


def _members(spec: str, side: str) -> list[str]:
    """Return the names of a suite's members of a side, in alphabetical order."""
    name = spec.removeprefix(SUITE)
    folder = _folder(name)
    if folder is None:
        shipped = [path.name for path in suites_folder().iterdir() if path.is_dir()]
        raise UserError(f"{side} {spec!r}: no such suite{nearest(name, shipped)}")
    members = sorted(path.name for path in (folder / side).glob("*/"))
    if not members:
        raise UserError(f"{spec}: has no members that play the {side}")
    return [f"{SUITE}{name.rstrip('/')}/{member}" for member in members]


def _folder(name: str) -> Path | None:
    """Return the folder of a suite; None if there is no such suite."""
    places = [suites_folder() / name, Path(name)] if name else []
    return next((place for place in places if any((place / side).is_dir() for side in SIDES)), None)
