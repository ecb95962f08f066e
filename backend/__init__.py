"""robot-acp: a robot's LLM agent, reached by people through ACP and reaching the robot through MCP.

Three layers, `bridge`, `agent` and `mcp_robot`, run as processes of their own and never import each other.
They share only the small modules of this folder: `config`, `identity`, `wire` and `telemetry`.
"""

__version__ = "0.1.0"
