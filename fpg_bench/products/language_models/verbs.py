"""The verb ``plan probe``."""

from __future__ import annotations

from typing import Annotated

import typer

from fpg_bench.common.errors import UserError, printable
from fpg_bench.common.extras import require_extra
from fpg_bench.products.language_models.options import PANEL


def probe(
    server: Annotated[
        str | None, typer.Option(help="The server profile, by name or as a YAML file.", rich_help_panel=PANEL)
    ] = None,
    deadline: Annotated[
        float | None, typer.Option(min=0.1, help="Time limit of each question in seconds. Default: 30.")
    ] = None,
) -> None:
    """Probe the server of the language model that the environment variables name for its features.

    Example: fpg-bench plan probe --deadline 60
    """
    require_extra("llm", "openai")
    from rich.console import Console

    from fpg_bench.products.language_models.probe import probe as findings_of
    from fpg_bench.products.language_models.servers import endpoint_from_environment

    endpoint = endpoint_from_environment(server)
    console = Console(soft_wrap=True, highlight=False)
    console.print(f"{endpoint.model} at {endpoint.base_url}, profile {endpoint.server.name}", markup=False)
    signs = {True: "yes", False: "no", None: "-"}
    for finding in findings_of(endpoint, deadline):
        line = f"{finding.subject:24} {signs[finding.ok]:4} {finding.detail}"
        console.print(printable(line), markup=False)
        if finding.subject == "answer" and not finding.ok:
            raise UserError(f"nothing answers at {endpoint.base_url}: {finding.detail}")
