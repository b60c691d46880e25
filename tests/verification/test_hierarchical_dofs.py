"""Dofs of contact faces of second order whose points are the corners: which answers they change, and which not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import latin_fmu
from latin_fmu.building import start_state, without_scheme
from latin_fmu.joined.hierarchical_dofs import HierarchicalDofs
from latin_fmu.joined.tied_assembly import Joints, channel_trace, joint_rows
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import column

from .static_scenes import STEEL, add_stack
from .test_non_matching import of_kind

SIZE = (0.02, 0.01, 0.01)


def stacked(folder: Path, **solver: Any) -> Scene:
    """Three blocks of 10-node tetrahedra with meshes of their own, the lower two bonded, pressed and pushed."""
    time = {"end": 2e-5, "step": 5e-7, "start": {"type": "static"}}
    tables = column({}, {}, time, name="stacked", solver={"tolerance": 1e-8, **solver}, output={"fields": True})
    tables |= {"material": {"steel": dict(STEEL)}}
    counts = ((4, 2, 2), (3, 3, 2), (5, 3, 2))
    add_stack(tables, SIZE, counts, 80e6, friction_coefficient=0.3, points_at="corners")
    tables["interface"]["i1"] = {"sides": ["b1.zmax", "b2.zmin"], "behaviour": "perfect", "points_at": "corners"}
    tables["boundary"]["base"] = {"type": "symmetry", "face": "b1.zmin"}
    tables["load"]["press"]["law"] = {"type": "constant"}
    push = {"type": "half_sine", "duration": 1e-5}
    tables["load"]["push"] = {"face": "b3.xmax", "traction": [-30e6, 0.0, 0.0], "law": push}
    return latin_fmu.scene_from_dict(of_kind(tables, "tetra10", folder))


def rows_and_dofs(scene: Scene) -> tuple[sp.csr_array, sp.csr_array, HierarchicalDofs]:
    """Rows of the joints, the expansion of all bodies, and the dofs of its contact faces."""
    problem = without_scheme(scene)
    models = [m for c in problem.classes for m in c.members]
    starts = np.concatenate([[0], np.cumsum([m.n_full for m in models])])
    where = {m.name: slice(*starts[i : i + 2]) for i, m in enumerate(models)}
    trace = channel_trace(problem.classes, problem.layout, where, int(starts[-1]))
    expansion = sp.csr_array(sp.block_diag([m.expansion for m in models], format="csr"))
    rows, _, _ = joint_rows(problem.units, problem.layout, trace, Joints.of(problem.units))
    return rows, expansion, HierarchicalDofs.of(problem.units, where, expansion)


def test_every_row_has_a_dof_of_its_own(tmp_path: Path) -> None:
    rows, expansion, dofs = rows_and_dofs(stacked(tmp_path))
    by_nodes, by_corners = rows @ expansion, rows @ dofs.expanded(expansion)

    def alone(matrix: sp.csr_array) -> int:
        # rows with an entry of 1 in a column where no other row has any
        entries = sp.csc_array(np.where(np.abs(matrix.toarray()) > 1e-9, matrix.toarray(), 0.0))
        single = np.flatnonzero(np.diff(entries.indptr) == 1)
        firsts = entries.indptr[single]
        return len(np.unique(entries.indices[firsts][np.abs(entries.data[firsts] - 1.0) < 1e-9]))

    moving = int((np.abs(by_nodes.toarray()).max(axis=1) > 1e-9).sum())
    assert alone(by_nodes) == 0
    # on the edge of a face points with little area are merged into others
    assert alone(by_corners) > 0.8 * moving


def test_they_are_the_motions_of_the_nodes(tmp_path: Path) -> None:
    _, expansion, dofs = rows_and_dofs(stacked(tmp_path))
    x = np.random.default_rng(1).normal(size=(expansion.shape[1], 2))
    y = dofs.of_reduced(x)
    assert np.abs(y - x).max() > 0.1
    assert dofs.expanded(expansion) @ y == pytest.approx(expansion @ x, abs=1e-12)
    assert dofs.reduced(sp.csr_array(y)).toarray() == pytest.approx(x, abs=1e-12)
    stiffness = sp.csr_array(np.diag(np.arange(1.0, len(x) + 1)))
    energy = np.einsum("ij,ij->j", y, dofs.congruent(stiffness) @ y)
    assert energy == pytest.approx(np.einsum("ij,ij->j", x, stiffness @ x), rel=1e-12)


@pytest.mark.parametrize("propagator", ["direct", pytest.param("modal", marks=pytest.mark.slow)])
def test_no_answer_depends_on_them(propagator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    march = {"type": "modal", "highest": 1e6} if propagator == "modal" else {"type": "direct"}
    scene = stacked(tmp_path, propagator=march)

    def answers() -> list[np.ndarray]:
        solution, modes = latin_fmu.solve(scene), latin_fmu.vibration_modes(scene, count=4)
        start = start_state(scene)
        assert start is not None
        assert solution.trustworthy
        histories = [history.traction for history in solution.interfaces.values()]
        moved = [body.displacement for body in solution.substructures.values()]
        return [modes.frequency[:4], *start.displacement.values(), *start.traction.values(), *histories, *moved]

    hierarchical = answers()
    assert rows_and_dofs(scene)[2].linear is not None
    monkeypatch.setattr(HierarchicalDofs, "of", staticmethod(lambda *_: HierarchicalDofs(None)))
    for one, other in zip(hierarchical, answers(), strict=True):
        assert one == pytest.approx(other, abs=2e-6 * np.abs(other).max())
