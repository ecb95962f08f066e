"""Attacks on logins, origins, paths and headers of the bridge. Most need no login at all."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json

from websockets.exceptions import ConnectionClosed, InvalidStatus

from tests.attack.target import Broken, Target, attack

FOREIGN = "http://elsewhere.example"


def _unsigned(claims: dict[str, object]) -> str:
    def part(value: object) -> str:
        return base64.urlsafe_b64encode(json.dumps(value).encode()).decode().rstrip("=")

    return f"{part({'alg': 'none', 'typ': 'JWT'})}.{part(claims)}."


def _tokens(target: Target) -> list[str]:
    """Tokens that must not be accepted."""
    claims = {"aud": "robot-acp", "sub": "Ana", "role": "supervisor", "jti": "a", "exp": 4_000_000_000}
    head, body, signature = target.token.split(".")
    promoted = json.loads(base64.urlsafe_b64decode(body + "=="))
    forged = base64.urlsafe_b64encode(json.dumps(promoted | {"role": "supervisor", "sub": "Eve"}).encode()).decode()
    return [
        "", " ", "null", "a.b.c", "." * 10_000, "x" * 60_000, _unsigned(claims), _unsigned(claims) + "AAAA",
        f"{head}.{forged.rstrip('=')}.{signature}", f"{head}.{body}.", f"{head}.{body}.{signature[:-4]}AAAA",
        target.token[:-1], "\u202e",
    ]  # fmt: skip


@attack("forged, cut, unsigned and empty tokens at each door")
async def forged_tokens(target: Target) -> str:
    tried = 0
    for token in _tokens(target):
        body = json.dumps({"token": token})
        requests = (
            f"POST /api/login HTTP/1.1\r\nContent-Length: {len(body)}\r\n",
            f"GET /api/me HTTP/1.1\r\nAuthorization: Bearer {token}\r\n",
            f"POST /api/stop HTTP/1.1\r\nAuthorization: Bearer {token}\r\n",
            f"POST /api/stop HTTP/1.1\r\nAuthorization: {token}\r\n",
            f"GET /api/me HTTP/1.1\r\nCookie: robot_acp={token}\r\n",
        )
        for request in requests:
            tried += 1
            host = f"Host: {target.address[0]}\r\nConnection: close\r\n\r\n"
            status = await _status(target, (request + host + body * ("login" in request)).encode())
            if status[:1] not in ("4", ""):
                raise Broken(f"{request[:16]} answered {status} to the token {token[:40]!r}")
    return f"all {tried} refused"


async def _status(target: Target, request: bytes) -> str:
    """Send bytes; the status of the answer, empty where the connection is closed without one."""
    async with target.raw(target.address) as (reader, writer):
        try:
            async with asyncio.timeout(10):
                writer.write(request)
                await writer.drain()
                return (await reader.read(12)).decode("latin-1")[9:]
        except OSError:
            return ""
        except TimeoutError:
            return "no answer"


@attack("200 wrong logins in a row")
async def wrong_logins(target: Target) -> str:
    statuses: dict[int, int] = {}
    async with target.http() as http:
        for number in range(200):
            status = (await http.post("/api/login", json={"token": f"a.b.{number}"})).status_code
            statuses[status] = statuses.get(status, 0) + 1
            if status not in (401, 429):
                raise Broken(f"a wrong login was answered with {status}")
    if 429 not in statuses:
        raise Broken("200 wrong logins at once were not limited")
    async with target.http(target.token) as http:
        if (await http.get("/api/me")).status_code != 200:
            raise Broken("a right token is refused because of wrong ones")
    return ", ".join(f"{number} times {status}" for status, number in statuses.items())


@attack("WebSockets and requests of a foreign page, with the person's cookie")
async def foreign_origin(target: Target) -> str:
    async with target.http() as http:
        login = await http.post("/api/login", json={"token": target.token})
        if login.status_code == 429:
            raise Broken("a right token is refused because of wrong ones")
        cookie = "; ".join(f"{name}={value}" for name, value in login.cookies.items())
        for path in ("/acp", "/scene", "/scene/a", "/camera", "/scene/a/control"):
            try:
                async with target.websocket(path, None, Origin=FOREIGN, Cookie=cookie) as socket:
                    async with asyncio.timeout(5):
                        await socket.recv()
                    raise Broken(f"{path} serves a page of {FOREIGN}")
            except InvalidStatus as refusal:
                if refusal.response.status_code >= 500:
                    raise Broken(f"{path} fails at a foreign origin") from None
            except ConnectionClosed:
                pass
        for path in ("/api/stop", "/api/release", "/api/logout"):
            for origin in (FOREIGN, "null", "https://" + "a" * 10_000):
                answer = await http.post(path, headers={"Origin": origin, "Cookie": cookie})
                if answer.status_code != 403:
                    raise Broken(f"{path} answered {answer.status_code} to a foreign page")
    return "all refused"


@attack("paths out of the web app's folder")
async def paths(target: Target) -> str:
    asked = [
        "/../pyproject.toml", "/..%2f..%2fpyproject.toml", "/%2e%2e/%2e%2e/backend/cli.py", "//etc/passwd", "/;/x",
        "/%00", "/assets/../../a", "/" + "a" * 20_000, "/\\..\\a", "/assets/%2e%2e%5c", "/scene/../api/me",
        "/scene/%2e%2e%2fa",
    ]  # fmt: skip
    for path in asked:
        async with target.raw(target.address) as (reader, writer):
            writer.write(f"GET {path} HTTP/1.1\r\nHost: {target.address[0]}\r\nConnection: close\r\n\r\n".encode())
            async with asyncio.timeout(10):
                answer = await reader.read(200_000)
        if b"[project]" in answer or b"root:" in answer or b"import argparse" in answer:
            raise Broken(f"{path[:60]} is served")
        if answer.startswith(b"HTTP/1.1 5"):
            raise Broken(f"{path[:60]} fails")
    return "none is served"


@attack("requests that are no HTTP, and headers without end")
async def odd_requests(target: Target) -> str:
    host = target.address[0].encode()
    odd = [
        b"\x16\x03\x01\x02\x00", b"\x00" * 10_000, b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: " + host + b"\r\n" + b"X: y\r\n" * 20_000 + b"\r\n",
        b"GET / HTTP/1.1\r\nHost: " + host + b"\r\nX: " + b"y" * 2_000_000 + b"\r\n\r\n",
        b"POST /api/login HTTP/1.1\r\nHost: " + host + b"\r\nContent-Length: -1\r\n\r\n",
        b"POST /api/login HTTP/1.1\r\nHost: " + host + b"\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n",
        b"POST /api/login HTTP/1.1\r\nHost: " + host
        + b"\r\nContent-Length: 2\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: " + host + b"\r\nRange: bytes=" + b"0-1," * 10_000 + b"\r\n\r\n",
        b"GET /acp HTTP/1.1\r\nHost: " + host + b"\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
        b"GET /api/me HTTP/1.1\r\nHost: " + host + b"\r\nCookie: " + b"robot_acp=a; " * 4_000 + b"\r\n\r\n",
    ]  # fmt: skip
    statuses: set[str] = set()
    for request in odd:
        status = await _status(target, request)
        statuses.add(status or "a closed connection")
        if status.startswith("5"):
            raise Broken(f"{request[:60]!r} is answered with {status}")
    return "answered with " + ", ".join(sorted(statuses))


@attack("frames to the scene, the camera and their controls")
async def scene(target: Target) -> str:
    served = 0
    for path in ("/scene", "/scene/attack", "/camera", "/scene/attack/control"):
        with contextlib.suppress(ConnectionClosed, InvalidStatus):
            async with target.websocket(path, target.token) as socket:
                served += 1
                for frame in (b"\x00" * 100_000, "{}", "[" * 10_000, '{"type":"ShareUrlRequest"}', "x" * 1_000_000):
                    for _ in range(200):
                        await socket.send(frame)
    return f"{served} of 4 opened"
