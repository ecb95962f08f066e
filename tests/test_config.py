"""Settings: the shipped file is true, variables and flags override it, and what is wrong is named."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from backend import config

SHIPPED = Path(__file__).parent.parent / "robot.toml"
EXAMPLES = {"data_dir", "robot_url", "database", "agent", "navigate_to_place", "navigate_to_pose", "speak"} | {
    "domain_id",
    "cmd_vel_stamped",
}
"""Settings whose shipped line shows an example, because the default depends on others."""


@pytest.fixture(autouse=True)
def _no_settings_from_outside(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("ROBOT_ACP_CONFIG", "ROBOT_ACP_DATA_DIR", "ROBOT_ACP_ROBOT__PORT", "XDG_DATA_HOME"):
        monkeypatch.delenv(name, raising=False)


def test_every_line_of_the_shipped_file_shows_the_default() -> None:
    lines = [
        re.sub(r"^# ", "", line)
        for line in SHIPPED.read_text().splitlines()
        if (re.match(r"# \w+ = ", line) and re.match(r"# (\w+)", line)[1] not in EXAMPLES) or line.startswith("[")  # type: ignore[index]
    ]
    written = config.Settings(**tomllib.loads("\n".join(lines)))
    assert written.model_dump() == config.load().model_dump()


def test_every_setting_is_in_the_shipped_file() -> None:
    text = SHIPPED.read_text()
    robot = (config.Robot, config.Limits, config.Simulator, config.Ros2)
    sections = {"robot", "limits", "simulator", "ros2", "agent", "bridge", "policy", "visitors", "storage", "requests"}
    agent = (config.Agent, config.Storage, config.AgentRequests)
    for section in (config.Settings, *robot, *agent, config.Bridge, config.BridgeRequests):
        for name, about in section.model_fields.items():
            if name not in sections or about.annotation is str:
                assert re.search(rf"^# {name} = ", text, re.M), name


def test_flags_override_variables_and_variables_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robot.toml").write_text('[robot]\nport = 1\nname = "File"\n[agent]\nport = 1\n')
    monkeypatch.setenv("ROBOT_ACP_ROBOT__PORT", "2")
    settings = config.load(robot={"time_scale": 3.0})
    assert (settings.robot.name, settings.robot.port, settings.robot.time_scale) == ("File", 2, 3.0)
    assert settings.agent.port == 1
    assert config.load(robot={"port": 4}).robot.port == 4


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[robot]\nmax_sped = 1", "robot.max_sped"),
        ("[robot.limits]\nmax_speed = -1", "robot.limits.max_speed"),
        ("[agent.policy.supervised]\nspeak = 'maybe'", "agent.policy.supervised.speak"),
        ("[robot", "cannot be read"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, named: str) -> None:
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(config.ConfigError, match=re.escape(named)):
        config.load()


def test_a_file_that_is_named_must_exist() -> None:
    with pytest.raises(config.ConfigError, match=re.escape("no settings file nowhere.toml")):
        config.load(Path("nowhere.toml"))


@pytest.mark.parametrize(
    ("agent", "bridge", "base", "ours"),
    [
        ({}, {}, "http://127.0.0.1:8000", True),
        ({"robot_url": "http://127.0.0.1:8000/mcp"}, {}, "http://127.0.0.1:8000", True),
        ({"robot_url": "http://localhost:8000/mcp"}, {}, "http://localhost:8000", True),
        ({"robot_url": "http://127.0.0.1:8300/mcp"}, {}, "http://127.0.0.1:8300", False),
        ({"robot_url": "https://127.0.0.1:8000/mcp"}, {}, "https://127.0.0.1:8000", False),
        ({"robot_url": "http://[::1]:8000/mcp"}, {}, "http://[::1]:8000", False),
        ({"robot_url": "http://lab.example/robots/7/mcp/"}, {}, "http://lab.example/robots/7", False),
        ({"robot_url": "stdio:python robot.py"}, {}, None, False),
        (
            {"robot_url": "stdio:python robot.py"},
            {"robot_url": "http://127.0.0.1:8000"},
            "http://127.0.0.1:8000",
            False,
        ),
        ({}, {"robot_url": "http://robot:8000", "agent": "tcp://robot:9100"}, "http://127.0.0.1:8000", True),
    ],
)
def test_the_stop_path_is_that_of_the_robot_which_the_agent_drives(
    agent: dict[str, str], bridge: dict[str, str], base: str | None, ours: bool
) -> None:
    settings = config.load(agent=agent, bridge=bridge)
    assert (settings.robot_base_url, settings.drives_our_robot_server) == (base, ours)
    assert settings.bridge_robot_base_url == bridge.get("robot_url", base)


def test_our_secret_is_for_our_robot_server_alone() -> None:
    settings = config.load(agent={"robot_url": "http://127.0.0.1:8300/mcp"})
    assert not settings.is_our_robot_server(settings.robot_base_url)
    assert not settings.is_our_robot_server(None)
    split = config.load(bridge={"robot_url": "http://robot:8000", "agent": "tcp://robot:9100"})
    assert split.is_our_robot_server(split.bridge_robot_base_url)
    everywhere = config.load(robot={"host": "0.0.0.0"})  # noqa: S104 - not bound
    assert everywhere.is_our_robot_server("http://127.0.0.1:8000")
    assert not everywhere.is_our_robot_server("http://192.0.2.1:8000")


@pytest.mark.parametrize(
    ("agent", "bridge"),
    [
        ({"robot_url": "http://127.0.0.1:8300/mcp"}, {"robot_url": "http://127.0.0.1:8000"}),
        ({}, {"robot_url": "http://127.0.0.1:8300"}),
    ],
)
def test_a_stop_for_another_robot_than_the_driven_one_is_refused(agent: dict[str, str], bridge: dict[str, str]) -> None:
    with pytest.raises(config.ConfigError, match="Stop would stop another robot"):
        config.load(agent=agent, bridge=bridge)


@pytest.mark.parametrize("url", ["", "8300", "ftp://robot/mcp", "http://", "http://robot:port/mcp", "stdio: "])
def test_an_address_that_is_none_is_refused(url: str) -> None:
    with pytest.raises(config.ConfigError, match=re.escape("agent.robot_url: Value error, give http://HOST:PORT/mcp")):
        config.load(agent={"robot_url": url})
