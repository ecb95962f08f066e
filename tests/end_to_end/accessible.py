"""What every state of every screen is held to: axe-core's rules for WCAG 2.2 A and AA, and what no rule sees.

A test brings a state about and calls `accessible`, or `everywhere` for all sizes and both colour schemes. It changes
nothing on the page but the size of the window and the colours.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from playwright.async_api import Page, expect

from tests.deep import DEEP

AXE = Path(__file__).parents[2] / "web/node_modules/axe-core/axe.min.js"
LEVELS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]

WIDE = {"width": 1440, "height": 900}
TABLET = {"width": 820, "height": 1180}
PHONE = {"width": 390, "height": 844}
USUAL = (WIDE, TABLET, PHONE) if DEEP else (WIDE, PHONE)

OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
TARGETS = ":is(button, input):visible"
SIZES = """all => all.map((one) => {
  // A box to tick, or a field, and the label around it are one target.
  const target = one.getAttribute('role') === 'checkbox' ? one.parentElement : one.closest('label') ?? one;
  return [one.outerHTML.slice(0, 120), target.offsetWidth, target.offsetHeight];
})"""


PAINTED = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done))))"


async def accessible(page: Page, state: str, *, stop: bool = True, smallest: int = 0, rules: str = "") -> None:
    """No rule is broken, nothing is wider than the screen, Stop is in sight, and every target is large enough.

    `rules` names the one rule to look at, for what was looked at with all of them a moment before.
    """
    broken = await violations(page, rules)
    assert broken == [], f"{state}: {broken}"
    assert await page.evaluate(OVERFLOW) == 0, f"{state}: wider than the screen"
    if stop:
        await expect(page.get_by_test_id("stop")).to_be_in_viewport(ratio=1)
    sizes = await page.locator(TARGETS).evaluate_all(SIZES)
    small = [size for size in sizes if min(size[1:]) < smallest]
    assert small == [], f"{state}: {small}"


async def violations(page: Page, rules: str = "") -> list[tuple[str, list[Any]]]:
    """The rules that the page breaks, with the elements that do; what is in frames (viser's page) is not ours."""
    await page.evaluate(f"() => {{ if (window.axe === undefined) {{ {AXE.read_text()} }} }}")
    only = {"type": "rule", "values": [rules]} if rules else {"type": "tag", "values": LEVELS}
    options = {"runOnly": only, "iframes": False, "resultTypes": ["violations"]}
    found = await page.evaluate(f"axe.run(document, {json.dumps(options)})")
    return [(rule["id"], [told(node) for node in rule["nodes"]]) for rule in found["violations"]]


def told(node: dict[str, Any]) -> str:
    reasons = [check["message"] for check in (*node["any"], *node["all"], *node["none"])]
    return f"{node['html'][:200]}: {'; '.join(reasons)}"


async def everywhere(page: Page, state: str, *sizes: dict[str, int], stop: bool = True) -> None:
    """`accessible` in each of the sizes, light and dark; where none is given, on a wide screen and on a phone, and in
    a deep run on a tablet, too.

    Colours alone differ between the two, so that the second look is for contrast alone. Motion is off, or a colour
    on its way to another would be measured.
    """
    for size in sizes or USUAL:
        await page.set_viewport_size(size)
        await page.evaluate(PAINTED)  # the layout has followed
        for scheme, rules in (("light", ""), ("dark", "color-contrast")):
            await page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
            where = f"{state}, {size['width']} px, {scheme}"
            await accessible(page, where, stop=stop, rules=rules)
