"""Build the site: a folder of files that refer only to each other, made from a board."""

from __future__ import annotations

import re
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import check_own_folder, write_whole
from fpg_bench.common.output import published
from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.leaderboard.board import Board
from fpg_bench.products.leaderboard.site import views
from fpg_bench.products.leaderboard.site.entry_page import badge_file, badge_text, entry_view
from fpg_bench.products.leaderboard.site.page_data import Policies, data_files
from fpg_bench.products.leaderboard.site.replays import Replay, Replays, label_of
from fpg_bench.products.leaderboard.tracks import SCENARIOS
from fpg_bench.products.rendering.replay import replay_code, replay_markup, replay_part

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

MARK = ".fpg-site"  # a file of a folder that holds a site, and may be cleared
PAPER = "https://doi.org/10.3390/drones10020147"  # the article whose game it is, as in CITATION.cff
SAMPLE = "agents/ally-champion/ppo-stack8/seed_0/policy.onnx"  # for a visitor who has no policy
_SLUG = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")


def build_site(
    board: Board,
    out: str | Path,
    replays: Replays | None = None,
    docs: str = "",
    policies: Policies | None = None,
) -> list[Path]:
    """Write a board's site.

    Args:
        board: the board.
        out: the folder; files of an earlier build that are no longer needed are removed from it.
        replays: by track and entry, the rounds that its page shows; ``board`` names their files.
        docs: address of the documentation's site, from the folder (such as ``..``); empty: the published one.
            Without any, its pages are named only.
        policies: by track and entry, policies of submitted entries that a visitor can play against; see
            :func:`fpg_bench.products.leaderboard.site.page_data.submitted_policies`.

    Returns:
        The files, sorted.

    Raises:
        UserError: the folder holds something else, or a name of the board cannot be part of a file's name.
        OSError: a file cannot be written.
    """
    _check_names(board)
    folder, replays = Path(out), replays or {}
    docs = docs or published().get("Documentation", "").rstrip("/")
    check_folder(folder)
    files: dict[str, str | bytes] = {MARK: "made by fpg-bench leaderboard build\n"}
    files |= _pages(board, replays, docs) | _static_files() | data_files(board, policies or {})
    files |= {replay.file: replay.script for rounds in replays.values() for replay in rounds}
    for name, content in files.items():
        _write(folder / name, content)
    kept = {folder / name for name in files}
    _remove_others(folder, kept)
    return sorted(kept)


def check_folder(folder: Path) -> None:
    """Raise UserError where a folder holds something other than a site."""
    check_own_folder(folder, MARK, "leaderboard's site")


def _check_names(board: Board) -> None:
    """Raise UserError where a track or an entry has a name that cannot be part of a file's name."""
    names = [("track", track.key) for track in board.tracks]
    names += [(f"entry of {track.key}", entry.slug) for track in board.tracks for entry in track.entries]
    for kind, name in names:
        if not _SLUG.fullmatch(name):
            raise UserError(
                f"board: {kind} {name!r}: expected at most 40 of a-z, 0-9 and -, a letter or digit first"
            )


def _pages(board: Board, replays: Replays, docs: str) -> dict[str, str]:
    """Render all pages and badges; returns their texts by file name."""
    tracks = [views.track_view(board, track) for track in board.tracks]
    front: dict[str, object] = {
        "film": _film(board, replays),
        "tracks": tracks,
        "n_entries": sum(len(track.entries) for track in board.tracks),
        "verified": [figures for track in board.tracks for _, figures in track.verified()],
    }
    pages: list[tuple[str, str, dict[str, object]]] = [
        ("index.html", "index.html", front),
        ("play.html", "play.html", {}),
        ("try.html", "try.html", {}),
        ("ranking.html", "ranking.html", {"tracks": tracks}),
        ("compare.html", "compare.html", {}),
        ("submit.html", "submit.html", {}),
    ]
    scenarios = {scenario: views.crossplay_page(scenario) for scenario in SCENARIOS}
    for scenario, stem in scenarios.items():
        played = board.crossplay.get(scenario)
        choice: dict[str, object] = {"crossplay": played, "scenario": scenario, "scenarios": scenarios}
        pages.append((f"{stem}.html", "crossplay.html", choice))
    for track in board.tracks:
        for entry in track.entries:
            content = entry_view(board, track, entry)
            content["replays"] = replays.get((track.key, entry.slug), [])
            pages.append((views.entry_page(track, entry), "entry.html", content))
            pages.append(
                (badge_file(track, entry), "badge.svg", {"track": track, "right": badge_text(track, entry)})
            )
    environment = _environment(board, docs)
    return {
        name: environment.get_template(template).render(page=name, root="../" * name.count("/"), **content)
        for name, template, content in pages
    }


def _film(board: Board, replays: Replays) -> Replay | None:
    """Return the round that moves on the front page: the last (hardest) of the first entry that has any."""
    keys = ((track.key, entry.slug) for track in board.tracks for entry in track.entries)
    return next((replays[key][-1] for key in keys if replays.get(key)), None)


def _environment(board: Board, docs: str) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    loader = PackageLoader("fpg_bench.products.leaderboard.site", "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "number": views.format_number,
        "sort_key": views.sort_key,
        "interval": views.format_interval,
        "signed": views.format_signed,
        "rank": views.format_rank,
    }
    environment.globals |= {
        "board": board,
        "player": Markup(replay_markup("h3")),  # the package's own
        "roles": views.ROLES,
        "measures": views.MEASURES,
        "mission": views.MISSION,
        "label_of": label_of,
        "few_seeds": views.FEW_SEEDS,
        "entry_page": views.entry_page,
        "warnings": views.warnings,
        "lost_text": views.lost_text,
        "same_policies_text": views.same_policies_text,
        "doc_link": partial(_doc_link, docs),
        "board_address": published().get("Leaderboard", "").rstrip("/"),
        "software_links": partial(_software_links, docs),
    }
    return environment


def _doc_link(docs: str, page: str, text: str, heading: str = "", root: str = "") -> Markup:
    """Return a link to a page of the documentation, ``folder/name``; without one, its text and file name."""
    from markupsafe import Markup

    if not docs:
        return Markup("{} (<code>docs/{}.md</code>)").format(text, page)
    place = f"{docs if '://' in docs else root + docs}/{page}.html"
    return Markup('<a href="{}{}">{}</a>').format(place, f"#{heading}" if heading else "", text)


def _software_links(docs: str, root: str) -> dict[str, str]:
    """Return addresses of documentation, source and paper by label; one that is not known is left out.

    The repository is that of ``[project.urls]`` in the package's metadata.
    """
    links = {
        "Docs": f"{docs if '://' in docs else root + docs}/index.html" if docs else None,
        "Source": published().get("Repository"),
        "Paper": PAPER,
    }
    return {label: address for label, address in links.items() if address}


def _static_files() -> dict[str, str | bytes]:
    """Return styles and scripts, the player of replays among them."""
    folder = resources.files("fpg_bench.products.leaderboard.site").joinpath("static")
    files: dict[str, str | bytes] = {
        f"static/{file.name}": file.read_bytes() for file in folder.iterdir() if file.is_file()
    }
    files |= {f"static/replay.{suffix}": replay_part(suffix) for suffix in ("css", "js")}
    files |= {f"static/{part}.js": replay_code(part) for part in ("events", "pen")}
    return files | {"agents/sample.onnx": (baselines_folder() / SAMPLE).read_bytes()}


def _write(path: Path, content: str | bytes) -> None:
    """Write a file, unless it has this content already."""
    data = content.encode() if isinstance(content, str) else content
    if not path.is_file() or path.read_bytes() != data:
        write_whole(path, data)


def _remove_others(folder: Path, kept: set[Path]) -> None:
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and not path.is_symlink():
            if not any(path.iterdir()):
                path.rmdir()
        elif path not in kept:
            path.unlink()
