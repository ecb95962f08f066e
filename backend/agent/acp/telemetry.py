"""`_robot/telemetry`: the robot's small and slow state as notifications, for a client that asked for it.

Only a client that asked for it in `initialize` receives it: the newest state alone, at the rate that it asked for.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import msgspec
import orjson

from backend import telemetry

if TYPE_CHECKING:
    from backend.agent.acp.connection import ClientConnection
    from backend.agent.wiring import Wiring

METHOD = "_robot/telemetry"
DEFAULT_HZ = 2.0
MIN_HZ = 0.5
"""With fewer messages a client could not tell a robot that is silent from one that sends rarely."""
MAX_HZ = 10.0


class TelemetryFeed:
    """Sends the robot's state to one connection until closed."""

    def __init__(self, wiring: Wiring, connection: ClientConnection, rate_hz: object) -> None:
        wanted = rate_hz if isinstance(rate_hz, int | float) and not isinstance(rate_hz, bool) else DEFAULT_HZ
        self._every_s = 1 / min(max(float(wanted), MIN_HZ), MAX_HZ)
        self._wiring = wiring
        self._connection = connection
        self._sent_at = 0.0
        self._sent_key: object = None
        self._unwatch = (
            wiring.link.watch(self._send),
            wiring.journal.watch(lambda: self._send(wiring.link.state)),  # also while the robot sends nothing
        )
        self._send(wiring.link.state)

    def close(self) -> None:
        """Send no more."""
        for unwatch in self._unwatch:
            unwatch()

    def _send(self, state: telemetry.State | None) -> None:
        if self._connection.identity is None:
            return
        now = time.monotonic()
        # A change that people wait for is sent at once; everything else waits for the rate.
        key = (
            state is None,
            state and (state.stop, state.motion is None, state.speaking, state.halted),
            self._wiring.journal.failed_at,
        )
        if key == self._sent_key and now - self._sent_at < self._every_s:
            return
        self._sent_at, self._sent_key = now, key
        message = {"jsonrpc": "2.0", "method": METHOD, "params": self._params(state)}
        self._connection.deliver_latest(METHOD, orjson.dumps(message, option=orjson.OPT_APPEND_NEWLINE))

    def _params(self, state: telemetry.State | None) -> dict[str, Any]:
        turn = self._turn()
        name = self._wiring.settings.robot.name
        if state is None:
            return {"robot": name, "online": False, "turn": turn, "database": self._database()}
        return {
            "robot": state.robot,
            "online": True,
            "time": state.time,
            "pose": msgspec.to_builtins(state.pose),
            "twist": msgspec.to_builtins(state.twist),
            "battery": msgspec.to_builtins(state.battery),
            "motion": msgspec.to_builtins(state.motion),
            "stop": msgspec.to_builtins(state.stop),
            "speaking": state.speaking,
            "halted": msgspec.to_builtins(state.halted),
            "turn": turn,
            "database": self._database(),
        }

    def _database(self) -> dict[str, Any] | None:
        """Why the database of sessions cannot be used, and since when; None while it can."""
        journal = self._wiring.journal
        return {"text": journal.failure, "at": journal.failed_at} if journal.failure else None

    def _turn(self) -> dict[str, Any] | None:
        """The turn that controls the robot. Only those who may approve receive the queue of those that wait for it."""
        lease = self._wiring.turns.lease
        if lease.holder is None:
            return None
        turn = {"sessionId": lease.holder.session_id, "by": lease.holder.by, "queue": len(lease.waiting)}
        if self._connection.may_approve:
            turn["waiting"] = [{"sessionId": claim.session_id, "by": claim.by} for claim in lease.waiting]
        return turn
