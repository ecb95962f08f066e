"""Everything that the commands import when they run: the process that `tests.forked` forks has it in memory already.

Nothing here starts a thread or reads a setting: a fork of this process must be as good as a new Python.
"""

from __future__ import annotations

import gc
import importlib.util
import os
from pathlib import Path

# What frameworks load late, by name, when the first connection, request or picture comes.
LATE = (
    "PIL.JpegImagePlugin",
    "PIL.PngImagePlugin",
    "aiosqlite",
    "anyio._backends._asyncio",
    "httpcore",
    "prompt_toolkit.shortcuts",
    "sqlalchemy.dialects.postgresql.psycopg",
    "sqlalchemy.dialects.sqlite",
    "uvicorn.lifespan.on",
    "uvicorn.loops.auto",
    "uvicorn.protocols.http.auto",
    "uvicorn.protocols.websockets.websockets_sansio_impl",
    "websockets.asyncio.client",
    "websockets.asyncio.server",
)
BACKEND = Path(__file__).parent.parent / "backend"


def load() -> None:
    """Import all of `backend` but what needs ROS or is a program of its own, and what is loaded late."""
    for file in sorted(BACKEND.rglob("*.py")):
        module = ".".join(file.relative_to(BACKEND.parent).with_suffix("").parts).removesuffix(".__init__")
        if "ros2" not in file.parts and "worlds" not in file.parts:
            importlib.import_module(module)
    for module in LATE:
        if importlib.util.find_spec(module.partition(".")[0]):
            importlib.import_module(module)
    threads = len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 1
    if threads > 1:
        raise RuntimeError(f"{threads - 1} threads run after the imports; a fork would lose them")
    gc.freeze()  # so that the collector of a fork does not write to every page that it shares


load()
