"""No attack of this folder breaks an instance, whoever sends it: others are served, Stop is in reach, and it goes on.

A deep run attacks as every role, `./test.sh` as the least trusted one that may prompt.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from backend.identity import Role
from tests.attack import access, floods, messages
from tests.attack.target import ATTACKS, Attack, Target, carry_out
from tests.deep import DEEP
from tests.processes import Robot

__all__ = ["access", "floods", "messages"]
PATIENCE_S = 20.0
"""Only what blocks the instance takes so long, on a busy machine too; `python -m tests.attack` measures."""
ROLES = tuple(Role) if DEEP else (Role.VISITOR,)

pytestmark = [pytest.mark.slow, pytest.mark.processes]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with Robot(tmp_path_factory.mktemp("data"), {"ROBOT_ACP_LOG_LEVEL": "warning"}).at_work() as running:
        yield running


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.run.__name__)
async def test_an_attack_breaks_nothing(robot: Robot, attack: Attack, role: Role) -> None:
    url = f"http://127.0.0.1:{robot.bridge_port}"
    token, witness = robot.token(f"Mallory {role}", role), robot.token("Wanda", Role.SUPERVISOR)
    target = Target(url, token, witness, role.value, ("127.0.0.1", robot.agent_port))
    outcome = await carry_out(attack, target, PATIENCE_S)
    print(outcome.answered, f"{outcome.longest_wait:.2f} s", f"{outcome.longest_stop_wait:.2f} s")
    assert outcome.broken is None
