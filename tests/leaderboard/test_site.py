"""The built site as files: what may stand in them, and that they refer to nothing but each other."""

import ast
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

from fpg_bench.errors import UserError
from fpg_bench.leaderboard.site.build import build_site
from fpg_bench.leaderboard.site.replays import Replay
from fpg_bench.leaderboard.site.serve import make_server
from fpg_bench.leaderboard.site.shown import Score
from fpg_bench.leaderboard.site.wording import interval_text, rank_text, safe_link, signed, written
from fpg_bench.zoo.zoo import load_zoo
from tests.leaderboard.example_board import HOSTILE, example_board
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
    four = ["Rank", "Entry", "Score, unseen", "Known", "Gap", "Shifted", "Worst", "Jammed", "Return a step"]
    assert columns(site) == four
    build_site(example_board(3, season=None), tmp_path)
    assert columns(tmp_path) == ["Rank", "Entry", "Score, known", "Worst", "Jammed", "Return a step"]
    assert "No season is closed yet" in (tmp_path / "ranking.html").read_text()
    assert "no season closed yet" in (tmp_path / "compare.html").read_text()


def test_entries_stand_by_score_and_the_best_is_named_with_how_many_may_be_first(tmp_path):
    board = example_board(5)
    for row, (score, rank) in zip(
        board["tracks"][0]["rows"][1:], [(40, [1, 4]), (60, [2, 3]), (70, [1, 2]), (30, [3, 4])], strict=True
    ):
        row |= {"rank": rank, "score": {"value": score}}
    build_site(board, tmp_path)
    page = (tmp_path / "ranking.html").read_text()
    order = re.findall(r'class="who" data-v="player (\d)', page.split('id="opponent-pursuit"')[0])
    assert order == ["3", "2", "1", "4", "0"]
    told = " ".join("".join(Page(tmp_path / "ranking.html").text).split())
    assert "Player 3 has the highest score; 1 other may be first as well. Ranked by" in told


def test_the_gap_is_known_minus_unseen(tmp_path):
    board = example_board(2)
    board["tracks"][0]["rows"][1]["scores"] |= {"known": {"value": 60.25}, "unseen": {"value": 20.0}}
    build_site(board, tmp_path)
    assert '<td class="num extra" data-v="40.25">+40.2</td>' in (tmp_path / "ranking.html").read_text()
    assert "+40.2" in (tmp_path / "entries/ally/player-1.html").read_text()


def test_the_worst_says_who_and_where(tmp_path):
    build_site(example_board(4), tmp_path)
    for name in ("ranking.html", "entries/ally/player-3.html"):
        text = "".join(Page(tmp_path / name).text)
        assert "Player 1" in text  # of the other side, by its name
        assert "cross-play" in text
        assert "−13.96 a step" in text
    text = "".join(Page(tmp_path / "entries/ally/player-2.html").text)
    assert re.search(r"against \w+/pursuit \(known\) it earns 2.50 a step", text)


def test_who_does_better_on_seeds_that_everybody_knew_is_told_in_words(site):
    told = "scores 7.2 more on the seeds that everybody knew"
    assert (site / "ranking.html").read_text().count(told) == 1
    assert told in (site / "entries/ally/player-2.html").read_text()
    assert "that everybody knew than" not in (site / "entries/ally/player-3.html").read_text()


def test_who_was_entered_after_the_season_was_closed_is_marked(site):
    told = "had access to the season's field</small>"
    assert (site / "ranking.html").read_text().count(told) == 2  # one in each table
    assert "It had access" in (site / "entries/ally/player-1.html").read_text()
    assert "It had access" not in (site / "entries/ally/player-3.html").read_text()


def test_an_entry_without_a_score_that_ranks_is_shown_last_and_without_a_rank(tmp_path):
    board = example_board(4)
    row = board["tracks"][0]["rows"][2]
    for role in ("unseen", "shifted", "public"):
        del row["scores"][role], row["counterparts"][role]
    row |= {"rank": None, "score": row["scores"]["known"]}
    build_site(board, tmp_path)
    data = json.loads((tmp_path / "data/compare.js").read_text().removeprefix("window.fpgData = ")[:-2])
    (compared,) = [one for one in data["tracks"][0]["rows"] if one["slug"] == "player-2"]
    assert (compared["rank"], compared["gap"], compared["scores"]["unseen"]) == ("–", None, [None] * 3)
    page = (tmp_path / "entries/ally/player-2.html").read_text()
    assert "over the known field" in page
    assert "It has not played the unseen field, so it has no rank." in page
    order = re.findall(r'href="entries/ally/(player-\d)', (tmp_path / "ranking.html").read_text())
    assert order[2:4] == ["player-2", "player-0"]


def crossplay_of(board, folder):
    build_site(board, folder)
    return json.loads((folder / "data/crossplay.js").read_text().removeprefix("window.fpgData = ")[:-2])


def test_one_player_in_two_tables_is_shown_once_where_it_fares_alike(tmp_path):
    board = example_board(3)
    found = board["crossplay"]
    found |= {"twins": [["player-0", "player-1"]]}
    found["nash"]["opponent"] = {"player-0": 0.25, "player-1": 0.75}
    assert crossplay_of(board, tmp_path / "apart")["opponents"] == ["player-0", "player-1"]
    for matrix in (*found["returns"].values(), found["jamming_success_rate"]):
        for line in matrix:
            line[1] = line[0]
    data = crossplay_of(board, tmp_path / "alike")
    assert data["opponents"] == ["player-0"]
    assert [len(line) for matrix in data["matrices"].values() for line in matrix] == [1] * 9
    assert data["nash"]["opponent"] == {"player-0": 1.0}
    told = (tmp_path / "alike/crossplay.html").read_text()
    assert "shown once: Player 1 as Player 0" in told


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
    assert [rank_text(rank) for rank in ast.literal_eval(told)] == table


def test_the_board_can_be_taken_away_whole(site):
    board = json.loads((site / "board.json").read_text())
    assert [row["slug"] for row in board["tracks"][0]["rows"]] == [f"player-{k}" for k in range(7)]
    assert board["tracks"][0]["rows"][1]["replays"] == ["replays/ally/player-1/ab.js"]


@pytest.mark.slow
def test_the_front_page_stays_small_for_many_entries(tmp_path):
    build_site(example_board(200, counterparts=22), tmp_path)
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
    assert "nobody of the board" in page  # it had access
    assert "trained-0, trained-1, trained-2" in (site / "entries/ally/player-2.html").read_text()


def test_every_command_that_trains_a_zoo_entry_names_an_agent_of_the_zoo():
    for path in sorted((ROOT / "leaderboard/submissions").glob("*/*/submission.yaml")):
        zoo = yaml.safe_load(path.read_text()).get("zoo")
        if zoo and "champion" not in zoo:
            assert load_zoo().members(zoo)


def test_a_board_without_entries_has_a_site(tmp_path):
    board = example_board(1) | {"crossplay": None}
    for track in board["tracks"]:
        track |= {"rows": [], "improvement": {"names": [], "value": [], "low": [], "high": []}}
        track["profiles"] = {"thresholds": [], "share": {}}
    build_site(board, tmp_path)
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


@pytest.mark.parametrize("slug", ["../../escaped", "a/b", "", "UPPER", "x" * 41, None, ".hidden", "a\n"])
def test_a_name_that_is_no_files_is_refused(tmp_path, slug):
    board = example_board(1)
    board["tracks"][0]["rows"][0]["slug"] = slug
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
        (["https://x.org"], False),
    ],
)
def test_only_plain_https_links_are_kept(link, kept):
    assert safe_link(link) == (link if kept else None)


def test_numbers_are_written_alike_and_missing_ones_as_a_dash():
    assert [written(value) for value in (1.26, -3, None, float("nan"), "7", True)] == ["1.3", "−3.0", *"––––"]
    told = [written(0.1234, "share"), written(12345.6, "whole"), written(2, "dB"), written(-2, "step")]
    assert told == ["12.3 %", "12,346", "2.0 dB", "−2.00"]
    assert [signed(value) for value in (1.26, -3, None)] == ["+1.3", "−3.0", "–"]
    assert [rank_text(rank) for rank in ([1, 1], [2, 5], None, [None, 2])] == ["1", "2–5", "–", "–"]
    assert interval_text(Score(0.0, -1.0, 2.0)) == "−1.0 to 2.0"
    assert interval_text(Score(0.0, None, 2.0)) == ""


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
