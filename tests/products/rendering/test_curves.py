"""Learning curves of runs: what is drawn of which folders."""

import json
import re

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text

from fpg_bench.common import canvas
from fpg_bench.common.canvas import styles_of
from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import SCRIPTED
from fpg_bench.evaluation.statistics import student_half
from fpg_bench.game.scenario import Scenario
from fpg_bench.products.rendering.curves import curves, draw_curves, levels_of, read_runs
from fpg_bench.products.rendering.verbs import curves as verb


def write_run(folder, algorithm="ppo", seed=0, slope=1.0, suite="ally-v2", steps=(0, 100, 200, 400)):
    folder.mkdir(parents=True)
    about = {"algorithm": algorithm, "training_seed": seed, "suite": suite}
    (folder / "run.json").write_text(json.dumps(about))
    rows = [{"steps": n, "seconds": n / 50, "side": "ally", "score": slope * n} for n in steps]
    (folder / "evaluations.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


@pytest.fixture
def runs(tmp_path):
    """Three seeds of PPO, one run of SAC."""
    for seed in range(3):
        write_run(tmp_path / "ppo" / f"seed_{seed}", seed=seed, slope=1.0 + seed)
    write_run(tmp_path / "sac", "sac")
    return [tmp_path / "ppo", tmp_path / "sac"]


def test_a_curve_is_a_mean_with_its_interval_over_seeds(runs):
    drawn = curves(read_runs(runs), "steps")
    assert list(drawn) == ["ppo", "sac"]
    ppo = drawn["ppo"]
    assert ppo.mean == pytest.approx(2 * ppo.x)
    assert ppo.high - ppo.mean == pytest.approx(ppo.x * student_half(np.array([1.0, 2.0, 3.0])))
    assert drawn["sac"].low == pytest.approx(drawn["sac"].high)  # a single seed has no band
    assert curves(read_runs(runs), "seconds")["ppo"].x[-1] == pytest.approx(8.0)


def test_runs_of_one_algorithm_are_named_by_their_folders(runs, tmp_path):
    write_run(tmp_path / "slow", "ppo")
    assert set(curves(read_runs([*runs, tmp_path / "slow"]), "steps")) == {
        str(tmp_path / "ppo"),
        "sac",
        str(tmp_path / "slow"),
    }


def test_runs_that_cannot_be_drawn_together_are_refused(runs, tmp_path):
    write_run(tmp_path / "other", suite="opponent-v2")
    write_run(tmp_path / "blind", steps=(0,))
    (tmp_path / "empty").mkdir()
    for folder, message in (
        ("other", "was evaluated on ally-v2, .*other on opponent-v2; draw them apart"),
        ("blind", "blind was not evaluated during its training; see --n-evals"),
        ("empty", r"empty holds no evaluations\.jsonl; name the folder of a run"),
    ):
        with pytest.raises(UserError, match=message):
            read_runs([*runs, tmp_path / folder])


def test_training_seeds_without_a_step_in_common_have_no_curve(runs, tmp_path):
    write_run(tmp_path / "ppo" / "seed_3", seed=3, steps=(0, 500, 600))
    with pytest.raises(UserError, match="the training seeds of ppo have no steps in common; draw them apart"):
        curves(read_runs(runs), "steps")


def test_the_verb_writes_a_figure_by_its_suffix(runs, tmp_path):
    verb(runs, tmp_path / "curves.svg")
    assert (tmp_path / "curves.svg").read_bytes().startswith(b"<?xml")


def test_many_players_differ_in_colour_or_marker_and_a_known_one_has_its_own():
    styles = styles_of([*map(str, range(36)), "sac", "ppo-stack8"])
    assert len({(style["color"], style["marker"]) for style in styles.values()}) == 38
    for names in (["sac"], ["DQN", "SAC"], ["ppo", "other", "sac"]):
        alone = styles_of(names)
        assert alone[names[-1]] == styles["sac"]


def write_described(folder, seed, slope, **changes):
    """A run that says how it was made, as those of ``fpg-bench train`` do."""
    write_run(folder, seed=seed, slope=slope)
    game = {"id": "FPG/AllyVsScripted-v0", "opponent": ["tone", "adaptive"]}
    about = json.loads((folder / "run.json").read_text()) | {"game": game, "training_steps": 400} | changes
    (folder / "run.json").write_text(json.dumps(about))


def test_runs_that_differ_by_their_training_seed_alone_are_one_curve(tmp_path):
    for seed in range(3):
        write_described(tmp_path / f"ppo_{seed}", seed, 0.1 * (1 + seed))
        write_described(tmp_path / f"slow_{seed}", seed, 0.01, hyperparameters={"learning_rate": 1e-5})
    seeds, others = ([tmp_path / f"{name}_{seed}" for seed in range(3)] for name in ("ppo", "slow"))
    drawn = curves(read_runs(seeds), "steps")
    assert list(drawn) == ["ppo"]
    assert drawn["ppo"].mean == pytest.approx(0.2 * drawn["ppo"].x)
    assert list(curves(read_runs([*seeds, *others]), "steps")) == [
        str(tmp_path / name) for name in ("ppo", "slow")
    ]


def test_random_play_and_the_best_script_are_levels(runs, tmp_path):
    levels = levels_of(runs)
    assert levels.pop("random") == 0
    ((script, score),) = levels.items()
    assert script in SCRIPTED["ally"]
    assert 0 < score < 100
    cheap = {"scenario": Scenario(hop_cost=1).hash, "scenario_fields": {"hop_cost": 1.0}}
    write_described(tmp_path / "cheap", 0, 1.0, **cheap)
    assert levels_of([tmp_path / "cheap"]) == {}  # its scores are on no scale
    assert levels_of([*runs, tmp_path / "cheap"]) == {}


def test_the_axis_ends_near_means_and_levels_whatever_bands_reach(tmp_path):
    for seed, slope in enumerate((-3.0, 0.05, 0.1)):
        write_described(tmp_path / f"run_{seed}", seed, slope)
    figure = draw_curves(read_runs([tmp_path / f"run_{seed}" for seed in (1, 2)]), levels={"best": 60.0})
    assert figure.axes[0].get_ylim() == pytest.approx((7.5 - 7.875, 60 + 7.875))
    figure = draw_curves(read_runs([tmp_path / "run_0"]), levels={"random": 0.0})
    assert figure.axes[0].get_ylim() == pytest.approx((-100, 15))


def test_a_figure_fits_a_page_of_a_journal_and_pages_that_are_dark(runs):
    before = dict(matplotlib.rcParams)
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "red"}):  # a reader's own settings
        figure = draw_curves(read_runs(runs), levels={"best": 60.0})
        image = canvas.image_of(figure, "svg", "curves").decode()
    assert dict(matplotlib.rcParams) == before
    assert figure.get_figwidth() == canvas.PAGE
    assert {text.get_fontsize() for text in figure.findobj(Text) if text.get_text()} == {8}
    legend = {text.get_text() for text in figure.legends[0].get_texts()}
    assert legend == {"ppo", "sac", "95 % interval of the mean"}
    assert "svg{color-scheme:light dark} @media (prefers-color-scheme:dark)" in image
    assert ">score</text>" in image  # text that can be searched
    drawn = image.partition("</style>")[2]
    assert "fill: #ffffff" not in drawn
    assert "fill: #ff0000" not in drawn


def test_colours_are_read_by_day_and_by_night_and_cells_keep_their_text():
    figure = canvas.blank_figure(2, 2)
    axes = figure.add_subplot()
    axes.imshow([[0, 1]], cmap="Greys")
    axes.text(0, 0, "on a light cell", color="black")
    axes.set_title("beside the cells")
    style, _, drawn = canvas.image_of(figure, "svg", "cells").decode().partition("</style>")
    turned = dict(re.findall(r"\[style\*='(?:fill|stroke): (#\w+)'\]\{\w+:(#\w+)", style))

    def light(colour):
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
        return np.dot(linear, (0.2126, 0.7152, 0.0722))

    for colour in canvas.COLOURS:
        assert (light(turned.get(colour, colour)) + 0.05) / (light("#15191e") + 0.05) > 4, colour
    texts = dict(map(reversed, re.findall(r'<text style="([^"]*)"[^>]*>([^<]+)</text>', drawn)))
    assert "fill:" not in texts["beside the cells"]  # turned with the ink
    assert not any(f"fill: {ink}" in texts["on a light cell"] for ink in turned)
    assert "fill: #0" in texts["on a light cell"]
