"""Every `_meta` key of ours is written once in the code and explained in docs/."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from backend import meta

ROOT = Path(__file__).parent.parent
KEYS = {value for name, value in vars(meta).items() if name.isupper() and name not in ("CAPABILITIES", "PREFIX")}


def strings(file: Path) -> set[str]:
    return {
        node.value
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


def test_a_key_is_written_in_one_file_only() -> None:
    files = [file for file in (ROOT / "backend").rglob("*.py") if file.name != "meta.py"]
    assert len(files) > 100
    for file in files:
        assert not [text for text in strings(file) if text.startswith(meta.PREFIX)], file


def test_every_key_is_explained_and_every_key_that_is_explained_exists() -> None:
    page = (ROOT / "docs" / "extensions.md").read_text()
    assert set(re.findall(r"robot-acp/[a-z_-]+", page)) == KEYS
