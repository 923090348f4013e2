"""Keys of seasons are read from the files of closed ones."""

import pytest
import yaml

from fpg_bench.common.errors import UserError
from fpg_bench.products.leaderboard import season_keys
from fpg_bench.products.leaderboard.season_keys import (
    SeasonKey,
    current_season,
    current_seasons,
    season_seed,
    seed_from,
)


def test_seasons_whose_suites_are_gone_keep_their_seeds():
    assert [season_seed(number)[:8] for number in (1, 2, 3)] == ["dec07a86", "c3ec4b3c", "b8a2973e"]


def test_a_season_met_an_entry_with_just_these_policies():
    key = SeasonKey(4, "seed", {"ally/mine": ("a", "b")})
    assert key.met("ally/mine", ["a", "b"])
    for policies in (["a"], ["a", "b", "c"], ["b", "a"], []):
        assert not key.met("ally/mine", policies)
    assert not key.met("ally/other", ["a", "b"])
    assert key.met("ally/other", [])


def test_the_newest_season_of_each_scenario_is_read_and_its_seed_follows_from_its_entries(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(season_keys, "suites_folder", lambda: tmp_path)

    def write(label, **changes):
        content = {"seed": seed_from("1", label, ["a", "b"]), "entries": {"ally/mine": ["b", "a"]}}
        content |= {"number": label, "protocol": "1"} | changes
        folder = tmp_path / f"season-{label}"
        folder.mkdir(exist_ok=True)
        (folder / "season.yml").write_text(yaml.safe_dump(content))

    assert current_season() is None
    write(3)
    write(4)
    write("3-link", number=3, scenario="link")
    assert {scenario: key.number for scenario, key in current_seasons().items()} == {"standard": 4, "link": 3}
    assert current_season().seed == season_seed(4) == seed_from("1", 4, ["b", "a"])
    assert current_season().suite_name("ally-v2") == "ally-season-4"
    for changes, message in (
        *(({"seed": seed}, "season season-5: its seed does not follow") for seed in ("0" * 64, "f" * 64)),
        *(({"entries": entries}, "does not follow") for entries in ({"ally/mine": 3}, {"ally/mine": ["a"]})),
        *(({name: None}, "season season-5: .* lacks its") for name in ("number", "seed", "entries")),
    ):
        write(5, **changes)
        with pytest.raises(UserError, match=message):
            current_season()
