"""The answer to `initialize`: what this agent can do, and who it takes the client for. It decides nothing."""

from __future__ import annotations

from acp.schema import (
    AgentCapabilities,
    AuthMethodAgent,
    Implementation,
    InitializeResponse,
    McpCapabilities,
    PromptCapabilities,
    SessionCapabilities,
)

from backend import __version__
from backend import meta as keys
from backend.agent.acp.extensions import EXTENSIONS
from backend.agent.wiring import Wiring
from backend.identity import Identity

PROTOCOL_VERSION = 1


def hello(wiring: Wiring, who: Identity | None) -> InitializeResponse:
    """The answer to `who`, None before the login."""
    robot = wiring.settings.robot.name
    about = {"extensions": list(EXTENSIONS), "robot": robot}
    if who:
        about |= {"role": who.role.value, "name": who.name}
    return InitializeResponse(
        protocol_version=PROTOCOL_VERSION,
        agent_info=Implementation(name="robot-acp", title=robot, version=__version__),
        auth_methods=[AuthMethodAgent(id="token", name="Login token", description="Ask the robot's operator.")],
        agent_capabilities=AgentCapabilities(
            load_session=True,
            prompt_capabilities=PromptCapabilities(image=True, audio=False, embedded_context=True),
            mcp_capabilities=McpCapabilities(http=bool(wiring.offers), sse=False),
            session_capabilities=SessionCapabilities.model_validate(
                {"list": {}, "resume": {}, "fork": {}, "close": {}, "delete": {}}
            ),
            field_meta={keys.CAPABILITIES: about},
        ),
    )
