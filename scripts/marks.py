"""Parts of pages between marks, ``<!-- title -->`` and ``<!-- end -->``, that a script writes.

Marks on one line hold a few words in the midst of a sentence; others have lines of their own.
"""

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
    try:
        write_whole(path, filled(path.read_text(encoding="utf-8"), parts))
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


def filled(page: str, parts: Mapping[str, str]) -> str:
    """Return the text of a page with texts between its marks; raises UserError if it lacks a mark."""
    for title, text in parts.items():
        head, mark, rest = page.partition(f"<!-- {title} -->")
        inside, end, rest = rest.partition("<!-- end -->")
        if not (mark and end):
            raise UserError(f"there are no marks {title!r}")
        around = "\n\n" if "\n" in inside else ""
        page = f"{head}{mark}{around}{text.strip()}{around}{end}{rest}"
    return page
