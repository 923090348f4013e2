"""No name on the board can be taken for another one, and every name is visible."""

import pytest

from fpg_bench.common.ids import SCRIPTED
from fpg_bench.leaderboard.submission import (
    character_problem,
    load_submission,
    name_conflicts,
    name_skeleton,
    problems,
    read_about,
)
from fpg_bench.planning import PLANNERS
from tests.attacks import SCALE, SEED
from tests.attacks.names import BLANK, LETTERS, UNSEEN, lookalikes
from tests.leaderboard.making import FIELDS, write_submission


def problems_of_name(name):
    return read_about(FIELDS | {"name": name})[1]


@pytest.mark.parametrize("name", ["expert-spread", "My agent", "Population PPO", "carpoist"])
def test_a_lookalike_is_the_same_name_or_refused(name):
    assert problems_of_name(name) == []
    for other in lookalikes(name, 200 * SCALE, seed=SEED):
        assert name_skeleton(other) == name_skeleton(name) or len(problems_of_name(other)) == 1, ascii(other)


def test_no_script_is_imitated_by_any_lookalike_in_any_place():
    for name in {*SCRIPTED["ally"], *SCRIPTED["opponent"], *PLANNERS}:
        for place, letter in enumerate(name):
            for lookalike in LETTERS.get(letter, ""):
                other = name[:place] + lookalike + name[place + 1 :]
                assert character_problem(other) or name_skeleton(other) == name_skeleton(name), ascii(other)


@pytest.mark.parametrize("name", ["ОРТіМіЅЕԁ", "ΕΧΡΕᴦΤ", "НіІІ-СІіМВ"])
def test_a_script_that_is_written_in_another_alphabet_is_the_same_name(name):
    scripts = ("optimised", "expert", "hill-climb")
    assert problems_of_name(name) == []
    assert name_skeleton(name) in map(name_skeleton, scripts)


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("tоne", "mixes Cyrillic and Latin letters"),
        ("tοne", "mixes Greek and Latin letters"),
        ("tꓳne", "mixes Latin and Lisu letters"),
        ("Ꭲone", "mixes Cherokee and Latin letters"),
        ("tⲟne", "mixes Coptic and Latin letters"),
        ("t𐍈ne", "mixes Gothic and Latin letters"),
        ("tօne", "mixes Armenian and Latin letters"),
        ("小鹿 PPO", "mixes Cjk and Latin letters"),
        ("ꓔꓳꓠꓰ", "is written in Lisu letters"),
        ("ᎢᎾᏁᎬ", "is written in Cherokee letters"),
        ("ton℮", "holds '℮'; besides letters, use digits and signs of ASCII"),
        ("always−hop", "holds '−'; besides letters, use digits and signs of ASCII"),
        ("t۵ne", "holds '۵'; besides letters, use digits and signs of ASCII"),
        ("ＥＸＰＥＲＴ", "holds 'Ｅ'; write 'E'"),
        ("ſweep", "holds 'ſ'; write 's'"),
        ("tಂne", "mixes Kannada and Latin letters"),
        ("pʋrsuit", "holds 'ʋ'; use plain Latin letters"),
        ("ɡame", "holds 'ɡ'; use plain Latin letters"),
        ("ᴛone", "holds 'ᴛ'; use plain Latin letters"),
    ],
)
def test_a_name_is_written_in_one_alphabet(name, problem):
    (line,) = problems_of_name(name)
    assert line.startswith("name: ")
    assert problem in line


@pytest.mark.parametrize(
    "name",
    [
        "Łukasz",
        "Mønster 2",
        "Straße",
        "Zoë Núñez",
        "Erdős",
        "Işık",
        "Guðrún",
        "Nguyễn Ái",
        "Ștefan",
        "e\u0301te",
        "дельта",
        "Мария",
        "λόγος",
        "Μαρία",
        "エージェント1号",
        "小鹿",
        "한국",
        "سارة",
        "שרה",
        "नेहा",
        "PPO (ally), 8+",
    ],
)
def test_names_in_other_alphabets_and_with_accents_are_allowed(name):
    assert problems_of_name(name) == []


def test_names_that_differ_stay_different():
    names = [*SCRIPTED["ally"], *SCRIPTED["opponent"], *PLANNERS, "ppo", "sac", "td3", "PPO 2", "ppo-stack8"]
    names += [
        "дельта",
        "小鹿",
        "代理",
        "Agent A",
        "Agent B",
        "ppo-fast",
        "PPO+",
        "mappo",
        "qmix",
        "+++",
        "---",
    ]
    assert len({name_skeleton(name) for name in names}) == len(set(names))


@pytest.mark.parametrize("blank", BLANK, ids=ascii)
@pytest.mark.parametrize("key", ["name", "authors"])
def test_a_name_that_cannot_be_seen_is_refused(blank, key):
    about, lines = read_about(FIELDS | {key: [blank] if key == "authors" else blank})
    assert len(lines) == 1
    assert not getattr(about, key)


@pytest.mark.parametrize("letter", UNSEEN, ids=ascii)
def test_no_invisible_letter_stands_in_a_text(letter):
    for key in ("name", "licence", "algorithm", "saw"):
        _, (line,) = read_about(FIELDS | {key: f"a{letter}b"})
        assert line.startswith(f"{key}: holds")


@pytest.mark.parametrize("name", ["expert.", "e x p e r t", "Éxpert", "ехреrt", "ЕХРЕRТ"])
def test_nobody_is_taken_for_a_script(name, tmp_path):
    folder = write_submission(tmp_path / "submissions" / "ally" / "mine", name=name)
    (line,) = problems(folder)
    assert "is what a script of the package is called" in line or "mixes Cyrillic and Latin" in line


@pytest.mark.parametrize("name", ["Popu1ation  PPO", "POPULATION ppo", "Populatíon-PP0"])
def test_the_name_of_another_entry_is_taken_however_it_is_written(tmp_path, name):
    write_submission(tmp_path / "submissions" / "ally" / "first", name="Population PPO")
    folder = write_submission(tmp_path / "submissions" / "ally" / "second", name=name)
    assert any("is that of 'first', too" in line for line in problems(folder))


def test_no_number_of_entries_hides_whose_name_is_taken(tmp_path):
    """Of an entry's folder only the first few hundred names are read; of a board, all."""
    board = tmp_path / "submissions" / "ally"
    mine = write_submission(board / "mine", seeds=(), training=None, script="expert")
    text = (mine / "submission.yaml").read_bytes()
    for number in range(250):
        (board / f"twin-{number}").mkdir()
        (board / f"twin-{number}" / "submission.yaml").write_bytes(text)
    assert len(list(name_conflicts(load_submission(mine)))) == 250
