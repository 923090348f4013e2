"""The model card of an agent: ``README.md`` with the Hub's metadata, made from ``agent.json`` and records."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from huggingface_hub import EvalResult, ModelCardData

from fpg_bench.common.ids import other_side
from fpg_bench.common.imports import HUB
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import markdown
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
    about: Mapping[str, Any],
    repository: str,
    side: str,
    suite: str,
    summaries: Sequence[Summary],
    files: Collection[str],
) -> str:
    """Return the model card of an agent.

    Args:
        about: the content of ``agent.json``.
        repository: ``owner/name`` on the Hub.
        side: the side that it plays.
        suite: the suite that measures it.
        summaries: its results, one for each suite; they become the ``model-index``.
        files: names of the files that stand beside the card.
    """
    metadata = ModelCardData(
        library_name="fpg-bench",
        pipeline_tag=_TASK,
        tags=[_TASK, "fpg-bench", str(about["id"]), str(about["algorithm"]), "onnx"],
        model_name=repository.partition("/")[2],
        eval_results=[result for summary in summaries for result in _eval_results(about, summary)] or None,
    )
    results = "\n".join(markdown([summary], summary.suite) for summary in summaries).strip()
    command = about.get("command")
    training = f"\n```sh\n{command}\n```\n" if command else ""
    if "curve.png" in files:
        training += "\n![Score over training steps](curve.png)\n"
    seconds, offline = about.get("seconds"), about.get("offline")
    return _CARD.format(
        metadata=metadata.to_yaml(),
        algorithm=about["algorithm"],
        id=about["id"],
        version=__version__,
        side=side,
        other=other_side(side),
        rival=_RIVAL[other_side(side)],
        results=results or "No records of an evaluation were uploaded.",
        seed="unknown" if about["training_seed"] is None else about["training_seed"],
        steps=f"{about['training_steps']:,}",
        data=f" of gradient descent on the data set `{offline['dataset']}`" if offline else "",
        time=f", {seconds:,.0f} seconds" if isinstance(seconds, int | float) else "",
        scenario=str(about["scenario"])[:12],
        training=training,
        player=HUB + repository,
        suite=suite,
    )


def _eval_results(about: Mapping[str, Any], summary: Summary) -> list[EvalResult]:
    """Return the score and the mean reward per step on a suite, as the Hub's ``model-index`` has them."""
    where = {"task_type": _TASK, "task_name": _TASK, "dataset_type": about["id"]}
    over = f"95 % interval over {summary.over}"
    return [
        EvalResult(
            **where,
            dataset_name=f"{about['id']}, suite {summary.suite.name}",
            dataset_config=summary.suite.name,
            metric_type=kind,
            metric_name=f"{name}, {over} {_ends(value, digits)}",
            metric_value=round(value.value, digits),
        )
        for kind, name, value, digits in (
            ("score", "score", summary.score, 1),
            ("mean_reward", "mean reward per step", summary.reward, 2),
        )
    ]


def _ends(interval: Interval, digits: int) -> str:
    return f"[{interval.low:.{digits}f}, {interval.high:.{digits}f}]"
