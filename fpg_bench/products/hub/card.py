"""Files by which the Hub shows an agent: ``README.md`` with its metadata, and results of evaluations."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import yaml
from huggingface_hub import ModelCardData

from fpg_bench.common.ids import other_side
from fpg_bench.common.imports import HUB
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import markdown
from fpg_bench.players.card import AgentCard
from fpg_bench.version import __version__

_TASK = "reinforcement-learning"
_RIVAL = {"ally": "expert", "opponent": "adaptive"}
_CARD = """\
---
{metadata}
---

# {algorithm} for {id}

An agent of fpg-bench {version}, a benchmark for anti-jamming UAV communication. It plays the {side}.

## Results

{results}

## Training

- Algorithm: `{algorithm}`, training seed {seed}, {steps} steps{data}{time}.
- Environment: `{id}`, scenario `{scenario}` (the first digits of its hash).
{training}
## Play it

```sh
pip install "fpg-bench[hub]"
fpg-bench play --{side} {player} --{other} {rival} --out round.html
fpg-bench evaluate {player} --suite {suite} --out results
```

The agent is data, an ONNX network and a description of it, and plays in a sandbox.
[`replay.html`](replay.html) replays one of its rounds: download it and open it in a browser.
"""


def model_card(
    card: AgentCard,
    repository: str,
    suite: str,
    summaries: Sequence[Summary],
    files: Collection[str],
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
    return _CARD.format(
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


def results_yaml(benchmark: str, repository: str, summaries: Sequence[Summary]) -> str:
    """Return the scores of an agent as the Hub shows them on its page and on that of the benchmark.

    The Hub's form: https://huggingface.co/docs/hub/eval-results.

    Args:
        benchmark: ``owner/name`` of the benchmark's data set on the Hub, whose ``eval.yaml`` names the tasks.
        repository, summaries: as in :func:`model_card`.
    """
    source = {"url": f"https://huggingface.co/{repository}", "name": "records and replay"}
    return yaml.safe_dump(
        [
            {
                "dataset": {"id": benchmark, "task_id": summary.suite.name},
                "value": round(summary.score.value, 1),
                "source": source.copy(),
                "notes": f"95 % interval {_ends(summary.score, 1)} over {summary.score.over}; "
                f"{summary.reward.value:.2f} per step {_ends(summary.reward, 2)}",
            }
            for summary in summaries
        ],
        sort_keys=False,
    )


def _ends(interval: Interval, digits: int) -> str:
    return f"[{interval.low:.{digits}f}, {interval.high:.{digits}f}]"
