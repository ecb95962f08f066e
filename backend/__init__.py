"""robot-acp: a robot's LLM agent. People reach it through ACP, and it reaches the robot through MCP.

Three layers, `bridge`, `agent` and `mcp_robot`, run as processes of their own and never import each other. They share
only the modules of this folder, such as `config`, `identity`, `wire` and `telemetry`.
"""

__version__ = "0.1.0"
