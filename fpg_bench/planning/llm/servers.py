"""Servers of language models: what each honours, as data; and the endpoint that the environment names."""

from __future__ import annotations

import dataclasses
import ipaddress
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from fpg_bench.common.checks import check_keys, flag, whole
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.extras import has
from fpg_bench.common.files import read_yaml
from fpg_bench.planning.llm.local.models import has_model, model_file

SERVER_FOLDER = Path(__file__).with_name("servers")
SERVERS = tuple(sorted(path.stem for path in SERVER_FOLDER.glob("*.yml")))
RESPONSE_FORMATS = ("none", "json_object", "json_object_with_schema", "json_schema")
TOKEN_FIELDS = ("max_tokens", "max_completion_tokens")
EMBEDDED = "embedded"  # the profile of a model on this machine
_TAKE_IT = 'pip install "fpg-bench[local-llm]" and fpg-bench llm fetch'
BASE_URL, MODEL, KEY, SERVER = "FPG_LLM_BASE_URL", "FPG_LLM_MODEL", "FPG_LLM_API_KEY", "FPG_LLM_SERVER"


@dataclass(frozen=True)
class Server:
    """What a kind of server is sent, and what it is known for.

    Attributes:
        name: the profile's name.
        about: what to know about it, in a sentence or two.
        base_url, model: taken where the environment names none.
        seed: whether it is sent a seed.
        response_format: one of ``RESPONSE_FORMATS``; how it is asked for the schema of an answer.
        temperature: what it is sent.
        temperature_range: the lowest and highest that it takes.
        max_tokens: the longest answer asked for, in tokens.
        max_tokens_field: one of ``TOKEN_FIELDS``, what it calls that.
        refusal_codes: the codes of its errors that mean that it refuses to answer this question.
        prompt: the prompt profile that it is asked with where nobody says another.
    """

    name: str
    about: str = ""
    base_url: str | None = None
    model: str | None = None
    seed: bool = False
    response_format: str = "none"
    temperature: float = 0.7
    temperature_range: tuple[float, float] = (0.0, 2.0)
    max_tokens: int = 4096
    max_tokens_field: str = "max_tokens"
    refusal_codes: tuple[int | str, ...] = ("content_filter", "content_policy_violation")
    prompt: str = "standard"

    def __post_init__(self) -> None:
        low, high = self.temperature_range
        if not low <= self.temperature <= high:
            raise UserError(f"temperature: {self.temperature} is outside temperature_range [{low}, {high}]")


def load_server(name: str) -> Server:
    """A server's profile by its name (``spark``), or from a YAML file of the same form.

    Raises:
        UserError: no such profile or file, or an entry that cannot be used.
    """
    path = Path(name) if name.endswith((".yml", ".yaml")) else SERVER_FOLDER / f"{name}.yml"
    if name not in SERVERS and not name.endswith((".yml", ".yaml")):
        raise UserError(f"unknown server {name!r}{nearest(name, SERVERS)}")
    content = read_yaml(path, "server")
    known = [spec.name for spec in dataclasses.fields(Server) if spec.name != "name"]
    check_keys(content, known, f"server {path}")
    try:
        checked: dict[str, Any] = {key: _CHECKS[key](value, key) for key, value in content.items()}
        return Server(path.stem, **checked)
    except UserError as error:
        raise UserError(f"server {path}: {error}") from error


@dataclass(frozen=True)
class Endpoint:
    """Where a language model answers: base URL, model, key and the server's profile.

    The key is in no ``repr``; a pickle leaves it out, and what is unpickled takes it from the environment.
    ``deadline_s`` is how long a plan may take where nobody says otherwise.
    """

    base_url: str
    model: str
    key: str | None = field(default=None, repr=False)
    server: Server = field(default_factory=lambda: load_server("generic"))
    deadline_s: float = 30.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_url", _checked_url(self.base_url, "base_url"))
        if self.key and not (self.key.isascii() and self.key.isprintable() and " " not in self.key):
            raise UserError(f"{KEY}: holds a space, a line break or a letter that no key holds; copy it anew")

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "key": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, key=_value(KEY))

    def __deepcopy__(self, memo: dict[int, Any]) -> Endpoint:
        return self  # nothing in it changes; and by way of a pickle the key would be lost

    def __copy__(self) -> Endpoint:
        return self

    @property
    def on_this_machine(self) -> bool:
        """Whether the base URL is one of loopback."""
        host = urlsplit(self.base_url).hostname or ""
        try:
            return ipaddress.ip_address(host).is_loopback
        except ValueError:
            return host == "localhost" or host.endswith(".localhost")


def endpoint_from_environment(server: str | None = None) -> Endpoint:
    """The endpoint that ``FPG_LLM_BASE_URL``, ``FPG_LLM_MODEL`` and ``FPG_LLM_API_KEY`` name.

    Where they name none, the small model on this machine answers, if it was fetched: its server is started.

    Args:
        server: the server's profile; None: ``FPG_LLM_SERVER``, or ``generic``. Its base URL and model
            stand in for those that are not set. A server on this machine needs no key. ``embedded``: the
            model on this machine, whatever else is configured.

    Raises:
        UserError: something is missing, or is of no use; the message says which variables to set.
    """
    profile = load_server(server or _value(SERVER) or "generic")
    if profile.name == EMBEDDED or (not _configured(profile) and has("xllamacpp") and has_model()):
        return _embedded()
    base_url, model = _value(BASE_URL) or profile.base_url, _value(MODEL) or profile.model
    missing = []
    if base_url is None:
        missing.append(f"{BASE_URL} (e.g. http://127.0.0.1:8080/v1, or {SERVER}=spark)")
    if model is None:
        missing.append(MODEL)
    known = Endpoint(_checked_url(base_url, BASE_URL), model or "", server=profile) if base_url else None
    if not _value(KEY) and not (known and known.on_this_machine):
        missing.append(KEY if known else f"{KEY} (none is needed on this machine)")
    if known is None or missing:
        small = "" if _configured(profile) else f"; or take a small one on this machine: {_TAKE_IT}"
        raise UserError(f"no language model is configured: set {', '.join(missing)}{small}")
    return dataclasses.replace(known, key=_value(KEY))


def at_temperature(endpoint: Endpoint, temperature: float | None) -> Endpoint:
    """The same endpoint, asked at another temperature; None: at that of its profile.

    Raises:
        UserError: the server takes no such temperature.
    """
    if temperature is None:
        return endpoint
    server = dataclasses.replace(endpoint.server, temperature=_checked_number(temperature, "temperature"))
    return dataclasses.replace(endpoint, server=server)


def _configured(profile: Server) -> bool:
    return any(_value(name) for name in (BASE_URL, MODEL, KEY)) or profile.base_url is not None


def _embedded() -> Endpoint:
    """The model on this machine, whose server is started where this process has none."""
    from fpg_bench.planning.llm.local.server import shared_server

    file = model_file()
    server = shared_server(file)
    return Endpoint(server.url, file.stem, server=load_server(EMBEDDED), deadline_s=server.speed.deadline_s)


def _value(variable: str) -> str | None:
    """A variable of the environment; None where it is unset or blank."""
    return os.environ.get(variable, "").strip() or None


# The messages below never hold the value of a variable: somebody may have put the key there


def _checked_url(value: Any, name: str) -> str:
    """A base URL without a slash at its end, and without the path that the client adds itself."""
    try:
        url = urlsplit(value.strip())
        sound = url.scheme in ("http", "https") and bool(url.hostname) and url.port != 0
    except (AttributeError, ValueError):
        sound = False
    if not sound:
        raise UserError(f"{name}: expected an address such as http://127.0.0.1:8080/v1")
    if url.username or url.password or url.query or url.fragment:
        raise UserError(f"{name}: holds more than an address; write https://host/v1, and the key in {KEY}")
    return value.strip().rstrip("/").removesuffix("/chat/completions")


# Entries of a profile


def _checked_word(value: Any, name: str) -> str:
    if not isinstance(value, str) or not value:
        raise UserError(f"{name}: expected a word, got {value!r}")
    return value


def _checked_choice(value: Any, name: str) -> str:
    choices = TOKEN_FIELDS if name == "max_tokens_field" else RESPONSE_FORMATS
    if value not in choices:
        raise UserError(f"{name}: expected one of {', '.join(choices)}, got {value!r}")
    return value


def _checked_number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 2:
        raise UserError(f"{name}: expected a number from 0 to 2, got {value!r}")
    return float(value)


def _checked_range(value: Any, name: str) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise UserError(f"{name}: expected [lowest, highest], got {value!r}")
    return _checked_number(value[0], name), _checked_number(value[1], name)


def _checked_codes(value: Any, name: str) -> tuple[int | str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, int | str) for item in value):
        raise UserError(f"{name}: expected a list of codes, got {value!r}")
    return tuple(value)


_CHECKS = {
    "about": _checked_word,
    "base_url": _checked_url,
    "model": _checked_word,
    "seed": flag,
    "response_format": _checked_choice,
    "temperature": _checked_number,
    "temperature_range": _checked_range,
    "max_tokens": whole,
    "max_tokens_field": _checked_choice,
    "refusal_codes": _checked_codes,
    "prompt": _checked_word,
}
