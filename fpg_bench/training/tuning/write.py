"""Values that were confirmed, written into a hyper-parameter file; everything else in it stays."""

from __future__ import annotations

import json
import os
import re
import textwrap
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.training.tuning.confirm import Confirmed
from fpg_bench.training.tuning.space import merged

_PACKAGES = ("fpg-bench", "stable-baselines3", "torch", "optuna")
_MARK = "  # tuned: "
_MORE = "  #        "


def write_values(file: Path, best: Confirmed) -> None:
    """Write a confirmed trial's values into a file's entry of its id, with where they come from.

    Comments, keys that were not searched and other ids stay; ids that are aliases of this one follow it.
    Where the entry is an alias itself, or is not there, it becomes one of its own.

    Raises:
        UserError: the file cannot be read, or its entry is written in a way that cannot be edited.
    """
    env_id = best.task.env_id
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    before = read_yaml(file, "hyper-parameters") if text.strip() else {}
    entry = merged(before.get(env_id) or best.task.hyperparameters, best.values)
    changed = {name.partition(".")[0] for name in best.values}
    lines = _edited(text.splitlines(), env_id, entry, changed, provenance(best))
    written = "\n".join(lines) + "\n"
    try:
        found = yaml.safe_load(written)
    except yaml.YAMLError:
        found = None
    kept = isinstance(found, dict) and found.get(env_id) == entry and before.keys() <= found.keys()
    if not kept or written.count(f"{env_id}:") + written.count(f'{env_id}":') > 1:
        raise UserError(
            f"hyper-parameters {file}: the entry of {env_id} cannot be edited; write it as one key a line, "
            f"or set yourself: {json.dumps(best.values)}"
        )
    write_whole(file, written)


def check_file(file: Path) -> None:
    """Raise UserError where a hyper-parameter file can't be written, before anything is trained for it."""
    if file.exists() and file.read_text(encoding="utf-8").strip():
        read_yaml(file, "hyper-parameters")
    folder = next(parent for parent in file.absolute().parents if parent.exists())
    if not (folder.is_dir() and os.access(file if file.exists() else folder, os.W_OK)):
        raise UserError(f"hyper-parameters {file}: cannot be written")


def provenance(best: Confirmed) -> list[str]:
    """The comment's lines: study, trial, scores, seeds, versions."""
    task, score = best.task, best.score
    said = (
        f"study {best.study!r}, trial {best.trial} (of {best.trials}): score {shown(score)} over the fresh "
        f"training seeds {best.seeds[0]} to {best.seeds[-1]} of {task.steps:,} steps each, "
        f"{best.searched:.1f} in the study; suite {task.suite} on tuning seeds, {task.rounds} rounds "
        "per rival; " + ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    )
    return textwrap.wrap(said, 110, initial_indent=_MARK, subsequent_indent=_MORE)


def shown(score: Interval) -> str:
    """A score, with its interval where it has one."""
    interval = f" [{score.low:.1f}, {score.high:.1f}]" if score.low < score.high else ""
    return f"{score.value:.1f}{interval}"


def _edited(
    lines: list[str], env_id: str, entry: dict[str, Any], changed: set[str], comment: list[str]
) -> list[str]:
    """The file's lines with the entry's changed keys and the comment."""
    start = next((i for i, line in enumerate(lines) if line.startswith(f"{env_id}:")), None)
    if start is None:
        return [*lines, f"{env_id}:", *comment, *_block(entry, set(entry))]
    head = lines[start]
    end = next((i for i in range(start + 1, len(lines)) if not lines[i].startswith(" ")), len(lines))
    if not re.fullmatch(rf"{re.escape(env_id)}:\s*(&\S+)?\s*(#.*)?", head):  # an alias, or one line
        anchor = re.match(rf"{re.escape(env_id)}:\s*(&\S+)", head)
        head = f"{env_id}: {anchor[1]}" if anchor else f"{env_id}:"
        return [*lines[:start], head, *comment, *_block(entry, set(entry)), *lines[end:]]
    kept, unwritten = [], set(changed)
    inside = False  # whether the last key's lines are replaced
    for line in lines[start + 1 : end]:
        if line.startswith((_MARK, _MORE)):
            continue
        if key := re.match(r"  (\w+):", line):
            inside = key[1] in changed
            unwritten.discard(key[1])
            kept += _block(entry, {key[1]}) if inside else []
        if not inside:
            kept.append(line)
    return [*lines[: start + 1], *comment, *kept, *_block(entry, unwritten), *lines[end:]]


def _block(entry: dict[str, Any], keys: set[str]) -> list[str]:
    """The entry's keys, one a line, mappings and lists in brackets."""
    return [f"  {key}: {_flow(value)}" for key, value in entry.items() if key in keys]


def _flow(value: Any) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)
    return text.removesuffix("\n").removesuffix("\n...")
