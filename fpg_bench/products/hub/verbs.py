"""The verbs of the Hugging Face Hub: push and pull."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fpg_bench.cli.options import complete_player
from fpg_bench.common.extras import require_extra
from fpg_bench.common.output import print_line

app = typer.Typer(help="Share agents on the Hugging Face Hub.", no_args_is_help=True)


@app.command()
def push(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RUN",
            help="A finished run's folder, an agent's folder, or a shipped agent.",
            autocompletion=complete_player,
        ),
    ],
    repository: Annotated[str, typer.Argument(metavar="REPO", help="The repository, owner/name.")],
    private: Annotated[bool, typer.Option("--private", help="Create the repository as private.")] = False,
    revision: Annotated[str | None, typer.Option(help="The branch. Default: main.")] = None,
    results: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the agent's results. Default: RUN/results, or the records of a shipped agent."
        ),
    ] = None,
) -> None:
    """Upload an agent with its records and a model card; HF_TOKEN holds the token.

    Example: fpg-bench hub push runs/ppo_0 me/ppo-ally
    """
    require_extra("hub", "huggingface_hub")
    require_extra("evaluate", "onnx", "scipy", "matplotlib", "joblib")
    from fpg_bench.products.hub.push import push as push_agent

    name = push_agent(source, repository, private=private, revision=revision, results=results)
    print_line(f"pushed: {name}")


@app.command()
def pull(
    repository: Annotated[
        str, typer.Argument(metavar="REPO", help="The repository, owner/name or hf://owner/name@revision.")
    ],
    out: Annotated[Path, typer.Option(help="Folder of the agent: new or empty.")],
    revision: Annotated[
        str | None, typer.Option(help="A branch, tag or commit. Default: the branch main.")
    ] = None,
) -> None:
    """Download an agent into a folder and check it in the same way as submissions.

    Only agent.json and policy.onnx are read.

    Example: fpg-bench hub pull me/ppo-ally --out agents/ppo
    """
    require_extra("hub", "huggingface_hub")
    require_extra("evaluate", "onnx", "scipy", "matplotlib", "joblib")
    from fpg_bench.products.hub.download import download, hub_name
    from fpg_bench.products.hub.pull import keep
    from fpg_bench.products.sandbox.process import forget_keys

    snapshot = download(hub_name(repository, revision))
    forget_keys()
    kept = keep(snapshot, out)
    print_line(f"{'pulled' if kept else 'already there'}: {snapshot.name}\nagent: {out}")
