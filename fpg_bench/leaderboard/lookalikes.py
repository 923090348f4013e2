"""Names as the eye takes them: letters that look alike are one letter, and what cannot be seen is none.

The idea is that of the skeletons of Unicode's UTS #39. Its table of thousands is cut down to the scripts that
have letters like Latin ones; NFKC and case folding do the rest.
"""

from __future__ import annotations

import unicodedata

# Each Latin letter with what looks like it, folded; 0 is o, and 1 is i as l is.
_ALIKE = {
    "a": "аαɑᴀⲁꭺ",
    "b": "ьвʙᏏᏴꮟ",
    "c": "сϲᴄⲥꮯ",
    "d": "ԁᏧꭰ",
    "e": "еєεҽᴇꭼ",
    "f": "ғϝꞙẝ",
    "g": "ɡցᶃꮐ",
    "h": "һհнʜᎻꮋ",
    "i": "іıɩιⲓꭵjјl1ӏ|ɪǀ!",
    "k": "кκᴋⲕꮶ",
    "m": "мᴍⲙꮇ",
    "n": "пηոռᴎⲛɴ",
    "o": "оοσօᴏⲟסߋ০๐໐0ჿ",
    "p": "рρϱᴘⲣꮲ",
    "q": "ԛզգ",
    "r": "гᴦⲅꭇꮁ",
    "s": "ѕꜱꮪʂ",
    "t": "тτᴛⲧꭲ",
    "u": "υսᴜꭎʋ",
    "v": "ѵνᴠꮩ",
    "w": "ѡωԝɯᴡꮃ",
    "x": "хχⲭ×",
    "y": "уүγʏⲩყ",
    "z": "ᴢꮓ",
}
_SKELETON = str.maketrans({other: letter for letter, others in _ALIKE.items() for other in others})
# Letters and marks that show nothing, in blocks (first, last); all others are controls or spaces by category.
_UNSEEN = (
    *((0x34F, 0x34F), (0x115F, 0x1160), (0x17B4, 0x17B5), (0x180B, 0x180F), (0x2800, 0x2800)),
    *((0x3164, 0x3164), (0xFE00, 0xFE0F), (0xFFA0, 0xFFA0), (0x1D159, 0x1D159), (0xE0000, 0xE0FFF)),
)


def skeleton(name: str) -> str:
    """What is left of a name for the eye: no case, space, accent, punctuation or script; ``rn`` is ``m``."""
    whole = unicodedata.normalize("NFKC", name.translate(_SKELETON)).casefold()
    letters = (c for c in unicodedata.normalize("NFD", whole) if _is_seen(c))
    return "".join(letters).translate(_SKELETON).replace("rn", "m").replace("vv", "w")


def _is_seen(letter: str) -> bool:
    return (unicodedata.category(letter)[0] in "LNS" or letter == "!") and not unseen(letter)


def unseen(letter: str) -> bool:
    """Whether a character leaves nothing on the page though it is no space and no control."""
    return any(first <= ord(letter) <= last for first, last in _UNSEEN)
