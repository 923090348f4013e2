"""The built site as files: what may stand in them, and that they refer to nothing but each other."""

import ast
import dataclasses
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.leaderboard.board import Improvement, Profiles, Score
from fpg_bench.leaderboard.site.build import build_site
from fpg_bench.leaderboard.site.replays import Replay
from fpg_bench.leaderboard.site.serve import make_server
from fpg_bench.leaderboard.site.views import (
    format_interval,
    format_number,
    format_rank,
    format_signed,
    safe_link,
)
from fpg_bench.leaderboard.tracks import PUBLIC, UNSEEN
from fpg_bench.training.zoo import load_zoo
from tests.leaderboard.example_board import HOSTILE, changed, example_board, with_figures
from tests.programs import fpg

ROOT = Path(__file__).parents[2]
LEADS_AWAY = {"src", "srcset", "poster", "action", "formaction", "data", "background", "ping"}


class Page(HTMLParser):
    """What a browser would find: elements, their attributes, and text."""

    def __init__(self, path):
        super().__init__()
        self.elements, self.text = [], []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A site whose every text tries to become markup."""
    folder = tmp_path_factory.mktemp("site") / "out"
    rounds = [Replay("replays/ally/player-1/ab.js", HOSTILE[0], HOSTILE[1], 'fpgRound({"label":"x"});\n')]
    build_site(example_board(7, hostile=True), folder, {("ally", "player-1"): rounds})
    return folder


@pytest.fixture(scope="module")
def pages(site):
    return {path: Page(path) for path in site.rglob("*.html")}


def test_there_is_a_page_for_all_that_is_to_be_seen(site):
    names = {str(path.relative_to(site)) for path in site.rglob("*.html")}
    shared = {
        "index.html",
        "ranking.html",
        "play.html",
        "crossplay.html",
        "statistics.html",
        "compare.html",
        "submit.html",
        "rules.html",
        "measures.html",
        "glossary.html",
    }
    entries = {f"entries/ally/player-{k}.html" for k in range(7)}
    assert names == shared | entries | {f"entries/opponent-pursuit/player-{k}.html" for k in range(2)}


def test_no_text_of_a_submission_becomes_markup(pages):
    for path, page in pages.items():
        assert not [name for tag, attrs in page.elements for name in attrs if name.startswith("on")], path
        images = [attrs["src"] for tag, attrs in page.elements if tag == "img"]
        assert not [src for src in images if not re.fullmatch(r"\.\./\.\./badges/[\w/-]+\.svg", src)], path
        scripts = [attrs for tag, attrs in page.elements if tag == "script"]
        assert all("src" in attrs for attrs in scripts), path
    texts = "".join("".join(page.text) for page in pages.values())
    assert all(text in texts for text in HOSTILE)


@pytest.mark.parametrize("text", [text for text in HOSTILE if re.search("[<>']", text)])
def test_hostile_texts_never_stand_there_raw(site, text):
    for path in site.rglob("*.html"):
        assert text not in path.read_text(encoding="utf-8"), path
    for path in (site / "data").iterdir():
        assert not re.search("[<>]", path.read_text(encoding="utf-8")), path


def test_lost_rounds_are_counted_where_an_entry_is_shown(site):
    for name in ("ranking.html", "entries/ally/player-4.html"):
        assert (site / name).read_text().count("1,234 of 5,000 rounds lost by rule") == 1
    assert "lost by rule" not in (site / "entries/ally/player-3.html").read_text()


def columns(site, track="ally"):
    """The heads of a track's table on the front page."""
    table = (site / "ranking.html").read_text().split(f'id="{track}"')[1].split("</thead>")[0]
    return re.findall(r'class="sort"[^>]*>([^<]*)</button>', table)


def test_the_table_shows_the_four_numbers_once_a_season_is_closed_and_only_what_there_is_before(
    site, tmp_path
):
    names = [
        "Rank",
        "Entry",
        "Score, unseen",
        "Public",
        "Gap",
        "Shifted",
        "Worst",
        "Jammed",
        "Return per step",
    ]
    assert columns(site) == names
    build_site(example_board(3, season=None), tmp_path)
    assert columns(tmp_path) == ["Rank", "Entry", "Score, public", "Worst", "Jammed", "Return per step"]
    assert "No season is closed yet" in (tmp_path / "ranking.html").read_text()
    assert "no season closed yet" in (tmp_path / "compare.html").read_text()


def test_the_best_is_named_with_how_many_may_be_first(tmp_path):
    board = example_board(5)
    for entry, rank in zip(board.tracks[0].entries, [(1, 2), (1, 3), (3, 4), (3, 4)], strict=False):
        board = with_figures(board, entry.slug, rank=rank)
    build_site(board, tmp_path)
    page = (tmp_path / "ranking.html").read_text()
    order = re.findall(r'class="who" data-v="player (\d)', page.split('id="opponent-pursuit"')[0])
    assert order == [entry.slug[-1] for entry in board.tracks[0].entries]
    text = " ".join("".join(Page(tmp_path / "ranking.html").text).split())
    assert f"Player {order[0]} has the highest score; 1 other may be first as well. Ranked by" in text


def test_the_gap_is_public_minus_unseen(tmp_path):
    scores = {PUBLIC: Score(60.25), UNSEEN: Score(20.0)}
    build_site(with_figures(example_board(2), "player-1", scores=scores), tmp_path)
    assert '<td class="num extra" data-v="40.25">+40.2</td>' in (tmp_path / "ranking.html").read_text()
    assert "+40.2" in (tmp_path / "entries/ally/player-1.html").read_text()


def test_the_worst_says_who_and_where(tmp_path):
    build_site(example_board(4), tmp_path)
    for name in ("ranking.html", "entries/ally/player-3.html"):
        text = "".join(Page(tmp_path / name).text)
        assert "Player 1" in text  # of the other side, by its name
        assert "cross-play" in text
        assert "−13.96 per step" in text
    text = "".join(Page(tmp_path / "entries/ally/player-2.html").text)
    assert re.search(r"against \w+/pursuit \(public\) it earns 2.50 per step", text)


def test_a_flagged_gain_on_public_seeds_is_named(site):
    told = "scores 7.2 more on public seeds"
    assert (site / "ranking.html").read_text().count(told) == 1
    assert told in (site / "entries/ally/player-2.html").read_text()
    assert "public seeds</strong> than" not in (site / "entries/ally/player-3.html").read_text()


def test_late_entries_are_marked(site):
    told = "late entry</small>"
    assert (site / "ranking.html").read_text().count(told) == 2  # one in each table
    assert "Late entry</strong>" in (site / "entries/ally/player-1.html").read_text()
    assert "Late entry</strong>" not in (site / "entries/ally/player-3.html").read_text()


def without_unseen(figures):
    """Figures of an entry that has played the public suite only."""
    return {
        "rank": None,
        "score": figures.scores[PUBLIC],
        "scores": {PUBLIC: figures.scores[PUBLIC]},
        "by_rival": {PUBLIC: figures.by_rival[PUBLIC]},
        "units": {PUBLIC: figures.units[PUBLIC]},
    }


def test_an_entry_without_a_score_that_ranks_has_no_rank(tmp_path):
    board = example_board(4)
    figures = next(figures for entry, figures in board.tracks[0].verified() if entry.slug == "player-2")
    build_site(with_figures(board, "player-2", **without_unseen(figures)), tmp_path)
    data = json.loads((tmp_path / "data/compare.js").read_text().removeprefix("window.fpgData = ")[:-2])
    (compared,) = [row for row in data["tracks"][0]["rows"] if row["slug"] == "player-2"]
    assert (compared["rank"], compared["gap"], compared["scores"][UNSEEN]) == ("–", None, [None] * 3)
    page = (tmp_path / "entries/ally/player-2.html").read_text()
    assert "over the public suite" in page
    assert "It has not played the unseen suite, so it has no rank." in page


def test_the_same_player_in_two_tables_is_named_once(tmp_path):
    board = example_board(3)
    crossplay = dataclasses.replace(board.crossplay, same_player={"player-1": "player-0"})
    build_site(dataclasses.replace(board, crossplay=crossplay), tmp_path)
    assert "shown once: Player 1 as Player 0" in (tmp_path / "crossplay.html").read_text()


def test_links_of_submissions_are_https_or_none(pages):
    links = [attrs["href"] for page in pages.values() for tag, attrs in page.elements if tag == "a"]
    assert not [link for link in links if re.match(r"(?i)\s*(javascript|data|vbscript):", link)]


def test_nothing_is_loaded_from_anywhere_else(pages):
    for path, page in pages.items():
        for tag, attrs in page.elements:
            addresses = [value for name, value in attrs.items() if name in LEADS_AWAY and tag != "a"]
            addresses += [attrs["href"]] if tag == "link" else []
            assert not [value for value in addresses if re.match(r"(?i)([a-z]+:)?//|[a-z]+:", value)], path


def test_every_file_that_a_page_refers_to_is_there(site, pages):
    for path, page in pages.items():
        for _, attrs in page.elements:
            for name in ("href", "src", "data-file"):
                address = attrs.get(name) or "#"
                if address.startswith(("#", "https://")):
                    continue
                target = path.parent / unquote(address.partition("#")[0])
                assert target.is_file(), (path, address)


def test_links_within_a_page_lead_somewhere(site, pages):
    for path, page in pages.items():
        ids = [attrs["id"] for _, attrs in page.elements if "id" in attrs]
        assert len(ids) == len(set(ids)), path
        inside = [
            attrs["href"][1:] for _, attrs in page.elements if (attrs.get("href") or "").startswith("#")
        ]
        assert set(inside) <= set(ids), path


def test_every_page_forbids_what_it_does_not_need(pages):
    for path, page in pages.items():
        (policy,) = [
            attrs["content"]
            for _, attrs in page.elements
            if attrs.get("http-equiv") == "Content-Security-Policy"
        ]
        assert "default-src 'none'" in policy, path
        scripts = re.search("script-src ([^;]*)", policy)[1]
        assert scripts == "'self' file:", path
        assert "unsafe" not in policy, path


def test_styles_and_scripts_of_ours_load_nothing(site):
    for path in (site / "static").glob("*"):
        text = path.read_text(encoding="utf-8")
        for word in ("fetch(", "XMLHttpRequest", "@import", "url(", "innerHTML", "eval(", "insertAdjacent"):
            assert word not in text, (path, word)


def test_the_page_on_submitting_shows_the_docs_own_commands(pages, site):
    page, docs = pages[site / "submit.html"], Path(__file__).parents[2] / "docs"
    told = (docs / "submitting.md").read_text()
    commands = [line for text in page.text for line in text.splitlines() if line.startswith("fpg-bench ")]
    verbs = [command.split()[1] for command in commands if command in told]
    assert verbs == ["train", "export", "submit", "submit"]


def test_the_page_on_submitting_leads_to_the_docs_where_they_are(tmp_path, pages, site):
    build_site(example_board(1), tmp_path, docs="../site")
    links = re.findall(r'<a href="../site/([\w-]+)\.html[^"]*">', (tmp_path / "submit.html").read_text())
    assert len(links) == 9  # three of them at the foot
    folder = Path(__file__).parents[2] / "docs"
    assert [page for page in links if not (folder / f"{page}.md").is_file()] == []
    assert "docs/submitting.md" in pages[site / "submit.html"].text  # where nobody said
    entry = (tmp_path / "entries/ally/player-0.html").read_text()
    assert 'href="../../../site/rules.html"' in entry
    assert not (tmp_path / "rules.html").exists()


@pytest.mark.parametrize("name", ["rules", "measures", "glossary"])
def test_the_words_of_the_docs_stand_in_the_site_with_links_that_hold(pages, site, name):
    page = pages[site / f"{name}.html"]
    source = (Path(__file__).parents[2] / "docs" / f"{name}.md").read_text()
    titles = [line.lstrip("# ") for line in source.splitlines() if re.match(r"##? \S", line)]
    assert [title for title in titles if title.replace("`", "") not in "".join(page.text)] == []
    assert not re.search(r":::|<!--|\]\(|\*\*", "".join(page.text))
    ids = {path: {has["id"] for _, has in found.elements if "id" in has} for path, found in pages.items()}
    links = [has["href"] for tag, has in page.elements if tag == "a" and "href" in has]
    for target, _, anchor in (link.partition("#") for link in links if link.endswith("html") or "#" in link):
        assert not anchor or anchor in ids[(site / target).resolve() if target else site / f"{name}.html"]


def test_the_docs_example_of_ranks_comes_out_and_its_table_says_the_same(capsys):
    text = (Path(__file__).parents[2] / "docs/leaderboard.md").read_text()
    code, told = re.search(r"```python\n(.*?)# (.*?)\n```", text, re.DOTALL).groups()
    exec(code)
    assert capsys.readouterr().out.strip() == told
    table = re.findall(r"^\| [abc] \|.*\| (\S+) \|$", text, re.MULTILINE)
    assert [format_rank(rank) for rank in ast.literal_eval(told)] == table


def test_the_board_can_be_downloaded_as_json(site):
    board = json.loads((site / "board.json").read_text())
    entries = {entry["slug"]: entry for entry in board["tracks"][0]["entries"]}
    assert sorted(entries) == [f"player-{k}" for k in range(7)]
    assert entries["player-1"]["replays"] == ["replays/ally/player-1/ab.js"]
    assert entries["player-0"]["figures"] is None


@pytest.mark.slow
def test_the_front_page_stays_small_for_many_entries(tmp_path):
    build_site(example_board(200, rivals=22), tmp_path)
    page = Page(tmp_path / "index.html")
    loaded = [
        attrs.get("src") or attrs.get("href") for tag, attrs in page.elements if tag in ("script", "link")
    ]
    files = [tmp_path / "index.html", *(tmp_path / name for name in loaded)]
    assert sum(file.stat().st_size for file in files) < 1_500_000


def test_an_entry_s_page_says_how_it_is_cited_and_has_a_badge(site):
    page = (site / "entries/ally/player-1.html").read_text()
    assert "@misc{fpg-bench-ally-player-1," in page
    badge = (site / "badges/ally/player-1.svg").read_text()
    assert ElementTree.fromstring(badge).attrib["aria-label"].startswith("fpg-bench ally: rank ")
    assert "none: it was submitted or changed after" in page
    assert "trained-0, trained-1, trained-2" in (site / "entries/ally/player-2.html").read_text()


def test_every_command_that_trains_a_zoo_entry_names_an_agent_of_the_zoo():
    for path in sorted((ROOT / "leaderboard/submissions").glob("*/*/submission.yaml")):
        zoo = yaml.safe_load(path.read_text()).get("zoo")
        if zoo and "champion" not in zoo:
            assert load_zoo().members(zoo)


def test_a_board_without_entries_has_a_site(tmp_path):
    board = example_board(1)
    empty = {"entries": (), "improvement": Improvement((), [], [], []), "profiles": Profiles((), {})}
    tracks = tuple(dataclasses.replace(track, **empty) for track in board.tracks)
    build_site(dataclasses.replace(board, tracks=tracks, crossplay=None), tmp_path)
    assert "No entries yet" in (tmp_path / "index.html").read_text()
    assert "has not been played" in (tmp_path / "crossplay.html").read_text()


def test_building_again_removes_what_is_no_longer_there(tmp_path):
    build_site(example_board(4), tmp_path)
    before = (tmp_path / "index.html").stat().st_mtime_ns
    build_site(example_board(4), tmp_path)
    assert (tmp_path / "index.html").stat().st_mtime_ns == before
    build_site(example_board(2), tmp_path)
    assert len(list((tmp_path / "entries" / "ally").iterdir())) == 2


def test_a_folder_of_other_files_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(UserError, match="not a leaderboard's site"):
        build_site(example_board(1), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize("slug", ["../../escaped", "a/b", "", "UPPER", "x" * 41, ".hidden", "a\n"])
def test_a_slug_that_is_no_file_name_is_refused(tmp_path, slug):
    board = changed(example_board(1), lambda entry: dataclasses.replace(entry, slug=slug), "player-0")
    with pytest.raises(UserError, match="entry of ally"):
        build_site(board, tmp_path / "out")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("link", "kept"),
    [
        ("https://example.org/a?b=1&c=2#d", True),
        ("https://example.org:8080/", True),
        ("http://example.org", False),
        ("javascript:alert(1)", False),
        ("https://user@evil.example", False),
        ('https://x.org/"onmouseover="alert(1)', False),
        ("https://x.org/ y", False),
        ("https://x.org\n", False),
        (None, False),
    ],
)
def test_only_plain_https_links_are_kept(link, kept):
    assert safe_link(link) == (link if kept else None)


def test_numbers_have_one_format_and_missing_ones_are_a_dash():
    assert [format_number(value) for value in (1.26, -3, None, float("nan"))] == ["1.3", "−3.0", "–", "–"]
    pairs = [(0.1234, "share"), (12345.6, "whole"), (2, "dB"), (-2, "step")]
    assert [format_number(*pair) for pair in pairs] == ["12.3 %", "12,346", "2.0 dB", "−2.00"]
    assert [format_signed(value) for value in (1.26, -3)] == ["+1.3", "−3.0"]
    assert [format_rank(rank) for rank in ((1, 1), (2, 5), None)] == ["1", "2–5", "–"]
    assert format_interval(Score(0.0, -1.0, 2.0)) == "−1.0 to 2.0"
    assert format_interval(Score(0.0)) == format_interval(None) == ""


def test_serving_needs_a_site_and_a_free_port(site, tmp_path):
    with pytest.raises(UserError, match="nothing is built there"):
        make_server(tmp_path, 0)
    with make_server(site, 0) as server, pytest.raises(UserError, match="is in use"):
        make_server(site, server.server_port)


@pytest.mark.process
def test_the_verbs_build_and_say_what_is_wrong(tmp_path):
    (tmp_path / "board" / "submissions").mkdir(parents=True)
    out = tmp_path / "out"
    found = fpg("leaderboard", "build", "--folder", tmp_path / "board", "--out", out)
    assert found.stdout.startswith("0 entries, 0 rounds to watch")
    assert (out / "index.html").is_file()
    served = fpg("leaderboard", "serve", tmp_path / "none")
    assert (served.returncode, served.stderr.count("\n")) == (2, 1)
    assert "leaderboard build" in served.stderr


@pytest.mark.process
def test_ctrl_c_ends_serving_with_one_line(site):
    import signal

    words = [sys.executable, "-m", "fpg_bench.cli", "leaderboard", "serve", str(site), "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith("http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        try:
            out, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (process.returncode, out, err) == (0, "stopped\n", "")


def test_templates_are_part_of_the_package():
    import fpg_bench.leaderboard.site as package

    assert (Path(package.__file__).parent / "templates" / "base.html").is_file()
