"""Whatever bytes are in a world's files, it is loaded or refused with a sentence, in limited time.

Generated from a seed that is printed. With ROBOT_ACP_TEST_FUZZ_SECONDS=600 each test goes on for so long, from a fresh
seed; in a deep run for half a minute. A world that was loaded is one that a robot can stand in.
"""

from __future__ import annotations

import io
import os
import random
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from backend.config import Limits
from backend.mcp_robot.navigation import named_places
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.simulator import world
from backend.mcp_robot.simulator.simulation import FOOTPRINT_RADIUS, Simulation
from backend.mcp_robot.simulator.world import World, WorldError
from tests.deep import DEEP, seed

ASKED = os.environ.get("ROBOT_ACP_TEST_FUZZ_SECONDS")
SECONDS = float(ASKED) if ASKED else 30.0 if DEEP else None
"""Wall seconds of each test; None for CASES cases, always the same ones."""
CASES = 60
SLOWEST = 20.0
"""CPU seconds that one file may take, however busy the machine is: a file of the largest size takes about five."""
NAMES = ("map.yaml", "places.yaml", "keep_out.yaml", "map.png")

MAP = {
    "image": "map.png",
    "mode": "trinary",
    "resolution": 0.1,
    "origin": [-1.0, -1.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
PLACES = {
    "frame_id": "map",
    "places": [
        {"id": "dock", "name": "dock", "type": "docking", "position": {"x": 0.5, "y": 0.5, "yaw": 0.0}},
        {"id": "a", "name": "lab 1", "position": {"x": 3.0, "y": 2.0}, "sign": {"x": 3.0, "y": 3.0}},
    ],
    "edges": [["dock", "a"]],
    "doors": [{"id": "gate", "start": {"x": 1.5, "y": 1.0}, "end": {"x": 1.5, "y": 2.0}}],
}
KEEP_OUT = {"zones": [{"name": "stairs", "polygon": [[2.0, 0.0], [2.5, 0.0], [2.5, 0.5]]}]}
ODD: list[Any] = [
    None, True, False, 0, -1, 1, 2**31, 10**400, 1e308, -1e308, 1e-300, 0.05, float("nan"), float("inf"), "", " ", "a",
    "dock", "the dock", "\u202e", "\x85", "x" * 5000, "1e9", "0x10", "12:30", "2024-01-01", "..", "/", "/dev/zero", [],
    {}, [[]], [None], [[1, 2]] * 300, {"a": 1}, b"bytes", list(range(9)), [1e308] * 3,
]  # fmt: skip
LINES = [
    "&a [*a]",
    "*a",
    "<<: *a",
    "? a\n: b",
    "---",
    "...",
    "%YAML 9.9",
    "!!int x",
    "!a b",
    "- - - - -",
    "'",
    "\t",
    "{",
    "]",
]


def picture() -> Image.Image:
    pixels = np.full((50, 60), 254, dtype=np.uint8)
    pixels[0] = pixels[-1] = 0
    pixels[:, 0] = pixels[:, -1] = 0
    pixels[:8, 40:] = 205
    return Image.fromarray(pixels)


def encoded(image: Image.Image, kind: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def valid() -> dict[str, bytes]:
    return {
        "map.yaml": yaml.safe_dump(MAP).encode(),
        "places.yaml": yaml.safe_dump(PLACES).encode(),
        "keep_out.yaml": yaml.safe_dump(KEEP_OUT).encode(),
        "map.png": encoded(picture(), "PNG"),
    }


def damaged(data: bytes, rng: random.Random) -> bytes:
    """The same bytes with some changed, cut, doubled or put in."""
    changed = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 5])):
        at = rng.randrange(len(changed) + 1)
        match rng.randrange(5):
            case 0:
                changed[at : at + 1] = rng.choice(["0", "1", "9", "-", ".", "e", "a", " ", "\xff"]).encode("latin-1")
            case 1:
                del changed[at : at + rng.randint(1, 40)]
            case 2:
                changed[at:at] = changed[: rng.randint(0, 400)]
            case 3:
                changed[at:at] = rng.randbytes(rng.randint(1, 20))
            case _:
                changed[at:at] = b"\n" + rng.choice(LINES).encode() + b"\n"
    return bytes(changed)


def paths(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every container in a value, with each of its keys or indices."""
    keys = list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        yield value, key
        yield from paths(value[key])


class WrittenOut(yaml.SafeDumper):
    """Without aliases, which are refused at once."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def odd(content: Any, rng: random.Random) -> bytes:
    """YAML of the same structure with odd values, keys that are not known, and keys that are missing."""
    content = yaml.safe_load(yaml.safe_dump(content))
    for _ in range(rng.randint(1, 3)):
        found = list(paths(content))
        if not found:
            break
        holder, key = rng.choice(found)
        match rng.randrange(6):
            case 0:
                del holder[key]
            case 1 if isinstance(holder, dict):
                holder[rng.choice(["odd", 1, None, True, "resolution", "name"])] = rng.choice(ODD)
            case 2 if len(repr(holder[key])) < 200:
                holder[key] = [holder[key]] * rng.choice([2, 3, 1001])
            case _:
                holder[key] = rng.choice(ODD)
    return yaml.dump(
        content, Dumper=WrittenOut, allow_unicode=rng.random() < 0.5, default_flow_style=rng.random() < 0.5
    ).encode()


def bytes_of_any_kind(rng: random.Random) -> bytes:
    repeated = rng.choice(
        [b"[", b"{", b"- ", b"a: ", b"? ", b"!", b"&a ", b"'", b"#", b"\n", b" ", b"[{", b"\xff", b"P5 "]
    )
    match rng.randrange(3):
        case 0:
            return rng.randbytes(rng.randint(0, 3000))
        case 1:
            return repeated * rng.choice([1, 100, 20_000])
        case _:
            return "\n".join(rng.choices(LINES, k=rng.randint(1, 30))).encode()


def drawn(rng: random.Random) -> bytes:
    """A picture of some kind, depth and size; often damaged."""
    image = picture()
    if rng.random() < 0.3:
        image = image.resize((rng.choice([1, 2, 3, 60]), rng.choice([1, 2, 3, 50])))
    mode = rng.choice(["1", "L", "LA", "P", "RGB", "RGBA", "I", "I;16", "F", "CMYK"])
    deep = Image.fromarray(np.asarray(image).astype(np.uint16) * 257)
    image = deep if mode == "I;16" else image.convert(mode)
    kind = rng.choice(["PNG", "PPM", "BMP", "JPEG", "TIFF", "GIF", "WEBP"])
    try:
        data = encoded(image, kind)
    except (OSError, ValueError, KeyError):
        data = encoded(picture(), "PNG")
    return damaged(data, rng) if rng.random() < 0.7 else data


def damaged_file(rng: random.Random) -> tuple[str, bytes]:
    name = rng.choice(NAMES)
    return name, damaged(valid()[name], rng)


def odd_file(rng: random.Random) -> tuple[str, bytes]:
    name, content = rng.choice([("map.yaml", MAP), ("places.yaml", PLACES), ("keep_out.yaml", KEEP_OUT)])
    return name, odd(content, rng)


KINDS: dict[str, Callable[[random.Random], tuple[str, bytes]]] = {
    "bytes of any kind": lambda rng: (rng.choice(NAMES), bytes_of_any_kind(rng)),
    "damaged files": damaged_file,
    "odd YAML": odd_file,
    "pictures": lambda rng: ("map.png", drawn(rng)),
}


def usable(loaded: World) -> None:
    """A robot stands in it with room, its places are found by name and id, and its doors can be closed."""
    start = loaded.start
    assert loaded.grid.clearance(start.x, start.y) >= FOOTPRINT_RADIUS
    for place in loaded.places.places:
        assert named_places.resolve(place.id, loaded.places) is place
        assert named_places.resolve(place.name, loaded.places) is place
        assert loaded.grid.clearance(place.pose.x, place.pose.y) >= FOOTPRINT_RADIUS
    loaded.with_closed([door.id for door in loaded.doors])
    simulation = Simulation(loaded, Limits())
    simulation.step()
    simulation.look()


def refusal_of(folder: Path) -> str | None:
    """Why the world is refused; None for one that is loaded and usable."""
    try:
        loaded = world.load(str(folder))
    except WorldError as error:
        return str(error)
    usable(loaded)
    return None


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_world_is_loaded_or_refused(tmp_path: Path, kind: str) -> None:
    rng = random.Random(seed(random.SystemRandom().randrange(2**32) if ASKED else 1))  # noqa: S311
    folder = tmp_path / "world"
    ended = {"loaded": 0, "refused": 0}
    began = time.monotonic()
    cases, slowest = 0, 0.0
    while cases < CASES if SECONDS is None else time.monotonic() - began < SECONDS:
        cases += 1
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        name, data = KINDS[kind](rng)
        for other, content in (valid() | {name: data}).items():
            (folder / other).write_bytes(content)
        used = time.process_time()
        try:
            complaint = refusal_of(folder)
        except BaseException as error:
            raise AssertionError(f"case {cases}: {name} of {data[:2000]!r} raised {error!r}") from error
        ended["refused" if complaint else "loaded"] += 1
        assert len(complaint or "") < 4000, (cases, name, complaint)
        slowest = max(slowest, time.process_time() - used)
        assert slowest < SLOWEST, (cases, name, data[:200])
    print(f"{kind}: {cases} cases in {time.monotonic() - began:.0f} s, one in {slowest:.1f} s at most: {ended}")
    assert ended["refused"] > 0


def test_the_world_that_is_damaged_is_a_valid_one(tmp_path: Path) -> None:
    for name, content in valid().items():
        (tmp_path / name).write_bytes(content)
    usable(world.load(str(tmp_path)))


@pytest.mark.parametrize("name", ["", "the", "?", "a" * 200, "\u0301", "the the", "un un un", "_ _", "\n\n"])
def test_a_name_of_any_kind_is_found_or_refused(tmp_path: Path, name: str) -> None:
    for file, content in valid().items():
        (tmp_path / file).write_bytes(content)
    with pytest.raises(Refusal, match=r"^unknown_place: "):
        named_places.resolve(name, world.load(str(tmp_path)).places)
