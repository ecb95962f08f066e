"""`/acp`: who gets in, what is passed on, and what comes back for what is wrong."""

from __future__ import annotations

import json

import orjson
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from backend import identity, wire
from backend.identity import Role

PING = '{"jsonrpc":"2.0","method":"$/ping"}'


async def refused(opening) -> tuple[int, str]:
    with pytest.raises(InvalidStatus) as refusal:
        async with opening:
            pass
    response = refusal.value.response
    return response.status_code, orjson.loads(response.body)["error"]


async def test_without_a_token_the_upgrade_is_refused_with_401(bridge, agent):
    status, sentence = await refused(bridge.websocket(token=None, origin=bridge.origin))
    assert status == 401
    assert sentence == "Log in with a token first."
    assert agent.connections == 0


@pytest.mark.parametrize("kind", ["garbage", "foreign", "expired"])
async def test_with_a_token_that_proves_nothing_it_is_refused_with_401(bridge, agent, kind):
    token = {
        "garbage": "garbage",
        "foreign": identity.issue(b"x" * 64, "Eve", Role.SUPERVISOR, 60),
        "expired": bridge.token(lifetime_s=-1),
    }[kind]
    status, sentence = await refused(bridge.websocket(token=token))
    assert status == 401
    assert sentence.endswith("Ask for a new one.")
    assert agent.connections == 0


async def test_a_page_of_another_site_is_refused_with_403_even_with_a_good_cookie(bridge, agent):
    cookie = {"Cookie": f"robot_acp={bridge.token()}"}
    status, sentence = await refused(bridge.websocket(token=None, headers=cookie, origin="https://evil.example"))
    assert status == 403
    assert "allowed_origins" in sentence
    assert agent.connections == 0


async def test_a_cookie_without_an_origin_is_refused_as_no_browser_does_that(bridge):
    cookie = {"Cookie": f"robot_acp={bridge.token()}"}
    status, _ = await refused(bridge.websocket(token=None, headers=cookie))
    assert status == 403


async def test_a_foreign_origin_is_refused_even_with_a_bearer_token(bridge):
    status, _ = await refused(bridge.websocket(origin="https://evil.example"))
    assert status == 403


async def test_a_host_that_is_not_ours_is_refused_before_anything_else(bridge):
    status, _ = await refused(bridge.websocket(called="evil.example"))
    assert status == 421


async def test_a_cookie_and_our_own_origin_let_a_browser_in(bridge, agent, initialize):
    cookie = {"Cookie": f"robot_acp={bridge.token()}"}
    async with bridge.websocket(token=None, headers=cookie, origin=bridge.origin) as websocket:
        await websocket.send(initialize.decode())
        assert (await agent.heard_message())["method"] == "initialize"


async def test_an_origin_that_the_settings_allow_is_let_in(bridge_with, agent, initialize):
    allowed = "https://robot.example.org"
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"allowed_origins": [allowed]}) as bridge,
        bridge.websocket(origin=allowed, called="robot.example.org") as websocket,
    ):
        await websocket.send(initialize.decode())
        assert (await agent.heard_message())["method"] == "initialize"


async def test_every_connection_is_told_an_id_of_its_own(bridge):
    async with bridge.websocket() as one, bridge.websocket() as other:
        ids = {one.response.headers["Acp-Connection-Id"], other.response.headers["Acp-Connection-Id"]}
    assert len(ids) == 2
    assert all(len(value) >= 16 for value in ids)


@pytest.mark.parametrize(
    ("offered", "chosen"),
    [
        (None, None),
        (["acp.v1"], "acp.v1"),
        (["acp.v1", "bearer.TOKEN"], "acp.v1"),
        (["something.else", "acp.v1"], "acp.v1"),
    ],
)
async def test_the_subprotocols_that_clients_offer(bridge, agent, initialize, offered, chosen):
    by_subprotocol = offered is not None and "bearer.TOKEN" in offered
    names = [name.replace("TOKEN", bridge.token()) for name in offered or []]
    options = {"subprotocols": names or None, "token": None if by_subprotocol else ""}
    async with bridge.websocket(**options) as websocket:
        assert websocket.subprotocol == chosen
        await websocket.send(initialize.decode())
        assert (await agent.heard_message())["method"] == "initialize"


async def test_an_unknown_subprotocol_is_let_in_and_not_echoed(bridge):
    # A client library may well give up on that by itself; the upgrade is what counts.
    async with bridge.websocket(headers={"Sec-WebSocket-Protocol": "something.else"}) as websocket:
        assert websocket.response.status_code == 101
        assert "Sec-WebSocket-Protocol" not in websocket.response.headers


async def test_frames_pass_in_both_directions_as_the_bytes_that_came(client, agent):
    to_agent = '{ "id":7,"jsonrpc" : "2.0", "method":"session/list","params":{"é":"\\u00e9 😀", "n":1.0e2} }'
    await client.send(to_agent)
    assert await agent.heard() == to_agent.encode()

    to_client = '{"result":{ "sessions":[],"x":1.50 },  "jsonrpc":"2.0","id":7,"_":"ü"}'
    await agent.say(to_client.encode() + b"\n")
    assert await client.recv() == to_client


async def test_a_frame_of_several_megabytes_passes_in_both_directions(client, agent):
    big = json.dumps({"jsonrpc": "2.0", "method": "session/update", "params": {"data": "ab😀" * 700_000}})
    await client.send(big)
    assert await agent.heard() == big.encode()
    await agent.say(big.encode() + b"\n")
    assert await client.recv() == big


async def test_binary_frames_and_a_trailing_newline_are_taken_as_text_without_them(client, agent):
    await client.send(PING.encode())
    assert await agent.heard() == PING.encode()
    await client.send(PING + "\n")
    assert (await agent.heard()).strip() == PING.encode()
    await client.send([PING[:9], PING[9:]])  # fragments of one message
    assert await agent.heard() == PING.encode()


async def test_unknown_notifications_are_the_agents_business(client, agent):
    await client.send(PING)
    assert await agent.heard() == PING.encode()


async def test_a_pretty_printed_frame_reaches_the_agent_as_one_line(client, agent):
    body = {"jsonrpc": "2.0", "id": 3, "method": "session/new", "params": {"cwd": "/", "text": "a\nb\r\nc"}}
    await client.send(json.dumps(body, indent=2).replace("\n", "\r\n"))
    line = await agent.heard()
    assert b"\n" not in line
    assert b"\r" not in line
    assert orjson.loads(line) == body
    await client.send(PING)
    assert await agent.heard() == PING.encode()


async def test_initialize_carries_the_verified_token_and_nothing_of_ours_that_the_client_made_up(bridge, agent):
    token = bridge.token(Role.VIEWER, "Vera")
    frame = {
        "jsonrpc": "2.0",
        "id": 0,
        "method": "initialize",
        "params": {
            "protocolVersion": 1,
            "clientCapabilities": {"_meta": {"robot-acp/telemetry": {"rate": 5}}},
            "_meta": {"robot-acp/token": "forged", "robot-acp/role": "supervisor", "mine": 1},
        },
    }
    async with bridge.websocket(token=token) as websocket:
        await websocket.send(json.dumps(frame))
        heard = await agent.heard_message()
        assert heard["params"]["_meta"] == {"mine": 1, "robot-acp/token": token}
        assert heard["params"]["clientCapabilities"] == frame["params"]["clientCapabilities"]

        await websocket.send(json.dumps(frame))  # a second one cannot slip through either
        assert (await agent.heard_message())["params"]["_meta"]["robot-acp/token"] == token


@pytest.mark.parametrize("escaped", ['"initiali\\u007ae"', '"\\u0069nitialize"'])
async def test_initialize_written_with_escapes_is_still_initialize(bridge, agent, escaped):
    token = bridge.token()
    async with bridge.websocket(token=token) as websocket:
        await websocket.send('{"jsonrpc":"2.0","id":0,"method":' + escaped + "}")
        assert (await agent.heard_message())["params"]["_meta"] == {"robot-acp/token": token}


@pytest.mark.parametrize(
    ("frame", "code", "request_id"),
    [
        ("{", wire.PARSE_ERROR, None),
        ("[]", wire.INVALID_REQUEST, None),
        ('"hello"', wire.INVALID_REQUEST, None),
        ('{"jsonrpc":"2.0","id":5,"method":"x","params":[1]}', wire.INVALID_PARAMS, 5),
        ('{"jsonrpc":"1.0","id":6,"method":"x"}', wire.INVALID_REQUEST, 6),
        (b"\xff\xfe", wire.PARSE_ERROR, None),
    ],
)
async def test_a_bad_frame_is_answered_and_the_connection_lives(client, agent, frame, code, request_id):
    await client.send(frame)
    answer = orjson.loads(await client.recv())
    assert answer["error"]["code"] == code
    assert answer["id"] == request_id
    await client.send(PING)
    assert await agent.heard() == PING.encode()  # and nothing of the bad frame before it


@pytest.mark.parametrize(
    ("first", "request_id"),
    [('{"jsonrpc":"2.0","id":4,"method":"session/new"}', 4), (PING, None)],
)
async def test_a_first_frame_that_is_not_initialize_ends_the_connection(bridge, agent, first, request_id):
    async with bridge.websocket() as websocket:
        await websocket.send(first)
        answer = orjson.loads(await websocket.recv())
        assert answer["id"] == request_id
        assert answer["error"]["message"] == "The first message must be initialize."
        with pytest.raises(ConnectionClosed) as closed:
            await websocket.recv()
    assert closed.value.rcvd.code == 1008
    await agent.left.wait()
    assert agent.heard_lines.empty()


async def test_a_bad_first_frame_is_answered_and_initialize_may_still_come(bridge, agent, initialize):
    async with bridge.websocket() as websocket:
        await websocket.send("{")
        assert orjson.loads(await websocket.recv())["error"]["code"] == wire.PARSE_ERROR
        await websocket.send(initialize.decode())
        assert (await agent.heard_message())["method"] == "initialize"


async def test_frames_that_come_before_the_agent_is_connected_are_not_lost(bridge, agent, initialize):
    async with bridge.websocket() as websocket:
        for frame in [initialize.decode()] + [PING] * 50:
            await websocket.send(frame)
        assert (await agent.heard_message())["method"] == "initialize"
        assert [await agent.heard() for _ in range(50)] == [PING.encode()] * 50


async def test_every_client_has_an_agent_connection_of_its_own(bridge, agent, initialize, wait_until):
    async with bridge.websocket() as one, bridge.websocket() as other:
        await one.send(initialize.decode())
        await other.send(initialize.decode())
        await wait_until(lambda: agent.connections == 2)


async def test_the_log_names_people_and_never_tokens(bridge, agent, initialize, caplog, wait_until):
    token = bridge.token(name="Ana")
    with caplog.at_level("DEBUG"):
        async with bridge.websocket(token=None, subprotocols=["acp.v1", f"bearer.{token}"]) as websocket:
            await websocket.send(initialize.decode())
            await agent.heard()
        await wait_until(lambda: "gone: Ana" in caplog.text)
    ours = "\n".join(record.getMessage() for record in caplog.records if record.name.startswith(("backend", "uvicorn")))
    assert "connected: Ana (operator)" in ours
    assert token not in ours
    assert token.split(".")[2] not in ours
