"""A web page of somebody else, on an origin of its own, that uses the robot with the official TypeScript SDK.

It logs in with a token as a WebSocket subprotocol, and the bridge's settings name its origin: no cookie, and none of
our code.
"""

from __future__ import annotations

from pathlib import Path

from backend.identity import Role
from tests.conformance.papers_session import run_the_papers_session
from tests.conformance.sdk_clients import TypeScriptInPage, page_of_another_site
from tests.end_to_end.conftest import Opener
from tests.processes import Robot


async def test_the_typescript_sdk_in_chromium_runs_the_papers_session(tmp_path: Path, open_page: Opener) -> None:
    folder = tmp_path / "page"
    folder.mkdir()
    with page_of_another_site(folder) as origin:
        robot = Robot(tmp_path / "data", {"ROBOT_ACP_BRIDGE__ALLOWED_ORIGINS": f'["{origin}"]'})
        with robot.at_work("--time-scale", "4"):
            page = await open_page(origin)
            address = f"ws://127.0.0.1:{robot.bridge_port}/acp"
            client = await TypeScriptInPage.open(page, address, robot.token("Ana", Role.SUPERVISOR))
            await run_the_papers_session(client, robot, "Ana")
