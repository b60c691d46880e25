"""Relations between two runs of one scene in two descriptions, and how far apart their results may be.

A relation changes the tables of a scene, and takes the change out of the results of the second run. Vectors, points and
units are found by the schema: a field with a unit has its number in other units changed by it, and a vector field that
is in neither list below is an error, so that a new one has a place before its first day is over.
"""

from __future__ import annotations

import copy
import re
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from scipy.spatial.transform import Rotation

import latin_fmu
from fmu_build.build import build_fmu
from latin_fmu.assembly import interfaces
from latin_fmu.cosim import Session
from latin_fmu.errors import SceneError, SolverError
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.scene.fields import SceneTable
from latin_fmu.scene.units import UNIT_SYSTEMS
from latin_fmu.stability.surfaces import write_mesh
from tests.fem.meshes import cut
from tests.fmu.host import Host

from .random_scenes import Tables

Array = np.ndarray
Results = dict[str, Array]
Random = np.random.Generator
LIMIT: Final = 1e-5
"""Of the largest of the quantity: two descriptions of one discrete problem, solved to 1e-9."""
SINGLE: Final = 1e-5
"""What docs/scene_time.md says of factors in single precision; a run tells no error of its own for them."""
RESIDUALS: Final = ("energy.balance", "energy.drift_work")
"""Zero but for round-off and for what the solver leaves: they count beside the largest energy."""
SMALL: Final = 1e-3
"""A quantity counts as at least this share of the largest of its kind: the tolerance is one of the whole scene."""
SMALL_ENERGY: Final = 1e-2
"""The same of energies: what contacts lose is what is left of the works of all forces."""
POINTS: Final = ("origin", "point", "centre")
VECTORS: Final = (
    *("initial_velocity", "initial_spin", "initial_displacement", "body_force", "acceleration", "traction", "force"),
    *("nodal_force", "moment", "velocity", "direction", "axis", "normal", "x", "y"),
)
TENSORS: Final = ("initial_velocity_gradient", "initial_displacement_gradient")
NOT_TURNED: Final = (
    "size",
    "elements",
    "young_moduli",
    "poisson_ratios",
    "shear_moduli",
    "thermal_expansions",
    "inertia",
)
"""Three numbers that are no vector. Boxes become mesh files before they are turned."""
FROM_FILES: Final = ("points", "values")
"""What the files of initial fields fill; no scene here has one."""
DOUBLED: Final = (
    *(
        "pressure",
        "traction",
        "force",
        "nodal_force",
        "moment",
        "body_force",
        "acceleration",
        "change",
        "initial_velocity",
        "value",
    ),
    *(
        "initial_spin",
        "initial_displacement",
        "gap",
        "interference",
        "preload",
        "preload_force",
        "velocity",
        "amplitude",
    ),
    *("shortening", "torque", "initial_velocity_gradient", "initial_displacement_gradient"),
)
"""Keys of what the motion is proportional to."""


@dataclass(frozen=True)
class Run:
    """What a run of a scene ended in: results by quantity, (n_time, 3) or (n_time,); or why there are none."""

    results: Results = field(default_factory=dict)
    converged: bool = True
    refused: str = ""
    warnings: tuple[str, ...] = ()
    solution: latin_fmu.Solution | None = None


class NotConvergedError(Exception):
    """A run step by step that stops because a step has not converged, or a run that its own checks stop."""


Apart = tuple[str, float, float]
"""The quantity that differs most, by how much, and the limit."""


@dataclass(frozen=True)
class Relation:
    """A second way to the same results.

    Attributes
    ----------
    change : tables of the second run, and how its results are taken back, from tables, random numbers and a folder;
        None where the scene has nothing to change. limit : of the difference; 0: the same bits. solve : the second run.
        apart : difference and limit of two runs and the largest force, where the second tells its error.
        costly : whether a second run takes a second and more.
    """

    name: str
    change: Callable[[Tables, Random, Path], tuple[Tables, Callable[[Results], Results]] | None]
    limit: float = LIMIT
    solve: Callable[[latin_fmu.Scene, Path], Results] | None = None
    apart: Callable[[Run, Run, float], Apart] | None = None
    costly: bool = False


# -- results ----------------------------------------------------------------------------------------------------------
def results_of(solution: latin_fmu.Solution) -> Results:
    """Forces of interfaces and supports, tensions of bolts, motions of sensors and energies at all instants."""
    made = {f"force.{name}": history.force() for name, history in solution.interfaces.items()}
    made |= {f"reaction.{name}": history.force for name, history in solution.reactions.items()}
    made |= {f"tension.{name}": history.force for name, history in solution.bolts.items()}
    for name, sensor in solution.sensors.items():
        made |= {f"displacement.{name}": sensor.displacement, f"velocity.{name}": sensor.velocity}
    made |= {f"energy.{name}": values for name, values in (solution.energy or {}).items()}
    return made


def run(tables: Tables, folder: Path, solve: Callable[[latin_fmu.Scene, Path], Results] | None = None) -> Run:
    """The outcome of a scene given as tables."""
    try:
        scene = latin_fmu.scene_from_dict(written(tables, folder), folder)
        if solve is not None:
            return Run(solve(scene, folder))
        solution = latin_fmu.solve(scene)
    except NotConvergedError as stopped:
        return Run(converged=False, refused=str(stopped))
    except (SceneError, SolverError) as error:
        # a static start that has not converged
        return Run(converged="not converged" not in str(error), refused=str(error))
    said = "" if solution.converged else solution.status
    return Run(results_of(solution), solution.converged, said, tuple(solution.warnings), solution)


def load_of(tables: Tables) -> float:
    """Largest force of a load, N: forces far below it are round-off."""
    edges = [body["box"]["size"] for body in tables["substructure"].values() if "box" in body]
    area = max((max(size) ** 2 for size in edges), default=0.0)
    loads = tables.get("load", {}).values()
    forces = [abs(load.get("pressure", 0.0)) * area + float(np.linalg.norm(load.get("force", 0.0))) for load in loads]
    forces += [bolt.get("force", 0.0) for bolt in tables.get("bolt", {}).values()]
    return max(forces, default=0.0)


def distances(expected: Results, found: Results, force: float) -> dict[str, float]:
    """Largest difference of each quantity over its largest value, or ``SMALL`` of the largest of its kind; ``force`` :
    of a load."""
    largest = {"force": force, "reaction": force, "tension": force}
    for name, values in expected.items():
        kind = name.partition(".")[0]
        largest[kind] = max(largest.get(kind, 0.0), float(np.abs(values).max(initial=0.0)))
    made = {}
    for name, values in found.items():
        kind, size = name.partition(".")[0], float(np.abs(expected[name]).max(initial=0.0))
        apart = float(np.abs(values - expected[name]).max(initial=0.0))
        share = 1.0 if name in RESIDUALS else SMALL_ENERGY if kind == "energy" else SMALL
        scale = max(size, share * largest[kind])
        made[name] = apart / scale if scale > 0.0 else apart
    return made


# -- walks over the tables of a scene by its schema -------------------------------------------------------------------
def fields(table: SceneTable, data: Any, path: str = "") -> Iterator[tuple[str, str, str | None, Any, Any]]:
    """Path, key, unit, the dictionary and the value of every field of a table that is written in ``data``."""
    for key, about in type(table).model_fields.items():
        value, place = getattr(table, key), f"{path}.{key}" if path else key
        if not isinstance(data, dict) or key not in data or value is None:
            continue
        extra = about.json_schema_extra
        unit = extra.get("unit") if isinstance(extra, dict) else None
        yield place, key, unit if isinstance(unit, str) else None, data, value
        inner: list[tuple[str, Any, Any]] = [(place, value, data[key])]
        if isinstance(value, Mapping):
            inner = [(f"{place}.{name}", item, data[key][name]) for name, item in value.items()]
        elif isinstance(value, tuple):
            inner = [(f"{place}.{i}", item, data[key][i]) for i, item in enumerate(value)]
        for where, item, written in inner:
            if isinstance(item, SceneTable):
                yield from fields(item, written, where)


def changed(tables: Tables, change: Callable[[str, str | None, Any], Any]) -> Tables:
    """Tables with the numbers that ``change(key, unit, value)`` gives for fields of the schema."""
    plain = copy.deepcopy(tables)
    cells = {n: b["box"].pop("cells") for n, b in plain["substructure"].items() if "cells" in b.get("box", {})}
    scene = latin_fmu.scene_from_dict(plain)
    made = scene.tables()
    for _, key, unit, data, _ in list(fields(scene, made)):
        data[key] = change(key, unit, data[key])
    for name, kind in cells.items():
        made["substructure"][name]["box"]["cells"] = kind
    return {key: value for key, value in made.items() if value not in ({}, None)}


def _is_vector(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) == 3 and all(isinstance(x, float) for x in value)


def each_vector(tables: Tables, turn: Callable[[Array], Array], move: Callable[[Array], Array]) -> Tables:
    """Tables with vectors turned and points moved."""

    def change(key: str, unit: str | None, value: Any) -> Any:
        del unit
        if key in TENSORS and value is not None:
            # on both sides: rows and columns are vectors
            once = np.array([turn(np.array(row)) for row in value])
            return [[float(x) for x in row] for row in np.array([turn(column) for column in once.T]).T]
        if not _is_vector(value) or key in NOT_TURNED:
            return value
        if key in POINTS:
            return [float(x) for x in move(np.array(value))]
        return [float(x) for x in turn(np.array(value))] if key in VECTORS else value

    return changed(tables, change)


# -- the relations ----------------------------------------------------------------------------------------------------
def _same(results: Results) -> Results:
    return results


def _each(results: Results, vector: Callable[[str, Array], Array]) -> Results:
    """Results with a function of each vector quantity."""
    return {name: vector(name, v) if v.ndim == 2 else v for name, v in results.items()}


def written(tables: Tables, folder: Path) -> Tables:
    """Tables with mesh files in the place of boxes that name their cells."""
    return as_files(tables, folder, names=[n for n, b in tables["substructure"].items() if "cells" in b.get("box", {})])


def as_files(tables: Tables, folder: Path, turn: Array | None = None, names: Collection[str] | None = None) -> Tables:
    """Tables whose boxes, all or those of ``names``, are mesh files in a folder, turned about the origin by a rotation
    (3, 3)."""
    made = copy.deepcopy(tables)
    place = Path(tempfile.mkdtemp(dir=folder))
    for name, body in made["substructure"].items():
        if "box" not in body or (names is not None and name not in names):
            continue
        box = body.pop("box")
        mesh = box_mesh(np.array(box.get("origin", [0.0] * 3)), np.array(box["size"]), tuple(box["elements"]))
        mesh = cut(mesh, box["cells"]) if "cells" in box else mesh
        write_mesh(place / f"{name}.msh", mesh, None if turn is None else lambda x: x @ turn.T)
        body["mesh"] = {"file": str(place / f"{name}.msh")}
    return made


def _turned(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
    turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    made = each_vector(as_files(tables, folder, turn), lambda v: turn @ v, lambda x: turn @ x)
    for material in made["material"].values():
        if (own := material.get("orthotropic")) and "axes" not in own:
            own["axes"] = {"x": turn[:, 0].tolist(), "y": turn[:, 1].tolist()}
    for boundary in made.get("boundary", {}).values():
        part = set(boundary.get("components", "xyz")) != set("xyz")
        if "value" in boundary or (boundary["type"] == "fixed" and part):
            boundary.setdefault("axes", {"x": turn[:, 0].tolist(), "y": turn[:, 1].tolist()})
    return made, lambda results: _each(results, lambda _, v: v @ turn)


def _shifted(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
    del folder
    size = max(max(b["box"]["size"]) for b in tables["substructure"].values())
    by = size * rng.uniform(-3.0, 3.0, 3)
    return each_vector(tables, lambda v: v, lambda x: x + by), _same


def _filed(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
    del rng
    return as_files(tables, folder), _same


NAMED: Final = (
    "substructure",
    "interface",
    "boundary",
    "load",
    "sensor",
    "temperature",
    "spring",
    "point_mass",
    "material",
    "bolt",
)


def _renamed(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
    """Other names, which sort the other way round, in another order."""
    del folder
    names = {name: f"z{99 - i}_{name}" for i, name in enumerate(tables["substructure"])}
    materials = {name: f"y{99 - i}_{name}" for i, name in enumerate(tables["material"])}

    def change(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {k: change(v, k) for k, v in value.items()}
        if isinstance(value, list | tuple):
            return [change(v, key) for v in value]
        if not isinstance(value, str):
            return value
        body, dot, face = value.partition(".")
        if key == "material":
            return materials.get(value, value)
        if key in ("substructure", "substructures"):
            return names.get(value, value)
        return f"{names[body]}.{face}" if dot and body in names else value

    made = {key: change(value, key) if key not in NAMED else value for key, value in tables.items()}
    for key in NAMED:
        group = {
            materials.get(n, n) if key == "material" else names.get(n, n) if key == "substructure" else n: change(t)
            for n, t in tables.get(key, {}).items()
        }
        order = rng.permutation(len(group))
        made[key] = {list(group)[i]: list(group.values())[i] for i in order}
    return made, _same


def _swapped(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]] | None:
    del rng, folder
    made = copy.deepcopy(tables)
    names = [n for n, table in made["interface"].items() if table["sides"][1] != "ground"]
    for name in names:
        made["interface"][name]["sides"].reverse()
    turned = {f"force.{name}" for name in names}
    return (made, lambda results: {n: -v if n in turned else v for n, v in results.items()}) if names else None


def _in_other_units(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
    del folder
    system = UNIT_SYSTEMS[str(rng.choice(["mm-t-s-MPa", "in-lbf-s-psi"]))]

    def scaled(value: Any, size: float) -> Any:
        if isinstance(value, list | tuple):
            return [scaled(v, size) for v in value]
        return value / size if isinstance(value, float) else value

    def change(key: str, unit: str | None, value: Any) -> Any:
        del key
        return value if unit is None else scaled(value, system.size(unit))

    units = dict.fromkeys(("force", "reaction", "tension"), "N") | {
        "displacement": "m",
        "velocity": "m s-1",
        "energy": "J",
    }
    made = changed(tables, change) | {"units": system.name}
    return made, lambda results: {n: v * system.size(units[n.partition(".")[0]]) for n, v in results.items()}


def _doubled(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
    """Twice the loads, motions and gaps: with contact and friction everything is homogeneous of degree one."""
    del rng, folder

    def twice(value: Any) -> Any:
        return [twice(v) for v in value] if isinstance(value, list | tuple) else 2.0 * value

    def change(key: str, unit: str | None, value: Any) -> Any:
        del unit
        return twice(value) if key in DOUBLED and not isinstance(value, str | dict) else value

    powers = {"energy": 4.0}
    return changed(tables, change), lambda r: {n: v / powers.get(n.partition(".")[0], 2.0) for n, v in r.items()}


def _with_twice_the_touch(scene: latin_fmu.Scene, folder: Path) -> Results:
    """Twice the one length that no table has: of the gap that counts as closed without slip."""
    del folder
    with patch.object(interfaces, "_TOUCH", 2.0 * interfaces._TOUCH):
        return results_of(latin_fmu.solve(scene))


def _in_motion(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]] | None:
    """The same seen from a frame in motion: only where nothing is held from outside."""
    del folder
    holds = any(t["sides"][1] == "ground" for t in tables["interface"].values())
    if tables.get("boundary") or holds:
        return None
    drift = rng.normal(size=3) * max(_speeds(tables), 1e-3)
    made = copy.deepcopy(tables) | {"motion": {"velocity": drift.tolist()}}
    time = np.linspace(0.0, tables["time"]["end"], tables["time"]["instants"] + 1)[:, None]

    def back(results: Results) -> Results:
        kept = {n: v for n, v in results.items() if not n.startswith("energy")}
        moved = {"displacement": time * drift, "velocity": np.tile(drift, (len(time), 1))}
        return {n: v - moved.get(n.partition(".")[0], 0.0) for n, v in kept.items()}

    return made, back


def _speeds(tables: Tables) -> float:
    given = [b.get("initial_velocity", [0.0]) for b in tables["substructure"].values()]
    return max(float(np.abs(v).max()) for v in given)


def with_solver(**settings: Any) -> Callable[[Tables, Random, Path], tuple[Tables, Callable[[Results], Results]]]:
    """A relation that changes settings of the solver."""

    def change(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
        del rng, folder
        return tables | {"solver": tables["solver"] | settings}, _same

    return change


def _more_output(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
    del rng, folder
    return tables | {"output": {"energy": True, "fields": True, "stress": True, "surfaces": True}}, _same


def _as_it_is(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]]:
    del rng, folder
    return tables, _same


def _cut(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]] | None:
    """A body cut in two by a bond between layers of its elements."""
    del folder
    bolts = {bolt["substructure"] for bolt in tables.get("bolt", {}).values()}
    boxes = {
        n: b["box"]
        for n, b in tables["substructure"].items()
        if b["box"]["elements"][2] > 1 and "cells" not in b["box"] and n not in bolts
    }
    if not boxes or tables["time"].get("scheme") == "generalized_alpha":
        return None
    name = sorted(boxes)[int(rng.integers(len(boxes)))]
    made, box = copy.deepcopy(tables), boxes[name]
    below = int(rng.integers(1, box["elements"][2]))
    height = box["size"][2] * below / box["elements"][2]
    low, high = made["substructure"][name], copy.deepcopy(made["substructure"][name])
    x, y, z = box["origin"]
    low["box"] |= {"size": [*box["size"][:2], height], "elements": [*box["elements"][:2], below]}
    high["box"] |= {
        "origin": [x, y, z + height],
        "size": [*box["size"][:2], box["size"][2] - height],
        "elements": [*box["elements"][:2], box["elements"][2] - below],
    }
    sides = f"{name}.xmin", f"{name}.xmax", f"{name}.ymin", f"{name}.ymax"
    if any(t.get("face") in sides for group in ("load", "boundary", "sensor") for t in made.get(group, {}).values()):
        return None
    made["substructure"]["upper_half"] = high
    made["interface"]["bond"] = {"sides": [f"{name}.zmax", "upper_half.zmin"], "behaviour": "perfect"}
    _move_to_the_upper_half(made, name, z + height)
    return made, lambda results: {n: v for n, v in results.items() if n != "force.bond"}


def _move_to_the_upper_half(tables: Tables, name: str, level: float) -> None:
    """What is on the upper part of a body that is cut at a height."""

    def visit(value: Any) -> None:
        if isinstance(value, dict):
            if value.get("substructure") == name and value.get("point", [0, 0, -np.inf])[2] > level:
                value["substructure"] = "upper_half"
            if name in value.get("substructures", ()):
                value["substructures"] = [*value["substructures"], "upper_half"]
            for key, item in value.items():
                if item == f"{name}.zmax":
                    value[key] = "upper_half.zmax"
                visit(item)
        elif isinstance(value, list):
            for item in value:
                visit(item)

    for key, table in tables.items():
        if key != "interface":
            visit(table)
    for other, table in tables["interface"].items():
        if other != "bond":
            table["sides"] = ["upper_half.zmax" if side == f"{name}.zmax" else side for side in table["sides"]]


def _resumed(scene: latin_fmu.Scene, folder: Path) -> Results:
    """The run stopped at the third instant, and gone on with from its checkpoint."""
    looks: list[int] = []
    place = Path(tempfile.mkdtemp(dir=folder)) / "c"
    stop = Checkpoint(place, every=1, stop=lambda: bool(looks.append(1)) or len(looks) > 2)
    assert not latin_fmu.solve(scene, checkpoint=stop).complete
    return results_of(latin_fmu.solve(scene, checkpoint=Checkpoint(place, resume=True, log=lambda _: None)))


def _in_a_session(scene: latin_fmu.Scene, folder: Path) -> Results:
    """The run step by step in a session."""
    del folder
    session, step = Session(scene), scene.time.time_step
    session.initialize()
    names = {f"force.{name}": [f"interface.{name}.force[{i}]" for i in (1, 2, 3)] for name in scene.joints}
    rows = {name: [] for name in names}
    for i in range(scene.time.n_step):
        report = session.step(i * step, step)
        if not report:
            raise NotConvergedError(report.message)
        for name, own in names.items():
            rows[name].append(session.values(own))
    return {name: np.array([np.full(3, np.nan), *values]) for name, values in rows.items()}


def _in_an_fmu(python: bool) -> Callable[[latin_fmu.Scene, Path], Results]:
    """The run step by step in an FMU, compiled or with Python."""

    def solve(scene: latin_fmu.Scene, folder: Path) -> Results:
        place = Path(tempfile.mkdtemp(dir=folder))
        names = {f"force.{name}": [f"interface.{name}.force[{i}]" for i in (1, 2, 3)] for name in scene.joints}
        rows = {name: [np.full(3, np.nan)] for name in names}
        with closing(Host(build_fmu(scene, place / "scene.fmu", "2", python=python), place / "host")) as host:
            host.start()
            for i in range(scene.time.n_step):
                # 1 is a warning: the step was made
                if not host.step(i * scene.time.time_step, scene.time.time_step) and host.last > 1:
                    raise NotConvergedError(str(host.messages))
                for name, outputs in names.items():
                    rows[name].append(host.read(outputs))
        return {name: np.array(values) for name, values in rows.items()}

    return solve


def _reduced(tables: Tables, rng: Random, folder: Path) -> tuple[Tables, Callable[[Results], Results]] | None:
    """A few modes of each body, where the time scheme permits it."""
    del folder
    if tables["time"].get("scheme") == "generalized_alpha":
        return None
    propagator = {"type": "reduced", "modes": int(rng.integers(4, 25))}
    return tables | {"solver": tables["solver"] | {"propagator": propagator}}, _same


_TOLD: Final = re.compile(r"estimated error of the interface velocities ([\d.e+-]+) %")


ESTIMATE: Final = 2.0
"""How far beyond an estimated error the difference may be."""


def _by_the_told_error(base: Run, second: Run, force: float) -> Apart:
    """Interface velocities and forces of a reduced run, root mean square over all of them, beside the error of the
    velocities that the run tells for its bodies: that of contact forces is smaller, it says."""
    told = [float(found[1]) for warning in second.warnings if (found := _TOLD.search(warning))]
    assert base.solution is not None
    assert second.solution is not None
    others = second.solution.interfaces
    # sums of squares: velocities of the differences and of all, then forces, those far below the load round-off
    sums = np.array([[0.0, 0.0], [0.0, 0.0]])
    for name, history in base.solution.interfaces.items():
        weights, expected = history.areas[:, None], history.velocity
        sums[0] += (weights * (others[name].velocity - expected) ** 2).sum(), (weights * expected**2).sum()
        forces = history.force()
        floor = len(forces) * (SMALL * force) ** 2
        sums[1] += ((others[name].force() - forces) ** 2).sum(), max((forces**2).sum(), floor)
    shares = np.sqrt(np.divide(sums[:, 0], sums[:, 1], out=np.zeros(2), where=sums[:, 1] > 0.0))
    worst = int(shares.argmax())
    name = ("interface velocities", "interface forces")[worst]
    return name, float(shares[worst]), ESTIMATE * max(told, default=0.0) / 100.0 + LIMIT


RELATIONS: Final = {
    relation.name: relation
    for relation in (
        Relation("turned", _turned),
        Relation("shifted", _shifted),
        Relation("mesh files", _filed),
        Relation("renamed", _renamed),
        Relation("swapped", _swapped),
        Relation("other units", _in_other_units),
        Relation("doubled", _doubled, 0.0, _with_twice_the_touch),
        Relation("moving frame", _in_motion),
        Relation("exact operator", with_solver(interface_operator="exact")),
        Relation("sparse operator", with_solver(interface_operator="sparse")),
        Relation("windows", with_solver(window=3)),
        Relation("threads", with_solver(threads=2), 0.0),
        Relation("outputs", _more_output, 0.0),
        Relation("checkpoint", _as_it_is, 0.0, _resumed),
        Relation("session", _as_it_is, LIMIT, _in_a_session),
        Relation("cut by a bond", _cut),
        Relation("single precision", with_solver(precision="float32"), SINGLE),
        Relation("reduced", _reduced, apart=_by_the_told_error),
        Relation("compiled FMU", _as_it_is, LIMIT, _in_an_fmu(python=False), costly=True),
        Relation("FMU with Python", _as_it_is, LIMIT, _in_an_fmu(python=True), costly=True),
    )
}
