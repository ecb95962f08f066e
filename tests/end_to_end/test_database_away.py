"""The database of sessions is away: dashboard and kiosk say just that, until it is back."""

from __future__ import annotations

from pathlib import Path

from playwright.async_api import expect

from backend.identity import Role
from tests.databases import SQLite
from tests.end_to_end import screens
from tests.end_to_end.conftest import Opener, at_work
from tests.end_to_end.test_people import ask, login
from tests.processes import Robot


async def test_a_band_says_that_conversations_cannot_be_kept_and_goes_away_by_itself(
    tmp_path: Path, open_plain: Opener
) -> None:
    database = SQLite(tmp_path / "sessions.db")
    with at_work(Robot(tmp_path, {"ROBOT_ACP_AGENT__DATABASE": database.url})) as up:
        page = await open_plain(login(up, "Ana", Role.OPERATOR))
        kiosk = await open_plain(f"{up.base}/kiosk#token={up.robot.token('Kiosk', Role.VISITOR)}")
        await screens.online(page)
        await ask(page, "where are you?")
        await screens.idle(page)
        with database.away():
            await ask(page, "where are you?")
            await expect(page.get_by_test_id("database-band")).to_contain_text("conversations cannot be kept or opened")
            await expect(kiosk.get_by_test_id("kiosk-database")).to_contain_text("cannot take requests just now")
            for band in ("connection-band", "robot-band", "silent-band"):
                await expect(page.get_by_test_id(band)).to_have_count(0)
            await expect(page.get_by_test_id("robot-state")).to_contain_text("ready")
        await expect(page.get_by_test_id("database-band")).to_have_count(0)
        await expect(kiosk.get_by_test_id("kiosk-database")).to_have_count(0)
