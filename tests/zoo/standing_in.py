"""A stand-in for training, which a file can hold up or break."""

from __future__ import annotations

import time
from pathlib import Path

from fpg_bench.errors import UserError
from fpg_bench.training.config import RunConfig
from fpg_bench.zoo.zoo import load_zoo
from tests.zoo.making import evaluations, make_agent


def stand_in(here: Path, spec: RunConfig, out: Path, **how: object) -> Path:
    """ "Train" a run of the zoo in a folder: ``hold_<seed>`` there holds it up, ``break_<seed>`` ends it."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "run.json").write_text('{"finished": false}')
    with (here / "begun").open("a") as file:
        file.write(f"{spec.seed}\n")
    if (here / f"break_{spec.seed}").exists():
        raise UserError("out of luck")
    try:
        while (here / f"hold_{spec.seed}").exists():
            time.sleep(0.02)
    except KeyboardInterrupt:
        (out / "saved").touch()
        raise
    members = [m for m in load_zoo(here).members() if (m.algorithm, m.seed) == (spec.algorithm, spec.seed)]
    if not (out / "agent").exists():
        make_agent(members[0], out / "agent")
    (out / "evaluations.jsonl").write_text(evaluations())
    (out / "run.json").write_text('{"finished": true}')
    return out / "agent"
