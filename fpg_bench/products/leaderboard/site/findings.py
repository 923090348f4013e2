"""Findings as cards on the front page: claims of the documentation's findings, and rounds that show them."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import begin_round, finish_round, make_match
from fpg_bench.game.recording import Recording
from fpg_bench.game.scenario import Scenario
from fpg_bench.players import agent
from fpg_bench.products.leaderboard.site.page_data import agent_file
from fpg_bench.products.leaderboard.site.views import format_number
from fpg_bench.products.rendering.replay import JammingData, ReplayData, replay_data

SEED = 2
_FROM, _SECONDS, _HEIGHT, _WIDTH = 120, 60, 60, 300  # of a picture
_LEAST = 5  # height of a tone, which is narrower
_JAMMED, _RETURN = "jamming_success_rate", "ally_return"


@dataclass(frozen=True)
class Claim:
    """A finding, and rounds of the first seed that show it.

    Attributes:
        title, text: the claim.
        measure: what the rounds differ in.
        rounds: what each round is called, its ally and its opponent; with a slash: an agent of the zoo.
    """

    title: str
    text: str
    measure: str
    rounds: tuple[tuple[str, str, str], ...]


_HARD = "opponent-pursuit/td3"
CLAIMS = (
    Claim(
        "No jamming type is best against everybody",
        "Among scripts a tone jams most against an ally that stays, broadband against one that hops blindly.",
        _JAMMED,
        (
            ("a tone, the ally stays", "idle", "tone"),
            ("broadband, the ally stays", "idle", "broadband"),
            ("a tone, the ally hops", "always-hop", "tone"),
            ("broadband, the ally hops", "always-hop", "broadband"),
        ),
    ),
    Claim(
        "The best against scripts is not the hardest to beat",
        "Allies without memory that trained on scripts alone lose to trained opponents that they never met.",
        _RETURN,
        (
            ("TD3 against a script, adaptive", "ally-scripted/td3", "adaptive"),
            ("TD3 against a trained opponent", "ally-scripted/td3", _HARD),
        ),
    ),
    Claim(
        "A population of opponents makes an ally hard to beat",
        "This ally met a population in training. Yet none is safe: training finds an answer to each.",
        _RETURN,
        (
            ("PPO of a population against adaptive", "ally-population/ppo-stack8", "adaptive"),
            ("PPO of a population against the same", "ally-population/ppo-stack8", _HARD),
        ),
    ),
)


@dataclass(frozen=True)
class ShownRound:
    """A round on a card.

    Attributes:
        name: what it is called.
        figure: its measure.
        href: where the page plays it.
        jamming, link, outage: a minute of the band as paths of an SVG: what is jammed, the ally's
            frequency, and where its link is broken.
    """

    name: str
    figure: str
    href: str
    jamming: str
    link: str
    outage: str


Cards = list[tuple[Claim, list[ShownRound]]]


def finding_cards() -> Cards:
    """Return the claims whose players are there, and their rounds."""
    return _cards(agent.baselines_folder())


@functools.cache
def _cards(folder: Path) -> Cards:
    cards = []
    for claim in CLAIMS:
        with contextlib.suppress(UserError):  # without the zoo
            cards.append((claim, [_shown(claim.measure, *names) for names in claim.rounds]))
    return cards


def _shown(measure: str, name: str, ally: str, opponent: str) -> ShownRound:
    data = play_round(ally, opponent)
    figures = {
        _JAMMED: f"jamming success rate {format_number(data[_JAMMED], 'share')}",
        _RETURN: f"the ally earns {format_number(data[_RETURN], 'step')} per step",
    }
    players = {"ally": _page_player(ally), "opponent": _page_player(opponent)}
    content = urlencode({"side": "nobody", **players, "seed": SEED, "pace": 10}, safe=":/")
    return ShownRound(name, figures[measure], f"play.html#{content}", *_band(data["replay"]))


def _page_player(name: str) -> str:
    return f"agent:{agent_file(name)}" if "/" in name else f"script:{name}"


def play_round(ally: str, opponent: str) -> JsonObject:
    """Play a round in pursuit; returns its two measures, and ``replay``, its data as a page replays it."""
    players = [agent.load_agent(f"{name}/seed_0") if "/" in name else name for name in (ally, opponent)]
    match = make_match(make_duel(1, scenario=Scenario(opponent_path="pursuit")), *players)
    begin_round(match, seeds=np.array([SEED]))
    recording = Recording(match.duel.batch)
    finish_round(match, on_step=recording.add)
    return {
        _JAMMED: match.duel.measures(0)[_JAMMED],
        _RETURN: float(recording.frames["ally_reward"][1:].mean()),
        "replay": replay_data([recording], "", ally, opponent),
    }


def _band(data: ReplayData) -> tuple[str, str, str]:
    """Return the third minute of a round's band as paths: jamming, the ally's frequency, its outages."""
    scenario, steps = data["scenario"], data["rounds"][0]["steps"]
    low, high = map(float, scenario["band_mhz"])
    low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    width = _WIDTH // _SECONDS

    def y(mhz: float) -> int:
        return round((high - mhz) / (high - low) * _HEIGHT)

    jamming, link, outage, level = "", "", "", None
    for second in range(_FROM + 1, _FROM + _SECONDS + 1):
        x = (second - 1 - _FROM) * width
        for bottom, top in _footprints(
            scenario["jamming"][steps["type"][second]], steps["centre"][second], low, high
        ):
            thick = max(_LEAST, y(bottom) - y(top))
            jamming += f"M{x} {(y(bottom) + y(top) - thick) // 2}h{width}v{thick}h-{width}z"
        now = y(steps["frequency"][second])
        link += ("" if now == level else f"V{now}" if level is not None else f"M0 {now}") + f"h{width}"
        level = now
        if steps["snr"][second] < scenario["threshold_db"]:
            outage += f"M{x} {now}h{width}"
    return jamming, link, outage


def _footprints(kind: JammingData, centre: float, low: float, high: float) -> Iterator[tuple[float, float]]:
    """Yield the jammed pieces of the band between two frequencies, in MHz."""
    half, spacing = kind["half_width_mhz"], kind["spacing_mhz"]
    teeth = np.arange(centre - spacing * ((centre - low) // spacing), high, spacing) if spacing else [centre]
    for tooth in teeth:
        yield max(low, float(tooth) - half), min(high, float(tooth) + half)
