"""Parts of pages between marks, ``<!-- title -->`` and ``<!-- end -->``, that a script writes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import write_whole


def fill(path: Path, parts: Mapping[str, str]) -> None:
    """Put texts between the marks of a page.

    Raises:
        UserError: the page lacks a mark; nothing is written then.
    """
    page = path.read_text(encoding="utf-8")
    for title, text in parts.items():
        head, mark, rest = page.partition(f"<!-- {title} -->\n")
        _, end, rest = rest.partition("<!-- end -->")
        if not (mark and end):
            raise UserError(f"{path}: there are no marks {title!r}")
        page = f"{head}{mark}\n{text.strip()}\n\n{end}{rest}"
    write_whole(path, page)
