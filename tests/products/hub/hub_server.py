"""A server on loopback that speaks as much of the Hugging Face Hub's API as its client asks for."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import threading
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import ClassVar
from urllib.parse import parse_qs, unquote, urlsplit

import yaml

TOKEN, READER = "hf_maySecretlyWrite", "hf_maySecretlyRead"
LARGE = (".onnx", ".png", ".zip")  # what the Hub keeps by LFS


@dataclass
class Repository:
    """A repository: its branches, and the files of each commit."""

    private: bool = False
    branches: dict[str, str] = field(default_factory=dict)
    commits: dict[str, dict[str, bytes]] = field(default_factory=dict)

    def commit(self, branch: str, files: dict[str, bytes]) -> str:
        """Add a commit with exactly these files."""
        oid = hashlib.sha1(repr((len(self.commits), branch, sorted(files.items()))).encode()).hexdigest()
        self.commits[oid] = dict(files)
        self.branches[branch] = oid
        return oid

    def files(self, revision: str = "main") -> dict[str, bytes]:
        """The files of a revision."""
        return self.commits[self.branches.get(revision, revision)]


class HubServer:
    """Serves while the ``with`` block lasts.

    Attributes:
        url: the endpoint.
        repositories: by ``owner/name``.
        requests: method and path of each request.
        cut: names of files whose download breaks off after half of them.
        short: names of files that are sent in half, as if that were all.
        meanwhile: called once, after the next listing of a repository.
    """

    def __init__(self) -> None:
        self.repositories: dict[str, Repository] = {}
        self.requests: list[str] = []
        self.stored: dict[str, bytes] = {}  # by LFS, under their SHA-256
        self.cut: set[str] = set()
        self.short: set[str] = set()
        self.meanwhile = lambda: None

    def __enter__(self) -> HubServer:
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), type("Bound", (_Handler,), {"hub": self}))
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    def add(self, name: str, files: dict[str, bytes], private: bool = False) -> str:
        """Add a commit with exactly these files to a repository, which need not exist; gives the commit."""
        repository = self.repositories.setdefault(name, Repository(private))
        return repository.commit("main", files)


class _Refused(Exception):
    """An answer with an error: its status, the code of the Hub, and the message."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    hub: HubServer

    def log_message(self, *words: object) -> None:
        """Say nothing."""

    def _do(self) -> None:
        size = int(self.headers.get("Content-Length") or 0)
        self.body = self.rfile.read(size)
        parts = urlsplit(self.path)
        self.query, path = parse_qs(parts.query), parts.path
        self.hub.requests.append(f"{self.command} {unquote(path)}")
        try:
            authorization = self.headers.get("Authorization", "").removeprefix("Bearer ")
            if authorization not in ("", TOKEN, READER):
                raise _Refused(401, None, "Invalid credentials in Authorization header")
            self.token = authorization
            for pattern, method in self.ROUTES.items():
                if match := re.fullmatch(pattern, f"{self.command} {path}"):
                    method(self, *map(unquote, match.groups()))
                    return
            raise _Refused(404, None, "no such route")
        except _Refused as refused:
            status, code, message = refused.args
            headers = {"X-Error-Message": message} | ({"X-Error-Code": code} if code else {})
            self._answer({"error": message}, status, headers)

    do_GET = do_HEAD = do_POST = do_PUT = _do

    def _answer(self, content: object, status: int = 200, headers: dict[str, str] | None = None) -> None:
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        self.send_response(status)
        for name, value in {"Content-Length": str(len(data)), **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(data)

    def _repository(self, name: str, write: bool = False) -> Repository:
        repository = self.hub.repositories.get(name)
        if repository is None or (repository.private and not self.token):
            raise _Refused(404 if self.token else 401, "RepoNotFound", "Repository not found")
        if write:
            self._check_writes()
        return repository

    def _check_writes(self) -> None:
        if self.token != TOKEN:
            raise _Refused(403 if self.token else 401, None, "You don't have the rights to write")

    def _create(self) -> None:
        self._check_writes()
        asked = json.loads(self.body)
        name = f"{asked['organization']}/{asked['name']}"
        answer = {"url": f"{self.hub.url}/{name}"}
        if name in self.hub.repositories:
            self._answer(answer | {"error": "You already created this model repo"}, 409)
            return
        is_private = asked.get("visibility") == "private" or bool(asked.get("private"))
        self.hub.add(name, {".gitattributes": b"*.onnx filter=lfs\n"}, private=is_private)
        self._answer(answer)

    def _branch(self, name: str, branch: str) -> None:
        repository = self._repository(name, write=True)
        if branch in repository.branches:
            raise _Refused(409, None, "Reference already exists")
        repository.branches[branch] = repository.branches["main"]
        self._answer({})

    def _info(self, name: str, revision: str = "main") -> None:
        repository = self._repository(name)
        oid = repository.branches.get(revision, revision)
        if oid not in repository.commits:
            raise _Refused(404, "RevisionNotFound", f"Invalid rev id: {revision}")
        siblings = [
            {"rfilename": path} | ({"size": len(data)} if "blobs" in self.query else {})
            for path, data in repository.commits[oid].items()
        ]
        self._answer({"id": name, "sha": oid, "private": repository.private, "siblings": siblings})
        then, self.hub.meanwhile = self.hub.meanwhile, lambda: None
        then()

    def _validate(self) -> None:
        _, metadata, _ = json.loads(self.body)["content"].split("---\n", 2)
        content = yaml.safe_load(metadata)
        errors = [] if isinstance(content, dict) else [{"message": "no mapping"}]
        self._answer({"errors": errors, "warnings": []}, 400 if errors else 200)

    def _preupload(self, name: str, revision: str) -> None:
        self._repository(name, write=True)
        files = [
            {
                "path": file["path"],
                "uploadMode": "lfs" if file["path"].endswith(LARGE) else "regular",
                "shouldIgnore": False,
            }
            for file in json.loads(self.body)["files"]
        ]
        self._answer({"files": files})

    def _batch(self, name: str) -> None:
        self._repository(name, write=True)
        objects = [
            {**each, "actions": {"upload": {"href": f"{self.hub.url}/stored/{each['oid']}"}}}
            for each in json.loads(self.body)["objects"]
        ]
        self._answer({"transfer": "basic", "objects": objects})

    def _store(self, oid: str) -> None:
        assert hashlib.sha256(self.body).hexdigest() == oid
        self.hub.stored[oid] = self.body
        self._answer({})

    def _commit(self, name: str, branch: str) -> None:
        repository = self._repository(name, write=True)
        files = dict(repository.files(branch))
        for line in self.body.splitlines():
            entry = json.loads(line)
            value = entry["value"]
            if entry["key"] == "file":
                files[value["path"]] = base64.b64decode(value["content"])
            elif entry["key"] == "lfsFile":
                files[value["path"]] = self.hub.stored[value["oid"]]
            elif entry["key"] == "deletedFile":
                del files[value["path"]]
        oid = repository.commit(branch, files)
        self._answer({"commitUrl": f"{self.hub.url}/{name}/commit/{oid}", "commitOid": oid})

    def _resolve(self, name: str, revision: str, path: str) -> None:
        repository = self._repository(name)
        oid = repository.branches.get(revision, revision)
        data = repository.commits[oid].get(path)
        if data is None:
            raise _Refused(404, "EntryNotFound", "Entry not found")
        etag = hashlib.sha256(data).hexdigest()
        headers = {"ETag": f'"{etag}"', "X-Repo-Commit": oid, "X-Linked-Size": str(len(data))}
        if self.command == "GET" and path in self.hub.short:
            data = data[: len(data) // 2]
        if self.command == "GET" and path in self.hub.cut:
            self.send_response(206 if "Range" in self.headers else 200)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(b"" if "Range" in self.headers else data[: len(data) // 2])
            self.close_connection = True
            return
        if begun := re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range", "")):
            first = int(begun[1])
            headers["Content-Range"] = f"bytes {first}-{len(data) - 1}/{len(data)}"
            self._answer(data[first:], 206, headers)
            return
        self._answer(data, headers=headers)

    ROUTES: ClassVar = {
        r"POST /api/repos/create": _create,
        r"POST /api/validate-yaml": _validate,
        r"POST /api/models/([^/]+/[^/]+)/branch/([^/]+)": _branch,
        r"POST /api/models/([^/]+/[^/]+)/preupload/([^/]+)": _preupload,
        r"POST /api/models/([^/]+/[^/]+)/commit/([^/]+)": _commit,
        r"GET /api/models/([^/]+/[^/]+)": _info,
        r"GET /api/models/([^/]+/[^/]+)/revision/([^/]+)": _info,
        r"POST /([^/]+/[^/]+)\.git/info/lfs/objects/batch": _batch,
        r"PUT /stored/(\w+)": _store,
        r"(?:GET|HEAD) /([^/]+/[^/]+)/resolve/([^/]+)/(.+)": _resolve,
    }
