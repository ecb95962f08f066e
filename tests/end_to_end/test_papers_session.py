"""The paper's session, P1 to P4, in Chromium against what `robot-acp up` starts, at the robot's real speed: on the
simulator, and on a ROS 2 robot, where the only change is the robot server's flag.

What counts is what the robot did: its own telemetry says where it drove and what it said. A terminal client watches the
same session over TCP all the while.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from tests.end_to_end.conftest import Opener, Up, start
from tests.end_to_end.terminal import Terminal
from tests.processes import Client, Robot, Watched, end, eventually
from tests.ros2_robots import needs_ros2

BRAKES_WITHIN = 0.5
"""m: it brakes on 0.05 m; the rest is for the time between two of its states. It would have driven on for metres."""
ROS2 = ("--robot", "ros2", "--ros2-demo")


@pytest.fixture(
    scope="module", params=[pytest.param((), id="simulator"), pytest.param(ROS2, id="ros2", marks=needs_ros2)]
)
def up(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Up]:
    """What a person starts, with no flag or with those of ROS 2."""
    data = tmp_path_factory.mktemp("data")
    # A machine that tests many things at once may stall for longer than a robot's computer ever should.
    patient = {"ROBOT_ACP_ROBOT__LIMITS__POSE_TIMEOUT": "5"}
    running = start(Robot(data, patient), *request.param)
    yield running
    assert end(running.process, signal.SIGINT) == 0


async def ask(page: Page, text: str) -> None:
    await page.get_by_test_id("composer").fill(text)
    await page.get_by_test_id("send").click()


async def answer(page: Page, sentence: str, allow: bool) -> None:
    question = page.get_by_test_id("permission")
    await expect(question).to_contain_text(f"Say aloud: “{sentence}”", timeout=90_000)
    await page.get_by_test_id("permission-allow" if allow else "permission-reject").click()


async def finished(terminal: Terminal, turns: int) -> None:
    await eventually(lambda: len(terminal.turn_ends()) == turns, f"the end of turn {turns}", 90)


async def place_of(client: Client, name: str) -> tuple[float, float]:
    """Where a place is, from the map that the agent read in this session."""
    await eventually(lambda: any("nodes" in (u.get("rawOutput") or {}) for u in client.updates), "the map")
    update = next(u for u in client.updates if "nodes" in (u.get("rawOutput") or {}))
    where = next(n["position"] for n in update["rawOutput"]["nodes"] if n["name"] == name)
    return where["x"], where["y"]


async def cancelled(page: Page, watched: Watched) -> float:
    """Click Cancel, and return the metres on which the robot brakes: how long the click takes to get through depends on
    the machine. bench/people.py measures that."""
    await page.get_by_test_id("cancel").click()
    await watched.until(lambda: watched.speed == 0, "the robot to halt")
    back = [state for _, state in reversed(watched.states)]
    at = next(i for i, state in enumerate(back) if state.twist.linear != 0)
    while abs(back[at + 1].twist.linear) > abs(back[at].twist.linear):
        at += 1
    return watched.distance_to(back[at].pose.x, back[at].pose.y)


async def test_the_papers_session(
    up: Up, open_page: Opener, open_plain: Opener, pictures: Path, request: pytest.FixtureRequest
) -> None:
    # The map of either robot comes over the same telemetry: it is drawn once.
    page = await (open_plain if "ros2" in request.node.name else open_page)(up.login_url)
    await expect(page.get_by_test_id("robot-state")).to_contain_text("ready")
    assert "token" not in page.url
    observer = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}", answer=None)

    async with up.robot.watched() as watched:
        begin = watched.state.pose

        # P1: thought first, the map, a drive with progress, a question, and only then speech.
        await ask(page, "Go to lab 2.3.7 and tell them that the meeting is at noon")
        await expect(page.get_by_test_id("thought").first).to_contain_text("look lab 2.3.7 up")
        listed = await observer.link.request("session/list", {})
        session = listed["sessions"][0]["sessionId"]
        terminal = await Terminal.join(up, session)
        await observer.load(session)
        driving = page.get_by_test_id("tool-card").filter(has_text="Drive to lab 2.3.7")
        await expect(driving).to_contain_text("m to go, about")
        await expect(page.get_by_test_id("robot-state")).to_contain_text("driving to lab 2.3.7")
        await watched.until(lambda: watched.distance_to(begin.x, begin.y) > 3, "the robot to be on its way")
        await page.screenshot(path=pictures / "driving.png")
        phone = await open_page(up.login_url, viewport={"width": 390, "height": 844}, device_scale_factor=2)
        await expect(phone.get_by_test_id("tool-card").last).to_contain_text("m to go, about")
        await phone.screenshot(path=pictures / "driving-phone.png")
        await phone.close()
        await expect(page.get_by_test_id("permission")).to_be_visible(timeout=90_000)
        assert watched.spoken == []
        lab = await place_of(observer, "lab 2.3.7")
        await watched.until(lambda: watched.distance_to(*lab) < 0.3, "the robot to be at the lab")
        await answer(page, "The meeting is at noon.", allow=True)
        await finished(terminal, 1)
        await watched.until(lambda: watched.spoken == ["The meeting is at noon."], "the sentence")
        await expect(page.get_by_test_id("agent-message").last).to_contain_text("I said: “The meeting is at noon.”")
        first = [update["sessionUpdate"] for _, update in terminal.events]
        assert first[:2] == ["user_message_chunk", "agent_thought_chunk"]

        # P2: on the way back, Cancel.
        await ask(page, "Go back to where you started")
        await watched.until(lambda: watched.speed > 0.5, "the robot to drive back")
        await watched.until(lambda: watched.distance_to(*lab) > 4, "the robot to be on its way")
        assert await cancelled(page, watched) < BRAKES_WITHIN
        await finished(terminal, 2)
        assert terminal.turn_ends()[-1] == "cancelled"
        assert watched.distance_to(*lab) > 3
        assert watched.distance_to(begin.x, begin.y) > 3
        halted = watched.state.pose
        await expect(page.get_by_test_id("conversation")).to_contain_text("Cancelled.")

        # P3: two new messages; the first is refused, the second allowed.
        await ask(
            page, "Go to lab 2.3.7, tell them that it moved to one o'clock, and then tell them that lunch is at two"
        )
        await answer(page, "It moved to one o'clock.", allow=False)
        await answer(page, "Lunch is at two.", allow=True)
        await finished(terminal, 3)
        await watched.until(lambda: len(watched.spoken) == 2, "the second sentence")
        assert watched.spoken == ["The meeting is at noon.", "Lunch is at two."]
        assert watched.distance_to(*lab) < 0.3
        await expect(page.get_by_test_id("agent-message").last).to_contain_text(
            "I did not say “It moved to one o'clock.”: refused by supervisor."
        )

        # P4: home.
        await ask(page, "Go back to where you started")
        await finished(terminal, 4)
        await watched.until(lambda: watched.distance_to(begin.x, begin.y) < 0.3, "the robot to be home")
        assert (halted.x - begin.x) ** 2 + (halted.y - begin.y) ** 2 > 9
        assert watched.spoken == ["The meeting is at noon.", "Lunch is at two."]
    assert terminal.turn_ends() == ["end_turn", "cancelled", "end_turn", "end_turn"]

    # The terminal saw every event of the browser's turns, in order: what the log holds, each once.
    archive = await Client.open(f"tcp://127.0.0.1:{up.robot.agent_port}", answer=None)
    await archive.load(session)
    assert terminal.events == list(zip(archive.numbers, archive.updates, strict=True))
    assert [number for number, _ in terminal.events] == list(range(1, len(terminal.events) + 1))
    assert observer.updates == archive.updates
    await terminal.leave()
    await observer.close()
    await archive.close()
