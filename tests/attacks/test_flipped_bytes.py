"""A byte of any file of a board is another one: what it belongs to is refused, or nothing shown changes."""

import dataclasses
import json
import random

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.products.leaderboard import crossplay, responses
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.encounters import Verification
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.responses import verify_responses
from fpg_bench.products.leaderboard.verification import verify
from tests.policies import write_seed
from tests.products.leaderboard.entering import bad_pairs, close_season, enter

pytestmark = [pytest.mark.slow]
FLIPS, SEED = 200, 0
KINDS = (
    "submissions/*/*/submission.yaml",
    "submissions/*/*/seed_*/agent.json",
    "submissions/*/*/seed_*/policy.onnx",
    "results/*/*.jsonl",
    "results/crossplay.jsonl",
    "results/exploited.jsonl",
    "responses/*/*/*/agent.json",
    "responses/*/*/*/policy.onnx",
    "responses/*/*/*/response.yaml",
    "../baselines/suites/*.yml",
    "../baselines/suites/season-*/season.yml",
)
# What the others decide, too: it may change where an entry is left out.
TOGETHER = ("rank", "may_be_best", "behind", "seeds_gap", "same_policies", "exploited", "is_late")


@pytest.fixture
def entered(board, small_suites, in_process, monkeypatch):
    """A board with all kinds of files."""
    monkeypatch.setattr(crossplay, "ROUNDS", 4)
    monkeypatch.setattr(responses, "ROUNDS", 4)
    close_season(small_suites)
    offline = {"dataset": "fpg/ally-random-v0", "sha256": "ab" * 32}
    folder = enter(board, "ally", "linear", seeds=(3, 5))
    for seed in (3, 5):
        write_seed(folder / f"seed_{seed}", seed, id="FPG/AllyVsScripted-v0", offline=offline)
    enter(board, "ally", "wise", script="expert")
    enter(board, "opponent", "flying", seeds=(1,), path="learned")
    assert all(verdict.is_good for verdict in verify(board))
    for name, seed in (("one", 11), ("two", 12)):
        response = board / "responses/ally/linear" / name
        write_seed(response, seed, game={"id": "FPG/OpponentVsPolicy-v0", "ally": "x/seed_3"})
        credit = {"name": "Breaker", "authors": ["A. Name"], "seconds": 60}
        (response / "response.yaml").write_text(yaml.safe_dump(credit))
    assert all(verdict.is_good for verdict in verify_responses(board, Verification()))
    assert bad_pairs(board) == {}
    return board


def shown(board):
    """All that a board shows of each entry that is verified, of each response and of each pair."""
    made, parts = make_board(load_entries(board)), {}
    for track in made.tracks:
        for entry, figures in track.verified():
            alone = {k: v for k, v in dataclasses.asdict(figures).items() if k not in TOGETHER}
            about = entry.about.model_copy(update={"policies": ()})  # cards may have keys of their own
            parts[track.key, entry.slug] = dataclasses.asdict(entry) | {"about": about, "figures": alone}
            attacks = figures.exploited.attacks if figures.exploited else ()
            parts |= {(track.key, entry.slug, each.rival): each for each in attacks}
    for scenario, played in made.crossplay.items():
        for row, ally in enumerate(played.allies):
            for column, opponent in enumerate(played.opponents):
                cells = [played.returns[side][row][column] for side in ("ally", "opponent")]
                parts[scenario, ally, opponent, "pair"] = [*cells, played.jamming_success_rate[row][column]]
    return parts


def test_a_flipped_byte_is_refused_or_changes_nothing_shown(entered):
    rng, before = random.Random(SEED), shown(entered)
    assert {len(key) for key in before} == {2, 3, 4}
    refused = 0
    for number in range(FLIPS):
        kind = KINDS[number % len(KINDS)]
        file = rng.choice(sorted(path for path in entered.glob(kind) if path.is_file()))
        content = file.read_bytes()
        place, bit = rng.randrange(len(content)), 1 << rng.randrange(8)
        file.write_bytes(content[:place] + bytes([content[place] ^ bit]) + content[place + 1 :])
        try:
            after = shown(entered)
        except UserError:
            refused += 1
        else:
            where = (
                f"{file.relative_to(entered.parent)}: byte {place}, {content[place : place + 1]!r} ^ {bit}"
            )
            changed = {key for key, part in after.items() if part != before.get(key)}
            assert not changed, (where, changed)
            refused += after.keys() != before.keys()
        file.write_bytes(content)
    assert refused > FLIPS / 2
    assert shown(entered) == before


def test_no_digit_of_a_row_can_be_changed(entered):
    before = shown(entered)
    for name in ("crossplay", "exploited", "ally/linear"):
        file = entered / f"results/{name}.jsonl"
        text = file.read_text()
        digits = [place for place, letter in enumerate(text) if letter.isdigit()]
        for place in random.Random(SEED).sample(digits, 20):
            other = str((int(text[place]) + 6) % 10)
            file.write_text(text[:place] + other + text[place + 1 :])
            after = shown(entered)
            assert {key for key, part in after.items() if part != before.get(key)} == set(), (name, place)
            assert len(json.dumps([str(key) for key in after])) < len(
                json.dumps([str(key) for key in before])
            )
        file.write_text(text)
