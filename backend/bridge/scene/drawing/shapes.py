"""Geometry of the scene: meshes of walls and simple bodies, the floor as a picture, lines and laser points.

Plain functions over arrays, without viser. Lengths in m, x forward, y left, z up (REP 103); triangles wind
counter-clockwise seen from outside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from backend.telemetry import Scan

Floats = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
Extent = tuple[float, float, float, float]
"""A rectangle of the map (x0, y0, x1, y1), in m."""

NAME_OFFSET = 0.9
"""m between a place and its name, so that the name does not hide a robot at the place."""


@dataclass(frozen=True)
class Mesh:
    """Triangles: `vertices` (V, 3) in m, `faces` (F, 3) as indices of vertices."""

    vertices: Floats
    faces: npt.NDArray[np.uint32]


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """The meshes as one; one triangle of no size where there is none."""
    if not meshes:
        # viser cannot draw a mesh without a triangle; one of no size is invisible.
        return Mesh(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.uint32))
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]).astype(np.uint32),
    )


def rectangles(mask: Mask) -> list[tuple[int, int, int, int]]:
    """The true cells of `mask` as few rectangles (row, column, rows, columns) that do not overlap.

    Greedy: a run of cells is joined with equal runs of the rows before.
    """
    padded = np.pad(mask, ((0, 0), (1, 1))).astype(np.int8)
    edges = np.diff(padded, axis=1)
    open_runs: dict[tuple[int, int], int] = {}  # (first column, end column) -> the row it began in
    found = []
    for row in range(mask.shape[0] + 1):
        runs: set[tuple[int, int]] = set()
        if row < mask.shape[0]:
            begins, ends = np.flatnonzero(edges[row] == 1), np.flatnonzero(edges[row] == -1)
            runs = {(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)}
        for run in [run for run in open_runs if run not in runs]:
            first = open_runs.pop(run)
            found.append((first, run[0], row - first, run[1] - run[0]))
        for run in runs:
            open_runs.setdefault(run, row)
    return found


def walls(occupied: Mask, resolution: float, origin: tuple[float, float], height: float) -> tuple[Mesh, Mesh]:
    """The sides and the tops of walls on the occupied cells; row 0 is at the smallest y, `origin` its first corner."""
    sides: list[Mesh] = []
    tops: list[Mesh] = []
    for row, column, rows, columns in rectangles(occupied):
        x0, y0 = origin[0] + column * resolution, origin[1] + row * resolution
        x1, y1 = x0 + columns * resolution, y0 + rows * resolution
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        tops.append(_quad([(x, y, height) for x, y in corners]))
        for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
            sides.append(_quad([(ax, ay, 0), (bx, by, 0), (bx, by, height), (ax, ay, height)]))
    return joined(sides), joined(tops)


def floor_picture(
    cells: npt.NDArray[np.uint8],
    resolution: float,
    origin: tuple[float, float],
    *,
    free: tuple[int, int, int],
    line: tuple[int, int, int],
    outside: tuple[int, int, int],
    scale: int = 3,
) -> npt.NDArray[np.uint8]:
    """The floor as RGB (rows, columns, 3), `scale` pixels a cell: known space with a fine line each metre.

    `cells` is the grid of `telemetry.Map`. Row 0 of the grid and of the picture is at the smallest y: viser lays a
    picture on the floor with its first row there.
    """
    height, width = cells.shape
    picture = np.empty((height * scale, width * scale, 3), np.uint8)
    picture[:] = outside
    inside = np.kron(cells != 255, np.ones((scale, scale), np.bool_)).astype(np.bool_)
    step = resolution / scale
    on_line = np.zeros_like(inside)
    for axis, start, length in ((1, origin[0], width * scale), (0, origin[1], height * scale)):
        at = start + (np.arange(length) + 0.5) * step
        near = np.abs(at - np.round(at)) < step * 0.75
        on_line |= near[None, :] if axis == 1 else near[:, None]
    picture[inside] = free
    picture[inside & on_line] = line
    return picture


def extent(cells: npt.NDArray[np.uint8], resolution: float, origin: tuple[float, float]) -> Extent:
    """The smallest rectangle around all known cells; the whole map where no cell is known."""
    known = cells != 255
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        rows, columns = np.array([0, cells.shape[0] - 1]), np.array([0, cells.shape[1] - 1])
    return (
        origin[0] + float(columns[0]) * resolution,
        origin[1] + float(rows[0]) * resolution,
        origin[0] + float(columns[-1] + 1) * resolution,
        origin[1] + float(rows[-1] + 1) * resolution,
    )


def lathe(
    profile: Sequence[tuple[float, float]], *, centre: tuple[float, float] = (0.0, 0.0), segments: int = 40
) -> Mesh:
    """A body of revolution around the vertical axis at `centre`; `profile` is (radius, z) from bottom to top."""
    angles = np.linspace(0, 2 * math.pi, segments, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rows = [np.column_stack([ring * radius + np.array(centre), np.full(segments, z)]) for radius, z in profile]
    faces = []
    for level in range(len(profile) - 1):
        for i in range(segments):
            a, b = level * segments + i, level * segments + (i + 1) % segments
            c, d = b + segments, a + segments
            faces += [(a, b, c), (a, c, d)]
    return Mesh(np.concatenate(rows).astype(np.float32), np.array(faces, np.uint32))


def ring(inner: float, outer: float, z: float, segments: int = 56) -> Mesh:
    """A flat ring at height `z`, visible from above."""
    return lathe([(outer, z), (inner, z)], segments=segments)


def polygon(points: Sequence[tuple[float, float]], z: float) -> Mesh:
    """A flat convex polygon at height `z`, visible from above; its points run counter-clockwise."""
    vertices = np.array([(x, y, z) for x, y in points], np.float32)
    return Mesh(vertices, np.array([(0, i, i + 1) for i in range(1, len(points) - 1)], np.uint32))


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """A box between two corners."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    bottom = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    parts = [
        _quad([(x, y, z1) for x, y in bottom]),
        _quad([(x, y, z0) for x, y in reversed(bottom)]),
    ]
    for (ax, ay), (bx, by) in zip(bottom, bottom[1:] + bottom[:1], strict=True):
        parts.append(_quad([(ax, ay, z0), (bx, by, z0), (bx, by, z1), (ax, ay, z1)]))
    return joined(parts)


def segments_of(points: Sequence[tuple[float, float]], z: float) -> Floats:
    """A path as line segments (N, 2, 3) at height `z`; one segment of no length where there is no path."""
    if len(points) < 2:
        return np.zeros((1, 2, 3), np.float32)
    line = np.column_stack([np.array(points, np.float32), np.full(len(points), z, np.float32)])
    return np.stack([line[:-1], line[1:]], axis=1)


def hits(scan: Scan, z: float) -> Floats:
    """The points (N, 3) of the map frame where a laser scan hit something, at height `z`, in the order of the scan."""
    distance = np.asarray(scan.ranges, float)
    angle = scan.pose.yaw + scan.angle_min + scan.angle_increment * np.arange(len(distance))
    hit = np.isfinite(distance) & (distance < scan.range_max) & (distance > 0)
    distance, angle = distance[hit], angle[hit]
    x, y = scan.pose.x + distance * np.cos(angle), scan.pose.y + distance * np.sin(angle)
    return np.column_stack([x, y, np.full(len(distance), z)]).astype(np.float32)


def _quad(corners: Sequence[tuple[float, float, float]]) -> Mesh:
    return Mesh(np.array(corners, np.float32), np.array([(0, 1, 2), (0, 2, 3)], np.uint32))
