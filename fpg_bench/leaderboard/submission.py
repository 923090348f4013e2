"""A submission to the leaderboard: data alone, which is read without running any of it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from fpg_bench.evaluation.field import Field
from fpg_bench.extras import need
from fpg_bench.leaderboard.fields import TRACKS, Training
from fpg_bench.leaderboard.policies import Policy
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

    @property
    def slug(self) -> str:
        """The folder's name: unique in its track."""
        return self.folder.name

    @property
    def fields(self) -> dict[str, Field]:
        """What it plays, by what that says; see :meth:`fpg_bench.leaderboard.tracks.Track.fields`."""
        return track_of(self.track, self.path).fields(transcripts=bool(self.transcripts))

    @property
    def fingerprint(self) -> str:
        """SHA-256 of what was submitted: the fields of ``submission.yaml``, policies and transcripts."""
        told = {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
            if field.name not in ("folder", "policies", "transcripts")
        }
        told["training"] = None if self.training is None else dataclasses.asdict(self.training)
        told["policies"] = {policy.seed: policy.sha256 for policy in self.policies}
        told["transcripts"] = {
            path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in self.transcripts
        }
        text = json.dumps({"slug": self.slug, **told}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
