"""`robot-acp chat` in a process of its own, through a pipe and in a real terminal."""

from __future__ import annotations

import asyncio
import codecs
import contextlib
import fcntl
import json
import os
import pty
import signal
import struct
import subprocess
import termios
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from backend.identity import Role
from tests.processes import PATIENCE_S, Client, Robot, end, eventually


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with Robot(tmp_path_factory.mktemp("data")).at_work("--time-scale", "2") as robot:
        yield robot


@pytest.fixture(autouse=True)
def released(robot: Robot) -> None:
    """A test that failed while the robot was stopped takes no other with it."""
    address = f"http://127.0.0.1:{robot.robot_port}/release"
    httpx.post(address, params={"by": "the next test"}, headers=robot.robot_headers).raise_for_status()


def chat(robot: Robot, *arguments: str, say: str = "") -> subprocess.CompletedProcess[str]:
    command = robot.command("chat", *arguments)
    return subprocess.run(
        command, env=robot.variables, input=say, text=True, capture_output=True, timeout=PATIENCE_S * 2
    )


def test_a_conversation_through_a_pipe(robot: Robot) -> None:
    done = chat(robot, say="say hello\ny\nsay goodbye\nn\nwhere are you?\n")
    assert done.returncode == 0
    assert "Sancho asks: Say aloud: “Hello.”" in done.stdout
    assert "I said: “Hello.”" in done.stdout
    assert "I did not say “Goodbye.”" in done.stdout
    assert "I am at x" in done.stdout


def test_telemetry_through_a_pipe_is_a_line_when_the_robot_s_state_changes(robot: Robot) -> None:
    plain = chat(robot, say="where are you?\n")
    assert "battery" not in plain.stdout
    done = chat(robot, "--telemetry", say="go to the reception\n")
    states = [line for line in done.stdout.splitlines() if "battery" in line]
    assert any(line.startswith("ready · ") and "held by nobody" in line for line in states)
    assert sum(line.startswith("driving to reception, ") for line in states) == len(
        [s for s in states if "driving" in s]
    )
    assert any("held by local" in line for line in states)
    assert all(" m/s · x " in line and " · link " in line for line in states)


def test_over_websocket_with_a_token(robot: Robot) -> None:
    token = robot.token("Olga", Role.OPERATOR)
    address = f"ws://127.0.0.1:{robot.bridge_port}/acp"
    assert "I am at x" in chat(robot, address, "--token", token, say="where are you?\n").stdout
    refused = chat(robot, address, "--token", "nonsense")
    assert refused.returncode == 1
    assert "did not accept this login" in refused.stderr


def test_a_token_counts_over_tcp_too(robot: Robot) -> None:
    done = chat(robot, "--token", robot.token("Vic", Role.VIEWER), say="say hello\n")
    assert done.returncode == 1
    assert "The role viewer may not prompt" in done.stderr


def test_export_writes_the_log_into_the_folder_of_the_terminal(robot: Robot, tmp_path: Path) -> None:
    command = robot.command("chat")
    environment = robot.variables | {"PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        command,
        env=environment,
        input="where are you?\n/export\n",
        text=True,
        capture_output=True,
        timeout=PATIENCE_S * 2,
        cwd=tmp_path,
        check=True,
    )
    [file] = tmp_path.iterdir()
    assert f"The log of this session is in {file}." in done.stdout
    assert file.stat().st_mode & 0o777 == 0o600
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    assert [line["seq"] for line in lines] == list(range(1, len(lines) + 1))
    session = file.stem.removeprefix("robot-acp-")
    printed = subprocess.run(
        robot.command("sessions", "export", session), env=robot.variables, text=True, capture_output=True, check=True
    )
    assert lines == [json.loads(line) for line in printed.stdout.splitlines()]


@pytest.mark.parametrize(
    ("address", "problem"),
    [("tcp://127.0.0.1:1", "Nothing answers at tcp://127.0.0.1:1"), ("nonsense", "'nonsense' is no address")],
)
def test_an_address_that_does_not_answer_is_told(robot: Robot, address: str, problem: str) -> None:
    done = chat(robot, address)
    assert done.returncode == 1
    assert problem in done.stderr


@contextlib.contextmanager
def piped(robot: Robot) -> Iterator[subprocess.Popen[str]]:
    """The chat with an input that stays open."""
    process = robot.spawn("chat", stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


async def test_losing_the_agent_ends_it_though_the_input_stays_open(robot: Robot) -> None:
    own = robot.with_another_agent()
    with own.running("agent", port=own.agent_port) as agent, piped(own) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        await asyncio.to_thread(process.stdout.readline)
        end(agent, signal.SIGKILL)  # told to end, it would first load its language model's library to the end
        assert await asyncio.to_thread(process.wait, PATIENCE_S) == 1
        assert "connection is lost" in process.stderr.read().lower()


def test_a_stop_that_is_the_last_line_is_made_and_told(robot: Robot) -> None:
    assert "Stopped by local." in chat(robot, say="/Stop\n").stdout
    assert "Released." in chat(robot, say="/release\n").stdout


async def test_a_stop_through_a_pipe_waits_for_no_line_before_it(robot: Robot) -> None:
    async with robot.watched() as watched:
        with piped(robot) as process:
            assert process.stdin is not None
            print("go to lab 2.3.9", file=process.stdin, flush=True)
            motion = await watched.until(lambda: watched.state.motion, "the robot to drive")
            print("/stop", file=process.stdin, flush=True)
            await watched.until(lambda: watched.state.stop is not None, "the stop")
            assert watched.distance_to(motion.goal.x, motion.goal.y) > 1, "it was not to get there first"


class Terminal:
    """The chat in a pseudo-terminal, and what is on its screen so far."""

    def __init__(self, robot: Robot, *arguments: str) -> None:
        command, variables = robot.command("chat", *arguments), robot.variables | {"TERM": "xterm"}
        self.pid, self._fd = pty.fork()
        if self.pid == 0:
            os.execvpe(command[0], command, variables)
        fcntl.ioctl(self._fd, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 160, 0, 0))
        self.screen = ""
        self._text = codecs.getincrementaldecoder("utf-8")("replace")
        self._told_where = 0
        asyncio.get_running_loop().add_reader(self._fd, self._read)

    @classmethod
    @contextlib.contextmanager
    def of(cls, robot: Robot, *arguments: str) -> Iterator[Terminal]:
        terminal = cls(robot, *arguments)
        try:
            yield terminal
        finally:
            terminal.close()

    def _read(self) -> None:
        try:
            self.screen += self._text.decode(os.read(self._fd, 65536))
            # "Where is the cursor?": each time without an answer there is no toolbar, and a second passes.
            for _ in range(self._told_where, self.screen.count("\x1b[6n")):
                self._told_where += 1
                self.type("\x1b[1;1R")
        except OSError:
            asyncio.get_running_loop().remove_reader(self._fd)

    def type(self, text: str) -> None:
        os.write(self._fd, text.encode())

    async def shows(self, text: str) -> None:
        await self._until(lambda: text in self.screen, text)

    async def shows_below(self, text: str) -> None:
        """Below the prompt only the cells that changed are drawn; Ctrl-L draws all of them."""
        seen = len(self.screen)
        self.type("\x0c")

        def drawn() -> bool:
            nonlocal seen
            if text in self.screen[seen:]:
                return True
            if "link" in self.screen[seen:]:  # the line's last word
                seen = len(self.screen)
                self.type("\x0c")
            return False

        await self._until(drawn, text)

    async def _until(self, condition: Callable[[], bool], text: str) -> None:
        try:
            await eventually(condition, f"{text!r} on the screen")
        except AssertionError as failure:
            raise AssertionError(f"{failure}, which had {self.screen!r}") from None

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._fd)
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)
        os.close(self._fd)


async def test_in_a_terminal_ctrl_c_cancels_the_turn_and_a_question_is_answered(robot: Robot) -> None:
    with Terminal.of(robot) as terminal:
        await terminal.shows("Sancho is listening.")
        async with robot.watched() as watched:
            terminal.type("go to lab 2.3.9\r")
            await watched.until(lambda: watched.state.motion is not None, "the robot to drive")
            terminal.type("\x03")
            await terminal.shows("Cancelled.")
            assert await robot.stands()
            terminal.type("say hello\r")
            await terminal.shows("Sancho asks: Say aloud: “Hello.”")
            terminal.type("maybe\r")
            await terminal.shows("Answer the question first")
            assert watched.spoken == []
            terminal.type("y\r")
            await terminal.shows("I said: “Hello.”")
            await watched.until(lambda: watched.spoken == ["Hello."], "the greeting")


async def test_in_a_terminal_a_question_stands_in_the_way_of_no_command(robot: Robot) -> None:
    with Terminal.of(robot) as terminal:
        await terminal.shows("Sancho is listening.")
        async with robot.watched() as watched:
            terminal.type("say hello\r")
            await terminal.shows("Sancho asks: Say aloud: “Hello.”")
            terminal.type("/stop\r")
            await watched.until(lambda: watched.state.stop is not None, "the stop")
            await terminal.shows("Stopped by local.")
            terminal.type("/release\r")
            await watched.until(lambda: watched.state.stop is None, "the release")
            terminal.type("/cancel\r")
            await terminal.shows("Cancelled.")
            assert watched.spoken == []
            assert "Answer the question first" not in terminal.screen


async def test_in_a_terminal_the_state_of_the_robot_stays_below_the_prompt(robot: Robot) -> None:
    with Terminal.of(robot, "--telemetry") as terminal:
        await terminal.shows("Sancho is listening.")
        await terminal.shows_below("held by nobody · link ")
        async with robot.watched() as watched:
            terminal.type("go to lab 2.3.9\r")
            await terminal.shows_below("driving to lab 2.3.9, ")
            await terminal.shows_below("held by local")
            terminal.type("/stop\r")
            await terminal.shows_below("STOPPED by local")
            # The robot itself may tell it a little later: without this, the next line would be true before the release.
            await watched.until(lambda: watched.state.stop is not None, "the stop")
            terminal.type("/release\r")
            await watched.until(lambda: watched.state.stop is None, "the release")


async def test_a_text_from_elsewhere_cannot_draw_on_the_screen(robot: Robot) -> None:
    asking = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer=None)
    try:
        session = await asking.new()
        with Terminal.of(robot, "--session", session) as terminal:
            await terminal.shows("Sancho is listening.")
            turn = asking.later(asking.prompt("say \x1b[2J\x1b[1;1Hpwned"))
            await terminal.shows("Sancho asks")
            await terminal.shows("pwned")
            assert "\x1b[1;1hpwned" not in terminal.screen.lower()
            await asking.cancel()
            await turn
    finally:
        await asking.close()
