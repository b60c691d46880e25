"""A results file as one HTML page: bodies that deform, fields of the interfaces, curves over time.

The page (``viewer.html``) draws with the WebGL of the browser and loads nothing else. Its numbers are one block of
bytes (little endian, zlib, base64); the header in JSON says where each array begins. Displacements and fields at the
points of interfaces are integers of 16 bits, of the largest value over all instants.
"""

from __future__ import annotations

import base64
import html
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..fem.mesh import Array, Index, Mesh, cell_blocks, nearest
from ..results.groups import datasets_of, unit_of, units_of
from ..results.interface_fields import InterfaceFields, friction_resultant, normal_resultant
from ..scene.readable_numbers import prefix_for
from ..scene.units import UnitSystem
from .body_fields import STRESSES, at_instants, base_motion, largest_stresses, nodal_stress, stored_bodies
from .frame import sharp_edges, shifts_apart, skin_of
from .result_picture import Window, magnification, stored_instants
from .style import PARTS, PRESSURE, SEQUENTIAL

MOST_BYTES: Final = 14_000_000  # of the block; the page is at most 4/3 of it and 0.1 MB
_MOST_INSTANTS: Final = 400
_CURVE: Final = 2000  # values of a curve, of which a screen has no more columns
_NORMAL, _FRICTION = "normal force (compression > 0)", "friction force"
_APART: Final = 0.5  # of the mean size of the bodies
_SHORTS: Final = 32767
_STATES: Final = 65535 // 2  # separation 0, stick 1, slip 2


class _Block:
    """Arrays in one block of bytes."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: NDArray[Any], dtype: str) -> list[int]:
        """Place of an array: offset in bytes, and number of values."""
        content = np.ascontiguousarray(values, dtype=dtype).tobytes()
        place = [self._size, int(np.size(values))]
        content += b"\0" * (-len(content) % 4)  # typed arrays of a browser begin at multiples of their items
        self._parts.append(content)
        self._size += len(content)
        return place

    def text(self) -> str:
        """The block, compressed, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), 9)).decode()


@dataclass(frozen=True)
class _Surface:
    """Skin of a body: its nodes among those of the mesh, at rest (n_node, 3), m, and what is drawn between them."""

    nodes: Index
    points: Array
    triangles: Index
    edges: Index
    size: float


def page(tree: xr.DataTree, first: float | None = None, last: float | None = None, frames: int | None = None) -> str:
    """The page of a results file.

    first, last : instants, s, None for the start and the end. frames : number of instants, None for as many as fit into
    20 MB, at most 400.

    Raises
    ------
    ResultsError : the file has no displacements of bodies (``output.fields``), or no two instants in the window.
    """
    bodies = stored_bodies(tree)
    surfaces = {name: _surface(dataset) for name, dataset in bodies.items()}
    interfaces = {name: d for name, d in datasets_of(tree, "interfaces").items() if "cells" in d}
    instants = Window(first, last, frames or _frames(surfaces, interfaces, bodies)).instants(stored_instants(tree))
    rest = np.concatenate([surface.points for surface in surfaces.values()])
    centre, size = 0.5 * (rest.min(axis=0) + rest.max(axis=0)), float(np.ptp(rest, axis=0).max())
    base = base_motion(bodies, instants)
    moved = {
        name: at_instants(dataset, "displacement", instants)[:, surfaces[name].nodes] - base[:, None]
        for name, dataset in bodies.items()
    }
    largest = max(float(np.linalg.norm(values, axis=2).max(initial=0.0)) for values in moved.values())
    units, block = units_of(tree.attrs), _Block()
    stresses = _stresses(bodies, instants, units)
    divisor, second = prefix_for(float(instants[-1]), "s", figure=True)
    joints = {name: _joined(dataset, surfaces) for name, dataset in interfaces.items()}
    pairs = [(*sides, interfaces[n]["normal"].values.mean(axis=0)) for n, sides in joints.items() if len(sides) == 2]
    apart = _APART * float(np.mean([surface.size for surface in surfaces.values()]))
    shifts = shifts_apart(list(surfaces), pairs, apart / size)
    head = {
        "title": tree.attrs.get("scene_name", "run"),
        "trustworthy": bool(tree.attrs.get("trustworthy", tree.attrs.get("converged", 1))),
        "times": (instants / divisor).tolist(),
        "second": second,
        "largest": _amount(largest, units.label("m")),
        "size": size,
        "reach": largest / size,
        "factor": magnification(size, largest),
        "relative": bool(base.any()),
        "stresses": stresses,
        "maps": [block.add(_colours(name), "u1") for name in (SEQUENTIAL, PRESSURE)],
        "bodies": [
            {
                "name": name,
                "tint": PARTS[i % len(PARTS)],
                "shift": shifts[name].tolist(),
                # single precision: about the centre and over the size
                "points": block.add((surface.points - centre) / size, "<f4"),
                "triangles": block.add(surface.triangles, "<u4"),
                "edges": block.add(surface.edges, "<u4"),
                # 16 bits of the largest displacement: steps of 3e-5 of it
                "moved": block.add(np.rint(moved[name] / max(largest, 1e-300) * _SHORTS), "<i2"),
                "stresses": _fields(bodies[name], surface.nodes, stresses, instants, block),
            }
            for i, (name, surface) in enumerate(surfaces.items())
        ],
        "interfaces": [
            _interface(name, interfaces[name], joints[name], surfaces, (instants, centre, size), block)
            for name in interfaces
        ],
        "sensors": [
            {"name": name, "at": [float((dataset[x].item() - c) / size) for x, c in zip("xyz", centre, strict=True)]}
            for name, dataset in datasets_of(tree, "sensors").items()
        ],
        "curves": [_panel(title, unit, curves, divisor, block) for title, unit, curves in _curves(tree) if curves],
    }
    return _filled(head, block)


def _filled(head: Mapping[str, Any], block: _Block) -> str:
    """The page with its header and its numbers."""
    template = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
    # a name of the scene may hold what ends a script
    content = json.dumps(head, separators=(",", ":")).replace("<", "\\u003c")
    texts = {"TITLE": html.escape(str(head["title"])), "HEAD": content, "BLOCK": block.text()}
    for name, text in texts.items():
        template = template.replace(f"@{name}@", text, 1)
    return template


def _stresses(bodies: Mapping[str, xr.Dataset], instants: Array, units: UnitSystem) -> dict[str, dict[str, Any]]:
    """Scales of the stresses that the file has: up to the largest one away from edges of contacts; ``beyond`` : the
    largest one there, 0 where it is not larger."""
    if not any("nodal_stress" in dataset for dataset in bodies.values()):
        return {}
    scales = {}
    for kind, name in STRESSES.items():
        far, anywhere = (float(values.max()) for values in largest_stresses(bodies, kind, instants))
        beyond = anywhere * (anywhere > far)
        scales[kind] = {"name": name, "largest": max(far, 1e-300), "beyond": beyond, "unit": units.label("Pa")}
    return scales


def _fields(
    dataset: xr.Dataset, nodes: Index, stresses: Mapping[str, dict[str, Any]], instants: Array, block: _Block
) -> dict[str, list[int]]:
    """Stresses (n_time, n_node) at some nodes over the largest of their scales, as integers of 16 bits."""
    places = {}
    for kind, scale in stresses.items() if "nodal_stress" in dataset else ():
        values = np.stack([nodal_stress(dataset, kind, time)[nodes] for time in instants])
        places[kind] = block.add(np.rint(65535 * np.clip(values / scale["largest"], 0.0, 1.0)), "<u2")
    return places


def _frames(
    surfaces: Mapping[str, _Surface], interfaces: Mapping[str, xr.Dataset], bodies: Mapping[str, xr.Dataset]
) -> int:
    """Number of instants that fit into the block."""
    fixed = sum(12 * s.points.size + 12 * s.triangles.size for s in surfaces.values())
    # 2 bytes a component, and a stress; 2 each of pressure, slip and state at a point
    each = sum((2 + 4 * ("nodal_stress" in bodies[n]) / 3) * s.points.size for n, s in surfaces.items()) + sum(
        6 * d.sizes["point"] for d in interfaces.values()
    )
    return int(np.clip((MOST_BYTES - fixed) // each, 2, _MOST_INSTANTS))


def _surface(dataset: xr.Dataset) -> _Surface:
    nodes = np.stack([dataset[f"node_{axis}"].values for axis in "xyz"], axis=1)
    mesh = Mesh(nodes, cell_blocks(np.nan_to_num(dataset["cell_nodes"].values, nan=-1).astype(np.int64)), {})
    skin = skin_of(mesh, np.zeros(3))
    used, numbers = np.unique(skin.facets, return_inverse=True)
    facets = numbers.reshape(-1, 4)
    skin = replace(skin, points=nodes[used], facets=facets)
    # a triangle has its last corner twice
    triangles = np.concatenate([facets[:, :3], facets[facets[:, 2] != facets[:, 3]][:, [0, 2, 3]]])
    return _Surface(used, skin.points, triangles, sharp_edges(skin), mesh.size)


def _colours(name: str) -> NDArray[np.uint8]:
    """A colour map, (256, 4) red, green, blue, alpha."""
    from matplotlib import colormaps

    return np.asarray(colormaps[name](np.arange(256), bytes=True), dtype=np.uint8)


def _amount(largest: float, unit: str) -> list[Any]:
    """A number and its unit, with a prefix."""
    divisor, label = prefix_for(largest, unit, figure=True)
    return [largest / divisor, label]


def _joined(dataset: xr.Dataset, surfaces: Mapping[str, _Surface]) -> list[str]:
    """Bodies on both sides of an interface; one where the other side is a wall."""
    sides = (str(dataset.attrs.get(key, "")).split(".")[0] for key in ("face_E", "face_Ep"))
    return [side for side in sides if side in surfaces]


def _interface(
    name: str,
    dataset: xr.Dataset,
    sides: Sequence[str],
    surfaces: Mapping[str, _Surface],
    frame: tuple[Array, Array, float],
    block: _Block,
) -> dict[str, Any]:
    """Surface and fields of an interface; its points move with the nearest node of the body of each side."""
    instants, centre, size = frame
    now = dataset.sel(time=instants, method="nearest")
    points = np.stack([dataset[axis].values for axis in "xyz"], axis=1)
    cells = np.nan_to_num(dataset["cells"].values, nan=-1).astype(np.int64)
    triangles = np.concatenate([cells[:, :3], cells[cells[:, 3] >= 0][:, [0, 2, 3]]])
    traction = np.nan_to_num(now["traction"].values)
    quantities = {
        "pressure": (-np.einsum("tpc,pc->tp", traction, dataset["normal"].values), unit_of(now["traction"], "Pa"))
    }
    if "slip" in now:
        quantities["slip"] = (np.nan_to_num(now["slip"].values), unit_of(now["slip"], "m"))
    fields: dict[str, Any] = {}
    for key, (values, unit) in quantities.items():
        largest = float(values.max(initial=0.0))
        share = np.clip(values / max(largest, 1e-300), 0.0, 1.0)  # tension has the colour of no pressure
        fields[key] = {"values": block.add(np.rint(65535 * share), "<u2"), "largest": largest, "unit": unit}
    if "contact_status" in now:
        states = np.nan_to_num(now["contact_status"].values).astype(int)
        fields["state"] = {"values": block.add(_STATES * states, "<u2"), "largest": 1.0, "unit": ""}
    names = list(surfaces)
    return {
        "name": name,
        "points": block.add((points - centre) / size, "<f4"),
        "triangles": block.add(triangles, "<u4"),
        "sides": [
            {"body": names.index(side), "nodes": block.add(nearest(points, surfaces[side].points)[1], "<u4")}
            for side in sides
        ],
        "fields": fields,
    }


Curves = dict[str, tuple[Array, Array]]
"""Times and values by name."""


def _curves(tree: xr.DataTree) -> Iterator[tuple[str, str, Curves]]:
    """Title, unit and curves of what is drawn over time: forces of interfaces, tension of bolts, motion of sensors."""
    forces: dict[str, Curves] = {_NORMAL: {}, _FRICTION: {}}
    unit = "N"
    for name, dataset in datasets_of(tree, "interfaces").items():
        fields, unit = InterfaceFields.of_dataset(dataset), unit_of(dataset["force"], "N")
        forces[_NORMAL][name] = fields.time, normal_resultant(fields)
        if "contact_status" in dataset:
            forces[_FRICTION][name] = fields.time, friction_resultant(fields)
    yield from ((title, unit, curves) for title, curves in forces.items())
    bolts = datasets_of(tree, "bolts")
    tension = {name: (d["time"].values, d["force"].values) for name, d in bolts.items()}
    yield "tension of bolts", next((unit_of(d["force"], "N") for d in bolts.values()), "N"), tension
    for name, dataset in datasets_of(tree, "sensors").items():
        for motion in ("acceleration_filtered", "acceleration", "velocity", "displacement"):
            if motion in dataset:
                values = dataset[motion]
                along = {axis: (dataset["time"].values, values.values[:, i]) for i, axis in enumerate("xyz")}
                how = motion.replace("_", ", ") + ", unfiltered" * (motion in ("acceleration", "velocity"))
                yield f"{name}: {how}", unit_of(values, ""), along


def _panel(title: str, unit: str, curves: Curves, second: float, block: _Block) -> dict[str, Any]:
    divisor, label = prefix_for(max(float(np.abs(v).max(initial=0.0)) for _, v in curves.values()), unit, figure=True)
    thin = {name: _thinned(time / second, values / divisor) for name, (time, values) in curves.items()}
    return {
        "title": title,
        "unit": label,
        "curves": [
            {"name": n, "time": block.add(t, "<f4"), "values": block.add(v, "<f4")} for n, (t, v) in thin.items()
        ],
    }


def _thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """A curve by the smallest and the largest value of each of some thousand pieces: no peak is lost."""
    if len(time) <= _CURVE:
        return time, values
    ends = np.linspace(0, len(time), _CURVE // 2 + 1).astype(int)
    pairs = ((a + int(values[a:b].argmin()), a + int(values[a:b].argmax())) for a, b in pairwise(ends))
    chosen = np.unique(np.concatenate([[0, len(time) - 1], *pairs]))
    return time[chosen], values[chosen]
