"""Three unlike clients at one session, as in the paper: the TypeScript SDK asks, the dashboard approves, the terminal
cancels. All three see the same events in the same order, and the agent knows nothing of it."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path
from typing import Any

from playwright.async_api import Page, WebSocket, expect

from backend.identity import Role
from tests.conformance.papers_session import place_in
from tests.conformance.sdk_clients import TypeScriptInNode
from tests.end_to_end.conftest import Opener, Up, start
from tests.end_to_end.terminal import Terminal
from tests.processes import Client, Robot, end, eventually

LUNCH = "Say aloud: “Lunch is at two.”"
Event = tuple[int, dict[str, Any]]


class Dashboard:
    """A page of the dashboard, and what has come over its WebSocket."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.heard: list[dict[str, Any]] = []
        page.on("websocket", self._follow)

    def _follow(self, wire: WebSocket) -> None:
        if wire.url.endswith("/acp"):
            wire.on("framereceived", lambda frame: self.heard.append(json.loads(frame)))

    def of(self, method: str) -> list[dict[str, Any]]:
        """What the agent sent by this method."""
        return [message for message in self.heard if message.get("method") == method]

    def shows(self, session: str) -> bool:
        """Whether the page has opened a session."""
        return any(message["params"]["sessionId"] == session for message in self.of("session/update"))

    def events(self, session: str) -> list[Event]:
        """The numbered events of a session."""
        return numbered([message["params"] for message in self.of("session/update")], session)


def numbered(shown: list[dict[str, Any]], session: str) -> list[Event]:
    """The numbered events of a session among all updates."""
    mine = [params for params in shown if params["sessionId"] == session and "_meta" in params]
    return [(params["_meta"]["robot-acp/seq"], params["update"]) for params in mine]


async def the_log(up: Up, session: str) -> list[Event]:
    """What the agent has kept of a session."""
    archive = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}", answer=None)
    await archive.load(session)
    events = list(zip(archive.numbers, archive.updates, strict=True))
    await archive.close()
    return events


def withdrawn(client: Dashboard | Terminal) -> bool:
    """Whether the one question that a client was asked has been taken back."""
    (question,) = client.of("session/request_permission")
    return {"requestId": question["id"]} in [message["params"] for message in client.of("$/cancel_request")]


async def test_one_asks_another_approves_and_the_third_cancels(tmp_path: Path, open_plain: Opener) -> None:
    up = start(Robot(tmp_path), "--time-scale", "2")
    try:
        page = await open_plain(up.login_url)
        await expect(page.get_by_test_id("robot-state")).to_contain_text("ready")
        await page.wait_for_url("**/#/s/*")  # a session of its own, as it is the first one
        address = f"ws://127.0.0.1:{up.robot.bridge_port}/acp"
        async with TypeScriptInNode.open(address, up.robot.token("Tom", Role.OPERATOR)) as typescript:
            await typescript.initialize()
            session = await typescript.new_session()
            terminal = await Terminal.join(up, session)
            dashboard = Dashboard(page)
            await page.goto(f"{up.base}/#/s/{session}")
            await page.reload()  # from its first frame on
            await eventually(lambda: dashboard.shows(session), "the session in the browser")
            await eventually(lambda: terminal.of("session/update"), "the session in the terminal")
            await run(up, typescript, dashboard, terminal)

            log = await the_log(up, session)
            assert [number for number, _ in log] == list(range(1, len(log) + 1))
            await eventually(lambda: dashboard.events(session)[-1:] == log[-1:], "the last event in the browser")
            await eventually(lambda: terminal.events[-1:] == log[-1:], "the last event in the terminal")
            assert dashboard.events(session) == log
            assert terminal.events == log
            # Whoever asks knows the own words: they come back to all the others.
            asked = [event for event in log if event[1]["sessionUpdate"] == "user_message_chunk"]
            assert len(asked) == 2
            assert numbered(typescript.heard, session) == [event for event in log if event not in asked]
            await terminal.leave()
    finally:
        end(up.process, signal.SIGINT)


async def run(up: Up, typescript: TypeScriptInNode, dashboard: Dashboard, terminal: Terminal) -> None:
    """What the three do, held against what the robot did."""
    page = dashboard.page
    async with up.robot.watched() as watched:
        home = watched.state.pose

        # The SDK asks, and all three are asked for permission. The browser gives it.
        turn = asyncio.create_task(typescript.prompt("Go to lab 2.3.7 and tell them that lunch is at two"))
        await expect(page.get_by_test_id("permission")).to_contain_text(LUNCH, timeout=90_000)
        await eventually(lambda: typescript.questions and terminal.of("session/request_permission"), "the question")
        assert [question["toolCall"]["title"] for question in typescript.questions] == [LUNCH]
        assert watched.spoken == []
        await page.get_by_test_id("permission-allow").click()
        assert await turn == "end_turn"
        await watched.until(lambda: watched.spoken == ["Lunch is at two."], "the robot to speak")
        lab = place_in(typescript, "lab 2.3.7")
        await watched.until(lambda: watched.distance_to(*lab) < 0.3, "the robot to be at the lab")
        await eventually(lambda: typescript.withdrawn == [0], "the question to be taken back from the SDK")
        await eventually(lambda: withdrawn(terminal), "the question to be taken back from the terminal")
        assert not withdrawn(dashboard)

        # The SDK asks again, and the terminal cancels in mid-drive.
        turn = asyncio.create_task(typescript.prompt("Go back to where you started"))
        await watched.until(lambda: watched.distance_to(*lab) > 2, "the robot to be on its way back")
        assert watched.speed > 0
        await terminal.say("/cancel")
        assert await turn == "cancelled"
        assert await up.robot.stands()
        assert watched.distance_to(home.x, home.y) > 1
        await expect(page.get_by_test_id("conversation")).to_contain_text("Cancelled.")
        await eventually(lambda: terminal.turn_ends() == ["end_turn", "cancelled"], "both ends in the terminal")

    (decision,) = [
        update["_meta"]["robot-acp/decision"]
        for _, update in terminal.events
        if "robot-acp/decision" in (update.get("_meta") or {})
    ]
    assert (decision["by"], decision["option"]) == ("supervisor", "allow_once")
