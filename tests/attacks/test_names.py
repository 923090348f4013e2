"""No name on the board can be taken for another one, and every name can be seen."""

import pytest

from fpg_bench.leaderboard.check import load_submission, problems, taken
from fpg_bench.leaderboard.submission_file import plain, read_fields
from fpg_bench.planning import PLANNERS
from fpg_bench.players.scripted import SCRIPTED
from tests.attacks.names import BLANK, UNSEEN, lookalikes
from tests.leaderboard.making import FIELDS, write_submission


@pytest.mark.parametrize("name", ["expert-spread", "My agent", "Population PPO", "carpoist"])
def test_a_name_that_looks_alike_is_the_same_name(name):
    for other in lookalikes(name, 200):
        _, wrong = read_fields(FIELDS | {"name": other})
        assert plain(other) == plain(name), ascii(other)
        assert wrong == [] or "cannot be seen" in wrong[0] or "control character" in wrong[0]


def test_names_that_differ_stay_different():
    names = [*SCRIPTED["ally"], *SCRIPTED["opponent"], *PLANNERS, "ppo", "sac", "td3", "PPO 2", "ppo-stack8"]
    names += [
        "маневр",
        "агент",
        "小鹿",
        "代理",
        "Ωmega",
        "Agent A",
        "Agent B",
        "ppo-fast",
        "PPO+",
        "mappo",
        "qmix",
    ]
    assert len({plain(name) for name in names}) == len(set(names))


def test_names_of_signs_are_told_apart():
    assert plain("+++") != plain("---")
    assert plain("PPO+") != plain("PPO")


@pytest.mark.parametrize("blank", BLANK, ids=ascii)
def test_a_name_that_cannot_be_seen_is_refused(blank):
    for fields in ({"name": blank}, {"authors": [blank]}):
        found, wrong = read_fields(FIELDS | fields)
        assert len(wrong) == 1
        assert not found.keys() >= FIELDS.keys()


@pytest.mark.parametrize("letter", UNSEEN, ids=ascii)
@pytest.mark.parametrize("key", ["name", "licence", "algorithm", "saw"])
def test_nothing_unseen_stands_in_a_text(key, letter):
    _, (line,) = read_fields(FIELDS | {key: f"a{letter}b"})
    assert line.startswith(f"{key}: holds")


@pytest.mark.parametrize("name", ["ехреrt", "Exреrт", "expert.", "e x p e r t", "ЕХРЕRТ"])
def test_nobody_is_taken_for_a_script(name, tmp_path):
    folder = write_submission(tmp_path / "submissions" / "ally" / "mine", name=name)
    assert any("is what a script of the package is called" in line for line in problems(folder))


def test_no_number_of_entries_hides_whose_name_is_taken(tmp_path):
    """A folder's first few hundred names are read of an entry; of a board, all."""
    board = tmp_path / "submissions" / "ally"
    mine = write_submission(board / "mine", seeds=(), training=None, script="expert")
    text = (mine / "submission.yaml").read_bytes()
    for number in range(250):
        (board / f"twin-{number}").mkdir()
        (board / f"twin-{number}" / "submission.yaml").write_bytes(text)
    assert len(list(taken(load_submission(mine)))) == 250


def test_the_name_of_another_entry_is_taken_however_it_is_written(tmp_path):
    write_submission(tmp_path / "submissions" / "ally" / "first", name="Population PPO")
    folder = write_submission(tmp_path / "submissions" / "ally" / "second", name="Роpulаtiоn  ΡРО")
    assert any("is that of 'first', too" in line for line in problems(folder))
