"""Link budgets against levels worked out by hand, and against the game's own steps."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import STANDARD, Scenario, preset
from fpg_bench.products.link_budget.link_budget import draw_link_budget, link_budget
from tests.game.playing import NARROWBAND, ally, begin, opponent, place, to_point
from tests.programs import fpg

LINK = preset("link")


def test_a_budget_is_what_an_engineer_works_out_by_hand():
    """36 dBm, 500 m at 2441.75 MHz, a jammer of 39 dBm in 20 MHz at 100 m."""
    rows = {(row.jamming, row.waveform, row.distance_m): row for row in link_budget(LINK)}
    clean, jammed = rows["-", "unspread", 500.0], rows["narrowband", "unspread", 100.0]
    loss = 32.44 + 20 * math.log10(0.5) + 20 * math.log10(2441.75)
    assert clean.path_loss_db == pytest.approx(loss)
    assert clean.received_dbm == pytest.approx(36 - loss)
    assert clean.snr_db == pytest.approx(36 - loss + 148 - 67, abs=0.02)
    assert clean.rate_mbit_s == pytest.approx(5 * 5.55)
    assert jammed.js_db == pytest.approx(39 - 36 + 20 * math.log10(5))
    assert jammed.passes_db == pytest.approx(10 * math.log10(5 / 20), abs=0.01)
    noise = 10 ** (-clean.snr_db / 10) + 10 ** ((jammed.js_db + jammed.passes_db) / 10)
    assert jammed.snr_db == pytest.approx(-10 * math.log10(noise))
    assert rows["tone", "spread", 100.0].gain_db == pytest.approx(10 * math.log10(25))
    assert len(rows) == 5 * 3 * 2


def test_a_budget_is_that_of_a_step_of_the_game():
    curve = ((750, 250, 25), *[(750, 1200, 25)] * 3)
    scenario = dataclasses.replace(
        LINK,
        ally_speed_m_s=(0, 0),
        ally_path_m=curve,
        fading_sd_db=0,
        jamming_fading_sd_db=0,
        opponent_path="learned",
    )
    (row,) = (r for r in link_budget(scenario, 500.0, [100.0]) if r[:2] == ("narrowband", "spread"))
    batch = begin(scenario)
    place(batch, [850.0, 250, 25])
    jam = opponent(NARROWBAND, in_band=True)
    batch.step(ally(hop=True, spread=True, preference=to_point(7)), jam)
    assert batch.games["snr_db"][0] == pytest.approx(row.snr_db)


@pytest.mark.process
def test_a_budget_reads_the_channel_as_the_game_does(tmp_path):
    corners = [(x, y, z) for x in (0, 1500) for y in (0, 1500) for z in (0, 600)]
    rows = [f"{x},{y},{z},{-49.8 - x / 100}" for x, y, z in corners]
    (tmp_path / "my.csv").write_text("\n".join(["x,y,z,gain_db", *rows]))
    file = tmp_path / "my.yml"
    file.write_text("preset: link\nchannel: my.csv\nfading_sd_db: 0\n")
    scenario = Scenario.from_yaml(file)
    free, mine = (
        {row[:3]: row for row in link_budget(s, distances_m=(100, 500, 2000))} for s in (LINK, scenario)
    )
    assert [key[2] for key in mine if key[0] == "-"] == [100, 100, 500, 500]  # none beyond the box
    clean, jammed = mine["-", "unspread", 500], mine["narrowband", "unspread", 500]
    assert clean.path_loss_db == pytest.approx(49.8 + 7.5)
    lower = clean.received_dbm - free["-", "unspread", 500].received_dbm
    assert jammed.js_db == pytest.approx(free["narrowband", "unspread", 500].js_db - lower)
    shown = json.loads(fpg("scenario", "show", file, "--json").stdout)
    assert shown[2]["received_dbm"] == pytest.approx(clean.received_dbm)
    assert "from the base station: mean gain of" in fpg("scenario", "show", file).stdout

    batch = begin(scenario)
    batch.step(ally(), opponent())
    place_x, noise = batch.games["ally_position"][0, 0], clean.received_dbm - clean.snr_db
    assert batch.games["clean_snr_db"][0] == pytest.approx(36 - 49.8 - place_x / 100 - noise)
    with pytest.raises(UserError, match="link_m: no place of the box lies 2000 m"):
        link_budget(scenario, 2000)
    draw_link_budget(scenario, tmp_path / "link.png")


def test_types_that_are_not_allowed_have_no_rows_and_other_models_no_budget():
    rows = link_budget(dataclasses.replace(LINK, jamming_types="comb"))
    assert {row.jamming for row in rows} == {"-", "comb"}
    with pytest.raises(UserError, match="snr_model 'link' alone, got 'sinr'"):
        link_budget(STANDARD)


@pytest.mark.process
def test_the_verbs_show_and_check(tmp_path):
    shown = fpg("scenario", "show", "link").stdout
    assert LINK.hash in shown
    assert "noise     = -148 dBm/Hz" in shown
    rows = json.loads(fpg("scenario", "show", "link", "--json").stdout)
    assert np.isclose(rows[0]["snr_db"], link_budget(LINK)[0].snr_db)
    assert "hop_cost: 100.0" in fpg("scenario", "show", "paper").stdout
    file = tmp_path / "mine.yml"
    file.write_text("preset: link\nhop_airtime_s: 0.1")
    assert "valid, the same as link-fast-hop" in fpg("scenario", "check", file).stdout
    file.write_text("preset: link\nhop_airtime_s: 2")
    refused = fpg("scenario", "check", file)
    assert refused.returncode != 0
    assert "hop_airtime_s: 2 is outside [0, 1]" in refused.stderr
