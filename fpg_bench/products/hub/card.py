"""The model card of an agent on the Hub, with its metadata."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from huggingface_hub import ModelCardData

from fpg_bench.common.ids import other_side
from fpg_bench.common.imports import HUB
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import markdown
from fpg_bench.players.card import AgentCard
from fpg_bench.version import __version__

_TASK = "reinforcement-learning"
_RIVAL = {"ally": "expert", "opponent": "adaptive"}
_CARD = Path(__file__).with_name("card.md")


def model_card(
    card: AgentCard, repository: str, suite: str, summaries: Sequence[Summary], files: Collection[str]
) -> str:
    """Return the model card of an agent.

    Args:
        card: the agent's ``agent.json``.
        repository: ``owner/name`` on the Hub.
        suite: the suite that measures it.
        summaries: its results, one for each suite.
        files: names of the files that stand beside the card.
    """
    metadata = ModelCardData(
        library_name="fpg-bench",
        pipeline_tag=_TASK,
        tags=[_TASK, "fpg-bench", card.game.id, card.algorithm, "onnx"],
        model_name=repository.partition("/")[2],
    )
    results = "\n".join(markdown([summary], summary.suite) for summary in summaries).strip()
    training = f"\n```sh\n{card.command}\n```\n" if card.command else ""
    if "curve.png" in files:
        training += "\n![Score over training steps](curve.png)\n"
    seconds, offline = card.seconds, card.offline
    return _CARD.read_text(encoding="utf-8").format(
        metadata=metadata.to_yaml(),
        algorithm=card.algorithm,
        id=card.game.id,
        version=__version__,
        side=card.side,
        other=other_side(card.side),
        rival=_RIVAL[other_side(card.side)],
        results=results or "No records of an evaluation were uploaded.",
        seed="unknown" if card.training_seed is None else card.training_seed,
        steps=f"{card.played_steps:,}",
        data=f" of gradient descent on the data set `{offline.dataset}`" if offline else "",
        time=f", {seconds:,.0f} seconds" if seconds is not None else "",
        scenario=card.scenario[:12],
        training=training,
        player=HUB + repository,
        suite=suite,
    )
