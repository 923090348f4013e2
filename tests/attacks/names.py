"""Names that look like another one, or like nothing."""

from __future__ import annotations

import random
from collections.abc import Iterator

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
