"""Supervisors make logins in the dashboard, hand them over, and end them; with the keyboard alone, and on a phone."""

from __future__ import annotations

import re
from pathlib import Path

from playwright.async_api import Page, expect

from backend.identity import Role
from tests.end_to_end.conftest import Opener, Running
from tests.end_to_end.test_people import login, press, violations

PHONE = {"width": 390, "height": 844}


async def seen(page: Page, name: str, pictures: Path) -> None:
    """Nothing is wider than the window, no rule of accessibility is broken, and there is a picture of it."""
    await page.screenshot(path=pictures / f"{name}.png")
    assert await page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    wider = "box => box.scrollWidth <= box.clientWidth"
    assert await page.get_by_role("dialog").or_(page.get_by_role("alertdialog")).last.evaluate(wider)
    assert await violations(page) == []


async def opened(page: Page) -> None:
    """The dialog, from the account's menu or from the settings of a smaller screen."""
    account = page.get_by_role("button", name=re.compile("You are"))
    settings = page.get_by_role("button", name="Settings")
    await press(page, account.or_(settings))
    await press(page, page.get_by_test_id("open-logins"))
    await expect(page.get_by_role("dialog", name="Logins")).to_be_visible()
    await expect(page.get_by_role("heading", name="Logins")).to_be_focused()
    await expect(page.get_by_test_id("login-row").first).to_be_visible()


async def test_a_login_is_made_works_in_another_page_and_ends_it_when_it_is_revoked(
    up: Running, open_plain: Opener, pictures: Path
) -> None:
    sue = await open_plain(login(up, "Sue", Role.SUPERVISOR))
    await opened(sue)
    await expect(sue.locator('[data-testid="login-row"][data-name="Sue"]')).to_contain_text("you, on this page")
    await press(sue, sue.get_by_test_id("login-new"))
    await sue.get_by_label("Name").fill("Guest at the door")
    await sue.get_by_role("radio", name=re.compile("operator")).press("Space")
    await sue.get_by_label("How long").select_option("1 day")
    await seen(sue, "logins-form", pictures)
    await press(sue, sue.get_by_test_id("login-create"))
    await expect(sue.get_by_role("dialog", name="The new login")).to_contain_text("Guest at the door, operator")
    address = await sue.get_by_test_id("login-address").input_value()
    token = await sue.get_by_test_id("login-token").input_value()
    assert address == f"{up.base}/#token={token}"
    await seen(sue, "logins-made", pictures)
    await press(sue, sue.get_by_test_id("login-done"))
    assert token not in await sue.content()

    guest = await open_plain(address)
    await expect(guest.get_by_role("button", name="You are Guest at the door, operator")).to_be_visible()
    await expect(guest.get_by_test_id("robot-state")).to_contain_text("ready")
    await press(guest, guest.get_by_role("button", name=re.compile("You are")))
    await expect(guest.get_by_role("menuitem", name="Log out")).to_be_visible()
    await expect(guest.get_by_test_id("open-logins")).to_have_count(0)

    row = sue.locator('[data-testid="login-row"][data-name="Guest at the door"]')
    await expect(row).to_contain_text("operator")
    await press(sue, row.get_by_test_id("login-revoke"))
    question = sue.get_by_role("alertdialog", name="Revoke this login?")
    await expect(question).to_contain_text("Guest at the door is logged out at once")
    await expect(question.get_by_role("button", name="Keep")).to_be_focused()
    await expect(guest.get_by_test_id("robot-state")).to_be_visible()
    await press(sue, sue.get_by_test_id("login-revoke-confirm"))
    await expect(row).to_have_attribute("data-state", "revoked")
    await expect(guest.get_by_test_id("login-problem")).to_contain_text("Your login has ended")
    await guest.goto(address)
    await guest.reload()
    await expect(guest.get_by_test_id("login-problem")).to_be_visible()

    await sue.keyboard.press("Escape")
    await expect(sue.get_by_role("dialog")).to_have_count(0)
    await expect(sue.get_by_role("button", name=re.compile("You are"))).to_be_focused()


async def test_on_a_phone_in_the_dark_and_one_s_own_login(up: Running, open_plain: Opener, pictures: Path) -> None:
    up.robot.token("Ana with a very long name of sixty letters, as many as may be", Role.OPERATOR)
    page = await open_plain(
        login(up, "Olga", Role.SUPERVISOR), viewport=PHONE, has_touch=True, color_scheme="dark", locale="en-GB"
    )
    await opened(page)
    await seen(page, "logins-phone", pictures)
    await expect(page.locator("button.stop")).to_be_visible()
    await page.get_by_test_id("login-new").tap()
    await page.get_by_label("Name").fill("olga")
    await expect(page.get_by_text("There is Olga already (supervisor).")).to_be_visible()
    await expect(page.get_by_test_id("login-create")).to_be_disabled()
    await page.get_by_test_id("login-same-person").tap()
    await seen(page, "logins-phone-form", pictures)
    await page.get_by_test_id("login-create").tap()
    await expect(page.get_by_test_id("login-token")).to_be_visible()
    await page.get_by_test_id("login-token-copy").tap()
    await seen(page, "logins-phone-made", pictures)
    await page.get_by_test_id("login-done").tap()
    own = page.locator('[data-testid="login-row"]', has_text="you, on this page")
    await own.get_by_test_id("login-revoke").tap()
    await expect(page.get_by_role("alertdialog")).to_contain_text("This is the login that you use now, Olga.")
    await seen(page, "logins-phone-own", pictures)
    await page.get_by_test_id("login-revoke-confirm").tap()
    await expect(page.get_by_test_id("login-problem")).to_contain_text("Your login has ended")
