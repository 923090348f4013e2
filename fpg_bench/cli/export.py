"""``fpg-bench export``: a trained model as an agent folder."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Annotated, Any

import typer

from fpg_bench.common.errors import UserError


def export(
    source: Annotated[Path, typer.Argument(help="a run's folder, or a zip that SB3's save has written")],
    out: Annotated[Path, typer.Option(help="the agent's folder, <submission>/seed_<k>")],
    side: Annotated[str | None, typer.Option(help="of a run that trained both: ally or opponent")] = None,
    algo: Annotated[str | None, typer.Option(help="of a zip: ppo, a2c, sac or td3")] = None,
    env_id: Annotated[
        str, typer.Option("--id", help="of a zip: the environment id")
    ] = "FPG/AllyVsScripted-v0",
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="of a zip: its training seed; default: that of the folder's name"),
    ] = None,
    not_normalized: Annotated[
        bool, typer.Option("--not-normalized", help="of a zip: it was trained without VecNormalize")
    ] = False,
) -> None:
    """Write a trained model as an agent folder, and say how far it is from the model's own predict.

    Example: fpg-bench export runs/ppo_0 --out leaderboard/submissions/ally/my-agent/seed_0
    """
    if (out / "agent.json").exists():
        raise UserError(f"export: {out} holds an agent; choose another folder, or remove it")
    if source.is_dir():
        difference = _from_run(source, out, side)
    else:
        difference = _from_zip(source, out, algo, env_id, seed, not_normalized)
    told = "unknown" if difference is None else f"{difference:.2g}"
    typer.echo(f"agent: {out}\nlargest difference to predict: {told}")


def _from_run(run: Path, out: Path, side: str | None) -> Any:
    """Copy the agent of a run's folder, which was compared when it was exported."""
    from fpg_bench.common.files import write_whole
    from fpg_bench.players.agent import load_agent

    agent = run / "agent" if (run / "agent").is_dir() else run
    if side is not None and (agent / side).is_dir():
        agent = agent / side
    if not (agent / "agent.json").is_file():
        both = (agent / "ally").is_dir()
        hint = "; say --side ally or --side opponent" if both else "; is the run finished?"
        raise UserError(f"export: {run} holds no agent{hint}")
    about = load_agent(agent, side).about
    for name in ("policy.onnx", "agent.json"):
        write_whole(out / name, (agent / name).read_bytes())
    return about.get("largest_difference")


def _from_zip(
    path: Path, out: Path, algorithm: str | None, env_id: str, seed: int | None, not_normalized: bool
) -> float:
    from fpg_bench.training.export import export_agent
    from fpg_bench.training.sb3_zip import INSTEAD, load_zip

    if not path.is_file():
        raise UserError(f"export: {path} is neither a run's folder nor a zip: there is no such file")
    if not zipfile.is_zipfile(path):
        raise UserError(f"export: {path} is no zip that SB3's save has written; a run's is called model.zip")
    if algorithm is None:
        raise UserError("export: a zip does not say its algorithm; say --algo ppo, a2c, sac or td3")
    if not not_normalized:
        raise UserError(
            "export: a zip does not say whether VecNormalize was used, and its statistics are a pickle, "
            f"which is not opened; say --not-normalized if it was not, else {INSTEAD}"
        )
    training_seed = _seed(out, seed)
    return export_agent(
        load_zip(path, algorithm, env_id), out, training_seed=training_seed, algorithm=algorithm
    )


def _seed(out: Path, seed: int | None) -> int:
    named = re.fullmatch(r"seed_(\d+)", out.name)
    if seed is None and named is None:
        raise UserError("export: say --seed, the training seed, or call the folder seed_<k>")
    return int(named[1]) if seed is None and named else int(seed or 0)
