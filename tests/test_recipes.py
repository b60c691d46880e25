"""Recipes of CONTRIBUTING, carried out in a copy of the sources: an interface law, friction with cohesion; outputs of
the FMU, the shear force of an interface and the acceleration of a sensor; an input of the FMU, wind on a face; a kind
of load, the pressure of a liquid; a quantity of an interface.

The kernels of the copy are plain Python, so that nothing is compiled.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from .package_copy import Edits, carry_out, copy_of

LAW = '''"""Contact with friction and cohesion: |F_t| <= mu P + c where pressed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import SEPARATION, SLIP, STICK, PointState, Unknowns, add_unknown, sticking


@kernel
def value(point: PointState, traction: Array) -> None:
    """P as in contact; the shear that stops the sliding, at most mu P + c."""
    jump, z = point.jump, point.z
    traction[:] = 0.0
    closing = -(jump[0] + point.reach[0])
    if not (closing > 0.0 and z[0] > 0.0):
        return
    traction[0] = -closing / z[0]
    if len(jump) == 1 or z[1] <= 0.0:
        return
    norm = np.hypot(jump[1], jump[2])
    limit = (point.parameters[1] - point.parameters[0] * traction[0]) * z[1]
    scale = 1.0 if norm <= limit else limit / norm
    for i in range(1, 3):
        traction[i] = scale * jump[i] / z[1]


@kernel
def tangent(point: PointState, unknowns: Unknowns) -> int:
    """The pressure; both components where it sticks, the one across the direction of slip elsewhere."""
    jump, z = point.jump, point.z
    closing = -(jump[0] + point.reach[0])
    if not (closing > 0.0 and z[0] > 0.0):
        return 0
    add_unknown(0, 0, unknowns.proximal * z[0], unknowns)
    if len(jump) == 1 or z[1] <= 0.0:
        return 1
    friction = point.parameters[0]
    norm = np.hypot(jump[1], jump[2])
    limit = (friction * closing / z[0] + point.parameters[1]) * z[1]
    if norm <= limit:
        return sticking(1, unknowns.proximal * z[1], unknowns)
    along, across = jump[1] / norm, jump[2] / norm
    unknowns.columns[1], unknowns.columns[2] = -friction * along, -friction * across
    if limit <= 0.0:
        return 1
    unknowns.columns[4] = unknowns.rows[4] = -across
    unknowns.columns[5] = unknowns.rows[5] = along
    unknowns.softness[4] = z[1] * (norm / limit - 1.0)
    return 2


@kernel
def point_status(traction: Array, parameters: Array, no_contact: float) -> int:
    """By the shear that friction and cohesion hold."""
    pressure = -traction[0]
    if pressure <= no_contact or pressure <= 0.0:
        return SEPARATION
    limit = (1 - 1e-10) * (parameters[0] * pressure + parameters[1])
    return STICK if len(traction) > 1 and np.hypot(traction[1], traction[2]) < limit else SLIP


@dataclass(frozen=True)
class CohesiveContact(PointLaw):
    """Contact with Coulomb friction and a cohesion, Pa."""

    friction_coefficient: float = 0.0
    cohesion: float = 0.0
    name: ClassVar[str] = "cohesive_contact"
    opens: ClassVar[bool] = True
    coulomb: ClassVar[bool] = False
    tangential: ClassVar[str] = "cohesion"
    value = staticmethod(value)
    tangent = staticmethod(tangent)
    point_status = staticmethod(point_status)
'''
EDITS: Edits = {  # file: what stands there, what stands there then
    "latin_fmu/laws/dispatch.py": [
        (
            "from .contact import Contact\n",
            "from .cohesive_contact import CohesiveContact\nfrom .contact import Contact\n",
        ),
        ("    MaxwellJoint,\n)\n", "    MaxwellJoint,\n    CohesiveContact,\n)\n"),
    ],
    "latin_fmu/scene/interfaces.py": [
        (
            '    "no_slip": _OPENING,',
            '    "cohesive_contact": ("friction_coefficient", "cohesion", *_OPENING),\n    "no_slip": _OPENING,',
        ),
        (
            "    friction_coefficient: Annotated[",
            '    cohesion: Annotated[Real | None, about("shear held without pressure", "Pa", ge=0)] = None\n'
            "    friction_coefficient: Annotated[",
        ),
    ],
    "tests/interface/conftest.py": [
        (
            '        "perfect": (MappingProxyType({}),),\n',
            '        "perfect": (MappingProxyType({}),),\n'
            '        "cohesive_contact": _sets({"friction_coefficient": 0.3, "cohesion": 0.5}, {"cohesion": 2.0}),\n',
        ),
        (
            '        "contact": contact_residual,\n',
            '        "contact": contact_residual,\n        "cohesive_contact": held,\n',
        ),
        ('{"touch": (0, 1), ', '{"touch": (0, 1), "cohesion": (1, 1), '),
        (
            "def no_slip_residual(",
            '''def held(behaviour: Behaviour, slip: Array, traction: Array, normalised_gap: Array) -> float:
    """Signorini, and |F_t| <= mu P + c with no sliding inside."""
    pressure, room = -traction[:, 0], normalised_gap + slip[:, 0]
    worst = max(0.0, float(-pressure.min()), float(-room.min()), float(np.abs(pressure * room).max()))
    limit = np.where(pressure > 0.0, behaviour.friction_coefficient * pressure + behaviour.cohesion, 0.0)
    size, speed = np.linalg.norm(traction[:, 1:], axis=1), np.linalg.norm(slip[:, 1:], axis=1)
    return max(worst, float((size - limit).max()), float((speed * np.clip(limit - size, 0.0, 1.0)).max()))


def no_slip_residual(''',
        ),
    ],
    "tests/interface/plain_laws.py": [
        (
            "def no_slip(",
            '''def cohesive_contact(jump: Array, z: Array, normalised_gap: Array, _: float, parameters: Array) -> Array:
    """Contact, with cohesion."""
    pressure = divided(np.maximum(0.0, -(jump[:, 0] + normalised_gap)), z[:, 0])
    norm = np.hypot(jump[:, 1], jump[:, 2])
    limit = np.where(pressure > 0.0, parameters[:, 0] * pressure + parameters[:, 1], 0.0) * z[:, 1]
    scale = np.where(norm > limit, divided(limit, norm), 1.0)
    return np.column_stack([-pressure, divided(scale[:, None] * jump[:, 1:], z[:, 1:])])


def no_slip(''',
        )
    ],
}
RUN = """
import numpy as np, latin_fmu
from latin_fmu.stability.scenes import STEEL, Box, column

def shear(traction):
    joint = {"behaviour": "cohesive_contact", "friction_coefficient": 0.1, "cohesion": 2e6, "preload": 1e7}
    body = Box(STEEL, (0.01, 0.01, 0.01), (1, 1, 1))
    scene = column({"low": body, "up": body}, {"joint": joint}, {"end": 1.0, "instants": 2, "quasi_static": True})
    hold = {"type": "fixed", "face": "low.zmin"}
    ramp = {"type": "table", "times": [0, 1], "values": [0, 1]}
    load = {"face": "up.zmax", "traction": [traction, 0.0, -1e7], "law": ramp}
    scene |= {"boundary": {"hold": hold}, "load": {"pull": load}}
    scene["interface"]["joint"].pop("preload")
    return latin_fmu.solve(latin_fmu.scene_from_dict(scene))

held, lost = shear(2.5e6), shear(3.5e6)   # 0.1 x 10 MPa + 2 MPa hold 3 MPa
assert held.converged, held.status
assert (held.interfaces["joint"].contact_status[-1] == 1).any()
assert not lost.converged and "equilibrium" in lost.status, lost.status
"""


OUTPUTS: Edits = {
    "latin_fmu/cosim/output_table.py": [
        (
            '        OutputKind("velocity", "m s-1", "velocity {about}", _read("motion", 1), _vector),\n',
            '        OutputKind("velocity", "m s-1", "velocity {about}", _read("motion", 1), _vector),\n'
            '        OutputKind("acceleration", "m s-2", "acceleration {about}", _read("motion", 2), _vector),\n',
        ),
        (
            '        OutputKind("smallestGap"',
            '        OutputKind("shear", "N", "tangential resultant on {first}", lambda p: '
            'np.einsum("p,tpc->tc", p.areas, '
            'p.traction - np.einsum("tpc,pc,pd->tpd", p.traction, p.normals, p.normals)), _vector, at_start=True),\n'
            '        OutputKind("smallestGap"',
        ),
    ]
}
RUN_OUTPUTS = """
import numpy as np, latin_fmu
from latin_fmu.cosim import Session
from latin_fmu.cosim.communication import CommunicationRun
from latin_fmu.kernels import entries
from latin_fmu.model_exchange.reduce import _table, Regularisation
from latin_fmu.scene.laws import ConstantLaw
from latin_fmu.cosim.input_table import with_laws
from latin_fmu.stability.scenes import STEEL, Box, column

body = Box(STEEL, (0.01, 0.01, 0.01), (1, 1, 1))
data = column({"low": body, "up": body}, {"joint": {"friction_coefficient": 0.3}}, {"end": 4e-6, "step": 1e-6},
              boundary={"base": {"type": "fixed", "face": "low.zmin"}},
              load={"pull": {"face": "up.zmax", "traction": [4e6, 1e6, -1e7], "law": {"type": "input"}}},
              solver={"window": 1, "tolerance": 1e-8},
              sensor={"head": {"substructure": "up", "point": [0.005, 0.005, 0.02]}}, output={"energy": True})
scene = latin_fmu.scene_from_dict(data)
known = latin_fmu.solve(with_laws(scene, {"pull": ConstantLaw()}))
session = Session(scene)
session.set_load("pull", 1.0, 0.0)
session.initialize()
for step in range(4):
    assert session.step(step * 1e-6, 1e-6)
def value(name):
    return session.values([f"{name}[{k}]" for k in (1, 2, 3)])
joint = known.interfaces["joint"]
normal = joint.traction[-1] @ joint.normals[0]
shear = joint.areas @ (joint.traction[-1] - normal[:, None] * joint.normals)
accelerations = known.sensors["head"].acceleration[-1]
assert np.linalg.norm(shear) > 1.0 and np.linalg.norm(accelerations) > 1.0
assert np.allclose(value("interface.joint.shear"), shear, rtol=1e-6)
assert np.allclose(value("sensor.head.acceleration"), accelerations, rtol=1e-6)
assert session.derivative(["interface.joint.shear[1]"], ["load.pull.value"], [1.0])[0] != 0.0
image = CommunicationRun(scene)  # what C marches
image.set("pull", 1.0, 0.0)
for step in range(4):
    assert image.image.call(entries.COMMUNICATE, 1, 3, 0, 1) == 1
assert np.array_equal(image.outputs(1), session.row)
names = [v.name for v in _table(scene, Regularisation(1.0, 1.0, 1.0))]
assert "interface.joint.force[1]" in names and "interface.joint.shear[1]" not in names
"""
INPUT: Edits = {
    "latin_fmu/scene/schema.py": [
        (
            '    load: Annotated[dict[Name, Load], about("loads by name")',
            '    wind: Annotated[dict[Name, Load], about("wind by name"), Field(default_factory=dict)]\n'
            '    load: Annotated[dict[Name, Load], about("loads by name")',
        ),
        (
            "        own = dict(self.load)\n",
            '        own = self.load | {f"wind.{name}": wind for name, wind in self.wind.items()}\n',
        ),
    ],
    "latin_fmu/cosim/input_table.py": [
        ("INPUTS: Final = (\n", 'INPUTS: Final = (\n    InputKind("wind.{}", "wind", "law", "wind {}"),\n')
    ],
}
RUN_INPUT = """
import numpy as np, latin_fmu
from latin_fmu.cosim import Session
from latin_fmu.cosim.communication import CommunicationRun
from latin_fmu.kernels import entries
from latin_fmu.stability.scenes import STEEL, Box, column

def scene(kind, law):
    table = {"face": "post.xmin", "traction": [1e6, 0.0, 0.0], "law": law}
    return latin_fmu.scene_from_dict(column(
        {"post": Box(STEEL, (0.01, 0.01, 0.02), (1, 1, 2))}, {}, {"end": 8e-7, "step": 2e-7},
        boundary={"base": {"type": "fixed", "face": "post.zmin"}},
        sensor={"head": {"substructure": "post", "point": [0.01, 0.01, 0.02]}}, **{kind: {"gust": table}}))

def row(session, name=None):
    session.initialize()
    for step in range(4):
        if name:
            session.set_load(name, 2e6 * step * 2e-7, 2e6)
        assert session.step(step * 2e-7, 2e-7)
    return session.row

ramp = {"type": "table", "times": [0.0, 8e-7], "values": [0.0, 1.6]}
given = Session(scene("wind", {"type": "input"}))
assert given.loads == ("wind.gust",)
assert [v.description for v in given.table if v.name == "wind.gust.value"] == [
    "amplitude that multiplies wind gust, at the start of the step"]
inputs = row(given, "wind.gust")
assert np.allclose(inputs, row(Session(scene("wind", ramp))), rtol=1e-9, atol=1e-15)
assert np.array_equal(inputs, row(Session(scene("load", {"type": "input"})), "gust"))
assert np.abs(inputs).max() > 0.0
image = CommunicationRun(scene("wind", {"type": "input"}))  # what C marches
for step in range(4):
    image.set("wind.gust", 2e6 * step * 2e-7, 2e6)
    assert image.image.call(entries.COMMUNICATE, 1, 3, 0, 1) == 1
assert np.array_equal(image.outputs(1), inputs)
"""


FLUID = '''"""The pressure of a liquid on a face: it grows linearly from a level on."""

from collections.abc import Iterator
from typing import Annotated, ClassVar

import numpy as np

from .fields import Vector, about
from .load_kinds import Array, LoadedFace, LoadEstimate, LoadKind


class FluidLoad(LoadKind):
    """A `liquid` presses with the pressure g . (x - level) at the place x."""

    chosen_by: ClassVar[tuple[str, ...]] = ("liquid",)

    liquid: Annotated[Vector | None, about("growth of the pressure along x, y, z", "Pa m-1")] = None
    level: Annotated[Vector, about("a place without pressure", "m")] = (0.0, 0.0, 0.0)

    def nodal_forces(self, face: LoadedFace, /) -> Array:
        """The pressure at each node, against the normal."""
        return -self._pressure(face)[:, None] * face.vector_areas

    def largest_traction(self, face: LoadedFace, /) -> float:
        """The pressure at the deepest node."""
        return float(np.abs(self._pressure(face)).max())

    def arrow(self, normal: Array, /) -> Array:
        """Against the normal."""
        return -normal

    def turns(self) -> bool:
        """The pressure of one end is larger than that of the other."""
        return True

    def doubts(self, estimate: LoadEstimate, /) -> Iterator[str]:
        """A liquid that is no heavier than air."""
        if estimate.small:
            yield f"a liquid that presses with {estimate.stress} at most is thinner than any"

    def _pressure(self, face: LoadedFace) -> Array:
        pressure: Array = (face.points - np.asarray(self.level)) @ np.asarray(self.liquid or (0.0, 0.0, 0.0))
        return pressure
'''
KIND: Edits = {
    "latin_fmu/scene/loads.py": [
        (
            "from .laws import ConstantLaw, Law\n",
            "from .fluid_load import FluidLoad\nfrom .laws import ConstantLaw, Law\n",
        ),
        ("first\n    ResultantLoad,\n", "first\n    FluidLoad,\n    ResultantLoad,\n"),
    ]
}
RUN_KIND = """
import numpy as np, latin_fmu, pathlib
from matplotlib.text import Text
from latin_fmu.assembly.body import build_bodies
from latin_fmu.assembly.loaded_faces import BodyFace
from latin_fmu.checks.plausibility import _load_remarks
from latin_fmu.cosim import Session
from latin_fmu.effects.explanation import explain
from latin_fmu.errors import Problems, SceneError
from latin_fmu.pictures.assembly_picture import _loads, assembly_figure
from latin_fmu.scene.histories import history_lines
from latin_fmu.scene.reference import reference_schema, reference_text
from latin_fmu.stability.scenes import STEEL, Box, column

SIDE, STEEP = 0.01, [3e9, 0.0, 0.0]  # 0 to 30 MPa over the face

def tables(law="constant", **time):
    body = Box(STEEL, (SIDE, SIDE, SIDE), (4, 2, 2))
    load = {"face": "up.zmax", "liquid": STEEP, "law": law}
    return column({"low": body, "up": body}, {"joint": {"behaviour": "perfect"}}, time,
                  boundary={"base": {"type": "fixed", "face": "low.zmin"}}, load={"sea": load})

still = tables(end=1.0, instants=2, quasi_static=True)
scene = latin_fmu.scene_from_dict(still)
found = latin_fmu.solve(scene)
assert found.converged, found.status
joint = found.interfaces["joint"]
# on the lower side: -p(centre) A along z
assert np.allclose(joint.force()[-1], [0.0, 0.0, -0.5 * STEEP[0] * SIDE**3], rtol=1e-3, atol=1e-2), joint.force()[-1]
moment = np.cross(joint.points - [SIDE / 2, SIDE / 2, SIDE], joint.traction[-1] * joint.areas[:, None]).sum(axis=0)
# int (x - c) g x dA = g b^4 / 12, by the sums of the areas of nodes 1/32 of b^4 g (4 elements: h^2 / 6 more)
assert np.isclose(moment[1], STEEP[0] * SIDE**4 / 12 * (1 + 2 / 16), rtol=5e-3), moment

bodies = build_bodies(scene, Problems())
load = scene.load["sea"]
face = BodyFace.of(bodies, load.face)
assert np.allclose(load.mean_traction(face), [0.0, 0.0, -0.5 * STEEP[0] * SIDE]) and load.turns()
assert np.isclose(load.largest_traction(face), STEEP[0] * SIDE)
(arrow,) = _loads(scene, bodies, np.concatenate([b.mesh.nodes for b in bodies.values()]), 0.01)
assert np.allclose(arrow[1], [0.0, 0.0, -1.0]) and arrow[2] == "sea\\n3.00 GPa/m", arrow
texts = [text.get_text() for text in assembly_figure(scene, []).findobj(Text)]
assert "sea\\n3.00 GPa/m" in texts, texts
assert not list(_load_remarks(scene, bodies)) and not [r for r in latin_fmu.check(scene) if "sea" in r]
thin = latin_fmu.scene_from_dict(still | {"load": {"sea": {"face": "up.zmax", "liquid": [1e-3, 0.0, 0.0]}}})
said = latin_fmu.check(thin)
assert any("sea: a liquid that presses with 1e-05 Pa at most" in remark for remark in said), said
words = " ".join(reference_text().split())
assert "A `liquid` presses with the pressure g . (x - level)" in words and "liquid: list of 3 numbers [Pa m-1]" in words
assert reference_schema()["$defs"]["Load"]["properties"]["liquid"]["unit"] == "Pa m-1"
assert "load.sea" in explain(scene).text()
for more in ({"pressure": 1e6}, {"moment": [1.0, 0.0, 0.0]}):
    try:
        latin_fmu.scene_from_dict(still | {"load": {"sea": {"face": "up.zmax", "liquid": STEEP, **more}}})
        raise AssertionError(more)
    except SceneError as error:
        assert "liquid" in str(error), error
pathlib.Path("tide.csv").write_text("time,level\\n0,0\\n0.5,1\\n1,1\\n")
history = latin_fmu.scene_from_dict(tables({"type": "csv", "file": "tide.csv"}, end=1.0, instants=2, quasi_static=True))
(line,) = history_lines(history)
assert "peak 3e+09 Pa/m" in line and "integral 2.25e+09 Pa s/m" in line, line
session = Session(latin_fmu.scene_from_dict(tables("input", end=8e-7, step=2e-7)))
assert session.loads == ("sea",)
assert "amplitude that multiplies load sea" in str([v.description for v in session.table])
"""


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """A copy of the sources and of the tests that the recipe of a law runs."""
    return copy_of(tmp_path, "fmu_build", "tests/interface")


QUANTITY: Edits = {
    "latin_fmu/scene/quantity_table.py": [
        (
            "QUANTITIES: Final[tuple[RunScalar, ...]] = (\n",
            '''def _mean(record: Any) -> float:
    """Mean of the normal force over the run, N."""
    return float(record.force.impulse() / record.end)


QUANTITIES: Final[tuple[RunScalar, ...]] = (
    QuantityOfInterest(
        "mean_force", "N", "mean of the normal force", INTERFACE, _mean, scale="itself", safety=1.35, alone=2.7
    ),
''',
        )
    ]
}
RUN_QUANTITY = """
import numpy as np, latin_fmu
from latin_fmu.parametric.study import sweep
from latin_fmu.parametric.figure import study_figure
from latin_fmu.stability.scenes import STEEL, Box, column

NAME = "joint.mean_force"
body = Box(STEEL, (0.01, 0.01, 0.01), (1, 1, 1))
tables = column({"low": body, "up": body}, {"joint": {"friction_coefficient": 0.3}}, {"end": 8e-6, "instants": 16},
                boundary={"base": {"type": "fixed", "face": "low.zmin"}},
                load={"press": {"face": "up.zmax", "pressure": 1e7}},
                output={"sensitivities": ["load.press.pressure"], "check_sensitivities": "none"},
                spread={"load.press.pressure": "1 %"},
                accuracy={"quantity": NAME})
scene = latin_fmu.scene_from_dict(tables)
solution = latin_fmu.solve(scene)
assert solution.converged, solution.status
joint = solution.interfaces["joint"]
known = np.trapezoid(joint.normal_resultant(), solution.time) / scene.time.end
assert known > 100.0

def same(value):
    return np.isclose(float(value), known, rtol=1e-12)

report = solution.report()
assert same(report["interfaces"]["joint"]["mean_force"])
derivative = report["sensitivities"]["quantities"][NAME]
assert same(derivative["value"]) and derivative["unit"] == "N"
assert np.isclose(derivative["changes"]["load.press.pressure"], known, rtol=1e-3)  # linear in the pressure
band = report["bands"]["quantities"][NAME]
assert same(band["value"]) and np.isclose(band["deviation"], 0.01 * known, rtol=1e-3)
solution.save("run.nc")
tree = latin_fmu.open_results("run.nc")
stored = tree["interfaces/joint"]["mean_force"]
assert same(stored) and stored.attrs == {"units": "N", "long_name": "mean of the normal force"}
assert NAME in tree["sensitivities"]["quantity"].values and NAME in tree["spread"]["quantity"].values
estimate = latin_fmu.estimate_error(scene, solution)[NAME]
assert same(estimate.value) and estimate.unit == "N" and 0.0 < estimate.error < 1.0
tables = {key: table for key, table in tables.items() if key not in ("spread", "output")}
study = sweep(latin_fmu.scene_from_dict(tables), {"load.press.pressure": [1e7, 2e7]})
found = study["mean_force"].sel(interface="joint").values
assert same(found[0]) and np.isclose(found[1], 2.0 * known, rtol=1e-3)
assert study["mean_force"].attrs["long_name"] == "mean of the normal force"
study_figure(study, ["mean_force"])
"""


@pytest.mark.slow
def test_a_quantity_by_the_recipe(tmp_path: Path) -> None:
    carry_out(copy_of(tmp_path), QUANTITY, ["-c", RUN_QUANTITY])


@pytest.mark.slow
def test_a_law_by_the_recipe(sources: Path) -> None:
    (sources / "latin_fmu" / "laws" / "cohesive_contact.py").write_text(LAW)
    carry_out(sources, EDITS, ["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/interface"], ["-c", RUN])


@pytest.mark.slow
def test_a_kind_of_load_by_the_recipe(sources: Path) -> None:
    """One file and one row: forces, picture, checks and words follow from the new kind."""
    (sources / "latin_fmu" / "scene" / "fluid_load.py").write_text(FLUID)
    carry_out(sources, KIND, ["-c", RUN_KIND])


@pytest.mark.slow
@pytest.mark.parametrize(("edits", "run"), [(OUTPUTS, RUN_OUTPUTS), (INPUT, RUN_INPUT)], ids=["outputs", "input"])
def test_a_row_of_the_fmu_by_the_recipe(sources: Path, edits: Edits, run: str) -> None:
    carry_out(sources, edits, ["-c", run])
