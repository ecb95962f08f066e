"""The layers share only the small modules at the top of `backend/`; they never import each other."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

BACKEND = Path(__file__).parent.parent / "backend"
LAYERS = ("bridge", "agent", "mcp_robot", "chat", "gateway")
ENTRY_POINTS = {"cli.py", "doctor.py", "up.py"}


def imported(file: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file} has a relative import, which this test cannot read"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def layer_of(name: str) -> str | None:
    parts = name.split(".")
    return parts[1] if parts[0] == "backend" and len(parts) > 1 and parts[1] in LAYERS else None


@pytest.mark.parametrize("layer", LAYERS)
def test_a_layer_imports_no_other_layer(layer: str) -> None:
    files = sorted((BACKEND / layer).rglob("*.py"))
    assert files
    for file in files:
        assert {layer_of(name) for name in imported(file)} <= {layer, None}, file


def test_what_the_layers_share_imports_none_of_them() -> None:
    shared = [file for file in BACKEND.glob("*.py") if file.name not in ENTRY_POINTS]
    assert {"config.py", "identity.py", "telemetry.py", "wire.py"} <= {file.name for file in shared}
    for file in shared:
        assert {layer_of(name) for name in imported(file)} == {None} or not imported(file), file
