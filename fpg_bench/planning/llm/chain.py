"""A chain of hashes through a transcript: each line holds one that follows from it and from all before it.

So a line can't be changed, left out or put in later without a new hash in every line after it, and lines of
two runs do not go together. It does not show who has written them: whoever writes a whole transcript anew
can chain it anew, too.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from fpg_bench.common.errors import UserError
from fpg_bench.common.rows import Row

KEY = "chain"


def chain_start(header: Mapping[str, Any], name: str) -> str:
    """Where the chain of a transcript begins: with the header of its run, and its own name."""
    return _digest([dict(header), name])


def linked(before: str, row: Row) -> Row:
    """A row with its link in the chain.

    Args:
        before: the link of the row before, or where the chain begins.
        row: what is to be written; a link that it holds already does not count.
    """
    content = {name: value for name, value in row.items() if name != KEY}
    return content | {KEY: _digest([before, content])}


def follows(before: str, row: Row, where: str) -> str:
    """The link of a row that was read, which must follow from the row before it.

    Raises:
        UserError: it does not; ``where`` begins the message.
    """
    link = linked(before, row)[KEY]
    if row.get(KEY) != link:
        raise UserError(
            f"{where} does not follow from the lines before it: one was changed, left out or put in, or the "
            "lines are of several runs"
        )
    return str(link)


def _digest(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
