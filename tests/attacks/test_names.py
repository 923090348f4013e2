"""No name on the board can be taken for another one, and every name is visible."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

from fpg_bench.common.files import read_yaml
from fpg_bench.common.ids import SCRIPTED
from fpg_bench.players.planner import PLANNERS
from fpg_bench.products.leaderboard import submission
from fpg_bench.products.leaderboard.about import name_skeleton, read_about
from fpg_bench.products.leaderboard.submission import Reader, Refusal, admit
from tests.attacks import SCALE, SEED
from tests.products.leaderboard.making import FIELDS, problems, write_submission

# What looks like each character in either case: Unicode's confusables.txt (in NFKC) and a few more
LETTERS = {
    "a": "ɑΑαАаᎪᗅ⍺ꓮ𐊠𖽀", "b": "ƄΒВЬᏏᏴᑲᖯᗷꓐꞴ𐊂𐊡𐌁", "c": "СсᏟᴄⲤⲥꓚꮯ𐊢𐌂𐐕𐐽𐔜𑣩𑣲🝌", "d": "ԁᎠᏧᑯᗞᗪꓒꓓ",
    "e": "ΕЕеҽᎬ℮⋿ⴹꓰꬲ𐊆𑢦𑢮ё", "f": "ϜքᖴẝꓝꞘꞙꬵ𐊇𐊥𐔥𑢢𑣂𝈓", "g": "ƍɡԌցᏀᏳᶃꓖ", "h": "ΗНһհᎻᏂᕼⲎꓧ𐋏",
    "i": "ıɩɪιіӏᎥ⍳ꙇꭵ𑣃l1|", "j": "ͿϳЈјᎫᒍꓙꞲ", "k": "ΚКᏦᛕⲔꓗ𐔘", "l": "ƖǀΙІӀ׀וןا١۱ߊᏞᒪᛁ∣⏽ⲒⳐⵏꓡꓲ𐊊𐌉𐌠𐐛𐔦𑢣𑢲𖼖𖼨𝈪𞣇",
    "m": "ΜϺМᎷᗰᛖⲘꓟ𐊰𐌑мᴍ", "n": "ΝոռⲚꓠ𐔓",
    "o": "ΟοσОоՕօסه٥ھہە۵߀०০੦૦ଠ୦௦ం౦ಂ೦ംഠ൦ං๐໐ဝ၀ჿዐᴏᴑⲞⲟⵔ〇ꓳꬽ𐊒𐊫𐐄𐐬𐓂𐓪𐔖𑓐𑢵𑣈𑣗𑣠0ö", "p": "ΡρРрᏢᑭ⍴Ⲣⲣꓑ𐊕", "q": "ԛգզⵕ",
    "r": "ƦгᎡᏒᖇᴦⲅꓣꭇꭈꮁ𐒴𖼵𝈖", "s": "ƽЅѕՏᏕᏚꓢꜱꮪ𐊖𐐠𐑈𑣁𖼺", "t": "ΤТᎢ⊤⟙Ⲧꓔ𐊗𐊱𐌕𑢼𖼊🝨тτꭲ", "u": "ʋυՍսሀᑌᴜ∪⋃ꓴꞟꭎꭒ𐓎𐓶𑢸𑣘𖽂",
    "v": "νѴѵט٧۷Ꮩᐯᴠ∨⋁ⴸꓦꛟꮩ𐔝𑜆𑢠𑣀𖼈𝈍", "w": "ɯѡԜԝաᎳᏔᴡꓪꮃ𑜊𑜎𑜏𑣦𑣯", "x": "×ΧХхᕁᕽ᙭᙮ᚷ╳⤫⤬⨯ⲬⵝꓫꞳ𐊐𐊴𐌗𐌢𐔧𑣬",
    "y": "ɣʏΥγУуҮүყᎩᎽᶌỿⲨꓬꭚ𐊲𑢤𑣜𖽃", "z": "ΖᏃᴢꓜꮓ𐋵𑢩𑣄𑣥", "2": "ƧϨᒿꙄꛯꝚ", "3": "ƷȜЗӠⳌꝪꞫ𑣊𖼻𝈆", "4": "Ꮞ𑢯",
    "5": "Ƽ𑢻", "6": "бᏮⳒ𑣕", "7": "𐓒𑣆𝈒", "8": "Ȣȣ৪੪ଃ𐌚𞣋", "9": "৭੧୨൭ⳊꝮ𑢬𑣌𑣖", "-": "˗۔‐‒–⁃−➖Ⲻ",
}  # fmt: skip
UNSEEN = ("\u200b", "\u2060", "\u00ad", "\u3164", "\uffa0", "\u115f", "\u2800", "\ufe0f", "\u034f", "\u200d")
BLANK = (" ", "\u00a0", "\u2003", "\u3000", *UNSEEN, "\u0301", "---", "...", "\u2800\u2800", "\U000e0041")


def lookalikes(name: str, count: int, seed: int = 0) -> Iterator[str]:
    """So many names that the eye takes for this one."""
    rng = random.Random(seed)
    for _ in range(count):
        letters = list(name)
        for place in rng.sample(range(len(letters)), rng.randrange(1, len(letters))):
            letters[place] = _changed(letters[place], rng)
        yield "".join(letters)


def _changed(letter: str, rng: random.Random) -> str:
    wide = chr(ord(letter) + 0xFEE0) if "!" <= letter <= "~" else letter
    ways = [letter.upper(), letter + "\u0301", wide, f"{letter} ", f"{letter}.", letter + rng.choice(UNSEEN)]
    return rng.choice([*ways, *LETTERS.get(letter.lower(), "")])


def problems_of_name(name):
    return read_about(FIELDS | {"name": name})[1]


@pytest.mark.parametrize("name", ["expert-spread", "Population PPO"])
def test_a_lookalike_is_the_same_name_or_refused(name):
    assert problems_of_name(name) == []
    for other in lookalikes(name, 60 * SCALE, seed=SEED):
        assert name_skeleton(other) == name_skeleton(name) or len(problems_of_name(other)) == 1, ascii(other)


def test_no_script_is_imitated_by_any_lookalike_in_any_place():
    for name in {*SCRIPTED["ally"], *SCRIPTED["opponent"], *PLANNERS}:
        for place, letter in enumerate(name):
            for lookalike in filter(str.isascii, LETTERS.get(letter, "")):
                other = name[:place] + lookalike + name[place + 1 :]
                assert name_skeleton(other) == name_skeleton(name), other


@pytest.mark.parametrize(
    "name", ["tоne", "小鹿", "ton℮", "always−hop", "t۵ne", "ＥＸＰＥＲＴ", "ſweep", "Zoë", "e\u0301te"]
)
def test_a_name_is_written_in_ascii(name):
    (line,) = problems_of_name(name)
    odd = next(letter for letter in name if not letter.isascii())
    assert line == f"name: {name!r} holds {odd!r}; a name is written in ASCII"


def test_signs_stand_in_names_and_authors_have_any_letters():
    assert problems_of_name("PPO (ally), 8+") == []
    assert read_about(FIELDS | {"authors": ["Nguyễn Ái", "Łukasz", "小鹿", "سارة", "नेहा"]})[1] == []


def test_names_that_differ_stay_different():
    names = [*SCRIPTED["ally"], *SCRIPTED["opponent"], *PLANNERS, "ppo", "sac", "td3", "PPO 2", "ppo-stack8"]
    names += ["Agent A", "Agent B", "ppo-fast", "PPO+", "mappo", "qmix", "+++", "---"]
    assert len({name_skeleton(name) for name in names}) == len(set(names))


@pytest.mark.parametrize("key", ["name", "authors"])
def test_a_name_that_cannot_be_seen_is_refused(key):
    for blank in BLANK:
        about, lines = read_about(FIELDS | {key: [blank] if key == "authors" else blank})
        assert (len(lines), bool(getattr(about, key))) == (1, False), ascii(blank)


@pytest.mark.parametrize("key", ["name", "licence", "algorithm", "saw"])
def test_no_invisible_letter_stands_in_a_text(key):
    for letter in UNSEEN:
        _, (line,) = read_about(FIELDS | {key: f"a{letter}b"})
        assert line.startswith(f"{key}: holds"), ascii(letter)


@pytest.mark.parametrize("name", ["expert.", "e x p e r t", "EXPERT", "ехреrt"])
def test_nobody_is_taken_for_a_script(name, tmp_path):
    folder = write_submission(tmp_path / "submissions" / "ally" / "mine", name=name)
    (line,) = problems(folder)
    assert "is the name of a script of the package" in line or "a name is written in ASCII" in line


@pytest.mark.parametrize("name", ["Popu1ation  PPO", "POPULATION ppo", "Populat!on-PP0"])
def test_the_name_of_another_entry_is_taken_however_it_is_written(tmp_path, name):
    write_submission(tmp_path / "submissions" / "ally" / "first", name="Population PPO")
    folder = write_submission(tmp_path / "submissions" / "ally" / "second", name=name)
    assert any("is the name of 'first', too" in line for line in problems(folder))


def test_no_number_of_entries_hides_whose_name_is_taken(tmp_path):
    """Of an entry's folder only the first few hundred names are read; of a board, all."""
    board = tmp_path / "submissions" / "ally"
    mine = write_submission(board / "mine", seeds=(), training=None, script="expert")
    text = (mine / "submission.yaml").read_bytes()
    for number in range(250):
        (board / f"twin-{number}").mkdir()
        (board / f"twin-{number}" / "submission.yaml").write_bytes(text)
    assert len(problems(mine)) == 250


def test_the_names_of_a_board_are_read_once_for_all_entries(tmp_path, monkeypatch):
    board, read = tmp_path / "submissions" / "ally", []
    monkeypatch.setattr(submission, "read_yaml", lambda *how: read.append(how) or read_yaml(*how))
    folders = [
        write_submission(board / f"mine-{k}", seeds=(), training=None, script="expert", name=f"Mine {k}")
        for k in range(20)
    ]
    reader = Reader()
    assert [admit(folder, reader).slug for folder in folders] == [folder.name for folder in folders]
    assert len(read) == len(folders)


def test_of_many_entries_with_one_name_the_first_has_it_and_each_is_asked_once_for_its_place(tmp_path):
    board, asked = tmp_path / "submissions" / "ally", []
    for k in range(20):
        name = "Population PPO" if k % 2 else "popu1ation-pp0"
        write_submission(board / f"mine-{k:02}", seeds=(), training=None, script="expert", name=name)
    reader = Reader(lambda folder: asked.append(folder) or (folder.name != "mine-07", folder.name))
    refused = {}
    for folder in sorted(board.iterdir()):
        try:
            assert admit(folder, reader).slug == "mine-07"
        except Refusal as refusal:
            refused[folder.name] = refusal.lines[0]
    assert list(refused) == [f"mine-{k:02}" for k in range(20) if k != 7]
    assert refused["mine-00"].endswith("is the name of 'mine-07', too; choose another")
    assert len(asked) == 40  # once among the slugs, once among the names
