"""Pages of the site that are made from the code: one an environment id, and the command line.

They are written into ``reference/generated``, which is not kept in the repository: also the notebooks with
their outputs, and a gallery. Its films, and those of the ids, are replays that stand in the site's ``films``.
"""

from __future__ import annotations

import base64
import contextlib
import inspect
import json
import os
import pydoc
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fpg_bench.common.ids import DUEL, ENVS, FIRST_VERSION, EnvConfig
from fpg_bench.envs.core import SingleAgentGame, action_space, observation_space
from fpg_bench.game.scenario import preset
from fpg_bench.players.planner import asks_language_model

GENERATED = Path(__file__).parent / "reference/generated"
NOTEBOOKS = sorted((Path(__file__).parents[1] / "examples").glob("*.ipynb"))
ELSEWHERE = {"../baselines/README.md": "results/findings.md"}  # pages that lie outside of this folder
_REGIONS = {  # of the theme's pages, and what they become
    r'role="heading">': 'role="heading" aria-level="2">',
    r'<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="All pages">',
    r'<aside class="toc-drawer': '<aside aria-label="This page" class="toc-drawer',
    r"<pre>": '<pre tabindex="0">',
    r'<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    r'(?<!</h1>)<div id="search-results">': '<h1>Search</h1><div id="search-results">',
}
_VIEW = """\
# {id}

{About}.

{film}

| property | of this id |
| --- | --- |
| you play | the {side} |
| {other_side} | {other}, where `{other_side}=` names nobody else |
| opponent's path | {flown} |
| rounds a match | {rounds} |
| steps a round | {steps}, one second each; a round ends by truncation |
| observation space | `{observations}` |
| action space | `{actions}` |

{example}

## What you see

```{{include}} ../rules.md
:start-after: "<!-- {side} sees -->"
:end-before: "<!-- end -->"
```

## What you do

```{{include}} ../rules.md
:start-after: "<!-- {side} acts -->"
:end-before: "<!-- end -->"
```

## Rewards and options

[The rules](../rules.md#10-rewards) have the rewards. `gymnasium.make("{id}", ...)` takes
`render_mode` (`rgb_array`, `human`) and

{options}

{{class}}`fpg_bench.envs.core.SingleAgentGame` says what each of them takes.

{versions}"""
_SINGLE = """\
```python
import gymnasium
import fpg_bench

env = gymnasium.make("{id}")
observation, info = env.reset(seed=1)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
```"""
_NEEDS_MODEL = (
    "It needs [a language model](../../guides/planners.md) that answers; `FPG/AllyVsPlanner-v0` needs none."
)
_HISTORY = """\
## Version history

{}

A change of dynamics, observations, rewards or defaults makes
[a new version](../../environments/index.md#versions).
"""
_DUEL = """\
# FPG/duel_v0

Both sides of one game are yours. PettingZoo's registry has it as a parallel environment and as one of
turns (`aec`).

| | |
| --- | --- |
| agents | `ally` and `opponent` |
| observation space of each | `{observations}` |
| action space of each | `{actions}` |
| state space | 54 numbers, for centralised critics |
| steps a round | {steps} |

```python
import pettingzoo
import fpg_bench

duel = pettingzoo.make("parallel", "FPG/duel_v0")
observations, infos = duel.reset(seed=1)
actions = {{agent: duel.action_space(agent).sample() for agent in duel.agents}}
observations, rewards, terminations, truncations, infos = duel.step(actions)
```

What the sides see and do stands on the pages of their own ids, {{doc}}`AllyVsPolicy-v0` and
{{doc}}`OpponentVsPolicy-v0`. Batched, it is `fpg_bench.make_duel(64)`.

{versions}"""


_GALLERY = """\
# Gallery

Rounds of notable players, to play, stop and step through, each with seed 12 as
`fpg-bench play --ally ALLY --opponent OPPONENT --seed 12 --out round.html` writes it.
[The board](../../benchmark/leaderboard.md) has rounds of every entry, [findings](../../results/findings.md)
what all of them show.

"""
_ROUNDS = {  # of the gallery: ally, opponent, and what to look at
    "wide": (
        "ally-wide/ppo-fast-stack8-memory/seed_0",
        "opponent-wide/ppo-fast-memory/seed_0",
        "PPO with a memory on both sides, the best learners against held-out rivals",
    ),
    "rule": (
        "ally-rule/rule/seed_0",
        "opponent-wide/ppo-fast-memory/seed_0",
        "the same opponent against a rule of a dozen numbers that a search found",
    ),
    "champion": (
        "ally-champion-4/tabular/seed_0",
        "opponent-rule/rule/seed_0",
        "a stochastic table from self-play, the hardest ally to break, against a searched opponent",
    ),
    "script": (
        "evidence",
        "hunter",
        "scripts: one counts the evidence that it was found, one jams where it heard last",
    ),
    "oracle": (
        "oracle",
        "opponent-wide/ppo-fast-memory/seed_0",
        "an ally that sees the full state: what knowledge is worth",
    ),
    "link": (
        "ally-link-wide/ppo-fast-stack8/seed_0",
        "opponent-link-wide/ppo-fast-memory/seed_0",
        "the best learners of the radio link",
    ),
}


def connect(app: Any) -> None:
    """Have Sphinx write the pages before it looks for any, and read each page as the site shows it."""
    app.connect("builder-inited", lambda app: write_pages(GENERATED))
    app.connect("builder-inited", lambda app: import_documented())
    app.connect("source-read", lead_inside)
    app.connect("source-read", show_on_site)
    for finish in (name_regions, mend_links_of_sources, draw_films):
        app.connect("build-finished", lambda app, failure, done=finish: failure or done(Path(app.outdir)))


def write_pages(folder: Path) -> None:
    """Write all pages into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for view in ENVS.values():
        _write(folder / f"{_short(view.id)}.md", view_page(view))
    _write(folder / f"{_short(DUEL)}.md", _DUEL.format(versions=_versions(FIRST_VERSION), **_sizes()))
    _write(folder / "command-line.md", command_line_page())
    _write(folder / "gallery.md", gallery_page())
    for notebook in NOTEBOOKS:
        _write(folder / f"{notebook.stem}.md", notebook_page(notebook, folder))


def gallery_page() -> str:
    """Return the films of notable players."""
    films = (
        f"## {ally} against {opponent}\n\n{look[0].upper() + look[1:]}.\n\n{_film(name, look)}\n"
        for name, (ally, opponent, look) in _ROUNDS.items()
    )
    return _GALLERY + "\n".join(films).replace("/seed_0", "")


def notebook_page(notebook: Path, folder: Path) -> str:
    """Return a notebook as Markdown, with the outputs that it holds; write its pictures into a folder."""
    parts = [f"*A notebook, `examples/{notebook.name}`, with its outputs.*"]
    for number, cell in enumerate(json.loads(notebook.read_text())["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source.replace("](../docs/", "](../../"))
            continue
        is_shell = source.startswith("!")
        parts.append(
            f"```{'sh' if is_shell else 'python'}\n{source.replace('!', '') if is_shell else source}\n```"
        )
        for output in cell["outputs"]:
            data = output.get("data", {"text/plain": output.get("text", [])})
            if "image/png" in data:
                picture = folder / f"{notebook.stem}-{number}.png"
                picture.write_bytes(base64.b64decode(data["image/png"]))
                parts.append(f"![What the cell above draws]({picture.name})")
            else:
                parts.append(f"```text\n{''.join(data['text/plain']).rstrip()}\n```")
    head, *rest = parts[1:]
    return "\n\n".join([head, parts[0], *rest, ""])


def view_page(view: EnvConfig) -> str:
    """The page of an id, from the registry, the spaces and the signature of what it opens."""
    return _VIEW.format(
        id=view.id,
        About=view.about[0].upper() + view.about[1:],
        film=_film(_short(view.id), f"seed 12, {_pairing(view)}"),
        side=view.side,
        other_side=view.other_side,
        other=f"`{view.other}`",
        flown=f"planned between rounds by `{view.planner}`" if view.planner else f"`{view.path}`",
        rounds=view.rounds_per_match,
        versions=_versions(view.versions),
        example=_NEEDS_MODEL if asks_language_model(view.planner) else _SINGLE.format(id=view.id),
        options=_options(view),
        **_sizes(),
    )


def command_line_page() -> str:
    """Return what Typer says of every verb."""
    words = [sys.executable, "-m", "typer", "fpg_bench.cli.main", "utils", "docs", "--name", "fpg-bench"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return done.stdout.replace("# `fpg-bench`\n", "# The command line\n", 1)


def _sizes() -> dict[str, Any]:
    return {
        "observations": observation_space(),
        "actions": action_space(),
        "steps": preset("standard").steps_per_round,
    }


def _versions(versions: Sequence[str]) -> str:
    """Return the section with the history of an id, newest first as on Gymnasium's pages."""
    lines = [f"- v{number}: {change}." for number, change in enumerate(versions)]
    return _HISTORY.format("\n".join(reversed(lines)))


def _options(view: EnvConfig) -> str:
    """The keywords that an id takes, a line each, with what they are where nothing is said."""
    given = {view.other_side: view.other, "path": view.path, "planner": view.planner}
    names = [
        name
        for name, option in inspect.signature(SingleAgentGame.__init__).parameters.items()
        if option.kind is inspect.Parameter.KEYWORD_ONLY and name not in (view.side, "threads")
    ]
    names = [name for name in names if view.planner or name != "planner"]
    return "\n".join(f"- `{name}`{_default(given.get(name))}" for name in names)


def _default(value: str | None) -> str:
    return f", here `{value}`" if value else ""


def _pairing(view: EnvConfig) -> str:
    sides = {view.side: _SHOWN[view.side], view.other_side: view.other}
    return f"the ally is {sides['ally']}, the opponent {sides['opponent']}"


_SHOWN = {"ally": "ally-scripted/ppo/seed_0", "opponent": "opponent-pursuit/ppo/seed_0"}


def _film(name: str, about: str) -> str:
    """Return the frame of a film of the site."""
    place = f"../../films/{name}.html#embed"
    return f'<iframe class="film" src="{place}" title="A round: {about}" loading="lazy"></iframe>'


def draw_films(site: Path) -> None:
    """Play the rounds of the gallery and of the ids, and write their replays into the site."""
    from fpg_bench.products.rendering.watching import watch

    games: dict[str, dict[str, Any]] = {
        name: {"ally": of[0], "opponent": of[1]} for name, of in _ROUNDS.items()
    }
    for view in ENVS.values():
        planner = "interceptor" if view.planner else None  # a language model's paths look the same
        game = {"planner": planner, "path": None if planner else view.path}
        games[_short(view.id)] = {view.side: _SHOWN[view.side], view.other_side: view.other, **game}
    (site / "films").mkdir(exist_ok=True)
    for name, game in games.items():
        file = site / f"films/{name}.html"
        file.unlink(missing_ok=True)
        with open(os.devnull, "w") as null, contextlib.redirect_stdout(null):
            watch(**game, seed=12, out=file)


def _short(name: str) -> str:
    return name.removeprefix("FPG/")


def _write(file: Path, text: str) -> None:
    if not file.exists() or file.read_text() != text:  # Sphinx reads again what has changed
        file.write_text(text)


def lead_inside(app: Any, page: str, source: list[str]) -> None:
    """Change a page's links to files outside of the site to the pages that show them."""
    up = "../" * page.count("/")
    for outside, inside in ELSEWHERE.items():
        source[0] = source[0].replace(f"]({up}{outside}", f"]({up}{inside}")


def import_documented() -> None:
    """Import all that the reference of Python documents.

    Autodoc writes annotations into pydantic's ``BaseModel`` as it reads. A model that is made afterwards and
    takes further keys is refused.
    """
    text = (GENERATED.parent / "api.md").read_text()
    for name in re.findall(r"\.\. auto\w+:: (\S+)", text):
        pydoc.locate(name)


def name_regions(site: Path) -> None:
    """Give the theme's pages what screen readers and keyboards need: levels, names, focus."""
    for file in site.rglob("*.html"):
        text = old = file.read_text()
        for pattern, named in _REGIONS.items():
            text = re.sub(pattern, named, text)
        if text != old:
            file.write_text(text)


def mend_links_of_sources(site: Path) -> None:
    """Lead the sources to what the reference documents.

    Sphinx names all objects of a module as the first one is named: ``TwoPlayerBatch`` as
    ``fpg_bench.make_duel``.
    """
    known = set(re.findall(r'id="(fpg_bench[\w.]+)"', (site / "reference/api.html").read_text()))
    for file in (site / "_modules/fpg_bench").rglob("*.html"):
        module = ".".join(file.relative_to(site / "_modules").with_suffix("").parts)
        text = file.read_text()
        for name in set(re.findall(r'/api\.html#(fpg_bench[\w.]+)"', text)) - known:
            text = text.replace(f'#{name}"', f'#{module}.{name.removeprefix("fpg_bench.")}"')
        file.write_text(text)


def show_on_site(app: Any, page: str, source: list[str]) -> None:
    """Uncover what a page has for the site in comments that GitHub leaves out, ``<!-- site ... -->``."""
    source[0] = re.sub(r"(?s)<!-- site\s(.*?)-->", r"\1", source[0])
