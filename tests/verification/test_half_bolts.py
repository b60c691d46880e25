"""Bolts cut by planes of symmetry: force of the modelled part; torque, thread and yield force of the whole screw."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.errors import SceneError
from latin_fmu.stability.surfaces import turned, typed_box, write_mesh

SIDE, LENGTH = 3.2e-3, 20e-3
AREA = 8.7787e-6  # tensile stress area of M4, ISO 898-1, m2
DIAMETER, TORQUE = 4e-3, 2.0
SHARES = {"whole": 1.0, "half": 0.5, "quarter": 0.25}


def screw(folder: Path, part: str = "whole", turn: np.ndarray | None = None, **bolt: Any) -> dict[str, Any]:
    """A square shank along the turned z axis, held at both ends; ``part`` of it is modelled, the rest by symmetry."""
    low = {"whole": (-1, -1), "half": (-1, 0), "quarter": (0, 0)}[part]
    rotation = np.eye(3) if turn is None else turn
    origin = np.array([*(0.5 * SIDE * x for x in low), 0.0])
    size = np.array([0.5 * SIDE * (1 - low[0]), 0.5 * SIDE * (1 - low[1]), LENGTH])
    file = folder / f"{part}.msh"
    write_mesh(file, typed_box("hexahedron", origin, size, (2, 2, 6)), lambda x: x @ rotation.T)
    boundary = {f"end_{face}": {"type": "fixed", "face": f"shank.{face}"} for face in ("zmin", "zmax")}
    for face in {"whole": (), "half": ("ymin",), "quarter": ("xmin", "ymin")}[part]:
        boundary[face] = {"type": "symmetry", "face": f"shank.{face}"}
    material = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0, "yield_stress": 640e6}
    return {
        "name": "screw",
        "material": {"steel": material},
        "substructure": {"shank": {"material": "steel", "mesh": {"file": str(file), "group": "body"}}},
        "boundary": boundary,
        "bolt": {"b": {"substructure": "shank", "axis": (rotation @ [0.0, 0.0, 1.0]).tolist(), "thread": "M4", **bolt}},
        "time": {"end": 1.0, "instants": 1, "quasi_static": True},
    }


@pytest.mark.parametrize("part", SHARES)
@pytest.mark.parametrize("seed", [None, 0])
def test_a_torque_gives_one_stress_whatever_part_is_modelled(tmp_path: Path, part: str, seed: int | None) -> None:
    turn = None if seed is None else turned(np.random.default_rng(seed).normal(size=3), 50.0)
    scene = latin_fmu.scene_from_dict(screw(tmp_path, part, turn, torque=TORQUE, diameter=DIAMETER))
    solution = latin_fmu.solve(scene)
    made, whole = solution.outcome.bolts["b"], TORQUE / (0.2 * DIAMETER)
    assert made.share == pytest.approx(SHARES[part])
    assert made.force[-1] == pytest.approx(SHARES[part] * whole, rel=1e-6)
    assert made.force[-1] / made.stress_area == pytest.approx(whole / AREA, rel=1e-4)
    report = solution.report()["bolts"]["b"]
    assert report["largest_stress"] == pytest.approx(whole / AREA, rel=1e-4)
    dataset = solution.to_datatree()["bolts/b"].to_dataset()
    assert float(dataset["thread_stress"][-1]) == pytest.approx(whole / AREA, rel=1e-4)
    text = "\n".join(latin_fmu.check(scene)), solution.summary()
    for words in text:
        assert ("as a whole" in words) == (part != "whole")


@pytest.mark.parametrize(("part", "force"), [("whole", 6e3), ("half", 3e3), ("quarter", 1.5e3)])
def test_a_force_is_that_of_the_part_and_yields_as_the_whole_does(tmp_path: Path, part: str, force: float) -> None:
    """6 kN on M4 are 683 MPa."""
    with pytest.raises(latin_fmu.SceneError, match=r"bolt\.b: the mean stress.*6\.83\de\+08"):
        discretise(latin_fmu.scene_from_dict(screw(tmp_path, part, force=force)))
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(screw(tmp_path, part, force=0.9 * force)))
    assert solution.outcome.bolts["b"].force[-1] == pytest.approx(0.9 * force, rel=1e-6)


def test_a_face_held_along_its_normal_is_a_plane_of_symmetry(tmp_path: Path) -> None:
    tables = screw(tmp_path, "half", torque=TORQUE, diameter=DIAMETER)
    tables["boundary"]["ymin"] = {"type": "fixed", "face": "shank.ymin", "components": ["y"]}
    assert discretise(latin_fmu.scene_from_dict(tables)).cuts["b"].share == 0.5


def test_the_share_that_is_given_counts(tmp_path: Path) -> None:
    """Half of a screw that no face of symmetry tells of; parallel faces tell nothing."""
    tables = screw(tmp_path, "half", torque=TORQUE, diameter=DIAMETER, share=0.5)
    del tables["boundary"]["ymin"]
    assert discretise(latin_fmu.scene_from_dict(tables)).cuts["b"].share == 0.5
    tables = screw(tmp_path, "whole", torque=TORQUE, diameter=DIAMETER)
    for face in ("xmin", "xmax"):
        tables["boundary"][face] = {"type": "symmetry", "face": f"shank.{face}"}
    with pytest.raises(latin_fmu.SceneError, match=r"bolt\.b\.share.*give share"):
        discretise(latin_fmu.scene_from_dict(tables))
    tables["bolt"]["b"]["share"] = 1.0
    assert discretise(latin_fmu.scene_from_dict(tables)).cuts["b"].share == 1.0


def test_a_section_of_another_screw_is_told(tmp_path: Path) -> None:
    """1.17 of the stress area is a shank of M4; the half of one taken for the whole is refused, and so is M6."""

    def remarks(tables: dict[str, Any]) -> list[str]:
        return [r for r in discretise(latin_fmu.scene_from_dict(tables)).remarks if "meshed section" in r]

    assert not remarks(screw(tmp_path, "half", force=100.0))
    with pytest.raises(SceneError, match=r"a diameter of 0.002553 m \(value: 0.004 m, M4"):
        remarks(screw(tmp_path, "half", force=100.0, share=1.0))
    with pytest.raises(SceneError, match=r"a diameter of 0.003611 m \(value: 0.006 m, M6"):
        remarks(screw(tmp_path, "whole", force=100.0) | _of_thread(tmp_path, "M6"))


def _of_thread(folder: Path, thread: str) -> dict[str, Any]:
    bolt = screw(folder, "whole", force=100.0)["bolt"]["b"]
    return {"bolt": {"b": {**bolt, "thread": thread}}}
