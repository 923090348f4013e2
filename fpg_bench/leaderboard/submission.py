"""A submission to the leaderboard: data alone, which is read without running any of it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.common.extras import need
from fpg_bench.evaluation.suite import Suite
from fpg_bench.leaderboard.policies import Policy
from fpg_bench.leaderboard.submission_file import TRACKS, Training
from fpg_bench.leaderboard.tracks import track_of

need("evaluate", "onnx", "scipy", "matplotlib", "joblib")

__all__ = ["TRACKS", "Policy", "Submission", "Training"]


@dataclass(frozen=True)
class Submission:
    """What somebody has entered; every text in it is untrusted.

    Attributes:
        folder: where it lies; its name is the submission's address in its track.
        track: ``ally``, ``opponent`` or ``planner``.
        name: what the page calls it.
        reference: an https link, or None.
        path: of the track ``opponent``: ``pursuit`` or ``learned``; else None.
        training: None where nothing was trained.
        saw: what it saw while it was trained.
        unable: what it was not able to do.
        script: the package's own player or planner that it names, or None.
        zoo: the package's own agents that it names, as ``ally-scripted/ppo``, or None.
        policies: by training seed; none where it is a script or transcripts.
        transcripts: of a language model that plans; their files, sorted.
        runs: how often that was recorded, as its authors say; None where nothing is.
    """

    folder: Path
    track: str
    name: str
    authors: tuple[str, ...]
    algorithm: str
    reference: str | None
    licence: str
    path: str | None
    training: Training | None
    saw: str
    unable: str
    description: str = ""
    script: str | None = None
    zoo: str | None = None
    policies: tuple[Policy, ...] = ()
    transcripts: tuple[Path, ...] = ()
    runs: int | None = None

    @property
    def slug(self) -> str:
        """The folder's name: unique in its track."""
        return self.folder.name

    @property
    def suites(self) -> dict[str, Suite]:
        """What it plays, by what that says; see :meth:`fpg_bench.leaderboard.tracks.Track.suites`."""
        return track_of(self.track, self.path).suites(transcripts=bool(self.transcripts))

    @property
    def fingerprint(self) -> str:
        """SHA-256 of what was submitted: the suites of ``submission.yaml``, policies and transcripts."""
        told = {
            suite.name: getattr(self, suite.name)
            for suite in dataclasses.fields(self)
            if suite.name not in ("folder", "policies", "transcripts")
        }
        if self.runs is None:  # an entry that has none keeps its fingerprint
            del told["runs"]
        told["training"] = None if self.training is None else dataclasses.asdict(self.training)
        told["policies"] = {policy.seed: policy.sha256 for policy in self.policies}
        told["transcripts"] = {
            path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in self.transcripts
        }
        text = json.dumps({"slug": self.slug, **told}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
