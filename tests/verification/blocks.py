"""Scenes of stacked blocks written in Python, and the same blocks for the reference solvers."""

from __future__ import annotations

from typing import Any

import numpy as np

from latin_fmu.stability.scenes import Box, Material, column, half_sine

from .oracles.contact_march import Body, ContactFace
from .oracles.hexahedra import Block, Solid, merged
from .oracles.monolithic import LinearSystem, Scheme

EDGE, ELEMENTS, STEP, N_STEP = 0.01, 3, 2e-7, 60
ALUMINIUM, STEEL = (70e9, 0.3, 2700.0), (210e9, 0.3, 7800.0)
MATERIALS = {"aluminium": ALUMINIUM, "steel": STEEL}  # E, nu, rho
PRESSURE, DURATION = 200e6, 6e-6


def stack(
    n: int, behaviour: str, friction: float = 0.0, gap: float = 0.0, elements: int = ELEMENTS, **solver: Any
) -> dict[str, Any]:
    """``n`` alternating blocks in quarter symmetry on a plane of symmetry, half-sine pressure on the top."""
    odd, even = (
        Box(Material(e, rho, nu, name), (EDGE,) * 3, (elements,) * 3) for name, (e, nu, rho) in MATERIALS.items()
    )
    keys = {"friction_coefficient": friction} if behaviour == "contact" else {}
    scene = column(
        {f"b{i}": odd if i % 2 else even for i in range(1, n + 1)},
        {f"i{i}": {"behaviour": behaviour, **keys} for i in range(1, n)},
        {"end": N_STEP * STEP, "instants": N_STEP},
        gap,
        boundary={"base": {"type": "symmetry", "face": "b1.zmin"}},
        load={"pulse": {"face": f"b{n}.zmax", "pressure": PRESSURE, "law": half_sine(DURATION)}},
        solver=solver,
        output={"fields": True, "energy": True},
    )
    for name in scene["substructure"]:
        for axis in "xy":
            scene["boundary"][f"{name}_{axis}"] = {"type": "symmetry", "face": f"{name}.{axis}min"}
    return scene


def _block(i: int) -> Block:
    material = ALUMINIUM if i % 2 else STEEL
    return Block((0, 0, (i - 1) * EDGE), (EDGE,) * 3, (ELEMENTS,) * 3, *material)


def _held(solid: Solid, with_base: bool) -> np.ndarray:
    held = [3 * solid.on_plane(axis, 0.0) + axis for axis in (0, 1)]
    if with_base:
        held.append(3 * solid.on_plane(2, 0.0) + 2)
    return np.unique(np.concatenate(held))


def pulse() -> np.ndarray:
    """Amplitude of the load at the instants."""
    time = STEP * np.arange(N_STEP + 1)
    return np.where(time < DURATION, np.sin(np.pi * time / DURATION), 0.0)


def _loads(solid: Solid, top: float) -> np.ndarray:
    nodes = solid.on_plane(2, top)
    loads = np.zeros((N_STEP + 1, solid.n_dof))
    loads[:, 3 * nodes + 2] = -PRESSURE * np.outer(pulse(), solid.face_areas(nodes))
    return loads


def bonded(n: int, scheme: Scheme) -> tuple[Solid, LinearSystem, np.ndarray]:
    """The blocks merged into one mesh, its system and loads."""
    solid = merged([_block(i) for i in range(1, n + 1)])
    system = LinearSystem(solid.mass, None, solid.stiffness, _held(solid, True), STEP, scheme)
    return solid, system, _loads(solid, n * EDGE)


def apart(n: int, friction: float, scheme: Scheme) -> tuple[list[Solid], list[Body], list[ContactFace]]:
    """The blocks as bodies in contact."""
    solids = [merged([_block(i)]) for i in range(1, n + 1)]
    bodies = []
    for i, solid in enumerate(solids, 1):
        system = LinearSystem(solid.mass, None, solid.stiffness, _held(solid, i == 1), STEP, scheme)
        loads = _loads(solid, n * EDGE) if i == n else np.zeros((N_STEP + 1, solid.n_dof))
        bodies.append(Body(system, loads, np.zeros(solid.n_dof), np.zeros(solid.n_dof)))
    faces = []
    for i in range(1, n):
        nodes = solids[i - 1].on_plane(2, i * EDGE), solids[i].on_plane(2, i * EDGE)
        normals = np.tile([0.0, 0.0, 1.0], (len(nodes[0]), 1))
        faces.append(ContactFace((i - 1, i), nodes, normals, np.zeros(len(nodes[0])), friction))
    return solids, bodies, faces
