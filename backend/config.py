"""Settings: one commented `robot.toml`, overridden by `ROBOT_ACP_*` variables, which command-line flags override.

Nested names use two underscores: `ROBOT_ACP_AGENT__MODEL=…` is `model` under `[agent]`. An unknown name is an error and
must never be ignored: a typing mistake in a speed limit must not pass.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from backend import addresses, robot_address

DEFAULT_FILE = Path("robot.toml")
Decision = Literal["allow", "ask", "deny"]
Coordinate = Annotated[FiniteFloat, Field(ge=-1e6, le=1e6)]
"""m in the map frame; nothing can be farther from its origin."""


class ConfigError(Exception):
    """A setting is invalid; the text names it, and says what is wrong and where it was read."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Limits(_Section):
    """Limits of what the robot does, in SI units. The robot server enforces them, whoever asks."""

    max_speed: float = Field(0.6, gt=0, le=3)
    max_turn_rate: float = Field(1.2, gt=0, le=4)
    max_acceleration: float = Field(0.8, gt=0, le=5)
    max_turn_acceleration: float = Field(2.5, gt=0, le=10)
    braking: float = Field(4.0, gt=0, le=10, description="deceleration of a protective stop, m/s^2")
    battery_floor: float = Field(
        0.10, ge=0, lt=1, description="charge (0 to 1) below which the robot drives only to a dock"
    )
    max_speech_chars: int = Field(400, gt=0, le=4000)
    max_motions_per_minute: int = Field(30, gt=0, le=6000)
    max_speeches_per_minute: int = Field(20, gt=0, le=6000)
    pose_timeout: float = Field(
        1.0, gt=0, le=10, description="seconds; a robot that moves with an older pose or scan halts"
    )
    client_silence: float = Field(
        2.0, ge=0.5, le=30, description="seconds without a sign of life from the client that moves it; then it halts"
    )
    unheard_motion: float = Field(
        60.0, ge=0, le=3600, description="seconds of motion for a client whose protocol has no sign of life"
    )


class KeepOut(_Section):
    """A keep-out zone, which the robot's footprint must not touch; corners in m of the map frame."""

    name: str = Field(min_length=1, max_length=80)
    polygon: list[tuple[Coordinate, Coordinate]] = Field(min_length=3, max_length=1000)


class Simulator(_Section):
    """The simulated robot's start and its imperfections, which are random from the seed and off by default."""

    people: int = Field(0, ge=0, le=50, description="people who walk about")
    closed_doors: list[str] = Field([], description="ids of doors of the world that are closed at the start")
    localisation_noise: float = Field(0.0, ge=0, le=0.2, description="standard deviation of the position error, m")
    heading_noise: float = Field(0.0, ge=0, le=0.1, description="standard deviation of the yaw error, rad")
    wheel_slip: float = Field(0.0, ge=0, le=0.5, description="share of their grip that the wheels lose at most")
    battery: float = Field(0.92, gt=0, le=1, description="its charge at the start, from 0 to 1")
    camera: bool = Field(True, description="whether it has a camera; without one there is no take_photo")
    voice: bool = Field(True, description="whether it has a voice; without one there is no speak")
    laser_rays: int = Field(360, ge=60, le=1440)


class Ros2(_Section):
    """The topics, actions and frames of a ROS 2 robot. The name of a topic that the robot does not have is empty."""

    distro: Literal["humble", "jazzy", "kilted"] = Field("kilted", description="the ROS 2 distribution of the robot")
    domain_id: int | None = Field(None, ge=0, le=232, description="default: ROS_DOMAIN_ID, else 0")
    demo: bool = Field(False, description="start a stand-in for the robot: the simulator behind ROS nodes")
    use_sim_time: bool = False
    places: str = Field("", description="path of a places.yaml; empty: no place has a name")
    footprint_radius: float = Field(0.25, gt=0, le=5, description="circle that encloses the robot, m")
    map_frame: str = Field("map", min_length=1)
    base_frame: str = Field("base_link", min_length=1)
    map: str = Field("map", min_length=1, description="nav_msgs/OccupancyGrid")
    amcl_pose: str = Field("amcl_pose", description="geometry_msgs/PoseWithCovarianceStamped")
    odom: str = Field("odom", min_length=1, description="nav_msgs/Odometry")
    scan: str = Field("scan", description="sensor_msgs/LaserScan")
    plan: str = Field("plan", description="nav_msgs/Path: the path that is being driven")
    battery: str = Field("battery_state", description="sensor_msgs/BatteryState")
    image: str = Field("camera/image_raw/compressed", description="a picture of the front camera")
    image_type: Literal["compressed", "raw"] = "compressed"
    speech: str = Field("speech", description="std_msgs/String: what the robot has to say aloud")
    speech_action: str = Field("", description="an action that says it instead; empty: the topic")
    speech_action_type: str = Field("audio_common_msgs/action/TTS", pattern=r"^\w+/action/\w+$")
    speech_action_field: str = Field("text", min_length=1, description="the field of its goal that holds the text")
    cmd_vel: str = Field("cmd_vel_nav", min_length=1, description="the input of velocity smoother, collision monitor")
    cmd_vel_stamped: bool | None = Field(None, description="TwistStamped; default: from Kilted on")
    navigate: str = Field("navigate_to_pose", min_length=1, description="nav2_msgs/action/NavigateToPose")
    spin: str = Field("spin", min_length=1, description="nav2_msgs/action/Spin")
    compute_path: str = Field("compute_path_to_pose", description="nav2_msgs/action/ComputePathToPose")
    stops: list[str] = Field(
        ["navigate_through_poses", "follow_waypoints", "follow_path", "backup", "drive_on_heading", "assisted_teleop"],
        description="further actions whose goals a stop cancels",
    )
    answer_timeout: float = Field(3.0, gt=0, description="seconds that a node may take to answer")
    camera_timeout: float = Field(3.0, gt=0, description="seconds that a picture may take")

    @property
    def stamped(self) -> bool:
        """Whether velocities are sent as TwistStamped."""
        return self.distro == "kilted" if self.cmd_vel_stamped is None else self.cmd_vel_stamped


class Robot(_Section):
    """The robot server."""

    kind: Literal["simulator", "ros2"] = "simulator"

    name: str = Field("Sancho", min_length=1, max_length=40)
    host: str = "127.0.0.1"
    port: int = Field(8000, ge=0, le=65535)
    world: str = Field("office", description="a built-in world, or the path of a map.yaml or the folder with one")
    time_scale: float = Field(1.0, gt=0, le=100)
    seed: int = Field(0, ge=0)
    keep_out: list[KeepOut] = Field(
        [], max_length=200, description="zones in addition to those of the world's keep_out.yaml"
    )
    limits: Limits = Limits()
    simulator: Simulator = Simulator()
    ros2: Ros2 = Ros2()


class Storage(_Section):
    """What the database of sessions keeps, of whom, and for how long. Sizes are in bytes of events, 0 is "no limit"."""

    max_prompt_blocks: int = Field(100, gt=0, description="content blocks of one prompt")
    max_prompt_chars: int = Field(100_000, gt=0, description="characters of text of one prompt, in all of its blocks")
    max_prompt_bytes: int = Field(
        12 * 1024 * 1024, gt=0, le=14 * 1024 * 1024, description="pictures, sounds and files of one prompt, as base64"
    )
    visitor_bytes: int = Field(256 * 1024 * 1024, ge=0, description="of all sessions of one login")
    operator_bytes: int = Field(2 * 1024 * 1024 * 1024, ge=0, description="of all sessions of one login")
    supervisor_bytes: int = Field(8 * 1024 * 1024 * 1024, ge=0, description="of all sessions of one login")
    visitor_sessions: int = Field(500, ge=0, description="sessions of one login")
    operator_sessions: int = Field(5_000, ge=0, description="sessions of one login")
    supervisor_sessions: int = Field(20_000, ge=0, description="sessions of one login")
    max_bytes: int = Field(16 * 1024 * 1024 * 1024, ge=0, description="of the sessions of everybody")
    max_sessions: int = Field(50_000, ge=0, description="of everybody; the oldest are deleted")
    media_days: float = Field(0, ge=0, description="photos and sounds of older sessions are removed")
    session_days: float = Field(0, ge=0, description="older sessions are deleted")

    def quota(self, role: str) -> tuple[int, int]:
        """The bytes and the sessions that a login of this role may have; 0 is "no limit". A viewer owns none."""
        return getattr(self, f"{role}_bytes", 0), getattr(self, f"{role}_sessions", 0)


class AgentRequests(_Section):
    """How much one login may ask of the agent, and how connections before login are limited. A cancel and a stop are
    never refused."""

    per_second: float = Field(200.0, gt=0, description="requests and notifications of one login")
    burst: int = Field(2000, ge=10, description="so many of them may come at once; more are answered with an error")
    pending_per_connection: int = Field(32, ge=4, description="requests that wait for their answers")
    pending_per_login: int = Field(128, ge=4, description="the same over all connections of one login")
    messages_per_second: float = Field(
        1000.0, gt=0, description="messages read from one login, refused ones included; a message of 4 kB counts as two"
    )
    messages_burst: int = Field(20_000, ge=100, description="so many may come at once; more are read later")
    initialize_timeout: float = Field(30.0, gt=0, description="seconds in which a new connection has to initialize")
    max_bytes_before_login: int = Field(64 * 1024, ge=4096, description="of one message")
    max_before_login: int = Field(256, ge=8, description="connections before login; beyond it the oldest is closed")
    max_before_login_per_address: int = Field(16, ge=1, description="the same from one address, except loopback")
    wrong_logins: int = Field(30, ge=1, description="a minute from one address; more are told to wait")


class Agent(_Section):
    """The ACP agent."""

    host: str = "127.0.0.1"
    port: int = Field(9100, ge=0, le=65535)
    model: str = Field("offline/commands", min_length=1, description="any litellm model name")
    models: list[str] = Field([], description="further models that people may choose")
    robot_url: str | None = Field(None, description="another MCP server: URL or stdio:COMMAND")
    database: str | None = Field(
        None, description="sqlite:///PATH or postgresql://…; default: SQLite in the data folder"
    )
    trust_loopback: bool | Literal["any_user"] = Field(
        True, description="whether a TCP client of this machine and of the agent's own user needs no token"
    )
    default_mode: str = "supervised"
    permission_timeout: float = Field(60.0, gt=0, description="seconds; no answer in time is a refusal")
    thought_timeout: float = Field(
        5.0, gt=0, description="seconds that the first action waits for the preliminary thought"
    )
    max_steps: int = Field(40, gt=0, description="inferences a turn")
    preview: bool = Field(True, description="before people are asked about a drive, its path is computed and drawn")
    pose_tool: str = Field("get_current_pose", description="the tool that returns where a session started")
    places_tool: str = Field(
        "get_topological_map", description="the tool that returns the places that a kiosk suggests"
    )
    unattended_after: float = Field(
        45.0, ge=0, description="seconds without anybody who may operate the robot; then it halts (0: never)"
    )
    max_outbox_bytes: int = Field(
        64 * 1024 * 1024, ge=1024 * 1024, description="a client that leaves more than this unread is disconnected"
    )
    four_eyes: list[str] = Field([], description="tools that another person with a token must approve, in every mode")
    mcp_allow: list[str] = Field([], description="MCP servers that a supervisor's client may bring: URL prefixes")
    policy: dict[str, dict[str, Decision]] = Field({}, description="mode -> tool -> allow, ask or deny")
    visitors: dict[str, Decision] = Field({}, description="tool -> what a visitor's prompt may do at most")
    storage: Storage = Storage()
    requests: AgentRequests = AgentRequests()

    @field_validator("robot_url")
    @classmethod
    def _is_an_mcp_server(cls, url: str | None) -> str | None:
        return url if url is None else robot_address.check(url)


class BridgeRequests(_Section):
    """How fast one login's WebSockets are read, and how HTTP connections before login are limited."""

    messages_per_second: float = Field(
        1000.0, gt=0, description="WebSocket messages read from one login; one of 4 kB counts as two"
    )
    messages_burst: int = Field(20_000, ge=100, description="so many may come at once; more are read later")
    header_timeout: float = Field(10.0, gt=0, description="seconds that the headers of a request may take")
    body_timeout: float = Field(30.0, gt=0, description="seconds that the body of a request may take")
    max_before_login: int = Field(
        256, ge=8, description="connections that are no page's WebSocket; beyond it the oldest is closed"
    )
    max_before_login_per_address: int = Field(64, ge=1, description="the same from one address, except loopback")
    wrong_logins: int = Field(30, ge=1, description="a minute from one address; more are answered with 429")


class Bridge(_Section):
    """The web side."""

    host: str = "127.0.0.1"
    port: int = Field(8080, ge=0, le=65535)
    agent: str | None = Field(None, description="tcp://HOST:PORT or stdio:COMMAND; default: the [agent] address")
    robot_url: str | None = Field(
        None, description="base URL of the robot server; default: that of the robot which the agent drives"
    )
    allowed_origins: list[str] = Field([], description="further origins; the bridge's own is always allowed")
    max_frame_bytes: int = Field(16 * 1024 * 1024, gt=1024)
    max_connections: int = Field(512, gt=0, description="pages at once")
    requests: BridgeRequests = BridgeRequests()

    @field_validator("robot_url")
    @classmethod
    def _is_a_robot_server(cls, url: str | None) -> str | None:
        return url if url is None else robot_address.check_base(url)


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
        """The sources by precedence: flags, then variables, then the file."""
        return init_settings, env_settings, TomlConfigSettingsSource(settings_cls, cls.toml_file)

    @model_validator(mode="after")
    def _stop_reaches_the_robot_that_the_agent_drives(self) -> Self:
        stopped, agent_is_elsewhere = self.bridge.robot_url, self.bridge.agent is not None
        driven = self.agent.robot_url or (None if agent_is_elsewhere else self._own_robot_url)
        if stopped and driven and robot_address.base_of(driven) and not robot_address.same_server(driven, stopped):
            raise ValueError(
                "bridge.robot_url is not the server of the robot that the agent drives, so Stop would stop another "
                "robot. Leave bridge.robot_url out: then it follows agent.robot_url and [robot]"
            )
        return self

    @property
    def drives_our_robot_server(self) -> bool:
        """Whether the agent drives the robot server of the `[robot]` section, and not an MCP server of another make or
        place. Only that one receives the secret of the data folder, and only that one is started by `up`."""
        return self.agent.robot_url is None or robot_address.same_server(self.agent.robot_url, self._own_robot_url)

    @property
    def robot_base_url(self) -> str | None:
        """The URL below which the robot that the agent drives has `/telemetry`, `/stop` and `/health`. None for a robot
        behind a command, unless `bridge.robot_url` says where it has them."""
        if self.agent.robot_url is None:
            return self._own_robot_url
        return robot_address.base_of(self.agent.robot_url) or self.bridge.robot_url

    @property
    def bridge_robot_base_url(self) -> str | None:
        """The same as the bridge reaches it, which may run on another machine."""
        return self.bridge.robot_url or self.robot_base_url

    def is_our_robot_server(self, base_url: str | None) -> bool:
        """Whether the robot server below `base_url` is ours: it may receive the secret of the data folder."""
        if base_url is None:
            return False
        named = self.agent.robot_url is None and base_url == self.bridge.robot_url
        return named or robot_address.same_server(base_url, self._own_robot_url)

    @property
    def robot_mcp_url(self) -> str:
        """The MCP URL of the robot's tools, or `stdio:COMMAND`."""
        return self.agent.robot_url or f"{self._own_robot_url}/mcp"

    @property
    def _own_robot_url(self) -> str:
        return addresses.url("http", addresses.reached_at(self.robot.host), self.robot.port)

    @property
    def agent_address(self) -> str:
        """The address at which the bridge reaches the agent: `tcp://HOST:PORT` or `stdio:COMMAND`."""
        return self.bridge.agent or self.agent_url

    @property
    def agent_url(self) -> str:
        """The address of this machine's own agent, `tcp://HOST:PORT`."""
        return addresses.url("tcp", addresses.reached_at(self.agent.host), self.agent.port)

    @property
    def bridge_url(self) -> str:
        """The address of this machine's own bridge, `http://HOST:PORT`."""
        return addresses.url("http", addresses.reached_at(self.bridge.host), self.bridge.port)

    @property
    def database_url(self) -> str:
        """SQLAlchemy URL of the session log."""
        return self.agent.database or f"sqlite:///{self.data_dir / 'sessions.db'}"


def _default_data_dir() -> Path:
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "robot-acp"


def load(file: Path | None = None, **flags: Any) -> Settings:
    """Read the settings. `flags` are nested dicts that override all else: `load(robot={"time_scale": 5})`.

    Without `file`, the file that `ROBOT_ACP_CONFIG` names is read, else `robot.toml` in the current folder where it
    exists. Raises `ConfigError`.
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
