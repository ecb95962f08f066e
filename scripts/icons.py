"""Draws the icons of the installed app from web/public/favicon.svg, the sign of robot-acp. Nothing else makes them.

Run `.venv/bin/python scripts/icons.py` after a change of the sign, and commit what it made.
"""

from __future__ import annotations

import asyncio
import io
import os
import re
from pathlib import Path

from PIL import Image
from playwright.async_api import Page, async_playwright

PUBLIC = Path(__file__).parent.parent / "web" / "public"
SHAPES = {"icon-192.png": (192, "any"), "icon-512.png": (512, "any")} | {
    "maskable-192.png": (192, "maskable"),
    "maskable-512.png": (512, "maskable"),
    "apple-touch-icon.png": (180, "maskable"),
}
"""File, edge in px, and whether a system cuts its own shape out of it."""


def mark(kind: str) -> str:
    """The sign; for a system that cuts its own shape, with a ground without corners and all within its safe circle."""
    svg = (PUBLIC / "favicon.svg").read_text()
    if kind == "maskable":
        # That circle is 80 % of the edge, and the ring of the sign 58 %.
        svg = re.sub(r' rx="[^"]*"', "", svg)
    return svg


async def draw(page: Page, kind: str, edge: int) -> Image.Image:
    await page.set_viewport_size({"width": edge, "height": edge})
    style = f"<style>body {{ margin: 0 }} svg {{ display: block; width: {edge}px; height: {edge}px }}</style>"
    await page.set_content(style + mark(kind))
    return Image.open(io.BytesIO(await page.screenshot(omit_background=True)))


async def main() -> None:
    async with async_playwright() as playwright:
        chromium = os.environ.get("ROBOT_ACP_TEST_CHROMIUM") or None
        browser = await playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = await browser.new_page()
        for name, (edge, kind) in SHAPES.items():
            picture = (await draw(page, kind, edge)).convert("RGB" if kind == "maskable" else "RGBA")
            picture.quantize(64, dither=Image.Dither.NONE).save(PUBLIC / name, optimize=True)
            print(f"web/public/{name}: {edge} px, {(PUBLIC / name).stat().st_size} bytes")
        await browser.close()


if __name__ == "__main__":
    asyncio.run(main())
