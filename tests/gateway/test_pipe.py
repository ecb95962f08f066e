"""What passes through `robot-acp connect`, byte by byte, with a remote that the test plays."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path

import pytest

from tests.gateway.peers import a_remote, connected
from tests.processes import PATIENCE_S, Robot

ODD = b'{ "params": {"z": 1.50, "a": 1e2,  "text":"\\u00fc \xc3\xbc"}, "method":"_x/y",\t"jsonrpc": "2.0" }'


async def test_messages_pass_as_the_bytes_that_they_are(alone: Robot) -> None:
    async with a_remote() as remote, connected(alone, remote.url, "--token", "T") as editor:
        far = await remote.client()
        assert remote.headers["authorization"] == "Bearer T"
        await editor.send(ODD + b"\r")
        assert await far.recv() == ODD.decode()  # a text frame
        await far.send(ODD.decode())
        assert await editor.line() == ODD
        await far.send(ODD)  # a binary frame
        assert await editor.line() == ODD


async def test_a_frame_is_one_line_whatever_it_holds(alone: Robot) -> None:
    async with a_remote() as remote, connected(alone, remote.url) as editor:
        far = await remote.client()
        await far.send('{\r\n  "jsonrpc": "2.0",\n  "method": "_x/y"\n}\n')
        assert await editor.line() == b'{    "jsonrpc": "2.0",   "method": "_x/y" }'


async def test_what_is_no_message_does_not_reach_the_client(alone: Robot) -> None:
    async with a_remote() as remote, connected(alone, remote.url) as editor:
        far = await remote.client()
        for nonsense in ("hello", "[]", '{"jsonrpc":"2.0"}', b"\xff"):
            await far.send(nonsense)
        await far.send(ODD.decode())
        assert await editor.line() == ODD
        status, words = await editor.leave()
        assert status == 0
        assert words.count("dropped a message of the remote") == 4


async def test_it_is_at_home_where_a_subprotocol_is_demanded(alone: Robot) -> None:
    async with a_remote("acp.v1") as remote, connected(alone, remote.url):
        assert (await remote.client()).subprotocol == "acp.v1"


@pytest.mark.parametrize("how", ["stdin ends", "SIGTERM", "SIGINT"])
async def test_leaving_closes_the_connection_politely(alone: Robot, how: str) -> None:
    async with a_remote() as remote, connected(alone, remote.url) as editor:
        far = await remote.client()
        await editor.send(ODD)
        assert await far.recv() == ODD.decode()
        if how == "stdin ends":
            editor.writer.close()
        else:
            editor.process.send_signal(signal.Signals[how])
        assert await editor.ended() == (0, "")
        await far.wait_closed()
        assert far.close_code == 1000


async def test_what_was_said_before_the_end_is_still_heard(alone: Robot) -> None:
    async with a_remote() as remote, connected(alone, remote.url) as editor:
        far = await remote.client()
        for request_id in (1, "one", 2):
            await editor.begin(request_id, "_x/y")
            await far.recv()
        await far.send('{"jsonrpc":"2.0","id":"one","result":{}}')
        await far.close(1013, "The agent is not running.")
        answered, *lost = await editor.rest()
        assert answered == {"jsonrpc": "2.0", "id": "one", "result": {}}
        assert {(answer["id"], answer["error"]["code"]) for answer in lost} == {(1, -32603), (2, -32603)}
        status, words = await editor.ended()
        assert status == 1
        assert "is lost (The agent is not running). Check" in words


async def test_a_message_beyond_the_limit_is_told(alone: Robot) -> None:
    async with a_remote() as remote, connected(alone, remote.url) as editor:
        far = await remote.client()
        await far.send('{"jsonrpc":"2.0","method":"_x/y","params":{"text":"' + "x" * 16 * 1024 * 1024 + '"}}')
        status, words = await editor.ended()
        assert status == 1
        assert "The robot sent a message larger than 16777216 bytes." in words


async def test_a_client_that_reads_late_gets_everything_in_order(alone: Robot) -> None:
    async with a_remote() as remote, connected(alone, remote.url) as editor:
        far = await remote.client()
        frames = [
            json.dumps({"jsonrpc": "2.0", "method": "_x/y", "params": {"n": n, "x": "x" * 10**6}}) for n in range(60)
        ]

        async def send_all() -> None:
            for frame in frames:
                await far.send(frame)

        sending = asyncio.create_task(send_all())
        # Up and down are apart: it still takes what the client says.
        await editor.send(ODD)
        assert await far.recv() == ODD.decode()
        assert not sending.done()
        for frame in frames:
            assert await editor.line() == frame.encode()
        await sending


async def test_files_may_stand_for_the_client(alone: Robot, tmp_path: Path) -> None:
    script, answers = tmp_path / "script", tmp_path / "answers"
    script.write_bytes(ODD + b"\n[]\n" + ODD + b"\n")
    async with a_remote() as remote:
        with script.open() as stdin, answers.open("w") as stdout:
            process = await asyncio.create_subprocess_exec(
                *alone.command("connect", remote.url), env=alone.variables, stdin=stdin, stdout=stdout
            )
        far = await remote.client()
        assert [await far.recv(), await far.recv()] == [ODD.decode()] * 2
        async with asyncio.timeout(PATIENCE_S):
            assert await process.wait() == 0
    assert [json.loads(line)["error"]["code"] for line in answers.read_text().splitlines()] == [-32600]
