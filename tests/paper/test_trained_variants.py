"""Trained variants: their choice, conditions and page."""

import dataclasses

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import PAPER, preset
from fpg_bench.paper.claims import ASPECTS
from fpg_bench.paper.conditions import BASE, Condition, conditions_of
from fpg_bench.paper.experiment import BUDGETS, Budget, hyperparameters
from fpg_bench.paper.reproduce import reproduce
from fpg_bench.paper.runs import Results, RunFile
from scripts.interpretations import trained
from scripts.interpretations.interpretations import POINTS, Interpretation, parse_interpretation
from scripts.interpretations.screen import effects, read_screen
from scripts.interpretations.trained import (
    FIGURES,
    LOW_NOISE,
    NEEDED,
    VARIANTS,
    Variant,
    all_conditions,
)
from tests.paper.made_up import SEEDS, results
from tests.programs import ROOT

TINY = Budget("tiny", 2_000, 8, 25, 2, 1)


def verdicts(rows, interpretation):
    """Return for each claim whether the screen says that it holds, and whether a part is reversed."""
    by_claim = effects([row for row in rows if row["interpretation"] == interpretation.name])
    return {name: (effect.holds, effect.is_reversed) for name, (effect,) in by_claim.items()}


def neighbours(interpretation):
    """Return the interpretations that resolve one point differently."""
    others = [interpretation.replace({point: name}) for point, known in POINTS.items() for name in known]
    return [other for other in others if other != interpretation]


def test_the_reference_is_the_preset_figures():
    assert FIGURES.scenario() == preset("figures")
    assert preset("figures") != PAPER


def test_variants_are_the_neighbours_under_which_a_claim_changes_and_as_printed():
    rows = read_screen(ROOT / "results/reproduction")
    asked = {variant.interpretation: set(variant.claims) for variant in VARIANTS if variant.noise_sd is None}
    assert asked.pop(parse_interpretation("as-printed")) == set(NEEDED) == set(ASPECTS)
    here = verdicts(rows, FIGURES)
    for interpretation in neighbours(FIGURES):
        there = verdicts(rows, interpretation)
        changed = {name for name in ASPECTS if here[name] != there[name]}
        if interpretation.setting("hop-cost") == "100":  # paid in each step, whoever plays
            assert changed == {"D3 level"}
        else:
            assert changed == asked.pop(interpretation, set())
    assert not asked


def test_conditions_of_variants_have_unique_names_and_the_right_scenario():
    every = all_conditions()
    assert len({condition.name for condition in every}) == len(every)
    for variant in VARIANTS:
        for condition in variant.conditions:
            name = condition.name.removeprefix(f"{variant.name}: ")
            (known,) = [each for each in conditions_of("all", "paper", full=False) if each.name == name]
            expected = dataclasses.replace(variant.interpretation.scenario(), **known.changes)
            assert condition.scenario("paper") == expected
            assert (condition.options, condition.tested) == (known.options, True)


def test_variants_change_only_the_noise():
    usual = hyperparameters(TINY)
    for variant in VARIANTS:
        for condition in variant.conditions:
            config = hyperparameters(TINY, condition.algorithm)
            noise = {} if variant.noise_sd is None else {"noise_sd": LOW_NOISE}
            assert config == dataclasses.replace(usual, algorithm=usual.algorithm | noise)


def test_claims_with_missing_runs_are_not_tested():
    runs = results()
    every = {"D1 frozen", *ASPECTS}
    assert set(trained.claim_tests(runs, SEEDS)) == every
    few = {name: seeds if name != "comb" else {0: seeds[0]} for name, seeds in runs.runs.items()}
    assert set(trained.claim_tests(Results(few, {}), SEEDS)) == every - {"D3 level", "D3 order"}


@pytest.mark.slow
def test_trained_variants_get_a_page_and_are_not_repeated(monkeypatch, tmp_path, capsys):
    two = (Variant(parse_interpretation("as-printed"), ("D2",)), Variant(FIGURES, ("D2",), LOW_NOISE))
    monkeypatch.setattr(trained, "VARIANTS", two)
    monkeypatch.setattr(trained, "BUDGETS", {**BUDGETS, "tiny": TINY})
    monkeypatch.setattr(Interpretation, "rounds", 4)  # instead of up to forty
    base = Condition(BASE, "planned", tested=True, changes={"rounds_per_match": 4})
    for module in ("fpg_bench.paper.reproduce", "scripts.interpretations.trained"):
        monkeypatch.setattr(f"{module}.conditions_of", lambda *_, **__: [base])
    monkeypatch.setattr("fpg_bench.paper.reproduce.draw", lambda *_: {})  # of Fig. 4
    reproduce("fig4", tmp_path, scenario="figures", budget=TINY, seeds=2, first_seed=5, n_jobs=1)
    options = {"budget": "tiny", "n_seeds": 2, "first_seed": 5, "n_jobs": 1}
    written = trained.train_variants(tmp_path, **options)
    assert [path.name for path in written] == [f"trained-variants.{end}" for end in ("png", "svg", "md")]
    page = (tmp_path / "trained-variants.md").read_text()
    assert "Training seeds are 5 to 6" in page
    assert "python -m scripts.interpretations trained --budget tiny --n-seeds 2 --first-seed 5" in page
    rows = [line.split(" | ")[0] for line in page.splitlines() if " | D2 | overlap ratio" in line]
    assert rows == ["| `figures`", "| `as-printed`", "| `noise=0.04`"]
    assert {seed for _, seed in RunFile(tmp_path, "trained-variants", "tiny").read()} == {5, 6}
    capsys.readouterr()
    trained.train_variants(tmp_path, **options)
    assert capsys.readouterr().out == ""
    file = RunFile(tmp_path, "figures", "tiny")
    file.add(
        dataclasses.replace(run, about={"scenario": "figures, of another day"})
        for run in file.read().values()
    )
    with pytest.raises(UserError, match="played another game than figures is now"):
        trained.train_variants(tmp_path, **options)
