"""Server profiles of language models, as YAML files, and the endpoint that the environment names."""

from __future__ import annotations

import dataclasses
import ipaddress
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args
from urllib.parse import urlsplit

from pydantic import Field, field_validator

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import read_yaml
from fpg_bench.common.schema import Expected, Items, PositiveInt, Strict, parse

SERVER_FOLDER = Path(__file__).with_name("servers")
SERVERS = tuple(sorted(path.stem for path in SERVER_FOLDER.glob("*.yml")))
BASE_URL, MODEL, KEY, SERVER = "FPG_LLM_BASE_URL", "FPG_LLM_MODEL", "FPG_LLM_API_KEY", "FPG_LLM_SERVER"

ResponseFormat = Literal["json_object", "json_object_with_schema", "json_schema"]
TokenField = Literal["max_tokens", "max_completion_tokens"]
RESPONSE_FORMATS, TOKEN_FIELDS = get_args(ResponseFormat), get_args(TokenField)
Word = Annotated[str, Field(min_length=1), Expected("a word")]
Temperature = Annotated[float, Field(ge=0, le=2), Expected("a number from 0 to 2")]


class Server(Strict):
    """Profile of a kind of server: the fields that it is sent, and its known properties.

    Attributes:
        name: the profile's name.
        about: its description, in a sentence or two.
        base_url, model: taken where the environment names none.
        seed: a seed is sent.
        response_format: the form in which the schema of an answer is sent.
        temperature: of sampling.
        max_tokens: longest answer, in tokens.
        max_tokens_field: the field's name.
        refusal_codes: the codes of errors by which the server refuses to answer a question.
        prompt: the default prompt profile.
    """

    name: str
    about: Word | None = None
    base_url: str | None = None
    model: Word | None = None
    seed: bool = False
    response_format: Literal["none", ResponseFormat] = "none"
    temperature: Temperature = 0.7
    max_tokens: PositiveInt = 4096
    max_tokens_field: TokenField = "max_tokens"
    refusal_codes: Annotated[Items[int | str], Expected("a list of codes")] = (
        "content_filter",
        "content_policy_violation",
    )
    prompt: Word = "standard"

    @field_validator("base_url")
    @classmethod
    def _check_url(cls, value: str | None) -> str | None:
        return None if value is None else checked_url(value)

    def at_temperature(self, temperature: float | None) -> Server:
        """Return the profile with another temperature; None: this one."""
        if temperature is None:
            return self
        return parse(Server, {**self.model_dump(), "temperature": temperature}, f"server {self.name}")


def load_server(name: str) -> Server:
    """Return a server's profile by its name (``spark``), or from a YAML file of the same form.

    Raises:
        UserError: no such profile or file, or an entry that cannot be used.
    """
    is_file = name.endswith((".yml", ".yaml"))
    if name not in SERVERS and not is_file:
        raise UserError(f"unknown server {name!r}{nearest(name, SERVERS)}")
    path = Path(name) if is_file else SERVER_FOLDER / f"{name}.yml"
    content = read_yaml(path, "server")
    if "name" in content:
        raise UserError(f"server {path}: unknown key 'name'; a profile is named by its file")
    return parse(Server, {**content, "name": path.stem}, f"server {path}")


@dataclass(frozen=True)
class Endpoint:
    """A language model's base URL, name, key and server profile.

    The key is in no ``repr``; a pickle leaves it out, and what is unpickled takes it from the environment.
    """

    base_url: str
    model: str
    key: str | None = field(default=None, repr=False)
    server: Server = field(default_factory=lambda: load_server("generic"))

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_url", checked_url(self.base_url, "base_url: "))
        if self.key and not (self.key.isascii() and self.key.isprintable() and " " not in self.key):
            raise UserError(f"{KEY}: holds a space, a line break or a letter that no key holds; copy it anew")

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "key": None}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state, key=_variable(KEY))

    def __deepcopy__(self, memo: dict[int, Any]) -> Endpoint:
        return self  # immutable; and a pickle would lose the key

    def __copy__(self) -> Endpoint:
        return self

    @property
    def on_this_machine(self) -> bool:
        """True for a loopback address."""
        host = urlsplit(self.base_url).hostname or ""
        try:
            address = ipaddress.ip_address(host)
            address = getattr(address, "ipv4_mapped", None) or address
            return address.is_loopback or address.is_unspecified  # 0.0.0.0 connects to this machine
        except ValueError:
            return host == "localhost" or host.endswith(".localhost")


def endpoint_from_environment(server: str | None = None) -> Endpoint:
    """Return the endpoint of ``FPG_LLM_BASE_URL``, ``FPG_LLM_MODEL`` and ``FPG_LLM_API_KEY``.

    Args:
        server: the server's profile; None: ``FPG_LLM_SERVER``, or ``generic``. Its base URL and model
            stand in for those that are not set. A server on this machine needs no key.

    Raises:
        UserError: something is missing or invalid; the message names the variables to set.
    """
    require_extra("llm", "openai")
    profile = load_server(server or _variable(SERVER) or "generic")
    base_url, model = _variable(BASE_URL) or profile.base_url, _variable(MODEL) or profile.model
    missing = []
    if base_url is None:
        missing.append(f"{BASE_URL} (e.g. http://127.0.0.1:8080/v1, or {SERVER}=spark)")
    if model is None:
        missing.append(MODEL)
    endpoint = None
    if base_url is not None:
        endpoint = Endpoint(checked_url(base_url, f"{BASE_URL}: "), model or "", server=profile)
    if not _variable(KEY) and not (endpoint and endpoint.on_this_machine):
        missing.append(KEY if endpoint else f"{KEY} (none is needed on this machine)")
    if endpoint is None or missing:
        begin = "; examples/llama_server.py serves a small model"
        raise UserError(f"no language model is configured: set {', '.join(missing)}{begin}")
    return dataclasses.replace(endpoint, key=_variable(KEY))


def _variable(name: str) -> str | None:
    """Return a variable of the environment; None where it is unset or blank."""
    return os.environ.get(name, "").strip() or None


def checked_url(value: str, where: str = "") -> str:
    """Return a base URL without a slash at its end, and without the path that the client adds itself.

    Raises:
        UserError: it is not valid. The message never holds the value: it may contain a key.
    """
    try:
        url = urlsplit(value.strip())
        is_sound = url.scheme in ("http", "https") and bool(url.hostname) and url.port != 0
    except (AttributeError, ValueError):
        is_sound = False
    if not is_sound:
        raise UserError(f"{where}expected an address such as http://127.0.0.1:8080/v1")
    if url.username or url.password or url.query or url.fragment:
        raise UserError(f"{where}holds more than an address; write https://host/v1, and the key in {KEY}")
    return value.strip().rstrip("/").removesuffix("/chat/completions")
