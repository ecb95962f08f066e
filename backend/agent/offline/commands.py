"""The command grammar as a chat model: it takes messages, tools and the situation, and returns text and tool calls.

It has no memory of its own. Each inference reads the last message of a person and the tool calls since then, and
returns the next step. So a refusal, a failure or a restart in between needs no state here.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from backend.agent.offline import report
from backend.agent.offline.grammar import (
    Action,
    GoBack,
    GoTo,
    GoToPoint,
    Say,
    TakePhoto,
    TellAbilities,
    TellBattery,
    TellPlaces,
    TellPose,
    Turn,
    parse,
)
from backend.agent.offline.places import Node, find, read_map, unknown
from backend.agent.offline.toolbox import Toolbox
from backend.agent.sessions.history import PLAN_TOOL
from backend.agent.turns.model import Situation, StartPose
from backend.agent.turns.prompts import ASK_TOOL

Call = tuple[str, dict[str, Any]]


@dataclass(frozen=True)
class Reply:
    """The answer of one inference: text, and the tool calls that it proposes."""

    text: str = ""
    calls: list[Call] = field(default_factory=list)


@dataclass(frozen=True)
class Done:
    """A tool call of this turn that has ended, and its result as the model reads it."""

    tool: str
    result: str

    @property
    def failed(self) -> bool:
        """Whether the result is an error."""
        return self.result.startswith("Error: ")


def respond(messages: list[dict[str, Any]], tools: list[dict[str, Any]], situation: Situation) -> Reply:
    """The next step for the last message of a person. Without tools: a sentence that announces the actions."""
    asked, since = _last_turn(messages)
    actions = parse(asked)
    if not tools:
        return Reply(report.intention(actions, situation.asks))
    book = Toolbox(tools)
    if not actions or actions == [TellAbilities()]:
        excuse = "" if actions else "I did not understand that. "
        return Reply(excuse + report.help_text(book.abilities()))
    done = _done(since)
    past = [d for d in done if d.tool not in (PLAN_TOOL, ASK_TOOL)]
    answers = [report.chosen(d.result) for d in done if d.tool == ASK_TOOL]
    return _Turn(book, actions, situation.start, past, answers, _last_plan(since)).next()


class _Turn:
    """The actions that a person asked for, and the tool calls that were made for them so far."""

    def __init__(
        self,
        book: Toolbox,
        actions: list[Action],
        start: StartPose | None,
        past: list[Done],
        answers: list[str | None],
        shown: list[str] | None,
    ) -> None:
        self._book = book
        self._actions = actions
        self._start = start
        self._past = past
        self._answers = answers
        self._meant: dict[str, Node] = {}
        self._shown = shown
        self._nodes: list[Node] = []
        self._failed: set[int] = set()
        """The actions that failed, by their number: they are not done."""

    def next(self) -> Reply:
        needs_map = any(isinstance(a, GoTo | TellPlaces) for a in self._actions)
        outcomes = self._past
        if needs_map:
            reading = self._book.map()
            if reading is None:
                return Reply("I have no map to look places up in.")
            if not self._past:
                return self._step(0, reading)
            first, outcomes = self._past[0], self._past[1:]
            self._nodes = read_map(first.result)
            if first.failed or not self._nodes:
                return self._finish([f"I could not read the map. {report.reason(first.result)}"], 0)
            if reply := self._settle_places():
                return reply
        return self._continue(outcomes)

    def _continue(self, outcomes: list[Done]) -> Reply:
        told: list[str] = []
        for position, action in enumerate(self._actions):
            if isinstance(action, TellPlaces):
                told.append("I know these places: " + ", ".join(n.name for n in self._nodes) + ".")
                continue
            if isinstance(action, TellAbilities):
                told.append(report.help_text(self._book.abilities()))
                continue
            if not outcomes:
                call = self._call(action)
                if call is None:
                    return self._finish([*told, report.impossible(action)], position)
                return self._step(position, call)
            outcome, outcomes = outcomes[0], outcomes[1:]
            told.append(report.outcome(action, outcome.result, outcome.failed))
            if outcome.failed:
                self._failed.add(position)
            if outcome.failed and isinstance(action, GoTo | GoToPoint | GoBack):
                return self._finish(told + report.left_out(self._actions[position + 1 :]), position)
        return self._finish(told, len(self._actions))

    def _finish(self, told: list[str], ended: int) -> Reply:
        """Say what happened, after the plan shows that the first `ended` actions are over and no other is under way."""
        statuses = self._statuses(ended)
        if self._shown is not None and self._shown != statuses:
            return Reply(calls=[self._plan_call(statuses)])
        return Reply(" ".join(told))

    def _step(self, position: int, call: Call) -> Reply:
        statuses = self._statuses(position)
        statuses[position] = "in_progress"
        wanted = len(self._actions) > 1 and self._book.has(PLAN_TOOL) and self._shown != statuses
        return Reply(calls=[*([self._plan_call(statuses)] if wanted else []), call])

    def _statuses(self, ended: int) -> list[str]:
        """The status of each action when the first `ended` ones are over. One that failed is not done."""
        return ["completed" if i < ended and i not in self._failed else "pending" for i in range(len(self._actions))]

    def _plan_call(self, statuses: list[str]) -> Call:
        entries = [
            {"content": report.plan_entry(action), "status": status}
            for action, status in zip(self._actions, statuses, strict=True)
        ]
        return PLAN_TOOL, {"entries": entries}

    def _settle_places(self) -> Reply | None:
        """Find the place that each name means; None when every name means one place, else a question or a refusal."""
        answers = list(self._answers)
        for place in dict.fromkeys(a.place for a in self._actions if isinstance(a, GoTo)):
            found = find(place, self._nodes)
            if not found:
                return self._finish([unknown(place, self._nodes)], 0)
            if len(found) > 1:
                names = [n.name for n in found]
                question = f"Which one do you mean: {', '.join(names)}?"
                if not answers and self._book.has(ASK_TOOL):
                    return Reply(calls=[(ASK_TOOL, {"question": "Which one do you mean?", "options": names})])
                answer = answers.pop(0) if answers else None
                found = [n for n in found if n.name == answer]
                if not found:
                    return self._finish([question], 0)
            self._meant[place] = found[0]
        return None

    def _call(self, action: Action) -> Call | None:
        book = self._book
        match action:
            case GoTo(place):
                node = self._meant[place]
                return book.drive_to_place(node.name, node.x, node.y, node.yaw)
            case GoToPoint(x, y, yaw):
                return book.drive_to_point(x, y, yaw)
            case GoBack():
                start = self._start
                return book.drive_to_point(start.x, start.y, start.yaw) if start else None
            case Say(text):
                return book.say(text)
            case Turn(degrees):
                return book.turn(degrees)
            case TakePhoto():
                return book.photo()
            case TellBattery():
                return book.status()
            case TellPose():
                return book.pose()
            case TellPlaces() | TellAbilities():
                return None


def _text(message: dict[str, Any]) -> str:
    content = message.get("content") or ""
    return content if isinstance(content, str) else " ".join(part.get("text", "") for part in content)


def _last_turn(messages: list[dict[str, Any]]) -> tuple[str, list[dict[str, Any]]]:
    for index in range(len(messages) - 1, -1, -1):
        if messages[index]["role"] == "user":
            return _text(messages[index]), messages[index + 1 :]
    return "", []


def _done(since: list[dict[str, Any]]) -> list[Done]:
    names = {c["id"]: c["function"]["name"] for m in since for c in m.get("tool_calls") or ()}
    return [Done(names.get(m["tool_call_id"], ""), _text(m)) for m in since if m["role"] == "tool"]


def _last_plan(since: list[dict[str, Any]]) -> list[str] | None:
    plans = [
        json.loads(c["function"]["arguments"])["entries"]
        for m in since
        for c in m.get("tool_calls") or ()
        if c["function"]["name"] == PLAN_TOOL
    ]
    return [entry["status"] for entry in plans[-1]] if plans else None
