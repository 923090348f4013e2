"""Channels of one's own: grids of gains in CSV files, read, refused by line, and played."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from make_channel import ELEVATIONS_DEG, rows

from fpg_bench.common.errors import UserError
from fpg_bench.game.channel import load_channel
from fpg_bench.game.scenario import Scenario, ScenarioError, preset

from .playing import ally, begin, opponent

LINK = preset("link")
GRID = [
    f"{x},{y},{z},{-60 - x / 100 - y / 50 - z / 20}"
    for x in (0, 1500)
    for y in (0, 800, 1600)
    for z in (0, 600)
]


def written(folder, lines) -> str:
    path = folder / "mine.csv"
    path.write_text("\n".join(["x,y,z,gain_db", *lines]))
    return str(path)


def test_a_grid_is_read_in_any_order_and_hashed_by_its_numbers(tmp_path):
    grid = load_channel(written(tmp_path, GRID))
    assert grid.gain_db.shape == (2, 3, 2)
    assert grid.gain_db[1, 2, 1] == pytest.approx(-60 - 15 - 32 - 30)
    assert grid.end_m.tolist() == [1500, 1600, 600]
    before = dataclasses.replace(LINK, channel=written(tmp_path, GRID))
    again = dataclasses.replace(LINK, channel=written(tmp_path, ["", *GRID[::-1]]))
    assert again.hash == before.hash != LINK.hash
    other = dataclasses.replace(LINK, channel=written(tmp_path, [*GRID[:-1], "1500,1600,600,-138"]))
    assert other.hash != before.hash


def test_the_gain_between_the_places_is_linear_in_db_and_read_beside_the_file(tmp_path):
    written(tmp_path, GRID)
    (tmp_path / "mine.yml").write_text("preset: link\nchannel: mine.csv\nfading_sd_db: 0")
    batch = begin(Scenario.from_yaml(tmp_path / "mine.yml"), games=5)
    for _ in range(3):
        batch.step(ally().repeat(5, 0), opponent().repeat(5, 0))
    x, y, z = batch.games["ally_position"].T
    noise = -148 + 10 * np.log10(5e6)
    expected = 36 - 60 - x / 100 - y / 50 - z / 20 - noise
    np.testing.assert_allclose(batch.games["clean_snr_db"], expected, rtol=1e-9)


def test_the_example_is_the_free_space_of_the_preset():
    lines = (Path(__file__).parents[2] / "examples/free-space.csv").read_text().splitlines()[1:]
    assert lines == [",".join(row) for row in rows(preset("link"), [250, 250, 150])]


def over_free_space(gains) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the places of a grid of 75 m, their elevations and the gains less those of free space."""
    free = np.array(rows(LINK, [75, 75, 75]), float)
    x, y, z = (free[:, :3] - LINK.base_station_m).T
    return free[:, :3], np.degrees(np.arctan2(z, np.hypot(x, y))), gains - free[:, 3]


def test_the_measured_example_is_what_its_page_says_of_its_fit():
    page = (Path(__file__).parents[2] / "docs/environments/scenario.md").read_text()
    said = next(line for line in page.splitlines() if "| gain over free space, dB |" in line).split("|")
    channel = load_channel(Path(__file__).parents[2] / "examples/lake-wheeler.csv")
    places, elevations, over = over_free_space(channel.gain_db.ravel())
    low, high = LINK.ally_path_altitude_m
    assert over[(low <= places[:, 2]) & (places[:, 2] <= high)].mean() == pytest.approx(0, abs=0.005)
    left = np.abs(over - np.interp(elevations, ELEVATIONS_DEG, [float(word) for word in said[2:-1]]))
    assert f"at {(left > 0.03).sum()} places of {len(places):,}" in page
    measured = places[left > 0.03]
    assert set(measured[:, 2]) == {75, 150}
    assert measured.max() < 1200  # the flights went 466 m far


def test_measured_gains_are_those_of_elevations_and_of_cells_with_samples():
    rng = np.random.default_rng(1)
    around = np.column_stack([rng.uniform(-400, 400, (4000, 2)), rng.uniform(20, 150, 4000)])
    apart = np.repeat([[0, 600, 55], [600, 0, 55]], [10, 9], axis=0)  # the samples of two cells, 6 dB higher
    sampled = np.vstack([around, apart])
    by_elevation = np.linspace(-3, 5, len(ELEVATIONS_DEG))
    above = np.degrees(np.arctan2(sampled[:, 2], np.hypot(sampled[:, 0], sampled[:, 1])))
    power = np.interp(above, ELEVATIONS_DEG, by_elevation) - 20 * np.log10(np.linalg.norm(sampled, axis=1))
    power[-len(apart) :] += 6
    gains = np.array(rows(LINK, [75, 75, 75], np.column_stack([sampled, power])), float)[:, 3]
    places, elevations, over = over_free_space(gains)
    left = over - np.interp(elevations, ELEVATIONS_DEG, by_elevation)
    left -= np.median(left)
    with_ten = np.all(places == [750, 1350, 75], axis=1)
    assert left[with_ten] == pytest.approx(6, abs=0.2)
    assert np.abs(left[~with_ten]).max() < 0.3


def test_a_fine_grid_of_free_space_is_free_space(tmp_path):
    low = dataclasses.replace(LINK, fading_sd_db=0, ally_path_altitude_m=(200, 250))
    grid = written(tmp_path, [",".join(row) for row in rows(low, [50, 50, 25])])
    played = [begin(s, games=20) for s in (low, dataclasses.replace(low, channel=grid))]
    for batch in played:
        batch.games["frequency_mhz"], batch.games["point"] = 2450, 7
        batch.step(ally().repeat(20, 0), opponent().repeat(20, 0))
    np.testing.assert_allclose(*(batch.games["clean_snr_db"] for batch in played), atol=0.1)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([*GRID, "0,0,0,-60"], r"line 14: \[0.0, 0.0, 0.0\] comes twice"),
        ([*GRID[:3], "0,800,600,80", *GRID[4:]], "line 5: gain_db 80: at most 0 dB"),
        ([*GRID[:3], "0,800,600,nan", *GRID[4:]], "line 5: expected four finite numbers"),
        ([*GRID[:3], "0,800,600", *GRID[4:]], "line 5: expected four finite numbers"),
        ([*GRID[:3], "0,800,600,low", *GRID[4:]], "line 5: expected four numbers, got '0,800,600,low'"),
        ([*GRID[:3], *GRID[4:]], r"no gain at \(0.0, 800.0, 600.0\): .* each of its 12 places"),
        ([line.replace(",800,", ",700,") for line in GRID], "y: unequal spacings, 700 to 900 m"),
        (GRID[:1], "x: expected 2 places or more, got 1"),
        ([f"{k},{k},{k},-60" for k in range(400)], r"no gain at \(0.0, 0.0, 1.0\): .* its 64,000,000"),
        (["\r".join(GRID[:1])], "x: expected 2 places or more, got 1"),
        (["1" * 131_073], "line 2: expected four finite numbers"),
    ],
)
def test_a_bad_grid_is_refused_by_line(tmp_path, lines, message):
    with pytest.raises(UserError, match=message):
        load_channel(written(tmp_path, lines))


def test_a_grid_that_does_not_hold_the_box_and_a_missing_file_are_refused(tmp_path):
    path = written(tmp_path, [line.replace("1500,", "1400,") for line in GRID])
    with pytest.raises(ScenarioError, match=r"\[1400.0, 1600.0, 600.0\] m; must hold box_m \(1500.0"):
        dataclasses.replace(LINK, channel=path)
    with pytest.raises(UserError, match=r"none\.csv"):
        dataclasses.replace(LINK, channel=str(tmp_path / "none.csv"))
    (tmp_path / "mine.csv").write_text("x,y,gain\n")
    with pytest.raises(UserError, match="line 1: expected the columns x,y,z,gain_db"):
        load_channel(tmp_path / "mine.csv")
