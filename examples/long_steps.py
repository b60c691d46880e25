"""Pressed joints that slip under long steps: iterations and Newton steps per instant, error of the tractions, CPU time.

    python examples/long_steps.py [CASE ...] [--former]

A step far above the passage of a wave through an element makes the condensed operator of an instant that of statics
plus a little mass: of long range, so that the iteration alone needs tens to hundreds of iterations where points slip
or open. The scenes, all with the scheme ``hht``:

    beam     two steel halves 300 x 30 x 8 mm, clamped by 8 kN on three patches, static start, hit of 400 us
    plates   two plates under 50 MPa, sheared to and fro
    stack    eight plates under pressure, sheared to and fro
    wall     3 x 3 cubes, contacts all around them (points held by several interfaces), pushed from the side
    bent     the beam without inertia, bent to and fro

The error is that of the tractions at each instant against the same instant solved to a tolerance of 1e-5 from the same
state, relative to their norm. With ``--former`` each case is also solved with ``solver.newton = false``, with
``--fast`` without errors.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.latin.outcome import InterfaceHistory
from latin_fmu.mesh_files.gmsh import write_gmsh
from latin_fmu.stability.scenes import STEEL, Box, Description, column, half_sine, rubbing

BEAM, CLAMPS, PATCH = (0.3, 0.03, 0.008), (0.05, 0.15, 0.25), 0.02
CLAMP, HIT, STEP = 8e3, 2e3, 1e-4
EXACT = 1e-5
_HEX_FACES = ((0, 3, 2, 1), (4, 5, 6, 7))  # below and above
FOLDER = TemporaryDirectory(prefix="long_steps_")


def _half(name: str, elements: Sequence[int], outer: int) -> str:
    """Mesh file of one half of the beam: volume "body", the face of contact, patches of the outer face, its end."""
    file = Path(FOLDER.name) / f"{name}_{'x'.join(map(str, elements))}.msh"
    below = 0.0 if outer == 0 else BEAM[2]
    mesh = box_mesh(np.array([0.0, 0.0, below]), np.array(BEAM), tuple(elements))
    cells = mesh.blocks[0].cells
    groups = {"body": (3, [("hexahedron", cells)])}
    for side in (0, 1):
        quads = cells[:, _HEX_FACES[side]]
        level = mesh.nodes[quads][..., 2]
        quads = quads[(np.abs(level - below - side * BEAM[2]) < 1e-9).all(axis=1)]
        if side != outer:
            faces = {"contact": np.ones(len(quads), dtype=bool)}
        else:
            centre = mesh.nodes[quads].mean(axis=1)
            near = [(np.abs(centre[:, :2] - (x, BEAM[1] / 2)) < PATCH / 2).all(axis=1) for x in CLAMPS]
            faces = {f"clamp{i}": n for i, n in enumerate(near)} | {"tip": centre[:, 0] > BEAM[0] - PATCH / 2}
        for face, on in faces.items():
            groups[face] = (2, [("quad", quads[on])])
    write_gmsh(file, mesh.nodes, groups)
    return str(file)


def patch_area(elements: Sequence[int]) -> float:
    """Area of the elements of one patch, m2."""
    nx, ny = elements[:2]
    x, y = (np.arange(nx) + 0.5) * BEAM[0] / nx, (np.arange(ny) + 0.5) * BEAM[1] / ny
    count = int((np.abs(x - CLAMPS[1]) < PATCH / 2).sum() * (np.abs(y - BEAM[1] / 2) < PATCH / 2).sum())
    return count * BEAM[0] * BEAM[1] / (nx * ny)


def beam(
    friction: float, elements: Sequence[int] = (48, 5, 2), hit: float = HIT, instants: int = 20, step: float = STEP
) -> Description:
    """Two clamped halves, one patch of the lower one held, hit at the tip."""
    scene = column({}, {}, {"end": instants * step, "instants": instants, "scheme": "hht", "start": "static"})
    scene["material"] = {"steel": STEEL.table()}
    press = CLAMP / patch_area(elements)
    for name, outer in (("lower", 0), ("upper", 1)):
        scene["substructure"][name] = {
            "material": "steel",
            "mesh": {"file": _half(name, elements, outer), "group": "body"},
        }
        for i in range(3):
            scene["load"][f"{name}{i}"] = {"face": f"{name}.clamp{i}", "pressure": press}
    del scene["load"]["lower0"]
    scene["boundary"]["held"] = {"type": "fixed", "face": "lower.clamp0"}
    area = BEAM[1] * BEAM[0] / elements[0] * max(1, round(PATCH / 2 * elements[0] / BEAM[0]))
    scene["load"]["hit"] = {"face": "upper.tip", "pressure": hit / area, "law": half_sine(4e-4)}
    scene["interface"]["joint"] = rubbing("lower.contact", "upper.contact", friction)
    return scene


def bent(
    friction: float, increments: int = 16, elements: Sequence[int] = (48, 5, 2), force: float = 250.0
) -> Description:
    """The beam without inertia, clamped in the first quarter and bent to and fro in the rest."""
    scene = beam(friction, elements, hit=force)
    scene["time"] = {"end": 1.0, "instants": increments, "quasi_static": True}
    for load in scene["load"].values():
        load["law"] = {"type": "table", "times": [0.0, 0.25, 1.0], "values": [0.0, 1.0, 1.0]}
    turns = {"times": [0.0, 0.25, 0.5, 0.75, 1.0], "values": [0.0, 0.0, 1.0, -1.0, 0.0]}
    scene["load"]["hit"]["law"] = {"type": "table", **turns}
    return scene


def cycle(period: float, instants: int, step: float) -> Description:
    """Law of a load: a sine wave, given at the instants."""
    times = np.arange(instants + 1) * step
    return {"type": "table", "times": times.tolist(), "values": np.sin(2 * np.pi * times / period).tolist()}


def plates(
    count: int,
    shear: float,
    elements: Sequence[int] = (16, 8, 2),
    height: float = 0.01,
    friction: float = 0.3,
    instants: int = 20,
    step: float = STEP,
) -> Description:
    """``count`` steel plates 100 x 50 mm under 50 MPa; the top one is sheared obliquely at one end, to and fro."""
    bodies = {f"b{i}": Box(STEEL, (0.1, 0.05, height), elements) for i in range(1, count + 1)}
    interfaces = {f"i{i}": {"friction_coefficient": friction} for i in range(1, count)}
    time = {"end": instants * step, "instants": instants, "scheme": "hht", "start": "static"}
    scene = column(bodies, interfaces, time)
    scene["boundary"]["base"] = {"type": "fixed", "face": "b1.zmin"}
    scene["load"]["press"] = {"face": f"b{count}.zmax", "pressure": 5e7}
    law = cycle(10 * step, instants, step)
    scene["load"]["shear"] = {"face": f"b{count}.xmax", "traction": [shear, 0.5 * shear, 0.0], "law": law}
    return scene


def wall(friction: float, elements: int = 3, instants: int = 20, step: float = STEP) -> Description:
    """3 x 3 steel cubes with contacts between all neighbours, pressed from above and both sides, pushed at one side."""
    edge = 0.03
    time = {"end": instants * step, "instants": instants, "scheme": "hht", "start": "static"}
    scene = column({}, {}, time)
    scene["material"] = {"steel": STEEL.table()}
    for i in range(3):
        for j in range(3):
            scene["substructure"][f"c{i}{j}"] = Box(STEEL, (edge,) * 3, (elements,) * 3).table(
                (i * edge, 0.0, j * edge)
            )
            if i:
                scene["interface"][f"x{i}{j}"] = rubbing(f"c{i - 1}{j}.xmax", f"c{i}{j}.xmin", friction)
            if j:
                scene["interface"][f"z{i}{j}"] = rubbing(f"c{i}{j - 1}.zmax", f"c{i}{j}.zmin", friction)
        scene["boundary"][f"base{i}"] = {"type": "fixed", "face": f"c{i}0.zmin"}
        scene["load"][f"top{i}"] = {"face": f"c{i}2.zmax", "pressure": 5e7}
        for face, sign in (("xmin", 0), ("xmax", 2)):
            scene["load"][f"{face}{i}"] = {"face": f"c{sign}{i}.{face}", "pressure": 2e7}
    push = {"face": "c02.xmin", "traction": [2e7, 4e6, 0.0], "law": cycle(10 * step, instants, step)}
    scene["load"]["push"] = push
    return scene


Make = Callable[[], Description]
CASES: Mapping[str, Make] = {
    **{f"beam 294, mu {mu:g}": partial(beam, mu) for mu in (0.1, 0.3, 0.6, 1.0)},
    "beam 294, mu 0.2, 8 kN": partial(beam, 0.2, hit=8e3),
    "beam 686, mu 0.3": partial(beam, 0.3, (97, 6, 2)),
    **{f"plates, {1e6 * s:g} us": partial(plates, 2, 6e7, step=s) for s in (1e-6, 1e-5, 1e-4, 1e-3)},
    "plates, 100 us, 3 x shear": partial(plates, 2, 1.8e8),
    "stack of 8": partial(plates, 8, 6e7, (10, 5, 2), 0.006),
    **{f"wall {n}, mu {mu:g}": partial(wall, mu, e) for e, n in ((3, 192), (4, 300)) for mu in (0.3, 1.0)},
    "wall 192, mu 0.3, 1 us": partial(wall, 0.3, 3, step=1e-6),
    "beam 294, mu 0.3, 1 us": partial(beam, 0.3, step=1e-6),
    "beam 294, mu 0.3, 10 us": partial(beam, 0.3, step=1e-5),
    "bent, mu 0.3": partial(bent, 0.3),
}


@dataclass(frozen=True)
class Counts:
    """Of one run: iterations and Newton steps of its instants, windows with fall-backs and unconverged ones, of the
    static start its message, error of the tractions per instant (NaN: not known), CPU seconds of the march."""

    iterations: np.ndarray
    newton_steps: np.ndarray
    fallbacks: int
    unconverged: int
    start: str
    error: np.ndarray
    seconds: float

    def row(self) -> str:
        """Line of the table."""
        i, n = self.iterations, self.newton_steps
        error = self.error[np.isfinite(self.error)]
        errors = f"{error.mean():8.1e} {error.max():8.1e}" if len(error) else f"{'':17s}"
        return (
            f"{i.mean():6.1f} {i.max():4d} {n.mean():6.1f} {n.max():4d} {self.fallbacks:4d} {self.unconverged:4d} "
            f"{errors} {1e3 * self.seconds / len(i):9.2f}  {self.start}"
        )


def tractions(histories: Mapping[str, InterfaceHistory]) -> np.ndarray:
    """Tractions of all interfaces at the last instant, weighted by the roots of areas."""
    return np.concatenate([(h.traction[-1] * np.sqrt(h.areas)[:, None]).ravel() for h in histories.values()])


def errors(scene: latin_fmu.Scene) -> np.ndarray:
    """Error of the tractions at each instant: against the same instant from the same state solved to EXACT."""
    run, exact = SegmentedRun(scene), SegmentedRun(scene, tolerance=EXACT)
    n, relative = scene.time.n_step, []
    for instant in range(1, n + 1):
        state, end = run.snapshot(), instant * scene.time.end / n
        exact.restore(state)
        now, true = (tractions(r.advance(end, 1, accept=True).interfaces) for r in (run, exact))
        relative.append(np.linalg.norm(now - true) / max(float(np.linalg.norm(true)), np.finfo(float).tiny))
    return np.array(relative)


def solved(scene: Description, **solver: Any) -> latin_fmu.Solution:
    """Solution of a scene with further keys of [solver]."""
    return latin_fmu.solve(latin_fmu.scene_from_dict({**scene, "solver": {**scene.get("solver", {}), **solver}}))


def measure(scene: Description, error: bool = True, **solver: Any) -> Counts:
    """Counts of a run with further keys of [solver]; ``error`` : with that of the tractions."""
    made = latin_fmu.scene_from_dict({**scene, "solver": {**scene.get("solver", {}), **solver}})
    before = time.process_time()
    solution = latin_fmu.solve(made)
    seconds = time.process_time() - before
    windows = solution.windows
    return Counts(
        np.array([w.iterations for w in windows]),
        np.array([w.newton_steps for w in windows]),
        sum(bool(w.fallbacks) for w in windows),
        sum(not w.converged for w in windows),
        next((v for v in solution.outcome.settings.values() if "static equilibrium" in v), ""),
        errors(made) if error else np.full(len(windows), np.nan),
        seconds,
    )


def main(argv: Sequence[str] | None = None) -> dict[str, Counts]:
    """Print the table; counts by case."""
    words = list(sys.argv[1:] if argv is None else argv)
    former, exact = "--former" in words, "--fast" not in words
    names = [w for w in words if not w.startswith("--")]
    print(f"{'':28s}   iterations   Newton  fall- uncon-  error of tractions  CPU ms")
    print(f"{'':28s}   mean  max mean max  backs verged   mean      max      an instant", flush=True)
    table = {}
    for name, make in CASES.items():
        if names and not any(name.startswith(n) for n in names):
            continue
        scene = make()
        for which in (True, False) if former else (True,):
            counts = measure(scene, exact, newton=which)
            table[name if which else f"{name}, former"] = counts
            print(f"{name if which else '   former':28s} {counts.row()}", flush=True)
    return table


if __name__ == "__main__":
    main()
