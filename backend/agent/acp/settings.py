"""The settings of a session (mode, model, first thought, ask before driving) as ACP publishes them: as modes, as
config options, and as the `models` of older clients. Also the cursor of the session list.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from backend import meta as keys
from backend.agent.acp import updates
from backend.agent.control.policy import MODE_IDS, MODES
from backend.agent.sessions.session import Session
from backend.agent.sessions.store import SessionRow


def state(session: Session, models: Sequence[str]) -> dict[str, Any]:
    """The settings as the answers to `session/new`, `session/load` and their like contain them."""
    current = session.row.model
    return {
        "modes": {
            "currentModeId": session.row.mode,
            "availableModes": [{"id": m.id, "name": m.name, "description": m.description} for m in MODES],
        },
        "configOptions": config_options(session, models),
        "models": {
            "currentModelId": current,
            "availableModels": [{"modelId": name, "name": name} for name in _with(models, current)],
        },
        "_meta": {keys.REMEMBERED: session.remembered},
    }


def config_options(session: Session, models: Sequence[str]) -> list[dict[str, Any]]:
    """All settings with their values."""
    return [
        {
            "id": "mode",
            "name": "Mode",
            "category": "mode",
            "type": "select",
            "currentValue": session.row.mode,
            "options": [{"value": m.id, "name": m.name, "description": m.description} for m in MODES],
        },
        {
            "id": "model",
            "name": "Model",
            "category": "model",
            "type": "select",
            "currentValue": session.row.model,
            "options": [{"value": name, "name": name} for name in _with(models, session.row.model)],
        },
        {
            "id": "thought",
            "name": "First thought",
            "description": "Say in a sentence what is about to be done.",
            "category": "thought_level",
            "type": "boolean",
            "currentValue": session.row.thought,
        },
        {
            "id": "motion_asks",
            "name": "Ask before driving",
            "description": "Motion asks a person first, also where the mode lets it go.",
            "type": "boolean",
            "currentValue": session.row.motion_asks,
        },
    ]


def change(session: Session, config_id: str, value: object, models: Sequence[str]) -> list[updates.Update]:
    """Set an option and return the updates to be recorded. Raises `ValueError` with the values that can be chosen."""
    changed: list[updates.Update] = []
    if config_id == "mode":
        if value not in MODE_IDS:
            raise ValueError(f"There is no such mode. Modes: {', '.join(m.id for m in MODES)}.")
        session.change(mode=value)
        changed.append(updates.current_mode(str(value)))
    elif config_id == "model":
        if value not in models:
            raise ValueError(f"There is no such model. Models: {', '.join(models)}.")
        session.change(model=value)
    elif config_id in ("thought", "motion_asks"):
        if not isinstance(value, bool):
            raise ValueError(f"The setting {config_id} is true or false.")
        session.change(**{config_id: value})
    else:
        raise ValueError("There is no such setting. Settings: mode, model, thought, motion_asks.")
    return [*changed, updates.config_options(config_options(session, models))]


def iso(time: float) -> str:
    """Unix seconds as ISO 8601 in UTC."""
    return datetime.fromtimestamp(time, UTC).isoformat()


def cursor_behind(row: SessionRow) -> str:
    """The cursor of the page that begins behind this session."""
    return base64.urlsafe_b64encode(f"{row.updated!r} {row.id}".encode()).decode()


def read_cursor(cursor: str | None) -> tuple[float, str] | None:
    """The time and the session id in a cursor of `cursor_behind`; None, for the first page, for any other text."""
    if cursor is None:
        return None
    try:
        updated, session_id = base64.urlsafe_b64decode(cursor).decode().split(" ")
        return float(updated), session_id
    except ValueError:
        return None


def _with(models: Sequence[str], current: str) -> list[str]:
    return list(dict.fromkeys([*models, current]))
