"""docs/conformance.md says what the cases say, and the cases cover what the issue of the protocol lists."""

from __future__ import annotations

import importlib

from tests.conformance import table

REQUIRED = {
    *("initialize", "authenticate", "logout", "session/new", "session/load", "session/resume", "session/list"),
    *("session/fork", "session/close", "session/delete", "session/cancel", "session/set_mode", "session/set_model"),
    *(f"session/prompt {kind}" for kind in ("text", "image", "resource", "resource_link")),
    *(f"session/set_config_option {option}" for option in ("mode", "model", "thought", "motion_asks")),
    *(f"available command /{name}" for name in ("stop", "home", "where", "battery", "photo", "places", "export")),
    *(
        f"session/update {kind}"
        for kind in (
            *("user_message_chunk", "agent_message_chunk", "agent_thought_chunk", "tool_call", "tool_call_update"),
            *("plan", "available_commands_update", "current_mode_update", "config_option_update"),
            *("session_info_update", "usage_update"),
        )
    ),
    *("session/request_permission", "elicitation/create", "fs/write_text_file"),
    *("$/cancel_request to the agent", "$/cancel_request to the client"),
    *("_robot/telemetry", "_robot/people", "_robot/stop", "_robot/release", "_robot/take_over"),
    *("_robot/abilities", "_robot/leave"),
}


def test_the_table_in_docs_is_up_to_date() -> None:
    assert table.DOCUMENT.read_text() == table.rendered(), "run `python -m tests.conformance.table`"


def test_every_operation_has_a_case() -> None:
    modules = [importlib.import_module(f"tests.conformance.{name}") for name in table.MODULES]
    claims = [operations for module in modules for _, operations in table.cases(module)]
    assert all(claims)
    shown = {operation for operations in claims for operation in operations}
    assert shown >= REQUIRED
