"""What an evaluation has found: summaries, best first, as a table or a DataFrame."""

from __future__ import annotations

from typing import Any

from fpg_bench.errors import UserError
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import flat, markdown


class Results(list[Summary]):
    """The summaries of all entries that met a field, best first."""

    def table(self) -> str:
        """A table of Markdown with all columns, and what its numbers are."""
        return markdown(self, self[0].field) if self else ""

    def dataframe(self) -> Any:
        """A ``pandas.DataFrame`` with one row per entry, unrounded, the columns of ``table.csv``.

        Raises:
            UserError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise UserError("dataframe: needs pandas (pip install pandas)") from error
        return pandas.DataFrame([flat(summary) for summary in self])
