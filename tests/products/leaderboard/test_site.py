"""The built site as files: their contents, and that they refer to nothing but each other."""

import csv
import dataclasses
import html
import json
import re
from email.message import Message
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import parse_qsl, unquote
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ALLIES, OPPONENTS
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.game import actions, sensing
from fpg_bench.game.metrics import measures
from fpg_bench.game.names import CHOSEN, JAMMING_TYPES, OBSERVED
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import TALLY
from fpg_bench.players.agent import load_agent
from fpg_bench.products.leaderboard.about import SubmissionFile
from fpg_bench.products.leaderboard.site import build, page_data, views
from fpg_bench.products.leaderboard.site.build import build_site
from fpg_bench.products.leaderboard.site.page_data import agent_file, zoo_policies
from fpg_bench.products.leaderboard.site.replays import Replay
from fpg_bench.products.leaderboard.tracks import PUBLIC, UNSEEN
from tests.products.leaderboard.example_board import (
    HOSTILE,
    example_board,
    small_zoo,
    with_entry,
    with_figures,
    with_link,
)

ROOT = Path(__file__).parents[3]
ROUND = Replay("replays/ally/player-1/ab.js", HOSTILE[0], HOSTILE[1], 'fpgRound({"label":"x"});\n')
LOADING = {"src", "srcset", "poster", "action", "formaction", "data", "background", "ping"}
FINDINGS = (ROOT / "docs/results/findings.md").read_text()
SHARED_PAGES = {"index", "ranking", "play", "try", "crossplay", "crossplay-link", "compare"}
SHARED_PAGES |= {"submit"}


class Page(HTMLParser):
    """A page as a browser reads it: elements with their attributes, and text."""

    def __init__(self, path):
        super().__init__()
        self.elements, self.texts = [], []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.texts.append(data)

    @property
    def text(self):
        return " ".join("".join(self.texts).split())

    def values(self, name):
        return [attrs[name] for _, attrs in self.elements if name in attrs]


@pytest.fixture(scope="module", autouse=True)
def few_agents():
    with small_zoo():
        yield


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A site whose every text tries to become markup."""
    folder = tmp_path_factory.mktemp("site") / "out"
    build_site(example_board(7, hostile=True), folder, {("ally", "player-1"): [ROUND]})
    return folder


@pytest.fixture(scope="module")
def plain_site(tmp_path_factory):
    """A site with unusual figures and without rounds, which links to the documentation."""
    folder, board = tmp_path_factory.mktemp("plain"), example_board(5)
    verified = {entry.slug: figures for entry, figures in board.tracks[0].verified()}
    figures = verified.pop("player-2")  # has not played the unseen suite
    changes = {name: {PUBLIC: getattr(figures, name)[PUBLIC]} for name in ("scores", "by_rival", "units")}
    board = with_figures(
        board, "player-2", rank=None, may_be_best=False, behind=None, score=figures.scores[PUBLIC], **changes
    )
    for slug, is_best in zip(verified, (True, True, False), strict=True):
        board = with_figures(board, slug, may_be_best=is_best)
    board = with_figures(board, "player-1", scores={PUBLIC: Interval(60.25), UNSEEN: Interval(20.0)})
    played = dataclasses.replace(board.crossplay["standard"], same_player={"player-1": "player-0"})
    build_site(dataclasses.replace(board, crossplay={"standard": played}), folder, docs="../site")
    return folder


@pytest.fixture(scope="module")
def pages(site):
    return {str(path.relative_to(site)): Page(path) for path in site.rglob("*.html")}


def entry_file(number, track="ally"):
    return f"entries/{track}/player-{number}.html"


def test_every_entry_has_a_page(pages):
    entries = {entry_file(k) for k in range(7)} | {entry_file(k, "opponent-pursuit") for k in range(2)}
    assert pages.keys() == {f"{name}.html" for name in SHARED_PAGES} | entries


def test_no_text_of_a_submission_becomes_markup(site, pages):
    for path, page in pages.items():
        assert not [name for _, attrs in page.elements for name in attrs if name.startswith("on")], path
        images = [attrs["src"] for tag, attrs in page.elements if tag == "img"]
        assert all(re.fullmatch(r"\.\./\.\./badges/[\w/-]+\.svg", image) for image in images), path
        assert all("src" in attrs for tag, attrs in page.elements if tag == "script"), path
        raw = (site / path).read_text(encoding="utf-8")
        assert not [text for text in HOSTILE if re.search("[<>']", text) and text in raw], path
        links = [attrs["href"] for tag, attrs in page.elements if tag == "a"]
        assert not [link for link in links if re.match(r"(?i)\s*(javascript|data|vbscript):", link)], path
    texts = "".join("".join(page.texts) for page in pages.values())
    assert all(text in texts for text in HOSTILE)
    for path in (site / "data").rglob("*.js"):
        assert not re.search("[<>]", path.read_text(encoding="utf-8")), path


def columns(site, kind='[^"]*'):
    """The headings of the first table of the ranking, by their class."""
    table = (site / "ranking.html").read_text().split('id="ally"')[1].split("</thead>")[0]
    return re.findall(rf'<th [^>]*class="{kind}"[^>]*><button [^>]*class="sort"[^>]*>([^<]*)</button>', table)


def test_tables_have_columns_for_what_was_played(site, tmp_path):
    mission = ["Overlap ratio", "Jamming success rate"]
    shown = ["Entry", "Score", "From the leader", "May be best", "If trained again", *mission, "Lowest known"]
    extra = ["95 % interval", "Rank", "Public", "Gap", "Shifted", "Return per step"]
    assert columns(site) == [*shown, *extra]
    assert columns(site, "num extra") == extra
    build_site(example_board(3, season=None), tmp_path)
    assert columns(tmp_path) == [*shown, "95 % interval", "Rank", "Return per step"]
    assert "No season is closed yet" in (tmp_path / "ranking.html").read_text()
    assert "no season closed yet" in (tmp_path / "compare.html").read_text()
    unchanged = (tmp_path / "submit.html").stat().st_mtime_ns
    build_site(example_board(2, season=None), tmp_path)  # equal files stay, and old ones go
    assert (tmp_path / "submit.html").stat().st_mtime_ns == unchanged
    assert len(list((tmp_path / "entries" / "ally").iterdir())) == 2


def test_a_table_explains_what_a_reader_stumbles_over():
    """Random play below its own zero, an agent in two tables, and a leader that is covered often."""
    board = with_link(example_board(3), season=2)
    zoo = {"zoo": "zoo/one"}
    rule = {"zoo": "ally-rule/rule", "training": {}}
    named = {"ally": {"script": "random"}, "opponent-pursuit": zoo, "opponent-link": zoo, "ally-link": rule}
    tracks = []
    for track in board.tracks:
        first, *others = track.entries
        figures = dataclasses.replace(first.figures, score=Interval(-11.13))
        about = SubmissionFile.model_construct(**named.get(track.key, {}))
        first = dataclasses.replace(first, about=about, figures=figures)
        trained = SubmissionFile.model_construct(training={})
        others = [dataclasses.replace(entry, about=trained) for entry in others]
        tracks.append(dataclasses.replace(track, entries=(first, *others)))
    board = dataclasses.replace(board, tracks=tuple(tracks))
    notes = {track.key: " ".join(views.track_view(board, track)["notes"]) for track in board.tracks}
    titles = {track.key: track.title for track in board.tracks}
    for one, other in (("opponent-pursuit", "opponent-link"), ("opponent-link", "opponent-pursuit")):
        assert f"also in the table “{titles[other]}”" in notes[one]
    assert "overlap ratio can be high" in notes["ally-link"]
    least = sum(f.rank is not None for t in board.tracks if t.key == "ally-link" for _, f in t.verified()) - 1
    assert f"{least} of {least} trained entries score less than" in notes["ally-link"]
    assert "trained entries" not in notes["ally"]
    failed = "1 of 2 checks on these rivals failed when the season was closed (kinds agree)"
    assert [failed in notes[track.key] for track in board.tracks] == [bool(t.checks) for t in board.tracks]


def test_the_best_and_its_gap_are_named(plain_site):
    leader = "Player 3 leads, but not surely: with 95 % confidence the best policies of 3 ranked entries"
    for name in ("index.html", "ranking.html"):
        assert leader in Page(plain_site / name).text
    gap = '<td class="extra">+40.2</td>'  # public minus unseen
    assert gap in (plain_site / "ranking.html").read_text()
    assert "+40.2" in (plain_site / entry_file(1)).read_text()
    assert "shown once here: Player 1 as Player 0" in Page(plain_site / "crossplay.html").text


def test_the_lowest_known_return_stands_there_with_who_found_it_and_what_was_tried(pages):
    ranking, entry, other = (pages[name].text for name in ("ranking.html", entry_file(2), entry_file(1)))
    headline = "Hardest to break of 1 that were attacked: Player 2"
    for text in (ranking, pages["index.html"].text):
        assert headline in text
    assert ranking.count("at most −14.65") == 2  # its row, and the headline
    assert "1,200 CPU s, seed 0" in ranking
    assert "at most −13.96" in ranking
    assert (
        "lowest known return of a single training seed is at most −14.65 per step (−15.00 to −14.30)" in entry
    )
    made = "2 responses were made to lower it (seed 0: 2 responses of 3,000,000 steps and 2,400 CPU s; "
    assert made + "seeds 1, 2, 3, 4: nobody yet)" in entry
    assert ranking.count("1 of 5 seeds attacked") == 1
    assert ranking.count("nobody yet") == 5
    assert "single training seed is at most −13.96 per step, against Player 1" in other
    assert ", cross-play, seed 3. Nobody made a response to it yet" in other
    assert "among the entries; no guarantee" in pages["crossplay.html"].text


@pytest.mark.parametrize(
    ("number", "in_ranking", "on_page"),
    [
        (1, "late entry", "Late entry: it was submitted or changed"),
        (4, "1,234 of 5,000 rounds lost by rule", "1,234 of 5,000 rounds lost by rule: its answer"),
        (6, "plays the same as ally/player-9", "It plays the same as ally/player-9: a script"),
    ],
)
def test_remarks_are_in_the_ranking_and_on_the_entry_s_page(site, pages, number, in_ranking, on_page):
    ranking = (site / "ranking.html").read_text()
    assert ranking.count(f'title="{in_ranking}">*<') == (2 if number == 1 else 1)  # tables
    assert on_page in pages[entry_file(number)].text
    assert on_page not in pages[entry_file(3)].text


def test_the_page_of_an_entry_has_its_citation_badge_and_rivals(site, pages):
    assert "@misc{fpg-bench-ally-player-1," in pages[entry_file(1)].text
    badge = (site / "badges/ally/player-1.svg").read_text()
    assert ElementTree.fromstring(badge).attrib["aria-label"].startswith("fpg-bench ally: rank ")
    assert "none: it was submitted or changed after" in pages[entry_file(1)].text
    assert "TD3 trained-0, trained-1, trained-2" in pages[entry_file(2)].text
    assert "TD3 trained-0trained against expert its rounds" in pages[entry_file(2)].text
    command = (
        f"fpg-bench play --ally no-such/agent/seed_0{HOSTILE[1]} --opponent trained-0 --path pursuit --seed 7"
    )
    assert command in pages[entry_file(1)].texts
    learned = "Learned offlinefrom fpg/ally-mixed-v0"
    assert [number for number in range(1, 5) if learned in pages[entry_file(number)].text] == [2]
    assert "returns 1234.5 in all" in pages[entry_file(3)].text
    assert "fpg-bench play --ally idle --opponent trained-0" in pages[entry_file(3)].text


def test_an_entry_without_a_score_that_ranks_has_no_rank(plain_site):
    data = (plain_site / "data/compare/ally.js").read_text().removeprefix('fpgCompared("ally", ')[:-3]
    (row,) = [row for row in json.loads(data)["rows"] if row["slug"] == "player-2"]
    assert (row["rank"], row["gap"], row["scores"][UNSEEN]) == ("–", None, [None] * 3)
    text = Page(plain_site / entry_file(2)).text
    assert "over the public suite" in text
    assert "It has not played the held-out suite, so it has no rank." in text


def test_the_front_page_shows_the_leaders_and_a_round_and_stays_small(site, pages, plain_site):
    board, text = example_board(7, hostile=True), pages["index.html"].text
    leaders = [next(track.verified()) for track in board.tracks]
    rows = re.findall(r'href="entries/([\w-]+)/([\w-]+).html"', (site / "index.html").read_text())
    assert rows == [(t.key, entry.slug) for t, (entry, _) in zip(board.tracks, leaders, strict=True)]
    cells = re.findall(r'<td class="num[^>]*>(?:<b>)?([^<]*)<', (site / "index.html").read_text())
    for k, (_, figures) in enumerate(leaders):
        score = views.format_number(figures.score.value)
        mission = [views.format_number(figures.measures[name], "share") for name in views.MISSION]
        assert cells[4 * k : 4 * k + 4] == [score, "2 of 6" if k == 0 else "2 of 2", *mission]
        assert f"<small>{views.format_interval(figures.score)}</small>" in (site / "index.html").read_text()
    assert "9 agents and scripts" in text
    assert "8 of 9 entries are verified: their 400 records, 40,000 rounds" in text
    assert ROUND.file in pages["index.html"].values("src")
    elements = pages["index.html"].elements
    loaded = [a.get("src") or a.get("href") for tag, a in elements if tag in ("script", "link")]
    assert sum((site / name).stat().st_size for name in ["index.html", *loaded]) < 100_000
    without_rounds = (plain_site / "index.html").read_text()
    assert "<canvas" not in without_rounds
    assert "film.js" not in without_rounds


def test_the_leader_of_the_game_is_the_best_of_the_board_that_the_page_can_play():
    board, zoo = example_board(6), page_data.zoo_policies()
    first, second, *_ = [entry.slug for entry, _ in board.tracks[0].verified()]
    board = with_entry(
        board, first, about=SubmissionFile.model_construct()
    )  # without a policy that the page has
    about = SubmissionFile.model_construct(zoo=next(iter(zoo)))
    data = page_data.data_files(with_entry(board, second, about=about), {})
    games = json.loads(data["data/play.js"].removeprefix("window.fpgData = ")[:-2])["games"]
    assert games["standard"]["leaders"]["ally"] == f"agent:agents/{next(iter(zoo)).replace('/', '-')}.js"


def test_the_axis_of_a_ranking_has_0_to_100_wide_however_low_the_last_is():
    axis = views.Axis.of_scores([Interval(-436.0, -440.0, -432.0), Interval(60.0, 58.0, 62.0)], lowest=-20)
    assert axis.place(100) - axis.place(0) == 100
    assert axis.place(-436.0) == axis.place(-20) == axis.margin
    macros = build._environment(example_board(2), "").from_string(
        '{% from "macros.html" import interval %}{{ interval(low, axis) }}|{{ interval(high, axis) }}'
    )
    low, high = macros.render(axis=axis, low=Interval(-436.0), high=Interval(60.0)).split("|")
    assert "M8 5l-6 5l6 5" in low
    assert "l-6" not in high


def test_each_scenario_has_a_page_of_cross_play_with_its_own_players(tmp_path):
    board = example_board(4, season=3)
    both = with_link(board, season=2)
    alone, standard, link = (
        page_data.crossplay_data(shown, scenario, {}, {})
        for shown, scenario in ((board, "standard"), (both, "standard"), (both, "link"))
    )
    assert standard == alone
    assert set(link["allies"]) == {f"player-{k}-link" for k in range(4)}
    assert link["names"]["opponent"] == {f"player-{k}-link": f"Player {k} on a link" for k in range(2)}
    assert standard["watch"]["opponent"]
    assert link["watch"]["opponent"]
    assert (standard["game"], link["game"]) == ("standard", "link")
    build_site(both, tmp_path)
    pages = {name: Page(tmp_path / f"{name}.html") for name in ("crossplay", "crossplay-link")}
    for name, page in pages.items():
        assert {"crossplay.html", "crossplay-link.html"} <= set(page.values("href"))
        assert f"data/{name}.js" in page.values("src")
        assert ("Not in it yet: Player 1 on a link." in page.text) == (name == "crossplay-link")
        assert re.search(
            r"everybody against everybody (No ally is best|One ally is best).* \d of \d allies",
            page.text,
            re.I,
        )


def test_the_install_box_of_the_front_page_holds_commands_of_the_readme(pages):
    readme = (ROOT / "README.md").read_text().splitlines()
    box = next(text for text in pages["index.html"].texts if text.startswith("make "))
    assert [line for line in box.splitlines() if not any(known.startswith(line) for known in readme)] == []


def software(page):
    """The links of a page's header to the software, by label."""
    header = page.read_text().split('aria-label="Software"')[1].split("</nav>")[0]
    return {label: link for link, label in re.findall(r'<a href="([^"]*)"[^>]*>(\w+)</a>', header)}


def test_every_header_leads_to_docs_source_and_paper_where_their_address_is_known(
    site, plain_site, tmp_path, monkeypatch
):
    paper = yaml.safe_load((ROOT / "CITATION.cff").read_text())["references"][0]["doi"]
    known = {"Paper": f"https://doi.org/{paper}"}
    for path in site.rglob("*.html"):
        assert software(path) == known
    assert software(plain_site / entry_file(1)) == {"Docs": "../../../site/index.html"} | known
    urls = ["Repository, https://git.example.org/fpg", "Documentation, https://docs.example.org"]
    message = Message()
    for url in urls:
        message["Project-URL"] = url
    monkeypatch.setattr("fpg_bench.common.output.metadata", lambda name: message)
    build_site(example_board(2), tmp_path)
    published = {"Docs": "https://docs.example.org/index.html", "Source": "https://git.example.org/fpg"}
    assert software(tmp_path / "index.html") == published | known


def test_pages_load_only_files_of_the_site_and_say_so(site, pages):
    for path, page in pages.items():
        loaded = [(tag, name, attrs[name]) for tag, attrs in page.elements for name in LOADING & attrs.keys()]
        security = [
            a["content"] for _, a in page.elements if a.get("http-equiv") == "Content-Security-Policy"
        ]
        assert len(security) == 1, path
        assert "default-src 'none'" in security[0], path
        assert re.search("script-src ([^;]*)", security[0])[1] == "'self' file:", path
        assert "unsafe" not in security[0], path
        addresses = [value for tag, _, value in loaded if tag != "a"]
        addresses += [attrs["href"] for tag, attrs in page.elements if tag == "link"]
        assert not [value for value in addresses if re.match(r"(?i)([a-z]+:)?//|[a-z]+:", value)], path
        for address in page.values("href") + page.values("src") + page.values("data-file"):
            if not address.startswith(("#", "https://")):
                target = (site / path).parent / unquote(address.partition("#")[0])
                assert target.is_file(), (path, address)
        ids = page.values("id")
        assert len(ids) == len(set(ids)), path
        assert {link[1:] for link in page.values("href") if link.startswith("#")} <= set(ids), path


def test_a_link_to_a_page_has_a_description_and_a_picture(site, pages):
    assert (site / "static/preview.png").read_bytes().startswith(b"\x89PNG")
    for path, page in pages.items():
        found = [attrs for tag, attrs in page.elements if tag == "meta"]
        metas = {a.get("name") or a.get("property"): a.get("content") for a in found}
        assert len(metas["description"]) > 50, path
        assert (site / path).parent.joinpath(metas["og:image"]).is_file(), path


def test_styles_and_scripts_load_nothing(site):
    for path in {*(site / "static").glob("*")} - {*(site / "static").glob("*.png")}:
        text = path.read_text(encoding="utf-8")
        for word in ("fetch(", "XMLHttpRequest", "@import", "url(", "innerHTML", "eval(", "insertAdjacent"):
            assert word not in text, (path, word)


def test_the_page_on_submitting_shows_the_commands_of_the_docs(pages):
    docs = (ROOT / "docs/benchmark/submitting.md").read_text()
    lines = [line for text in pages["submit.html"].texts for line in text.splitlines()]
    commands = [line for line in lines if line.startswith("fpg-bench ") and line in docs]
    assert [command.split()[1] for command in commands] == [
        "train",
        "export",
        "submit",
        "submit",
        "leaderboard",
    ]


def test_pages_link_to_the_documentation_where_its_address_is_known(plain_site, pages):
    links = re.findall(r'<a href="../site/([\w/-]+)\.html[^"]*">', (plain_site / "submit.html").read_text())
    assert len(links) == 10  # one of them in the header, three in the footer
    assert [page for page in links if not (ROOT / "docs" / f"{page}.md").is_file()] == []
    assert "../../../site/reference/rules.html" in Page(plain_site / entry_file(0)).values("href")
    assert {"docs/benchmark/leaderboard.md", "docs/benchmark/submitting.md"} <= set(
        pages["submit.html"].texts
    )


def test_the_docs_example_of_ranks_holds(capsys):
    text = (ROOT / "docs/benchmark/protocol.md").read_text()
    code, output = re.search(r"```python\n([^`]*rank_ranges\(.*?)# (.*?)\n```", text, re.DOTALL).groups()
    exec(code)
    assert capsys.readouterr().out.strip() == output


def test_the_board_can_be_downloaded_as_json(site):
    board = json.loads((site / "board.json").read_text())
    entries = {entry["slug"]: entry for entry in board["tracks"][0]["entries"]}
    assert sorted(entries) == [f"player-{k}" for k in range(7)]
    assert entries["player-0"]["figures"] is None


def test_scores_can_be_downloaded_as_csv(site):
    board = json.loads((site / "board.json").read_text())
    with (site / "scores.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    shown = {
        (track["key"], entry["slug"], role): score["value"]
        for track in board["tracks"]
        for entry in track["entries"]
        if entry["figures"]
        for role, score in entry["figures"]["scores"].items()
    }
    assert {(row["track"], row["entry"], row["suite"]): float(row["score"]) for row in rows} == shown


def test_who_is_unbroken_and_who_broke_what_stand_below_the_table_of_a_track(pages, site):
    text = pages["ranking.html"].text
    assert text.count("Entries by their lowest known return, and attackers") == 1  # one track has responses
    page = (site / "ranking.html").read_text()
    assert '<td class="num">−14.65</td><td class="num">−15.00 to −14.30</td><td>Breaker' in page
    assert '<td class="num">1</td><td class="num">1</td><td>Player 2' in page
    with (site / "unbroken.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["entry"], row["response"], row["return_per_step"]) for row in rows] == [
        ("player-2", "breaker-1", "-14.65"),
        ("player-2", "breaker-2", "-14.65"),
    ]


def test_every_measure_of_a_round_has_a_label():
    measured = measures(dict.fromkeys(TALLY.names, 0), np.zeros((2, 3)))
    of_records = {"return", "hop_entropy_bits"}
    assert views.MEASURES.keys() == {*of_records, *measured} - {"recoveries_cut"}


def sizes_in_the_browser():
    """Sizes and indices of the game that the browser's scripts write as numbers: file, pattern, values."""
    types, seen, chosen = len(JAMMING_TYPES), len(OBSERVED["ally"]), len(CHOSEN["ally"])
    first, cover = sensing.SENSED_TYPE, sensing.SENSED_COVERS
    return [
        ("game_rules", r"action\[(\d)\] > 0 \? rules\.band_middle", [actions.IN_BAND_GATE]),
        ("game_rules", r"action\[(\d)\] \* rules\.(?:band_half|tuning_span)", [actions.TUNING]),
        ("game_knowledge", r"SENSED_CENTRE = (\d+)", [sensing.SENSED_CENTRE]),
        ("game_knowledge", r"SENSED_TYPE = (\d+)", [first]),
        ("game_knowledge", r"action\[(\d+) \+ kind\]", [actions.STRATEGY_SCORES]),
        ("game_flight", r"action\[(\d+) \+ axis\]", [actions.VELOCITY]),
        ("game_flight", r"\[(\d+), 7, 8\]", [actions.VELOCITY]),
        ("game_scripts", r"length: (\d+) \+ rules", [chosen - types]),
        ("game_scripts", r"seen\[(\d\d)\]", [cover, first]),
        ("game_scripts", r"slice\((\d+, \d+) \+ ", [f"{first}, {first}"]),
        ("game_sight", r"seen\[(\d\d)\]", [cover]),
        ("game_sight", r"slice\((\d+, \d+) \+ ", [f"{first}, {first}"]),
        ("game_onnx", r"inputs\.get\(\"observation\"\) !== (\d+)", [seen]),
        ("game_onnx", r"outputs\.get\(\"action\"\) !== (\d+)", [chosen]),
        ("play", r"allySees\[(\d+)\]", [cover]),
        ("game_players", r"action\.length === (\d+)", [chosen]),
    ]


@pytest.mark.parametrize(("script", "pattern", "values"), sizes_in_the_browser())
def test_the_browser_s_game_has_the_sizes_of_the_game(script, pattern, values):
    text = (Path(page_data.__file__).parent / "static" / f"{script}.js").read_text()
    assert list(dict.fromkeys(re.findall(pattern, text))) == list(map(str, values))


def test_the_browser_s_scripts_have_the_names_of_the_game():
    text = (Path(page_data.__file__).parent / "static/game_scripts.js").read_text()
    for name, words in (("ally:", ALLIES), ("opponent:", OPPONENTS)):
        assert f"{name} {json.dumps(words)}" in text


def test_a_folder_of_other_files_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(UserError, match="holds other files, but no leaderboard's site"):
        build_site(example_board(1), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_slug_that_is_no_file_name_is_refused(tmp_path):
    for slug in ("../../escaped", "", "UPPER", "x" * 41, ".hidden", "a\n"):
        board = with_entry(example_board(1), "player-0", slug=slug)
        with pytest.raises(UserError, match="entry of ally"):
            build_site(board, tmp_path / "out")
        assert not list(tmp_path.iterdir())


def test_only_plain_https_links_are_kept():
    kept = ["https://example.org/a?b=1&c=2#d", "https://example.org:8080/"]
    refused = ["http://example.org", "javascript:alert(1)", "https://user@evil.example", None]
    refused += ['https://x.org/"onmouseover="alert(1)', "https://x.org/ y", "https://x.org\n"]
    assert [views.safe_link(link) for link in kept] == kept
    assert not any(views.safe_link(link) for link in refused)


def test_numbers_have_one_format_and_missing_ones_are_a_dash():
    number = views.format_number
    assert [number(value) for value in (1.26, -3, None, float("nan"))] == ["1.3", "−3.0", "–", "–"]
    pairs = [(0.1234, "share"), (12345.6, "whole"), (2, "dB"), (-2, "step")]
    assert [number(*pair) for pair in pairs] == ["12.3 %", "12,346", "2.0 dB", "−2.00"]
    assert [views.format_signed(value) for value in (1.26, -3)] == ["+1.3", "−3.0"]
    assert [views.format_rank(rank) for rank in ((1, 1), (2, 5), None)] == ["1", "2–5", "–"]
    assert views.format_interval(Interval(0.0, -1.0, 2.0)) == "−1.0 to 2.0"
    assert views.format_interval(Interval(0.0)) == views.format_interval(None) == ""


def test_the_rounds_that_the_findings_link_show_what_they_say():
    """Each link names players of the site's page and a seed; a return has a sign that the text gives."""
    links = re.findall(r'<a href="../board/play.html#([^"]*)">', FINDINGS)
    measures = [played(dict(parse_qsl(html.unescape(link)))) for link in links]
    jammed, earned = ([each[name] for each in measures] for name in ("jamming_success_rate", "ally_return"))
    assert jammed[0] > jammed[1]  # an ally that stays: a tone jams more than broadband
    assert jammed[2] < jammed[3]  # one that hops
    assert earned[4] > 0 > earned[5]  # trained on scripts: against a script, and a trained opponent
    assert earned[7] > 0  # of a population, against the same


def played(link):
    """Play the round of a link, and return its measures."""
    files = {agent_file(name): f"{name}/seed_0" for name in zoo_policies()}
    words = (link[side].split(":", 1) for side in ("ally", "opponent"))
    names = (word if kind == "script" else load_agent(files[word]) for kind, word in words)
    match = make_match(make_duel(1, scenario=Scenario(opponent_path="pursuit")), *names)
    play_round(match, seeds=np.array([int(link["seed"])]))
    return match.duel.measures(0)
