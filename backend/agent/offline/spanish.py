"""Translates the simplest sentences from Spanish to English, which the grammar understands.

It translates whole sentences with one action. It returns any other text unchanged, and the grammar understands none of
it. The page in Spanish suggests such sentences; the answers are English.
"""

from __future__ import annotations

import re

_TO = r"\s+(?:al|(?:a|hasta)(?:\s+(?:el|la|los|las))?)\s*:?\s+"
_YOU = r"(?:\s+(?:usted|t[uú]|el\s+robot))?"
_BACK = r"(?:vuelv[ae]|regres[ae])"
_PLEASE = "por favor"
_FORMS = [
    (
        r"(?:(?:ll[eé]v[ae]|acomp[aá]ñ[ae]|gu[ií][ae])(?:me|nos)|ve|vete|vaya|condu(?:ce|zca)|naveg(?:a|ue)|"
        rf"{_BACK}){_TO}(?P<what>.+)",
        r"go to \g<what>",
    ),
    (rf"{_BACK}", "go back to where you started"),
    (
        r"(?:di|diga|anunci[ae])(?:\s+en\s+voz\s+alta)?(?:\s*:|\s+que)?\s+[\"“«]?(?P<what>[^\"“”«»]+?)[\"”»]?",
        r"say “\g<what>”",
    ),
    (r"salud[ae]", "say “Hola”"),
    (r"(?:gir[ae]|d[aé])\s+media\s+vuelta", "turn around"),
    (r"gir[ae]\s+a\s+la\s+izquierda", "turn left"),
    (r"gir[ae]\s+a\s+la\s+derecha", "turn right"),
    (r"(?:tom[ae]|ha(?:z|ga)|saca|saque)\s+una\s+(?:foto|fotograf[ií]a|imagen)", "take a photo"),
    (rf"qu[eé]\s+(?:ves?|est[aá]s?\s+viendo){_YOU}", "what do you see"),
    (rf"d[oó]nde\s+est[aá]s?{_YOU}", "where are you"),
    (
        r"(?:cu[aá]nta\s+bater[ií]a|c[oó]mo\s+est[aá]\s+(?:de|la)\s+bater[ií]a)(?:\s+(?:te|le)\s+queda)?",
        "how is the battery",
    ),
    (r"(?:qu[eé]|cu[aá]les)\s+(?:lugares|sitios|salas)(?:\s+(?:hay|conoces?|sabes?))?", "which places are there"),
    (rf"(?:qu[eé]\s+(?:sabes?|puedes?)\s+hacer{_YOU}|ayuda)", "what can you do"),
]


def in_english(text: str) -> str:
    """The sentence in English, or `text` itself where no form fits."""
    bare = _without_politeness(text)
    for form, english in _FORMS:
        if found := re.fullmatch(form, bare, re.I):
            return found.expand(english)
    return text


def _without_politeness(text: str) -> str:
    bare = text.strip(" ,.¿?¡!")
    if bare[: len(_PLEASE) + 1].lower().rstrip(" ,") == _PLEASE:
        bare = bare[len(_PLEASE) :].lstrip(" ,¿¡")
    if bare[-len(_PLEASE) - 1 :].lower().lstrip(" ,") == _PLEASE:
        bare = bare[: -len(_PLEASE)].rstrip(" ,.?!")
    return bare
