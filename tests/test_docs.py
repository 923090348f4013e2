"""README and site: blocks of tutorials and how-tos are run, links lead somewhere, pages follow the code."""

import importlib
import json
import re
import subprocess

import gymnasium
import pytest
import quote_figures
import reference_pages
import typer
import value_of_game
from lineage import filled

from fpg_bench.cli.main import app
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import ACTION_MODES, DUEL, ENVS, action_modes
from fpg_bench.common.rows import RowFile
from fpg_bench.game.choices import Choices
from fpg_bench.game.scenario import STANDARD, as_scenario
from fpg_bench.players.agent import read_card
from fpg_bench.players.planner import PLANNERS, asks_language_model
from fpg_bench.products.language_models.servers import SERVERS, load_server
from fpg_bench.products.leaderboard.exploited import RESPONSE
from fpg_bench.products.leaderboard.site.entry_page import entry_view
from fpg_bench.products.leaderboard.site.views import track_view
from fpg_bench.products.theory.learners import LEARNERS
from tests.pages import Reader, blocks, broken_links, small, small_baselines
from tests.products.language_models.fault_server import FaultServer, answer
from tests.programs import ROOT
from tests.test_cli import VERBS

DOCS = ROOT / "docs"
README = ROOT / "README.md"
PLANNERS_PAGE = DOCS / "guides/planners.md"
# Pages whose blocks do something for a reader who runs them in their order
RUN = [
    README,
    DOCS / "index.md",
    DOCS / "start/first-game.md",
    DOCS / "start/train-compare-enter.md",
    DOCS / "environments/discrete-actions.md",
    DOCS / "environments/scenario.md",
    DOCS / "environments/teams.md",
    DOCS / "environments/waterfall.md",
    DOCS / "guides/datasets.md",
    DOCS / "guides/frameworks.md",
    DOCS / "guides/offline.md",
    DOCS / "guides/opponent.md",
    PLANNERS_PAGE,
]
PAGES = [page for page in sorted(DOCS.rglob("*.md")) if "generated" not in page.parts]
WAYPOINTS = [{"x": 200 + 50 * i, "y": 700, "z": 300} for i in range(16)]


def name(page):
    return page.relative_to(ROOT if page == README else DOCS).as_posix()


def python_runs(text):
    """Run all blocks of Python of a page, and return their number."""
    codes = [code for language, code in blocks(text) if language == "python"]
    for code in codes:
        exec(compile(code, "block", "exec"), {})
    return len(codes)


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize("page", RUN, ids=name)
def test_every_block_works_in_the_order_of_the_page(page, tmp_path):
    with FaultServer([answer(lambda body: json.dumps({"waypoints": WAYPOINTS}))]) as model:
        reader = Reader(
            tmp_path / "here", small_baselines(tmp_path / "baselines"), FPG_LLM_BASE_URL=model.url
        )
        for language, code in blocks(page.read_text()):
            reader.does(language, small(code))
        assert reader.ran
        assert bool(model.requests) == ("FPG_LLM_MODEL" in page.read_text())


@pytest.mark.parametrize("page", [*PAGES, README, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    assert broken_links(page) == []


def installs_of(text):
    """Ways in which a text installs fpg-bench with pip: options and source, without extras."""
    for line in re.findall(r"\bpip install ([^\n`]*)", text.replace("\\", "").replace("../", "")):
        words = (
            re.sub(r"--quiet |-r \S+ |\[[\w,]+\]", "", line.replace('"..[', '".[')).replace('"', "").split()
        )
        if "." in words or "fpg-bench" in words:
            yield [word.rstrip(",") for word in words]


def test_all_install_as_the_page_of_installation_does():
    """Its page says what works today; a release changes it, and this test names what else says it."""
    (today,) = installs_of((DOCS / "start/install.md").read_text())
    texts = [*PAGES, README, *(ROOT / "examples").glob("*.*"), *(ROOT / "fpg_bench").rglob("*.md")]
    found = {path: list(installs_of(path.read_text())) for path in texts}
    assert {path.name: ways for path, ways in found.items() if any(way != today for way in ways)} == {}
    assert sum(path.suffix == ".ipynb" and len(ways) == 1 for path, ways in found.items()) == 3


def test_every_page_has_its_place_in_the_site():
    listed = {
        (page.parent / place).relative_to(DOCS).as_posix()
        for page in PAGES
        for tree in re.findall(r"(?s)```\{toctree\}\n(.*?)```", page.read_text())
        for place in tree.split()
    }
    names = {name(page).removesuffix(".md") for page in PAGES}
    assert names - listed == {"index"}


def test_the_front_page_reads_on_github_as_on_the_site():
    """GitHub shows a directive of Sphinx as a grey block, and has no built board to lead to."""
    text = (DOCS / "index.md").read_text()
    source = [text]
    reference_pages.show_on_site(None, "index", source)
    on_github = re.sub(r"(?s)<!--.*?-->", "", text)
    assert "```{" not in on_github
    assert "board/index.html" not in on_github
    assert source[0].count("```{toctree}") == 7
    assert "board/index.html" in source[0]
    assert "<!-- site" not in source[0]


@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_the_page_of_discrete_actions_has_all_choices_and_sizes(side):
    text = (DOCS / "environments/discrete-actions.md").read_text()
    assert [name for name in (*ACTION_MODES, *LEARNERS) if f"`{name}`" not in text] == []
    names = Choices(side, "discrete", STANDARD).lists[0].names
    table = text.split(f"<!-- {side} chooses -->")[1].split("<!-- end -->")[0]
    rows, listed = re.findall(r"\| (\d+)-?(\d*) \| (.*?) \| (.*?) ?\|", table), []
    for first, last, name_of_first, name_of_last in rows:
        assert names[int(first)] == name_of_first
        assert names[int(last or first)] == (name_of_last or name_of_first)
        listed += range(int(first), int(last or first) + 1)
    assert listed == list(range(len(names)))
    for scenario in (STANDARD, as_scenario(STANDARD, opponent_path="learned")):
        for mode in action_modes(side)[1:]:
            sizes = Choices(side, mode, scenario).sizes
            assert f"`{list(sizes)}`" in text if len(sizes) > 1 else f"`Discrete({sizes[0]})`" in text


def test_the_reference_of_python_names_what_there_is():
    for path in re.findall(
        r"\.\. auto(?:class|function|exception):: (\S+)", (DOCS / "reference/api.md").read_text()
    ):
        module, _, attribute = path.rpartition(".")
        assert hasattr(importlib.import_module(module), attribute), path


@pytest.mark.slow
def test_every_id_has_a_page_of_what_it_sees_and_does(tmp_path):
    reference_pages.write_pages(tmp_path)
    rules = (DOCS / "reference/rules.md").read_text()
    for config in ENVS.values():
        text = (tmp_path / f"{config.id.removeprefix('FPG/')}.md").read_text()
        assert f"`{config.other}`" in text
        for mark in re.findall(r':start-after: "(.*)"', text):
            table = rules.split(mark)[1].split("<!-- end -->")[0]
            assert table.strip().startswith("| index |")
        assert python_runs(text) == (not asks_language_model(config.planner))
        history = text.split("## Version history")[1]
        assert re.findall(r"(?m)^- v(\d+): \w", history)[0] == str(gymnasium.spec(config.id).version)
        assert len(config.versions) == gymnasium.spec(config.id).version + 1
    duel = (tmp_path / f"{DUEL.removeprefix('FPG/')}.md").read_text()
    assert python_runs(duel) == 1
    assert "## Version history\n\n- v0: " in duel


@pytest.mark.slow
def test_the_page_of_the_command_line_has_every_verb():
    page = reference_pages.command_line_page()
    assert [verb for verb in VERBS if f"`{verb}`" not in page] == []


def test_a_page_elsewhere_is_led_to_its_place_inside():
    source = ["[zoo](../../baselines/README.md)"]
    reference_pages.lead_inside(None, "guides/selfplay", source)
    assert source == ["[zoo](../results/findings.md)"]


COMMANDS = typer.main.get_command(app)


def command_of(words):
    """The command that words begin with."""
    command, line = COMMANDS, " ".join(words)
    while words and words[0] in getattr(command, "commands", {}):
        command = command.commands[words.pop(0)]
    assert not getattr(command, "commands", {}) or not words or words[0].startswith("-"), line
    return command


def commands_of(page):
    """The commands of a page: of its code, and of its text, where ``leaderboard build`` is one, too."""
    text = page.read_text()
    code = "\n".join(code for language, code in blocks(text) if language != "python")
    yield from re.findall(r"(?m)^[^#\n]*?\bfpg-bench ([a-z-].*)$", code.replace("\\\n", " "))
    groups = "|".join(name for name, of in COMMANDS.commands.items() if hasattr(of, "commands"))
    prose = re.sub(r"(?ms)^ *```.*?^ *```", "", text)
    for whole, other, verb in re.findall(
        rf"`(?:fpg-bench )?((?:{groups}) [^`]+|(?<=fpg-bench )[^`]+)`(?:(?<=`) (and|or) `([a-z-]+)`)?", prose
    ):
        yield whole
        if other and verb != whole:
            yield f"{whole.split()[0]} {verb}"


@pytest.mark.parametrize("page", [*PAGES, README], ids=lambda page: page.name)
def test_commands_of_a_page_have_their_options(page):
    for command in commands_of(page):
        words = command.partition(" #")[0].split()
        known = {option for parameter in command_of(words).params for option in parameter.opts}
        assert {word.partition("=")[0] for word in words if word.startswith("--")} <= known, command


@pytest.mark.full
@pytest.mark.slow
def test_the_figures_that_pages_quote_are_those_of_the_data():
    for page, figures in quote_figures.quotes().items():
        assert filled((ROOT / page).read_text(), figures) == (ROOT / page).read_text(), page


@pytest.mark.full
@pytest.mark.slow
def test_the_lowest_known_return_is_one_number_wherever_it_stands():
    board, _ = quote_figures.board()
    draws: dict[str, list[tuple[float, float]]] = {}  # the first draw chooses, the second is shown
    for row in RowFile(ROOT / "leaderboard/results/exploited.jsonl").read():
        pairs = zip(row["first"]["rewards"], row["second"]["rewards"], strict=True)
        draws.setdefault(row["slug"], []).append(min(pairs))
    least = {slug: min(found)[1] for slug, found in draws.items()}
    searches = value_of_game.read_searches(ROOT / "baselines/agents", ROOT / "docs/results/value.md")
    bracket = value_of_game.bracket(searches, value_of_game.kept_by_entries(board))
    value = (ROOT / "docs/results/value.md").read_text()
    assert value_of_game.markdown_table(bracket) in value
    champions = (ROOT / "docs/results/champions.md").read_text()
    shown = set()
    for track in (track for track in board.tracks if track.side == "ally"):
        view = track_view(board, track)
        kept = [view["exploited"][entry.slug]["value"] for entry in view["unbroken"]]
        assert kept == sorted(kept, reverse=True)
        for entry in view["unbroken"]:
            exploited = entry.figures.exploited
            lowest = exploited.lowest.return_per_step.value
            chosen = min(exploited.attacks, key=lambda attack: attack.chosen_by)
            assert chosen.return_per_step.value == least[entry.slug]
            assert lowest == least[entry.slug] or (
                lowest < least[entry.slug] and exploited.lowest.where != RESPONSE
            )
            number = f"{lowest:.2f}"
            page = entry_view(board, track, entry)["exploited"]
            assert page == view["exploited"][entry.slug]
            assert page["at_most"] == f"at most {number.replace('-', '−')}"
            lines = [line for line in champions.splitlines() if line.startswith(f"| `{entry.plays}` |")]
            assert sum(f"| {number} " in line for line in lines) == 1, entry.slug
            shown.add(entry.slug)
        name, number = view["unbroken"][0].plays, f"{kept[0]:.2f}"
        assert f"| {number} (`{name}`, found by: " in value
        if track.key == "ally":
            assert f"| `{name}` | the champion, first by" in README.read_text()
            (line,) = (line for line in README.read_text().splitlines() if line.startswith(f"| `{name}` |"))
            assert line.split(" | ")[4] == number
    assert shown == least.keys()


@pytest.mark.full
@pytest.mark.slow
def test_the_page_of_a_shipped_agent_has_the_command_of_its_card():
    board, _ = quote_figures.board()
    for track in board.tracks:
        for entry in track.entries:
            _, *again = entry_view(board, track, entry)["commands"]
            cards = [read_card(entry.player)] if entry.kind == "zoo" else []
            assert [command for _, command in again] == [card.command for card in cards]


def test_a_figure_stands_in_the_midst_of_a_sentence_and_a_table_on_lines_of_its_own():
    page = "It earns <!-- most -->1<!-- end --> a step.\n\n<!-- table -->\n<!-- end -->\n"
    table = "| a |\n| --- |"
    wanted = f"It earns <!-- most -->2<!-- end --> a step.\n\n<!-- table -->\n\n{table}\n\n<!-- end -->\n"
    assert filled(page, {"most": "2", "table": table}) == wanted
    with pytest.raises(UserError, match="there are no marks 'least'"):
        filled(page, {"least": "2"})


def test_the_example_of_a_server_can_be_loaded(tmp_path):
    page = blocks(PLANNERS_PAGE.read_text())
    (code,) = [code for _, code in page if "my_server.yml" in code]
    (tmp_path / "my_server.yml").write_text(code)
    assert load_server(str(tmp_path / "my_server.yml")).response_format == "json_schema"


def test_every_planner_and_every_server_profile_is_told_of():
    text = PLANNERS_PAGE.read_text()
    assert [name for name in (*PLANNERS, *SERVERS) if f"`{name}`" not in text] == []


def test_make_targets():
    for target, command in (("benchmark", "fpg-bench train"), ("test", "pytest"), ("docs", "sphinx -W")):
        assert f"make {target}" in README.read_text() + (ROOT / "CONTRIBUTING.md").read_text()
        done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True)
        assert command in done.stdout


def test_every_snippet_of_the_readme_shows_something():
    snippets = [code for language, code in blocks(README.read_text()) if language == "python"]
    assert [code for code in snippets if "print(" not in code and not code.startswith("# ")] == []
