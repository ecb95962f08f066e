"""The MCP tools of the robot. catalogue.py lists them, and says where a tool is added."""
