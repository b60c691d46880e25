"""Coordinate systems in which a deck may give its nodes: rectangular, cylindrical and spherical ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .content import Array


@dataclass(frozen=True)
class CoordinateSystem:
    """A coordinate system placed in the basic one.

    Attributes
    ----------
    kind : "R", "C" or "S". origin : (3,). axes : (3, 3), its unit vectors x, y, z as rows.
    """

    kind: str
    origin: Array
    axes: Array

    def basic(self, values: Array) -> Array:
        """Points (n, 3) in the basic system.

        values : (n, 3): x, y, z; or r, theta, z of a cylindrical system; or r, theta, phi of a spherical one, theta
        from the z axis and phi about it (MSC Nastran Quick Reference Guide, CORD2S). Angles in degrees.
        """
        local = cartesian(self.kind, values)
        if self is BASIC:
            return local
        with np.errstate(all="ignore"):  # absurd numbers make nodes that are not finite, refused later
            return np.asarray(self.origin + local @ self.axes)


BASIC = CoordinateSystem("R", np.zeros(3), np.eye(3))
"""The system of a file without others."""


def cartesian(kind: str, values: Array) -> Array:
    """Coordinates (n, 3) of a system of this kind as x, y, z of its axes (see ``CoordinateSystem.basic``)."""
    if kind == "R":
        return values
    first, second, third = values.T
    with np.errstate(all="ignore"):  # absurd numbers make nodes that are not finite, refused later
        if kind == "C":
            angle = np.radians(second)
            return np.stack([first * np.cos(angle), first * np.sin(angle), third], axis=1)
        polar, about = np.radians(second), np.radians(third)
        across = first * np.sin(polar)
        return np.stack([across * np.cos(about), across * np.sin(about), first * np.cos(polar)], axis=1)


def from_points(kind: str, origin: Array, on_z: Array, in_xz: Array) -> CoordinateSystem | None:
    """The system with its origin, a point of its z axis, and one of its plane x z, x > 0; None where they lie on one
    line."""
    return _system(kind, origin, on_z - origin, in_xz - origin, "z")


def from_x_axis(kind: str, origin: Array, on_x: Array, in_xy: Array) -> CoordinateSystem | None:
    """The system with its origin, a point of its x axis, and one of its plane x y, y > 0; None where they lie on one
    line."""
    return _system(kind, origin, on_x - origin, in_xy - origin, "x")


def _system(kind: str, origin: Array, first: Array, second: Array, axis: str) -> CoordinateSystem | None:
    with np.errstate(all="ignore"):
        unit = first / np.linalg.norm(first)
        # unit vector z of the plane x y, or y of the plane z x
        normal = np.cross(unit, second)
        normal /= np.linalg.norm(normal)
    if not np.isfinite([*unit, *normal]).all():
        return None
    third = np.cross(normal, unit)
    if axis == "z":
        axes = (third, normal, unit)
    else:
        axes = (unit, third, normal)
    return CoordinateSystem(kind, origin, np.array(axes))


def turned(points: Array, origin: Array, axis: Array, angle: float) -> Array:
    """Rotation of points (n, 3) by ``angle`` (rad) about the axis through ``origin`` (Rodrigues)."""
    with np.errstate(all="ignore"):  # absurd numbers make nodes that are not finite, refused later
        k = axis / np.linalg.norm(axis)
        r = points - origin
        along = np.outer(r @ k, k)
        return np.asarray(origin + along + np.cos(angle) * (r - along) + np.sin(angle) * np.cross(k, r))
