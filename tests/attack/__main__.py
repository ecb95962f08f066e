"""Attacks a running instance as one person, beside a witness who uses it, and prints a table of what was tried.

    python -m tests.attack http://127.0.0.1:8080 --token TOKEN --witness TOKEN [--tcp 127.0.0.1:9100] [--only WORD]

The exit status is 1 when an attack broke something. No attack stops the robot or makes it drive on purpose; prompts of
a role that may prompt do reach it, so rather point this at a simulator.
"""

from __future__ import annotations

import argparse
import asyncio
import sys

import httpx

from tests.attack import access, floods, messages
from tests.attack.target import ATTACKS, Outcome, Target, carry_out

__all__ = ["access", "floods", "messages"]
PATIENCE_S = 2.0


def role_of(url: str, token: str) -> str:
    """The role of a token, by the instance's own word."""
    answer = httpx.get(f"{url}/api/me", headers={"Authorization": f"Bearer {token}"}, trust_env=False)
    answer.raise_for_status()
    return str(answer.json()["role"])


def row(outcome: Outcome) -> str:
    """One line of the table."""
    verdict = f"**broken**: {outcome.broken}" if outcome.broken else "held"
    waits = f"{outcome.longest_wait:.2f} s | {outcome.longest_stop_wait:.2f} s"
    return f"| {outcome.attack.sends} | {outcome.answered.replace('|', '/')} | {waits} | {verdict} |"


async def run(target: Target, only: str, patience: float) -> bool:
    """All attacks whose text contains `only`; false when one broke something."""
    print(f"As {target.role}:\n\n| sent | answered | longest wait of another person | … for Stop | verdict |")
    print("|---|---|---|---|---|")
    held = True
    for attack in ATTACKS:
        if only in attack.sends:
            outcome = await carry_out(attack, target, patience)
            print(row(outcome), flush=True)
            held = held and outcome.broken is None
    return held


def main() -> int:
    """Read the arguments and attack."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("url", help="the bridge, such as http://127.0.0.1:8080")
    parser.add_argument("--token", required=True, help="the attacker's login token, of any role")
    parser.add_argument("--witness", required=True, help="the login token of another person, an operator or supervisor")
    parser.add_argument("--tcp", help="HOST:PORT of the agent, where the attacker can reach it")
    parser.add_argument("--only", default="", help="only attacks whose text contains this")
    parser.add_argument(
        "--patience", type=float, default=PATIENCE_S, help="s that another person may wait (default: 2)"
    )
    asked = parser.parse_args()
    host, _, port = (asked.tcp or "").rpartition(":")
    tcp = (host, int(port)) if host else None
    target = Target(asked.url, asked.token, asked.witness, role_of(asked.url, asked.token), tcp)
    return 0 if asyncio.run(run(target, asked.only, asked.patience)) else 1


if __name__ == "__main__":
    sys.exit(main())
