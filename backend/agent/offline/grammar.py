"""Parses commands in English, and the simplest in Spanish, into a list of actions. Plain functions over text.

Nothing about this robot may stand here: neither its places nor its tools.

"Go to lab 2.3.7 and tell them that the meeting is at noon, then come back" is three actions. What is quoted, or
follows "that", is speech up to the next ", then …" or the end.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from backend.agent.offline.spanish import in_english


@dataclass(frozen=True)
class GoTo:
    """Drive to a place, in the person's words."""

    place: str


@dataclass(frozen=True)
class GoToPoint:
    """Drive to a point of the map, in m; `yaw` in rad."""

    x: float
    y: float
    yaw: float | None = None


@dataclass(frozen=True)
class GoBack:
    """Drive to where the session started."""


@dataclass(frozen=True)
class Say:
    """Say a sentence aloud."""

    text: str


@dataclass(frozen=True)
class Turn:
    """Turn on the spot, in degrees, left (counter-clockwise) positive."""

    degrees: float


@dataclass(frozen=True)
class TakePhoto:
    """Take a picture and show it."""


@dataclass(frozen=True)
class TellBattery:
    """Tell how much charge is left."""


@dataclass(frozen=True)
class TellPose:
    """Tell where the robot is."""


@dataclass(frozen=True)
class TellPlaces:
    """Tell which places there are."""


@dataclass(frozen=True)
class TellAbilities:
    """Tell what can be asked for."""


Action = GoTo | GoToPoint | GoBack | Say | Turn | TakePhoto | TellBattery | TellPose | TellPlaces | TellAbilities

_GO = r"(?:go|drive|navigate|move|head|walk|come|run|get)"
_TAKE = r"(?:take|bring|guide|lead|show|accompany)\s+(?:me|us)"
_SAY = r"(?:say|tell|announce|speak|inform|let\s+\S+(?:\s+\S+)?\s+know|deliver)"
_VERB = (
    rf"(?:please\s+)?(?:{_GO}\b|{_TAKE}\b|{_SAY}\b|visit\b|return\b|turn\b|rotate\b|spin\b|look\b|photograph\b"
    rf"|(?:take|make|shoot|show\s+me)\s+an?\s+(?:photo|picture)|(?:tell|show)\s+me\b|what\b|where\b|how\b|check\b)"
)
_STRONG = re.compile(
    rf"\s*(?:[,;.]\s*(?:and\s+)?then|;|\s+and\s+then|\s+then|,?\s+after\s+that,?|[.!?]\s)\s*,?\s*(?={_VERB})",
    re.I,
)
_WEAK = re.compile(rf"\s*(?:,\s*(?:and\s+)?|\s+and\s+)(?={_VERB})", re.I)
_WEAK_BACK = re.compile(r"\s*(?:,\s*(?:and\s+)?|\s+and\s+)(?=(?:come|go|drive|head)\s+back\b|return\b)", re.I)
_PLEASE = (
    r"(?:(?:hey|hi|hello|ok|okay|now|please|then|and|so)\b[\s,]*|(?:can|could|would|will)\s+you\s+(?:please\s+)?"
    r"|i\s+(?:want|need)\s+you\s+to\s+)"
)
_POLITE = re.compile(rf"^{_PLEASE}", re.I)
_CALLED = re.compile(rf"^\w+\s*,\s*(?={_VERB}|{_PLEASE})", re.I)
_QUOTE = re.compile(r"[\"“”«]([^\"“”«»]*)[\"“”»]|(?<!\w)'([^']*)'(?!\w)")
_NUMBER = r"[-+]?\d+(?:\.\d+)?"
_POINT = re.compile(
    rf"^(?:the\s+)?(?:point|position|coordinates?|pose)?\s*\(?\s*(?:x\s*[=:]?\s*)?({_NUMBER})\s*(?:m\b)?\s*"
    rf"(?:,|\s|and)\s*(?:y\s*[=:]?\s*)?({_NUMBER})\s*(?:m\b)?\s*\)?$",
    re.I,
)
_START = (
    r"(?:where|the\s+(?:place|point|spot|position)\s+where)\s+(?:you|we|it|this\s+session)"
    r"\s+(?:started|began|were|came\s+from)"
)
_BACK = re.compile(
    rf"^(?:(?:{_GO})\s+back|return|come\s+home|go\s+home)\s*(?:(?:to|from)\s+(?:{_START}(?:\s+from)?"
    r"|(?:the|your)\s+(?:start|starting\s+(?:point|position|place)|origin|beginning)))?$",
    re.I,
)
_THEM = r"(?:them|everyone|everybody|people|the\s+people|him|her|us|it|all|the\s+team|visitors|the\s+visitors)"


LONGEST = 2_000
"""Characters of a text that is looked at: no pattern here takes longer than a few ms for so many."""

_COMMANDS = {
    "/home": "go back to where you started",
    "/where": "where are you?",
    "/battery": "how is the battery?",
    "/photo": "take a photo",
    "/places": "which places are there?",
}


def parse(text: str) -> list[Action]:
    """The actions that `text` asks for, in order; an empty list when any part of it is not understood."""
    text = " ".join(text.split())
    if len(text) > LONGEST:
        return []
    quotes: list[str] = []
    text = in_english(_COMMANDS.get(text.lower(), text))

    def keep(match: re.Match[str]) -> str:
        quotes.append(match.group(1) if match.group(1) is not None else match.group(2))
        return f"\x00{len(quotes) - 1}\x00"

    masked = _QUOTE.sub(keep, text)
    actions: list[Action] = []
    for clause in _clauses(masked):
        found = _clause(clause, quotes)
        if not found:
            return []
        actions += found
    return actions


def _clauses(text: str) -> list[str]:
    parts: list[str] = []
    for part in _STRONG.split(_bare(text)):
        speech = re.match(rf"(?:please\s+)?{_SAY}\b", _bare(part), re.I)
        is_question = re.match(r"tell\s+me\b", _bare(part), re.I)
        parts += (_WEAK_BACK if speech and not is_question else _WEAK).split(part, maxsplit=1)
        while not speech and len(_WEAK.split(parts[-1], maxsplit=1)) > 1:
            if re.match(rf"(?:please\s+)?{_SAY}\b", parts[-1], re.I):
                break
            parts += _WEAK.split(parts.pop(), maxsplit=1)
        if not speech and re.match(rf"(?:please\s+)?{_SAY}\b", parts[-1], re.I):
            parts += _WEAK_BACK.split(parts.pop(), maxsplit=1)
    return [bare for part in parts if (bare := _bare(part))]


def _bare(text: str) -> str:
    """The text without greetings, politeness, a name at its start and a full stop at its end."""
    text = text.strip().strip(",;")
    while True:
        shorter = _CALLED.sub("", _POLITE.sub("", text)).strip()
        if shorter == text:
            return text.rstrip(" .!?") if "\x00" not in text[-2:] else text
        text = shorter


def _clause(clause: str, quotes: list[str]) -> list[Action]:
    speech = re.match(rf"{_SAY}\b", clause, re.I) and not re.match(r"tell\s+me\b", clause, re.I)
    # What is to be said can hold any words, so nothing else is looked for in it.
    for rule in (_speaking,) if speech else (_looking, _moving):
        if found := rule(clause, quotes):
            return found
    return []


_CHARGE, _STATE = re.compile(r"\bcharged?\b", re.I), re.compile(r"\b(?:left|are|is)\b", re.I)
_LIST, _PLACES = re.compile(r"(?:list|show)\b", re.I), re.compile(r"\bplaces", re.I)


def _then(text: str, first: re.Pattern[str], second: re.Pattern[str]) -> bool:
    """Whether `second` comes somewhere after `first`. One pattern for both would look at the rest of the text from
    each `first` again."""
    found = first.search(text)
    return found is not None and second.search(text, found.end()) is not None


def _looking(clause: str, _quotes: list[str]) -> list[Action]:
    if re.search(r"\b(?:photo|picture|photograph)\b|what\s+(?:do|can)\s+you\s+see|^look\s+around", clause, re.I):
        return [TakePhoto()]
    if re.search(r"\bbattery\b|how\s+much\s+(?:charge|power)", clause, re.I) or _then(clause, _CHARGE, _STATE):
        return [TellBattery()]
    if re.search(
        r"where\s+(?:are\s+(?:you|we)|(?:you|we)\s+are|am\s+i|is\s+the\s+robot)|your\s+(?:position|pose|location)",
        clause,
        re.I,
    ):
        return [TellPose()]
    if re.search(r"where\s+can\s+you|(?:which|what)\s+(?:\w+\s+)?(?:places|rooms|labs)", clause, re.I) or _then(
        clause, _LIST, _PLACES
    ):
        return [TellPlaces()]
    if re.fullmatch(
        r"what\s+(?:can\s+you|are\s+you\s+able\s+to)\s+do(?:\s+for\s+(?:me|us))?|(?:how\s+can\s+you\s+)?help(?:\s+(?:me|us))?",
        clause,
        re.I,
    ):
        return [TellAbilities()]
    return []


def _moving(clause: str, _quotes: list[str]) -> list[Action]:
    if _BACK.match(clause):
        return [GoBack()]
    if turn := re.match(r"(?:turn|rotate|spin)\b\s*(?P<rest>.*)$", clause, re.I):
        return _turn(turn["rest"].lower())
    going = re.match(
        rf"(?:(?:{_GO})\s+(?:back\s+)?(?:to|into|over\s+to)|return\s+to|visit|{_TAKE}\s+(?:to|the\s+way\s+to))\s+(?P<place>.+)$",
        clause,
        re.I,
    )
    if not going:
        return []
    if point := _POINT.match(going["place"]):
        x, y = float(point[1]), float(point[2])
        return [GoToPoint(x, y)] if math.isfinite(x + y) else []
    return [GoTo(_place(going["place"]))]


_TURN_WORD = re.compile(
    rf"to|the|by|left|right|around|degrees?|deg|°|(?:counter-?|anti-?)?clockwise|{_NUMBER}(?:°|deg|degrees?)?"
)


def _turn(rest: str) -> list[Action]:
    if not all(map(_TURN_WORD.fullmatch, rest.split())):
        return []
    number = re.search(_NUMBER, rest)
    if number is None and "around" in rest:
        return [Turn(180.0)]
    if number is None and not re.search(r"\b(?:left|right)\b", rest):
        return []
    degrees = float(number[0]) if number else 90.0
    clockwise = re.search(r"\bright\b|(?<!counter)(?<!counter-)(?<!anti)\bclockwise\b", rest)
    return [Turn(-degrees if clockwise else degrees)] if math.isfinite(degrees) else []


def _speaking(clause: str, quotes: list[str]) -> list[Action]:
    delivery = re.match(
        r"deliver\s+(?:the\s+)?(?:message\s+)?(?P<text>\x00\d+\x00|.+?)\s+to\s+(?P<place>.+)$", clause, re.I
    )
    if delivery:
        return [GoTo(_place(delivery["place"])), Say(_sentence(delivery["text"], quotes))]
    telling = re.match(
        rf"(?:tell|inform|let)\s+(?:(?P<them>{_THEM})|(?P<place>.+?))"
        r"(?:\s*:\s*|\s+(?:know\s+)?(?:that\s+|(?=\x00)))(?P<text>.+)$",
        clause,
        re.I,
    ) or re.match(rf"(?:tell|inform|let)\s+(?P<them>{_THEM})(?P<place>)\s+(?:know\s+)?(?P<text>.+)$", clause, re.I)
    if telling:
        said = Say(_sentence(telling["text"], quotes))
        return [said] if telling["them"] else [GoTo(_place(telling["place"])), said]
    saying = re.match(
        rf"(?:say|announce|speak)\s*(?:aloud|out\s+loud)?\s*(?:to\s+{_THEM}\s*)?(?:that\s+|:\s*)?(?P<text>.+)$",
        clause,
        re.I,
    )
    return [Say(_sentence(saying["text"], quotes))] if saying else []


def _place(text: str) -> str:
    people = r"^(?:(?:everyone|everybody|people|those|the\s+people|the\s+team|them)\s+(?:in|at)\s+)"
    return re.sub(people, "", text.strip(), flags=re.I)


def _sentence(text: str, quotes: list[str]) -> str:
    spoken = re.sub(r"\x00(\d+)\x00", lambda m: quotes[int(m[1])], text.strip()).strip().lstrip(":").strip()
    spoken = spoken[:1].upper() + spoken[1:]
    return spoken if spoken[-1:] in ".!?…" else spoken + "."
