"""Settings: one commented `robot.toml`, overridden by `ROBOT_ACP_*` variables, then by command-line flags.

Nested names use two underscores: `ROBOT_ACP_AGENT__MODEL=…` is `model` under `[agent]`. An unknown name is an
error, never ignored: a typing mistake in a speed limit must not pass.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

DEFAULT_FILE = Path("robot.toml")
Decision = Literal["allow", "ask", "deny"]


class ConfigError(Exception):
    """A setting is wrong; the text names it, says what is wrong and where it was read."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Limits(_Section):
    """What the robot may do at most; SI units."""

    max_speed: float = Field(0.6, gt=0, le=3)
    max_turn_rate: float = Field(1.2, gt=0, le=4)
    max_acceleration: float = Field(0.8, gt=0, le=5)
    max_turn_acceleration: float = Field(2.5, gt=0, le=10)
    braking: float = Field(4.0, gt=0, le=10, description="deceleration when it has to stop, m/s^2")
    battery_floor: float = Field(0.10, ge=0, lt=1, description="refuse motion below, except to a dock")
    max_speech_chars: int = Field(400, gt=0, le=4000)


class Robot(_Section):
    """The robot server."""

    name: str = Field("Sancho", min_length=1, max_length=40)
    host: str = "127.0.0.1"
    port: int = Field(8000, ge=0, le=65535)
    world: str = Field("office", description="a built-in world, or the path of a folder with map.yaml and places.yaml")
    time_scale: float = Field(1.0, gt=0, le=100)
    seed: int = 0
    limits: Limits = Limits()


class Agent(_Section):
    """The ACP agent."""

    host: str = "127.0.0.1"
    port: int = Field(9100, ge=0, le=65535)
    model: str = Field("offline/commands", min_length=1, description="any litellm model name")
    models: list[str] = Field([], description="further models that people may choose")
    robot_url: str | None = Field(None, description="another MCP server: URL or stdio:COMMAND")
    database: str | None = Field(None, description="SQLAlchemy URL; default: SQLite in the data folder")
    trust_loopback: bool = True
    default_mode: str = "supervised"
    permission_timeout: float = Field(60.0, gt=0, description="seconds; no answer in time is a refusal")
    thought_timeout: float = Field(5.0, gt=0, description="seconds that acting waits for the first thought")
    max_steps: int = Field(40, gt=0, description="inferences a turn")
    pose_tool: str = Field("get_current_pose", description="tool that tells where a session started")
    unattended_after: float = Field(45.0, ge=0, description="seconds without anybody who may operate; 0 is never")
    four_eyes: list[str] = Field([], description="tools that somebody else than the asker must approve")
    policy: dict[str, dict[str, Decision]] = Field({}, description="mode -> tool -> allow, ask or deny")
    visitors: dict[str, Decision] = Field({}, description="tool -> what a visitor's prompt may do at most")


class Bridge(_Section):
    """The web side."""

    host: str = "127.0.0.1"
    port: int = Field(8080, ge=0, le=65535)
    agent: str | None = Field(None, description="tcp://HOST:PORT or stdio:COMMAND; default: the [agent] address")
    robot_url: str | None = Field(None, description="base URL of the robot server; default: the [robot] address")
    allowed_origins: list[str] = Field([], description="further origins; the bridge's own is always allowed")
    max_frame_bytes: int = Field(16 * 1024 * 1024, gt=1024)
    max_connections: int = Field(512, gt=0)


class Settings(BaseSettings):
    """All settings of one robot, frozen once read."""

    model_config = SettingsConfigDict(env_prefix="ROBOT_ACP_", env_nested_delimiter="__", extra="forbid", frozen=True)
    toml_file: ClassVar[Path | None] = None

    data_dir: Path = Field(default_factory=lambda: _default_data_dir())
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    robot: Robot = Robot()
    agent: Agent = Agent()
    bridge: Bridge = Bridge()

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Flags first, then variables, then the file."""
        return init_settings, env_settings, TomlConfigSettingsSource(settings_cls, cls.toml_file)

    @property
    def robot_base_url(self) -> str:
        """Base URL of the robot server: `/mcp`, `/telemetry`, `/stop` and `/health` lie below it."""
        return self.bridge.robot_url or f"http://{self.robot.host}:{self.robot.port}"

    @property
    def robot_mcp_url(self) -> str:
        """Where the agent finds the robot's tools."""
        return self.agent.robot_url or f"http://{self.robot.host}:{self.robot.port}/mcp"

    @property
    def agent_address(self) -> str:
        """Where the bridge finds the agent: `tcp://HOST:PORT` or `stdio:COMMAND`."""
        return self.bridge.agent or f"tcp://{self.agent.host}:{self.agent.port}"

    @property
    def database_url(self) -> str:
        """SQLAlchemy URL of the session log."""
        return self.agent.database or f"sqlite:///{self.data_dir / 'sessions.db'}"


def _default_data_dir() -> Path:
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "robot-acp"


def load(file: Path | None = None, **flags: Any) -> Settings:
    """Read the settings. `flags` override all else, as nested dicts: `load(robot={"time_scale": 5})`.

    Without `file`, `ROBOT_ACP_CONFIG` names it, or `robot.toml` of the current folder is read where it exists.
    Raises `ConfigError`.
    """
    named = file or (Path(os.environ["ROBOT_ACP_CONFIG"]) if "ROBOT_ACP_CONFIG" in os.environ else None)
    path = named or DEFAULT_FILE
    if named and not named.is_file():
        raise ConfigError(f"There is no settings file {named}.")

    class _Bound(Settings):
        toml_file = path if path.is_file() else None

    try:
        return _Bound(**flags)
    except ValidationError as error:
        lines = [f"  {'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors()]
        where = f" ({path}, ROBOT_ACP_* or flags)"
        raise ConfigError("Settings that cannot be used" + where + ":\n" + "\n".join(lines)) from None
    except ValueError as error:  # a malformed TOML file
        raise ConfigError(f"{path} cannot be read: {error}") from None
