"""Building the site: a board in, a folder of files out, which refer to nothing but each other."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fpg_bench.errors import UserError
from fpg_bench.files import write_whole
from fpg_bench.leaderboard.site import entry_page, reading, scripts_data, views
from fpg_bench.leaderboard.site.front_page import front_view
from fpg_bench.leaderboard.site.play_data import Policies, play_files, watched, zoo_policies
from fpg_bench.leaderboard.site.shown import names_of, read_tracks
from fpg_bench.pictures.replay import replay_code, replay_markup, replay_part

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

    from fpg_bench.leaderboard.site.replays import Replay

MARK = ".fpg-site"  # what tells a folder that this has written, and may clear, from any other
Replays = Mapping[tuple[str, str], list["Replay"]]
Row = dict[str, Any]


def build_site(
    board: Row,
    out: str | Path,
    replays: Replays | None = None,
    progress: Callable[[str], None] = lambda page: None,
    docs: str = "",
    policies: Policies | None = None,
) -> list[Path]:
    """Write a board's site.

    Args:
        board: what :func:`fpg_bench.leaderboard.board.make_board` gives, or its JSON.
        out: the folder; files of an earlier build that are no longer needed are removed from it.
        replays: by track and entry, the rounds that its page shows; None: none.
        progress: called with each file's name.
        policies: by track and entry, the policies of submitted entries that a visitor can play against; see
            :func:`fpg_bench.leaderboard.site.play_data.submitted_policies`.
        docs: where the documentation's site is, seen from the folder, ``..`` for instance; empty: the pages
            of :mod:`fpg_bench.leaderboard.site.reading` stand in this one, others are named and not linked.

    Returns:
        The files, sorted.

    Raises:
        UserError: the folder holds something else, or the board a name that can't be a file's.
        OSError: a file cannot be written.
    """
    read_tracks(board)  # all of it is checked before anything is written
    folder = Path(out)
    check_folder(folder)
    board = _with_replays(board, replays or {})
    wanted = {MARK: "made by fpg-bench leaderboard build\n"} | _pages(board, replays or {}, docs)
    tracks, policies, zoo = read_tracks(board), policies or {}, zoo_policies()
    wanted |= _static() | play_files(tracks, policies, zoo)
    wanted |= _scripts(board, watched(tracks, policies, zoo))
    wanted |= {replay.file: replay.script for found in (replays or {}).values() for replay in found}
    for name, content in wanted.items():
        progress(name)
        _write(folder / name, content)
    kept = {folder / name for name in wanted}
    _clear(folder, kept)
    return sorted(kept)


def check_folder(folder: Path) -> None:
    """Raise UserError for a folder that holds something else than a site."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"out: {folder} is a file; name a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / MARK).is_file():
        raise UserError(f"out: {folder} holds files that are not a leaderboard's site; name another folder")


def _with_replays(board: Row, replays: Replays) -> Row:
    """The board, in which each entry names the files of its rounds."""
    return board | {
        "tracks": [
            track
            | {
                "rows": [
                    row | {"replays": [r.file for r in replays.get((track["key"], row["slug"]), [])]}
                    for row in track["rows"]
                ]
            }
            for track in board["tracks"]
        ]
    }


def _pages(board: Row, replays: Replays, docs: str) -> dict[str, str]:
    """All HTML pages by their names."""
    from markupsafe import Markup

    environment, read = _environment(board, docs), read_tracks(board)
    names = names_of(read)
    tracks = [views.track_view(track, names) for track in read]
    crossplay = scripts_data.crossplay_data(board)
    shown: list[tuple[str, str, Row]] = [
        ("index.html", "index.html", {"front": front_view(read, names, replays)}),
        ("play.html", "play.html", {}),
        ("ranking.html", "ranking.html", {"tracks": tracks}),
        ("compare.html", "compare.html", {"tracks": tracks}),
        ("statistics.html", "statistics.html", {"tracks": tracks}),
        ("crossplay.html", "crossplay.html", {"crossplay": crossplay}),
        ("submit.html", "submit.html", {}),
    ]
    for name, title in reading.PAGES.items() if not docs else ():
        shown.append(
            (f"{name}.html", "reading.html", {"title": title, "text": Markup(reading.reading(name))})
        )
    for track in read:
        for entry in track.entries:
            rounds = replays.get((track.key, entry.slug), [])
            content = {"entry": entry_page.entry_view(track, entry, names, board), "replays": rounds}
            shown.append((entry.page, "entry.html", content))
            badge = entry_page.badge_view(track, entry)
            shown.append((entry_page.badge_file(track, entry), "badge.svg", badge))
    return {
        name: environment.get_template(template).render(page=name, root="../" * name.count("/"), **content)
        for name, template, content in shown
    }


def _told(docs: str, page: str, words: str, heading: str = "", root: str = "") -> Markup:
    """A link to a page of the documentation; where that is nowhere, the words and the page's file."""
    from markupsafe import Markup

    if not docs and page not in reading.PAGES:
        return Markup("{} (<code>docs/{}.md</code>)").format(words, page)
    anchor = f"#{heading}" if heading else ""
    folder = docs if "://" in docs else root + (docs or ".")
    return Markup('<a href="{}/{}.html{}">{}</a>').format(folder, page, anchor, words)


def _environment(board: Row, docs: str) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    loader = PackageLoader("fpg_bench.leaderboard.site", "templates")
    found = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    about = {key: board.get(key) for key in ("version", "protocol", "season", "built")}
    found.globals |= {
        "board": about,
        "player": Markup(replay_markup("h3")),  # the package's own
        "few_seeds": views.FEW_SEEDS,
        "told": partial(_told, docs),
    }
    return found


def _scripts(board: Row, watch: Row) -> dict[str, str]:
    """The board as data: for the page's scripts, and whole for everybody else's.

    With cross-play goes by which players of the page a pair's round is played.
    """
    crossplay = scripts_data.crossplay_data(board)
    return {
        "board.json": json.dumps(board, allow_nan=False, separators=(",", ":")) + "\n",
        "data/compare.js": scripts_data.data_file(scripts_data.compare_data(board)),
        "data/statistics.js": scripts_data.data_file(scripts_data.statistics_data(board)),
        "data/crossplay.js": scripts_data.data_file(crossplay and crossplay | {"watch": watch}),
    }


def _static() -> dict[str, str]:
    """Styles and scripts, the player of replays among them."""
    folder = resources.files("fpg_bench.leaderboard.site").joinpath("static")
    found = {f"static/{file.name}": file.read_text("utf-8") for file in folder.iterdir() if file.is_file()}
    found |= {f"static/replay.{suffix}": replay_part(suffix) for suffix in ("css", "js")}
    return found | {f"static/{part}.js": replay_code(part) for part in ("events", "pen")}


def _write(path: Path, content: str) -> None:
    """Write a file, unless it is there just so."""
    data = content.encode()
    if not path.is_file() or path.read_bytes() != data:
        write_whole(path, data)


def _clear(folder: Path, kept: set[Path]) -> None:
    """Remove what an earlier build has left."""
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and not path.is_symlink():
            if not any(path.iterdir()):
                path.rmdir()
        elif path not in kept:
            path.unlink()
