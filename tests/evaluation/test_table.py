"""Tables: what fits a terminal, and the files that hold everything."""

import csv
import dataclasses
import itertools
import re

import numpy as np
import pytest

from fpg_bench.cli.evaluation import print_table
from fpg_bench.evaluation.statistics import difference, pair_error
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import TrainingCost, summarise
from fpg_bench.evaluation.table import (
    as_csv,
    caption,
    flat_lines,
    latex,
    lines_of_table,
    markdown,
    standings,
    write_table,
)
from tests.evaluation.test_summary import records_of

NAMES = ("ppo", "recurrent-ppo", "expert-spread")


@pytest.fixture(scope="module")
def suite():
    return dataclasses.replace(load_suite("ally-v2"), matches=3)


@pytest.fixture(scope="module")
def summaries(suite):
    seeds = {"ppo": (0, 1), "recurrent-ppo": (0, 1, 2), "expert-spread": (None,)}
    lines = [
        line
        for k, name in enumerate(NAMES)
        for seed in seeds[name]
        for line in records_of(suite, name, [[9.0 - k, 3.0 - k, (seed or 0) - 4.5]] * len(suite.rivals), seed)
    ]
    return summarise(lines, suite)


@pytest.mark.parametrize("width", [80, 120, 160])
def test_tables_fit_the_terminal(summaries, suite, width, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(width))
    head, *lines = lines_of_table(summaries, suite, width)
    assert {"player", "score", "95 % interval", "worst"} <= set(head)
    assert {"overlap ratio %", "jamming success rate %"} <= set(head)
    print_table(head, lines, caption([], suite))
    drawn = capsys.readouterr().out.splitlines()
    assert max(map(len, drawn)) <= width
    assert sum(line.startswith(" expert-spread") for line in drawn) == 1  # no cell is broken over two lines


def test_a_latex_table_prints_each_character_of_a_name(summaries, suite):
    names = {
        "a_b": r"a\_b",
        "50 %": r"50 \%",
        "#1 & {x}^~\\": r"\#1 \& \{x\}\textasciicircum{}\textasciitilde{}",
    }
    renamed = [dataclasses.replace(s, entry=name) for s, name in zip(summaries, names, strict=True)]
    text = latex(renamed, suite)
    for name in ("[0]", "*x"):  # after a line's end they would belong to it
        assert f"\n{{}}{name} & " in latex([dataclasses.replace(summaries[0], entry=name)], suite)
    rows = [line.removesuffix(r" \\") for line in text.splitlines() if line.endswith(r" \\")]
    cells = [re.split(r" (?<!\\)& ", row) for row in rows]
    assert [row[0] for row in cells[1:3]] == list(names.values())[:2]
    assert cells[3][0].startswith(names["#1 & {x}^~\\"])
    assert cells[3][0].endswith(r"\textbackslash{}")
    assert {len(row) for row in cells} == {len(re.search(r"tabular}{(.*?)}", text)[1])}
    assert r"95 \% interval" in cells[0]
    assert re.search(r"& \[\d|& \[\$-\$\d", text)


def test_wider_terminals_see_more_and_nobody_loses_a_column(summaries, suite):
    heads = [lines_of_table(summaries, suite, width)[0] for width in (40, 80, 120, 160, None)]
    for narrow, wide in itertools.pairwise(heads):
        assert set(narrow) < set(wide)
        assert [name for name in wide if name in narrow] == narrow
    assert heads[0][0] == "player"


def test_the_files_hold_everything(summaries, suite, tmp_path):
    write_table(summaries, suite, tmp_path)
    text = (tmp_path / "table.md").read_text()
    assert text.startswith(
        "| player | seeds | steps | minutes | score | 95 % interval | rank | from the first | "
        "overlap ratio % | jamming success rate % | return | worst "
    )
    by_name = {line.split(" | ")[0].strip("| "): line for line in text.splitlines()}
    columns = by_name["player"].split(" | ")
    ranks = {name: by_name[name].split(" | ")[columns.index("rank")] for name in NAMES}
    assert ranks == {"ppo": "-", "recurrent-ppo": "-", "expert-spread": "1"}  # of fewer than five seeds: none
    assert "score: 0 = -6.9 per step (random), 100 = 22" in text
    rows = list(csv.DictReader((tmp_path / "table.csv").open()))
    assert [row["entry"] for row in rows] == [summary.entry for summary in summaries]
    for row, summary in zip(rows, summaries, strict=True):
        assert float(row["score"]) == summary.score.value
        assert float(row["score_low"]) == summary.score.low
        assert float(row["return_per_step adaptive/circle"]) == summary.by_rival["adaptive/circle"].value


def test_ranks_and_differences_stand_beside_the_score(suite):
    rng = np.random.default_rng(0)
    returns = {"near": (9.0, 0.2), "far": (2.0, 0.2), "best": (9.01, 0.2)}
    found = summarise(
        [
            line
            for name, (mean, spread) in returns.items()
            for seed in range(5)
            for line in records_of(suite, name, mean + rng.normal(0, spread, 3), seed)
        ],
        suite,
    )
    head, first, second, third = lines_of_table(found, suite)
    assert (first[0], third[0]) == (found[0].entry, "far")
    assert [line[head.index("rank")] for line in (first, second, third)] == ["1-2", "1-2", "3"]
    away = [line[head.index("from the first")] for line in (first, second, third)]
    assert away[0] == "-"
    expected = difference(found[2].samples, found[0].samples, pair_error(3))
    assert away[2] == f"{expected.value:.1f} [{expected.low:.1f}, {expected.high:.1f}]"
    assert expected.low < found[2].score.value - found[0].score.value < expected.high < 0
    rows = flat_lines(found)
    assert [(row["rank_low"], row["rank_high"]) for row in rows] == [(1, 2), (1, 2), (3, 3)]
    assert [row["may_be_best"] for row in rows] == [True, True, False]
    assert rows[2]["from_first"] == expected.value
    alone = summarise(records_of(suite, "once", 1.0, 0), suite)
    assert standings(alone)["once"].behind.value == 0


def test_an_oracle_stands_last_and_without_a_rank_however_much_it_earns(suite):
    found = summarise(
        [
            *records_of(suite, "oracle", 99.0, None),
            *records_of(suite, "once", 1.0),
            *records_of(suite, "twice", 2.0),
        ],
        suite,
    )
    head, *lines = lines_of_table(found, suite)
    assert [line[0] for line in lines] == ["twice", "once", "oracle (full state)"]
    assert [line[head.index("rank")] for line in lines[:2]] != ["-", "-"]
    assert lines[2][head.index("rank")] == "-"
    rows = flat_lines(found)
    assert (rows[2]["entry"], rows[2]["may_be_best"], rows[2]["rank_low"]) == ("oracle", None, None)
    assert rows[2]["from_first"] > 0 == rows[0]["from_first"]
    assert rows[0]["may_be_best"]


def test_training_stands_beside_the_score(summaries, suite):
    for steps, text in ((3_000_000, "3M"), (405_000, "405k"), (400, "400"), (None, "-")):
        training = TrainingCost() if steps is None else TrainingCost(steps, 90.0)
        head, line = lines_of_table([dataclasses.replace(summaries[0], training=training)], suite)
        assert line[head.index("steps")] == text
        assert line[head.index("minutes")] == ("-" if steps is None else "1.5")


def test_the_caption_names_players_of_code_and_apart_from_them_rivals_of_code(summaries, suite):
    one, *others = summaries
    dated = [dataclasses.replace(one, played="2026-01-02 03:04 UTC"), *others]
    assert f"Code, as it was when it was played: {one.entry} (2026-01-02 03:04 UTC)." in caption(dated, suite)
    rivals = (*suite.rivals[:2], dataclasses.replace(suite.rivals[2], players=("mine:Jammer",)))
    coded = dataclasses.replace(suite, rivals=rivals)
    coded.__dict__["hash"] = "0" * 64  # no such package is installed
    assert f"Rows against code (mine:Jammer), as it was when it was played: {one.entry} (" in caption(
        dated, coded
    )
    assert "code" not in caption(summaries, suite).lower()


def test_a_table_of_nobody_and_names_with_bars(summaries, suite):
    assert as_csv([]).strip() == ""
    assert len(lines_of_table([], suite, 80)) == 1
    barred = dataclasses.replace(summaries[0], entry="a|b")
    assert markdown([barred], suite).splitlines()[2].startswith(r"| a\|b | ")
