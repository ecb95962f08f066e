"""`robot-acp chat`: type to the robot, see what it thinks and does, answer its questions, Ctrl-C to cancel.

Reads the terminal, or plain lines where stdin is none. With `--json` each event is one line of JSON, for programs; with
`--telemetry` the robot's state is below the prompt, or a line when it changes. It must never use anything but ACP.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import orjson
from prompt_toolkit import PromptSession
from prompt_toolkit.formatted_text import FormattedText
from prompt_toolkit.patch_stdout import patch_stdout
from rich.console import Console
from rich.text import Text

from backend import local_user
from backend import meta as keys
from backend.chat import plain_input
from backend.chat.export import save_log
from backend.chat.link import Link, LinkError, RefusedError, open_link
from backend.chat.question import Question
from backend.chat.status import METHOD, SUBSCRIPTION, Status
from backend.chat.view import Line, Style, View
from backend.config import Settings
from backend.visible import visible

_STYLES: dict[Style, str] = {
    "you": "bold",
    "thought": "italic dim",
    "robot": "",
    "tool": "cyan",
    "result": "green",
    "problem": "yellow",
    "note": "dim",
}
_PING_SECONDS = 5.0
"""How often the round trip to the agent is timed, and how long an answer may take."""
_HELP = (
    "Type what the robot shall do. /stop stops it at once, /release lets it move again, Ctrl-C cancels, Ctrl-D leaves."
)


async def run(
    settings: Settings,
    address: str | None,
    session: str | None,
    token: str | None,
    *,
    as_json: bool = False,
    telemetry: bool = False,
) -> int:
    """Chat until the input ends; the exit status is 1 when the connection could not be made or was lost."""
    where = address or settings.agent_url
    chat = Chat(as_json, Status() if telemetry else None)
    token = token or os.environ.get("ROBOT_ACP_TOKEN")
    try:
        await chat.connect(where, token or local_user.token_for(where, settings), session)
        return await chat.talk()
    except (LinkError, RefusedError) as error:
        print(f"robot-acp: {error}", file=sys.stderr)
        return 1
    finally:
        await chat.close()


class Chat:
    """One terminal at one session."""

    def __init__(self, as_json: bool, status: Status | None) -> None:
        self._as_json = as_json
        self._status = status
        self._view = View()
        self._link: Link | None = None
        self._session = ""
        """Empty while no session is open, because the database of sessions is away."""
        self._wanted_session: str | None = None
        self._questions: dict[Any, Question] = {}
        """The questions that wait, by request id. The first one is on the screen, and an answer is for that one."""
        self._turn: asyncio.Task[None] | None = None
        self._ready_for_input = asyncio.Event()
        """Set while the next line of a pipe may be read: between turns, and while a question is open."""
        self._ready_for_input.set()
        self._background: set[asyncio.Task[None]] = set()
        """Messages to the agent that nobody waits for."""
        self._commands: set[asyncio.Task[None]] = set()
        """Stops and releases without an answer yet; the chat does not end before their answers are shown."""
        self._redraw: Callable[[], None] = lambda: None

    async def connect(self, address: str, token: str | None, session: str | None) -> None:
        """Connect and open a session: a new one, the one of this id, or the newest for `last`."""
        self._link = await open_link(address, token, self._receive)
        about = {
            "protocolVersion": 1,
            "clientCapabilities": {"_meta": SUBSCRIPTION} if self._status else {},
            "clientInfo": {"name": "robot-acp chat", "version": "1"},
        }
        if token and address.startswith("tcp:"):
            about["_meta"] = {keys.TOKEN: token}  # over WebSocket it went with the handshake
        initialized = await self._link.request("initialize", about)
        extensions = initialized.get("agentCapabilities", {}).get("_meta", {}).get(keys.CAPABILITIES, {})
        self._view.robot = extensions.get("robot", "The robot")
        self._wanted_session = session
        try:
            await self._open_session()
        except RefusedError as error:
            if not error.database_away:
                raise
            # Stop and telemetry need no session; the next prompt tries again.
            self._show([Line("problem", str(error)), Line("note", _HELP)])
        if self._status:
            self._in_background(self._time_round_trips(self._link, self._status))

    async def _open_session(self) -> None:
        assert self._link is not None  # noqa: S101
        wanted = self._wanted_session
        if wanted == "last":
            listed = (await self._link.request("session/list", {}))["sessions"]
            wanted = listed[0]["sessionId"] if listed else None
        if wanted is None:
            self._session = (await self._link.request("session/new", {"cwd": "/", "mcpServers": []}))["sessionId"]
        else:
            await self._link.request("session/load", {"sessionId": wanted, "cwd": "/", "mcpServers": []})
            self._session = wanted
        self._show(
            [Line("note", f"{self._view.robot} is listening. {_HELP}"), Line("note", f"Session {self._session}")]
        )

    async def talk(self) -> int:
        """Carry out the input until it ends, or the connection is lost; the exit status is 1 then."""
        assert self._link is not None  # noqa: S101 - `connect` comes first
        lines = asyncio.create_task(self._read_all())
        waiting: list[asyncio.Future[Any]] = [lines, self._link.closed]
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        if self._link.closed.done():
            lines.cancel()
            await asyncio.gather(lines, return_exceptions=True)
            print(f"robot-acp: {self._link.closed.result()}", file=sys.stderr)
            return 1
        if not lines.cancelled():
            lines.result()
        return 0

    async def close(self) -> None:
        """Disconnect."""
        if self._link is not None:
            await self._link.close()
        for task in [*self._background, *self._commands, *([self._turn] if self._turn else [])]:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    # From the agent

    def _receive(self, message: dict[str, Any]) -> None:
        method, params = message["method"], message.get("params") or {}
        if self._as_json:
            print(orjson.dumps(message).decode(), flush=True)
        if method == "session/update" and params.get("sessionId") == self._session:
            self._show(self._view.apply(params["update"]))
        elif method == "session/update" and not self._session:
            self._show(self._view.apply(params["update"]))  # the replay of a session that is being opened
        elif method == METHOD and self._status:
            if self._status.apply(params) and not sys.stdin.isatty():
                self._show([Line("note", self._status.line)])
        elif method == "session/request_permission":
            self._take_question(message["id"], Question.of(params))
        elif method == "$/cancel_request":
            first = next(iter(self._questions), None)
            if self._questions.pop(params.get("requestId"), None) and params.get("requestId") == first:
                self._show([Line("note", "This question has been settled.")])
                self._show_question()
        elif "id" in message and self._link is not None:
            self._in_background(self._link.refuse(message["id"]))
        self._redraw()

    def _take_question(self, request_id: Any, question: Question) -> None:
        if not question.options and self._link is not None:
            self._in_background(self._link.refuse(request_id))  # nothing can be chosen
            return
        self._questions[request_id] = question
        self._ready_for_input.set()
        if len(self._questions) == 1:
            self._show_question()

    def _show_question(self) -> None:
        """Show the question that the next answer is for."""
        if question := next(iter(self._questions.values()), None):
            self._show([*self._view.flush(), Line("problem", question.text(self._view.robot))])

    async def _time_round_trips(self, link: Link, status: Status) -> None:
        with contextlib.suppress(LinkError):  # `talk` reports the lost connection
            while True:
                try:
                    async with asyncio.timeout(_PING_SECONDS):
                        status.round_trip = await link.round_trip()
                except TimeoutError:
                    status.round_trip = None
                await asyncio.sleep(_PING_SECONDS)

    # From the person

    async def _read_all(self) -> None:
        if not sys.stdin.isatty():
            asyncio.get_running_loop().add_signal_handler(signal.SIGINT, self._on_sigint, asyncio.current_task())
        async for line in self._terminal() if sys.stdin.isatty() else self._plain_lines():
            if not await self._run_line(line.strip()):
                break
        else:
            if self._turn is not None:
                await self._turn  # the input has ended; the turn that it began still runs to its end
        await asyncio.gather(*self._commands)

    def _on_sigint(self, reading: asyncio.Task[None] | None) -> None:
        """Ctrl-C without a terminal: cancel the turn, or leave when none runs."""
        if self._turn is not None and not self._turn.done():
            self._in_background(self._interrupt())
        elif reading is not None:
            reading.cancel()

    async def _run_line(self, line: str) -> bool:
        """Carry out a line; false when it asks to leave."""
        command = line.lower()
        if command in ("/quit", "/exit"):
            return False
        if not line:
            return True
        # Commands come before answers: an open question must not delay a stop.
        if command in ("/stop", "/release"):
            self._command(f"_robot{command}")
        elif command in ("/cancel", "/help"):
            await self._interrupt() if command == "/cancel" else self._show([Line("note", _HELP)])
        elif self._questions:
            await self._answer(line)
        elif self._turn is not None and not self._turn.done():
            self._show([Line("note", "The robot is still busy. /stop stops it at once, Ctrl-C cancels.")])
        else:
            self._ready_for_input.clear()
            self._turn = asyncio.create_task(self._prompt(line))
        return True

    async def _answer(self, line: str) -> None:
        request_id, question = next(iter(self._questions.items()))
        option = question.selected(line)
        if option is None:
            self._show([Line("problem", f"Answer the question first: {question.choices}.")])
            return
        del self._questions[request_id]
        self._show_question()
        if self._turn is not None and not self._turn.done() and not self._questions:
            self._ready_for_input.clear()
        assert self._link is not None  # noqa: S101
        await self._link.respond(request_id, {"outcome": {"outcome": "selected", "optionId": option}})

    async def _prompt(self, text: str) -> None:
        assert self._link is not None  # noqa: S101
        try:
            if not self._session:
                await self._open_session()
            if text.lower() == "/export":
                file = await save_log(self._link, self._session, Path.cwd())
                self._show([Line("note", f"The log of this session is in {file}.")])
                return
            prompt = {"sessionId": self._session, "prompt": [{"type": "text", "text": text}]}
            answer = await self._link.request("session/prompt", prompt)
            if self._as_json:
                print(orjson.dumps({"stopReason": answer["stopReason"]}).decode(), flush=True)
        except RefusedError as error:
            self._show([Line("problem", str(error))])
        except OSError as error:
            self._show([Line("problem", f"The log cannot be written here: {error.strerror or error}.")])
        except LinkError:
            pass  # `talk` reports the lost connection
        finally:
            self._ready_for_input.set()
            self._show(self._view.flush())

    def _command(self, method: str) -> None:
        task = asyncio.create_task(self._send_command(method))
        self._commands.add(task)
        task.add_done_callback(self._commands.discard)

    async def _send_command(self, method: str) -> None:
        assert self._link is not None  # noqa: S101
        try:
            answer = await self._link.request(method, {})
            stopped = answer.get("stopped")
            self._show(
                [Line("problem", f"Stopped by {visible(stopped['by'])}.") if stopped else Line("note", "Released.")]
            )
        except (RefusedError, LinkError) as error:
            self._show([Line("problem", str(error))])

    async def _interrupt(self) -> None:
        assert self._link is not None  # noqa: S101
        if self._view.status or (self._turn is not None and not self._turn.done()):
            self._show([Line("note", "Stopping …")])
            await self._link.notify("session/cancel", {"sessionId": self._session})
        else:
            self._show([Line("note", "Nothing runs. Ctrl-D leaves.")])

    def _in_background(self, work: Any) -> None:
        task = asyncio.ensure_future(work)
        self._background.add(task)
        task.add_done_callback(self._background.discard)

    # The terminal

    async def _terminal(self) -> AsyncIterator[str]:
        prompt: PromptSession[str] = PromptSession(bottom_toolbar=self._toolbar, erase_when_done=True)
        self._redraw = prompt.app.invalidate
        with patch_stdout(raw=True):
            while True:
                try:
                    line = await prompt.prompt_async(lambda: "allow? " if self._questions else "> ")
                except KeyboardInterrupt:
                    await self._interrupt()
                    continue
                except EOFError:
                    return
                if line.strip() and not self._questions:
                    self._show([Line("you", f"> {line}")])
                yield line

    def _toolbar(self) -> FormattedText:
        lines = [self._view.status or ("" if self._status else "ready")]
        if self._status:
            lines.append(self._status.line)
        return FormattedText([("", "\n".join(f" {visible(line)}"[:200] for line in lines if line))])

    def _show(self, lines: list[Line]) -> None:
        if self._as_json or not lines:
            return
        # A new console each time: `patch_stdout` replaces the stream while a prompt is open.
        console = Console(file=sys.stdout, highlight=False, soft_wrap=True, force_terminal=sys.stdin.isatty() or None)
        for line in lines:
            console.print(Text(visible(line.text, lines=True), style=_STYLES[line.style]))

    async def _plain_lines(self) -> AsyncIterator[str]:
        """Lines of a pipe: each is read when the one before has been carried out, but a stop as soon as it arrives."""
        async for line in plain_input.lines(self._stop_at_once):
            yield line
            await self._ready_for_input.wait()

    def _stop_at_once(self, line: str) -> bool:
        if line.strip().lower() != "/stop":
            return False
        self._command("_robot/stop")
        return True
