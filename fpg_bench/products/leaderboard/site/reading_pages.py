"""Pages of the documentation as pages of the site, without another host: rules, measures, how to enter."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from fpg_bench.common.documentation import docs_folder

if TYPE_CHECKING:
    from markdown_it import MarkdownIt
    from markdown_it.token import Token

PAGES = {  # file of the documentation and title, by the name in the site
    "rules": ("reference/rules.md", "Rules"),
    "protocol": ("benchmark/protocol.md", "Protocol"),
    "measures": ("reference/measures.md", "Measures"),
    "glossary": ("reference/glossary.md", "Glossary"),
    "submitting": ("benchmark/submitting.md", "Entering a player"),
    "submitting-planners": ("benchmark/submitting-planners.md", "Entering a planner"),
}


def render_page(name: str) -> str:
    """Render one of ``PAGES`` as HTML, without pictures; links lead only to others of them."""
    text = re.sub(r"<!--.*?-->\n?|(?m:^!\[.*\n)", "", (docs_folder() / PAGES[name][0]).read_text("utf-8"))
    parts = re.split(r"^:::(?:\{glossary\})?\n", text, flags=re.MULTILINE)  # outside, inside, outside
    return "".join(_render_terms(part) if k % 2 else _render(part) for k, part in enumerate(parts))


@cache
def _markdown() -> MarkdownIt:
    from markdown_it import MarkdownIt

    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.add_render_rule("table_open", lambda *_: '<div class="scroll" tabindex="0"><table>\n')
    markdown.add_render_rule("table_close", lambda *_: "</table></div>\n")
    return markdown


def _render(text: str) -> str:
    markdown = _markdown()
    tokens = markdown.parse(text)
    for token, following in pairwise(tokens):
        if token.type == "heading_open":
            token.attrSet("id", re.sub(r"[^\w -]", "", following.content).lower().replace(" ", "-"))
        elif token.type == "fence":
            token.attrSet("tabindex", "0")
    for token in tokens:
        _restrict_links(token.children or [])
    html: str = markdown.renderer.render(tokens, markdown.options, {})
    return html


def _restrict_links(tokens: Sequence[Token]) -> None:
    """Turn links to pages that the site lacks into plain text."""
    tag = "a"
    for token in tokens:
        if token.type == "link_open":
            name, mark, anchor = str(token.attrs.pop("href")).partition("#")
            page = Path(name).stem
            tag = "a" if page in PAGES or not name else "span"
            if tag == "a":
                token.attrs["href"] = (f"{page}.html" if name else "") + mark + anchor
        if token.type in ("link_open", "link_close"):
            token.tag = tag


def _render_terms(text: str) -> str:
    """Render a list of terms: each on its own line, with its definition indented below it."""
    terms = re.findall(r"^(\S.*)\n((?:  .*\n)+)", text, re.MULTILINE)
    lines = (f"<dt>{escape(term)}</dt><dd>{_render(meaning)}</dd>\n" for term, meaning in terms)
    return f"<dl>\n{''.join(lines)}</dl>\n"
