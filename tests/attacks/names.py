"""Names that look like another one, or like nothing."""

from __future__ import annotations

import random
from collections.abc import Iterator

LETTERS = {"a": "аα", "c": "сϲ", "e": "её", "i": "іl1|", "o": "оο0ö", "p": "рρ", "r": "г", "s": "ѕ"}
LETTERS |= {"t": "τтꓔꭲ", "x": "хχⲭ", "y": "уγ", "n": "ոꓠ", "g": "ɡց", "m": "мᴍ", "u": "υս"}
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
