"""Who may import whom: the layers each other never, the rooms of the agent only as the table here says.

An import for type checkers alone, or within a function, counts like any other.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

BACKEND = Path(__file__).parent.parent / "backend"
LAYERS = ("bridge", "agent", "mcp_robot", "chat", "gateway")
ENTRY_POINTS = {"cli.py", "doctor.py", "sessions_command.py", "up.py"}
SHARED = {"config.py", "dial.py", "identity.py", "meta.py", "stdio.py", "streams.py", "telemetry.py", "wire.py"}

ROOMS: dict[str, set[str]] = {
    "server": {"wiring", "acp", "sessions", "turns", "control", "robot"},
    "wiring": {"acp.abilities", "acp.people", "acp.request_limits", "sessions", "turns", "robot"},
    "acp": {"wiring", "sessions", "turns", "control", "robot"},
    "turns": {"acp.updates", "acp.commands", "acp.export", "sessions", "control", "robot", "offline"},
    "control": {"acp.updates", "turns.phases", "sessions", "robot"},
    "sessions": {"acp.updates", "control.approvers", "robot"},
    "robot": {"control.policy"},
    "offline": {"sessions.history", "turns.model", "turns.prompts"},
}
"""Room of the agent -> the other rooms, or the single files of them, that its files may import.

`acp.updates` is the vocabulary of session updates, which all may use. Beside it, only turns know files of `acp`.
"""


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
    assert {file.name for file in shared} >= SHARED
    for file in shared:
        assert {layer_of(name) for name in imported(file)} == {None} or not imported(file), file


def module_of(file: Path) -> str:
    """The module without `backend.agent`, as in `acp.updates`."""
    return ".".join(file.relative_to(BACKEND / "agent").with_suffix("").parts)


def agent_imports() -> dict[str, set[str]]:
    """Module of the agent -> the modules of the agent that it imports."""
    files = [file for file in (BACKEND / "agent").rglob("*.py") if file.name != "__init__.py"]
    modules = {module_of(file) for file in files}

    def within_agent(file: Path) -> Iterator[str]:
        for name in imported(file):
            inner = name.removeprefix("backend.agent.")
            if inner != name:
                module = inner if inner in modules else inner.rpartition(".")[0]
                assert module in modules, f"{file} imports {name}"
                yield module

    return {module_of(file): set(within_agent(file)) for file in files}


def test_the_files_of_the_agent_import_each_other_in_no_circle() -> None:
    try:
        order = list(TopologicalSorter(agent_imports()).static_order())
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' -> '.join(reversed(error.args[1]))}")
    assert order[-1] == "server"


def test_the_rooms_of_the_agent_import_only_what_the_table_says() -> None:
    imports = agent_imports()
    assert {module.split(".")[0] for module in imports} == set(ROOMS)
    for importer, targets in imports.items():
        room = importer.split(".")[0]
        for target in targets:
            allowed = target.split(".")[0] in ROOMS[room] | {room} or target in ROOMS[room]
            assert allowed, f"backend.agent.{importer} imports backend.agent.{target}: see ROOMS in this file"
