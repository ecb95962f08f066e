"""The web app's files, and the headers around them."""

from __future__ import annotations

import asyncio
import gzip
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from backend.bridge.app import create_app

INDEX = "<!doctype html><title>robot-acp</title><script src=/assets/app-1a2b.js></script>"
SCRIPT = "console.log('hello');" * 200


@pytest.fixture
def dist(tmp_path: Path) -> Path:
    folder = tmp_path / "dist"
    (folder / "assets").mkdir(parents=True)
    (folder / "index.html").write_text(INDEX)
    (folder / "icon.svg").write_text("<svg/>")
    (folder / "assets" / "app-1a2b.js").write_text(SCRIPT)
    (tmp_path / "secret.txt").write_text("not for the web")
    return folder


@pytest.fixture
def web(settings_for, dist):
    """A client of the application itself."""
    application = create_app(settings_for(), dist)
    transport = httpx.ASGITransport(application)
    return httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1", headers={"Accept-Encoding": "x"})


@pytest.mark.parametrize("path", ["/", "/kiosk", "/sessions/s1", "/index.html"])
async def test_every_page_is_the_app_and_is_asked_for_anew(web, path):
    response = await web.get(path)
    assert (response.status_code, response.text) == (200, INDEX)
    assert response.headers["cache-control"] == "no-cache"
    assert response.headers["content-type"].startswith("text/html")
    again = await web.get(path, headers={"If-None-Match": response.headers["etag"]})
    assert again.status_code == 304


async def test_assets_with_a_hash_in_their_name_are_kept_for_long(web):
    response = await web.get("/assets/app-1a2b.js")
    assert response.text == SCRIPT
    assert response.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert "javascript" in response.headers["content-type"]


async def test_text_is_compressed_for_those_who_take_it(web):
    async with web.stream("GET", "/assets/app-1a2b.js", headers={"Accept-Encoding": "gzip"}) as response:
        raw = b"".join([chunk async for chunk in response.aiter_raw()])
    assert response.headers["content-encoding"] == "gzip"
    assert response.headers["vary"] == "Accept-Encoding"
    assert len(raw) == int(response.headers["content-length"]) < 300
    assert gzip.decompress(raw).decode() == SCRIPT


@pytest.mark.parametrize("path", ["/assets/gone.js", "/assets/gone", "/favicon.ico", "/robots.txt"])
async def test_a_file_that_is_not_there_is_not_the_app(web, path):
    assert (await web.get(path)).status_code == 404


@pytest.mark.parametrize("path", ["/api", "/api/", "/api/nothing"])
async def test_an_unknown_api_address_is_not_the_app_either(web, path):
    response = await web.get(path)
    assert response.status_code == 404
    assert response.json() == {"error": "There is no such address."}


@pytest.mark.parametrize("path", ["/../secret.txt", "/%2e%2e/secret.txt", "/assets/..%2f..%2fsecret.txt", "/%00"])
async def test_nothing_outside_the_build_is_served(web, path):
    response = await web.get(path)
    assert "not for the web" not in response.text


async def test_a_missing_build_says_what_to_do_and_a_later_one_is_served(web, dist):
    page = dist / "index.html"
    page.rename(dist / "away")
    response = await web.get("/")
    assert response.status_code == 503
    assert "The web app is not built." in response.text
    assert "./run.sh" in response.text
    (dist / "away").rename(page)
    assert (await web.get("/")).status_code == 200


async def test_every_answer_carries_the_headers_that_protect_it(web):
    for path in ("/", "/assets/app-1a2b.js", "/api/me", "/nothing.txt"):
        headers = (await web.get(path)).headers
        policy = headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "script-src 'self';" in policy
        assert "frame-ancestors 'self'" in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "SAMEORIGIN"
        assert headers["referrer-policy"] == "no-referrer"


async def test_a_name_that_is_not_ours_gets_nothing(web):
    response = await web.get("/", headers={"Host": "evil.example"})
    assert response.status_code == 421
    assert INDEX not in response.text


def test_viser_is_not_imported_before_the_first_page_can_be_served():
    check = "import sys, backend.bridge.server; sys.exit('viser' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", check]).returncode == 0


async def test_the_pages_are_there_while_the_scene_still_starts(bridge_with, monkeypatch):
    holding = asyncio.Event()

    async def never(*_):
        await holding.wait()

    monkeypatch.setattr("backend.bridge.scene.scene.Scene.run", never)
    async with bridge_with() as bridge, bridge.http() as http:
        assert (await http.get("/api/health")).status_code == 200
