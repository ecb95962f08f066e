"""Renders the picture of the robot's camera: the map as if it were a building.

Plain functions over an immutable world, run in a thread. For every column of the picture a ray is followed through the
map; the nearest thing whose top reaches above a row fills that row (the voxel-space method of Comanche, 1992), unless
floor, ceiling or the lintel of a door come first. materials.py has the colours. Nothing may navigate by this picture.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from backend.mcp_robot.navigation.grid import Floats32
from backend.mcp_robot.simulator import legend
from backend.mcp_robot.simulator.rendering import materials, person_sprites
from backend.mcp_robot.simulator.world import Sign, World
from backend.telemetry import Pose

WIDTH, HEIGHT = 640, 480
FIELD_OF_VIEW = math.radians(78)
EYE = 1.2
"""Height of the lens above the floor, in m."""
HORIZON = HEIGHT * 0.47
FOCAL = WIDTH / 2 / math.tan(FIELD_OF_VIEW / 2)
SIGN_HEIGHT = 1.75
NEAREST, FARTHEST = 0.15, 30.0

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Rays:
    """The shade and height in m of the map at each of `_DEPTHS` along the ray of each column: shape (samples, columns),
    nearest first."""

    shade: npt.NDArray[np.uint8]
    height: Floats32


@lru_cache(maxsize=1)  # a robot at rest sees the same five times a second
def photograph(world: World, pose: Pose, people: tuple[Pose, ...] = ()) -> bytes:
    """The picture from `pose` as JPEG; `people` are their poses."""
    rays = _follow_rays(world, pose)
    distance, sample, kind = _nearest(rays)
    pixels = materials.paint(world, _surface(pose, rays, distance, sample, kind))
    image = Image.fromarray(pixels.reshape(HEIGHT, WIDTH, 3))
    _hang_signs(image, world.signs, pose, distance)
    _show_people(image, people, pose, distance)
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=86)
    return buffer.getvalue()


def _depths() -> Floats32:
    """Sampling distances: every 2 cm near, every 0.8 % farther away, which is below a pixel.

    They are measured along the optical axis, so that straight walls stay straight.
    """
    depths = [NEAREST]
    while depths[-1] < FARTHEST:
        depths.append(depths[-1] + max(0.02, depths[-1] * 0.008))
    return np.array(depths, dtype=np.float32)


_DEPTHS = _depths()
_SIDEWAYS: Floats32 = ((WIDTH / 2 - np.arange(WIDTH) - 0.5) / FOCAL).astype(np.float32)
_RISE: Floats32 = ((HORIZON - np.arange(HEIGHT) - 0.5) / FOCAL).astype(np.float32)
"""Metres up for each metre of depth, one per row."""


def _directions(pose: Pose) -> tuple[Floats32, Floats32]:
    """Where the ray of each column goes in the map frame, a metre along the optical axis."""
    forward, left = math.cos(pose.yaw), math.sin(pose.yaw)
    return forward - left * _SIDEWAYS, left + forward * _SIDEWAYS


def _follow_rays(world: World, pose: Pose) -> Rays:
    grid = world.grid
    dx, dy = _directions(pose)
    column = np.floor((np.outer(_DEPTHS, dx) + (pose.x - grid.origin_x)) / grid.resolution).astype(np.intp)
    row = np.floor((np.outer(_DEPTHS, dy) + (pose.y - grid.origin_y)) / grid.resolution).astype(np.intp)
    outside = (column < 0) | (column >= grid.width) | (row < 0) | (row >= grid.height)
    shade = world.shades[np.clip(row, 0, grid.height - 1), np.clip(column, 0, grid.width - 1)]
    shade = np.where(outside, np.uint8(legend.UNKNOWN), shade)
    return Rays(shade, materials.HEIGHTS.take(shade))


def _nearest(rays: Rays) -> tuple[Floats32, Indices, npt.NDArray[np.uint8]]:
    """For every pixel: depth, sample on its column's ray, and which kind of surface; shape (HEIGHT, WIDTH)."""
    samples = len(_DEPTHS)
    top = HORIZON + FOCAL * (EYE - rays.height) / _DEPTHS[:, None]
    above = np.minimum.accumulate(top, axis=0)
    # How many samples of a column stay below a row is the index of the first that does not: counted by histogram.
    first_row = np.clip(np.ceil(above - 0.5), 0, HEIGHT).astype(np.intp)
    flat = first_row * WIDTH + np.arange(WIDTH)
    counts = np.bincount(flat.ravel(), minlength=(HEIGHT + 1) * WIDTH).reshape(HEIGHT + 1, WIDTH)
    sample: Indices = np.cumsum(counts[::-1], axis=0)[::-1][1:]
    depth = np.append(_DEPTHS, np.float32(np.inf))
    distance = depth[np.minimum(sample, samples)]
    kind = np.full(distance.shape, materials.SOLID, dtype=np.uint8)

    number = np.arange(samples + 1, dtype=np.int16)[:, None]
    door = np.full((samples + 1, WIDTH), samples, dtype=np.int16)
    door[:-1] = np.where(rays.shade == legend.DOORWAY, number[:-1], number[-1])
    next_door = np.minimum.accumulate(door[::-1], axis=0)[::-1]
    lintel = next_door[np.searchsorted(_DEPTHS, _up_to(legend.LINTEL_HEIGHT))]
    ceiling, floor = _up_to(legend.CEILING_HEIGHT)[:, None], _up_to(0.0)[:, None]
    for surface, far, at in (
        (materials.LINTEL, depth[lintel], lintel),
        (materials.CEILING, ceiling, np.searchsorted(_DEPTHS, ceiling)),
        (materials.FLOOR, floor, np.searchsorted(_DEPTHS, floor)),
    ):
        nearer = far < distance
        distance = np.where(nearer, far, distance)
        sample = np.where(nearer, at, sample)
        kind[nearer] = surface
    return np.minimum(distance, FARTHEST), np.minimum(sample, samples - 1), kind


def _up_to(height: float) -> Floats32:
    """The depth at which each row reaches a height, in m; infinite where it never does."""
    with np.errstate(divide="ignore"):
        depth = (height - EYE) / _RISE
    result: Floats32 = np.where(depth > 0, depth, np.float32(np.inf))
    return result


def _surface(
    pose: Pose, rays: Rays, distance: Floats32, sample: Indices, kind: npt.NDArray[np.uint8]
) -> materials.Surface:
    columns = np.arange(WIDTH)
    here = sample * WIDTH + columns
    before = np.where(sample > 0, here - WIDTH, here)
    # A wall is painted as its room is: by the last floor that the ray crossed, whatever furniture stands there.
    on_floor = np.where(rays.height == 0.0, np.arange(len(_DEPTHS), dtype=np.int16)[:, None], np.int16(0))
    last_floor = np.maximum.accumulate(on_floor, axis=0)
    floor_before = last_floor.take(before) * np.intp(WIDTH) + columns
    dx, dy = _directions(pose)
    return materials.Surface(
        kind=kind.ravel(),
        x=(distance * dx + np.float32(pose.x)).ravel(),
        y=(distance * dy + np.float32(pose.y)).ravel(),
        z=(distance * _RISE[:, None] + np.float32(EYE)).ravel(),
        direction_x=np.broadcast_to(dx, distance.shape).ravel(),
        distance=distance.ravel(),
        shade=rays.shade.take(here).ravel(),
        floor_before=rays.shade.take(floor_before).ravel(),
        is_top=(rays.height.take(before) >= rays.height.take(here)).ravel(),
    )


def _show_people(image: Image.Image, people: tuple[Pose, ...], pose: Pose, distance: Floats32) -> None:
    """Paste people, the farthest first. The floor at their feet is as near as they are, so their depth is reduced a
    little."""
    numbered = sorted(enumerate(people), key=lambda item: -math.hypot(item[1].x - pose.x, item[1].y - pose.y))
    for number, person in numbered:
        depth, left = _in_view(person.x, person.y, pose)
        if not NEAREST < depth < FARTHEST:
            continue
        scale = FOCAL / depth
        column, feet = WIDTH / 2 - scale * left, HORIZON + scale * EYE
        half, height = scale * person_sprites.WIDTH / 2, scale * person_sprites.HEIGHT
        facing = math.cos(person.yaw - pose.yaw) < 0.0
        box = (round(column - half), round(feet - height), round(column + half), round(feet))
        if box[0] < WIDTH and box[2] > 0:
            person_sprites.paste(image, person_sprites.sprite(number, facing), box, depth * 0.98 - 0.05, distance)


def _in_view(x: float, y: float, pose: Pose) -> tuple[float, float]:
    """How far a point lies ahead and to the left, in m."""
    dx, dy = x - pose.x, y - pose.y
    forward, aside = math.cos(pose.yaw), math.sin(pose.yaw)
    return dx * forward + dy * aside, -dx * aside + dy * forward


def _hang_signs(image: Image.Image, signs: tuple[Sign, ...], pose: Pose, distance: Floats32) -> None:
    """Door signs, as plates that face the camera, where nothing stands before them."""
    draw = ImageDraw.Draw(image)
    for sign in sorted(signs, key=lambda s: -math.hypot(s.x - pose.x, s.y - pose.y)):
        depth, left = _in_view(sign.x, sign.y, pose)
        if not 0.4 < depth < 12.0:
            continue
        column = WIDTH / 2 - FOCAL * left / depth
        row = HORIZON - FOCAL * (SIGN_HEIGHT - EYE) / depth
        if not (0 <= column < WIDTH and 0 <= row < HEIGHT) or distance[int(row), int(column)] < depth - 0.02:
            continue
        size = FOCAL * 0.11 / depth
        if size < 7:
            continue
        font = ImageFont.load_default(min(size, 60.0))
        box = draw.textbbox((column, row), sign.text, font=font, anchor="mm")
        pad = size * 0.45
        plate = (box[0] - pad, box[1] - pad, box[2] + pad, box[3] + pad)
        if plate[0] < 0 or plate[2] > WIDTH:
            continue
        draw.rounded_rectangle(plate, radius=size * 0.25, fill=(38, 70, 92), outline=(230, 234, 236))
        draw.text((column, row), sign.text, font=font, anchor="mm", fill=(244, 246, 246))
