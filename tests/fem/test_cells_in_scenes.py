"""Scenes with bodies of every type of cell: impact, absorbing end, explicit march, rigid body, periodic faces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import api
from latin_fmu.building import build, discretise
from latin_fmu.fem.faces import consistent_dashpots, lumped_dashpots
from latin_fmu.reader import scene_from_dict

from .meshes import IN_MSH, QUADRATIC, typed_box
from .scenes import box_file, steel

SPEED = float(np.sqrt(210e9 / 7800))
SIDE, LENGTH, VELOCITY = 0.01, 0.03, 1.0


def two_bars(folder: Path, cell_type: str) -> dict[str, Any]:
    """A bar thrown on another one, nu = 0: their contact lasts 2 L / c with the force rho c A v / 2."""
    size, elements = (SIDE, SIDE, LENGTH), (2, 2, 4)
    return {
        "name": "bars",
        "material": steel(),
        "substructure": {
            "low": box_file(folder / "low.msh", cell_type, size, elements),
            "up": box_file(folder / "up.msh", cell_type, size, elements, LENGTH)
            | {"initial_velocity": [0.0, 0.0, -VELOCITY]},
        },
        "interface": {"meet": {"sides": ["low.zmax", "up.zmin"]}},
        "time": {"end": 1.5e-5, "instants": 100, "scheme": "massless_contact"},
        "output": {"energy": True},
    }


@pytest.mark.parametrize("cell_type", IN_MSH)
def test_impact_of_two_bars(tmp_path: Path, cell_type: str) -> None:
    solution = api.solve(scene_from_dict(two_bars(tmp_path, cell_type)))
    assert solution.converged
    force = 7800 * SPEED * SIDE**2 * VELOCITY / 2
    impulse = solution.interfaces["meet"].impulse(solution.time)[-1]
    assert abs(impulse[2]) == pytest.approx(force * 2 * LENGTH / SPEED, rel=0.01 if cell_type in QUADRATIC else 0.03)
    assert np.abs(impulse[:2]).max() < 1e-9 * abs(impulse[2])
    assert solution.energy is not None
    assert np.abs(solution.energy["balance"]).max() < 1e-11 * solution.energy["kinetic"][0]


def pulse(folder: Path, cell_type: str) -> dict[str, Any]:
    """A smooth pulse runs along a bar into an absorbing end."""
    transit = 2 * LENGTH / SPEED
    times = np.linspace(0.0, transit / 2, 21)
    values = np.sin(2 * np.pi * times / transit) ** 2
    law = {"type": "table", "times": [*times.tolist(), 1.0], "values": [*values.tolist(), 0.0]}
    return {
        "name": "pulse",
        "material": steel(),
        "substructure": {"bar": box_file(folder / "bar.msh", cell_type, (SIDE, SIDE, 2 * LENGTH), (2, 2, 12))},
        "load": {"hit": {"face": "bar.zmin", "pressure": 1e6, "law": law}},
        "boundary": {"end": {"type": "absorbing", "face": "bar.zmax"}},
        "time": {"end": 2 * transit, "instants": 200},
        "output": {"energy": True},
    }


@pytest.mark.parametrize("cell_type", IN_MSH)
def test_absorbing_end(tmp_path: Path, cell_type: str) -> None:
    """What is left of the energy: 1e-4 with quadratic cells, 2e-3 with linear ones."""
    energy = api.solve(scene_from_dict(pulse(tmp_path, cell_type))).energy
    assert energy is not None
    total = energy["kinetic"] + energy["elastic"]
    assert total[-1] < (2e-4 if cell_type in QUADRATIC else 2e-3) * total.max()


@pytest.mark.parametrize("cell_type", QUADRATIC)
def test_dashpots_of_a_uniform_velocity_give_uniform_tractions(cell_type: str) -> None:
    mesh = typed_box(cell_type, (2, 2, 2))
    facets = mesh.faces["xmax"]
    velocity = np.tile([3.0, 2.0, -1.0], mesh.n_node)

    def impedance(n: np.ndarray) -> np.ndarray:
        return np.asarray(0.5 * np.eye(3) + 4.5 * n[..., :, None] * n[..., None, :])

    for make in (consistent_dashpots, lumped_dashpots):
        force = (make(mesh.nodes, facets, impedance) @ velocity).reshape(-1, 3)
        np.testing.assert_allclose(force.sum(axis=0), 0.8 * 1.5 * np.array([15.0, 1.0, -0.5]), rtol=1e-12)
    assert np.linalg.eigvalsh(lumped_dashpots(mesh.nodes, facets, impedance).toarray())[0] > -1e-15
    assert np.linalg.eigvalsh(consistent_dashpots(mesh.nodes, facets, impedance).toarray())[0] > -1e-12


@pytest.mark.parametrize("cell_type", ["tetra10", "hexahedron20", "hexahedron27", "wedge", "mixed"])
def test_explicit_march(tmp_path: Path, cell_type: str) -> None:
    """Masses and lumped damping are positive, the step given as stable is stable, momentum is that of Newton."""
    tables = pulse(tmp_path, cell_type)
    tables["substructure"]["bar"] = box_file(tmp_path / "bar.msh", cell_type, (SIDE, SIDE, LENGTH), (2, 1, 3))
    tables["material"] = steel(0.3, rayleigh_mass=2e3, frame="absolute")
    tables["solver"] = {"propagator": "explicit"}
    tables["time"] = {"end": 4e-6, "instants": 800, "scheme": "central_difference"}
    tables["output"] = {"fields": True, "energy": True, "every": 800}
    built = build(scene_from_dict(tables))
    (propagator,) = built.assembly.propagators
    assert propagator.members[0].inertia.diagonal().min() > 0
    assert propagator.dashpots.diagonal().min() > 0
    assert propagator.stability.longest > 5e-9
    solution = api.solve(scene_from_dict(tables))
    assert solution.energy is not None
    assert np.abs(solution.energy["balance"]).max() < 1e-11 * solution.energy["kinetic"].max()
    del tables["boundary"]
    tables["material"] = steel(0.3)
    solution = api.solve(scene_from_dict(tables))
    velocity = solution.substructures["bar"].velocity
    assert velocity is not None
    mass = built.assembly.propagators[0].members[0].inertia.diagonal().reshape(-1, 3)
    momentum = (mass * velocity[-1]).sum(axis=0)
    law = tables["load"]["hit"]["law"]
    time = np.linspace(0.0, 4e-6, 801)
    push = np.interp(time, law["times"], law["values"]) * 1e6 * SIDE**2
    assert momentum[2] == pytest.approx(np.trapezoid(push, time), rel=1e-3)


@pytest.mark.parametrize("cell_type", IN_MSH)
def test_rigid_and_periodic_bodies(tmp_path: Path, cell_type: str) -> None:
    """Mass of a rigid body; a block with periodic sides strained along z stays straight."""
    body = box_file(tmp_path / "cube.msh", cell_type, (SIDE, SIDE, SIDE), (2, 2, 2))
    tables = {
        "name": "cube",
        "material": steel(0.3),
        "substructure": {"cube": body | {"rigid": True}},
        "load": {"push": {"face": "cube.zmin", "pressure": 1e6}},
        "time": {"end": 1e-5, "instants": 4},
        "output": {"fields": True},
    }
    moved = api.solve(scene_from_dict(tables)).substructures["cube"].displacement
    assert moved is not None
    np.testing.assert_allclose(moved[-1, :, 2], 0.5 * 1e6 / (7800 * SIDE) * 1e-10, rtol=0.1)
    if cell_type == "mixed":
        return  # its opposite sides are not meshed alike
    tables["substructure"] = {"cube": body}
    tables["boundary"] = {
        "x": {"type": "periodic", "faces": ["cube.xmin", "cube.xmax"]},
        "y": {"type": "periodic", "faces": ["cube.ymin", "cube.ymax"]},
        "z": {"type": "fixed", "face": "cube.zmax"},
    }
    tables["time"] = {"end": 1.0, "instants": 1, "quasi_static": True}
    history = api.solve(scene_from_dict(tables)).substructures["cube"]
    assert history.displacement is not None
    modulus = 210e9 * 0.7 / (1.3 * 0.4)  # no lateral strain
    exact = 1e6 / modulus * (SIDE - history.nodes[:, 2])
    np.testing.assert_allclose(history.displacement[-1, :, 2], exact, atol=1e-9 * exact.max())


def test_pressure_on_a_quadratic_face_is_consistent(tmp_path: Path) -> None:
    """Nothing at the corners of triangles, against the push at those of 8-node quadrilaterals; the total is p A."""
    for cell_type, corner in (("tetra10", 0.0), ("hexahedron20", -1 / 12), ("hexahedron27", 1 / 36)):
        body = box_file(tmp_path / f"{cell_type}.msh", cell_type, (1.0, 1.0, 1.0), (1, 1, 1))
        tables = {
            "name": "cube",
            "material": steel(),
            "substructure": {"cube": body},
            "time": {"end": 1e-5, "instants": 1},
            "load": {"push": {"face": "cube.zmin", "pressure": 3.0}},
        }
        prepared = discretise(scene_from_dict(tables))
        (load,) = prepared.classes[0].members[0].loads
        pattern = load.pattern.reshape(-1, 3)
        assert pattern[:, 2].sum() == pytest.approx(3.0, rel=1e-12)
        nodes = prepared.bodies["cube"].mesh.nodes
        at = np.linalg.norm(nodes, axis=1).argmin()
        assert pattern[at, 2] == pytest.approx(3.0 * corner, abs=1e-12)


def test_explicit_march_of_twenty_nodes_is_remarked_on(tmp_path: Path) -> None:
    for cell_type, schemes in (("hexahedron20", {"central_difference"}), ("hexahedron27", set())):
        tables = pulse(tmp_path, cell_type)
        tables["substructure"]["bar"] = box_file(tmp_path / "bar.msh", cell_type, (SIDE, SIDE, LENGTH), (1, 1, 3))
        for scheme in ("central_difference", "hht"):
            tables["time"]["scheme"] = scheme
            warned = any("20-node" in r for r in discretise(scene_from_dict(tables)).remarks)
            assert warned == (scheme in schemes)
