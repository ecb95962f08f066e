"""The limit of open files, raised by the processes that many people connect to. Limits are lowered in processes of
their own: what was lowered cannot be raised again."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import Robot, end, wait_until

resource = pytest.importorskip("resource", reason="only where there are such limits")

BEGIN = "import resource; resource.setrlimit(resource.RLIMIT_NOFILE, ({soft}, {hard}));"
RAISE = """
import logging
from backend.descriptors import raise_limit
logging.basicConfig(format="%(message)s")
print(raise_limit({needed}), resource.getrlimit(resource.RLIMIT_NOFILE))
"""


def raised(soft: int, hard: int, needed: int) -> tuple[str, str]:
    """What a process prints and logs that begins with these limits."""
    program = BEGIN.format(soft=soft, hard=hard) + RAISE.format(needed=needed)
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return ran.stdout.strip(), ran.stderr


def test_the_limit_becomes_what_the_system_allows() -> None:
    assert raised(200, 900, needed=700) == ("900 (900, 900)", "")


def test_a_limit_that_is_high_already_stays() -> None:
    assert raised(900, 900, needed=700) == ("900 (900, 900)", "")


def test_a_system_that_allows_too_few_is_told_of() -> None:
    said, logged = raised(200, 300, needed=700)
    assert said == "300 (300, 300)"
    assert "may open 300 files and connections at once, and 700 would be enough" in logged


@pytest.mark.processes
@pytest.mark.skipif(not hasattr(resource, "prlimit"), reason="nobody can ask for the limits of another process")
@pytest.mark.parametrize("name", ["agent", "bridge"])
def test_those_that_many_people_connect_to_raise_it(name: str, tmp_path: Path) -> None:
    begin = BEGIN.format(soft=200, hard=900) + "from backend.cli import main; main()"
    robot = Robot(tmp_path)
    process = subprocess.Popen([sys.executable, "-c", begin, name], env=robot.variables)
    try:
        wait_until(lambda: resource.prlimit(process.pid, resource.RLIMIT_NOFILE) == (900, 900), f"the {name}")
    finally:
        end(process)
