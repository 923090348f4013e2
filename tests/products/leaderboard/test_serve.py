"""The local server of a site answers this machine alone, with files of the site alone."""

import os
import socket
import threading

import pytest

from fpg_bench.products.leaderboard.site import serve
from fpg_bench.products.leaderboard.site.mark import MARK


@pytest.fixture
def server(tmp_path, monkeypatch):
    monkeypatch.setattr(serve._Handler, "timeout", 0.3)
    folder = tmp_path / "site"
    (folder / "static").mkdir(parents=True)
    (folder / MARK).touch()
    (folder / "index.html").write_text("the front page")
    (folder / "pages").mkdir()
    (folder / "pages/index.html").touch()
    (folder / "static/app.js").write_text("1")
    (tmp_path / "secret").write_text("a secret")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/index.html").write_text("a secret")
    (folder / "link").symlink_to(tmp_path / "secret")
    (folder / "folder").symlink_to(tmp_path / "elsewhere")
    (folder / "inner").symlink_to(folder / "index.html")
    os.mkfifo(folder / "pipe")
    with serve.make_server(folder, 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def connected(server):
    return socket.create_connection(("127.0.0.1", server.server_port), 30)


def get(server, path, host="127.0.0.1:1"):
    with connected(server) as client, client.makefile("rb") as answer:
        client.sendall(f"GET {path} HTTP/1.0\r\nHost: {host}\r\n\r\n".encode())
        head, _, body = answer.read().partition(b"\r\n\r\n")
        return int(head.split()[1]), body.decode()


@pytest.mark.parametrize(
    "path", ["/%00", "/a%00b", "/link", "/folder/", "/folder/index.html", "/pipe", "/static/"]
)
def test_nothing_but_files_of_the_site_is_served(server, path):
    assert get(server, path)[0] == 404


def test_no_name_is_too_long_for_an_answer(server):
    assert get(server, "/" + 300 * "a")[0] == 404


@pytest.mark.parametrize("path", ["/", "/index.html", "/inner"])
def test_files_of_the_site_are_served(server, path):
    assert get(server, path) == (200, "the front page")
    assert get(server, "/pages")[0] == 301


def test_a_page_of_another_host_is_refused(server):
    for host in ("evil.example", "evil.example:80", "127.0.0.1.evil.example", "[", ""):
        assert get(server, "/", host)[0] == 421
    for host in ("localhost:8000", "LOCALHOST", "127.0.0.1"):
        assert get(server, "/", host)[0] == 200


def test_clients_that_send_nothing_hold_few_threads_and_are_sent_away(server, monkeypatch):
    before = threading.active_count()
    idle = [connected(server) for _ in range(serve._MOST_THREADS + 40)]
    assert get(server, "/")[0] == 200  # once those before it were sent away
    assert threading.active_count() - before <= serve._MOST_THREADS
    for client in idle:
        assert client.recv(1) == b""
        client.close()
