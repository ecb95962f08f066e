"""Generated ROS interfaces are kept between runs, and a build that fails leaves nothing behind that would be used."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros2_robots import own_domains

PROVIDE = "import sys; from pathlib import Path; from backend.mcp_robot.ros2 import interfaces; "
PROVIDE += "print(interfaces.provide(Path(sys.argv[1]), 'kilted'))"


def provide(data: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PROVIDE, str(data)]
    return subprocess.run(command, env=os.environ | environment, text=True, capture_output=True, timeout=300)


def test_what_was_generated_once_is_used_by_every_data_folder(interfaces: Path, tmp_path: Path) -> None:
    from backend.mcp_robot.ros2.interfaces import cache_folder

    # Without a compiler nothing could be generated anew.
    done = provide(tmp_path / "another", PATH="", CC="absent", CXX="absent")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "installed" or Path(done.stdout.strip()).parent == cache_folder(tmp_path)
    assert not (tmp_path / "another").exists()


def test_a_build_that_fails_leaves_nothing_to_be_used(interfaces: Path, tmp_path: Path) -> None:
    if provide(tmp_path).stdout.strip() == "installed":
        pytest.skip("ROS itself has these interfaces here, so that none are generated")
    cache = tmp_path / "cache"
    done = provide(tmp_path, XDG_CACHE_HOME=str(cache), CC="false", CXX="false")
    assert done.returncode != 0
    assert "The ROS interfaces could not be generated" in done.stderr
    assert [path.suffix for path in (cache / "robot-acp" / "ros2").iterdir()] == [".lock"]


def test_the_workers_of_a_run_divide_the_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTEST_XDIST_WORKER_COUNT", "4")
    seen: list[int] = []
    for worker in range(4):
        monkeypatch.setenv("PYTEST_XDIST_WORKER", f"gw{worker}")
        assert len(own_domains()) >= 20
        seen += own_domains()
    assert len(seen) == len(set(seen))
    assert min(seen) >= 10
    assert max(seen) < 100
