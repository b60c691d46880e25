"""The recipe of CONTRIBUTING for an interface law, carried out in a copy of the sources: friction with cohesion.

The kernels of the copy are plain Python, so that nothing is compiled.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAW = '''"""Contact with friction and cohesion: |F_t| <= mu P + c where pressed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import SEPARATION, SLIP, STICK, add_unknown, sticking


@kernel
def value(jump: Array, z: Array, reach: Array, rate: float, parameters: Array, traction: Array) -> None:
    """P as in contact; the shear that stops the sliding, at most mu P + c."""
    traction[:] = 0.0
    closing = -(jump[0] + reach[0])
    if not (closing > 0.0 and z[0] > 0.0):
        return
    traction[0] = -closing / z[0]
    if len(jump) == 1 or z[1] <= 0.0:
        return
    norm, limit = np.hypot(jump[1], jump[2]), (parameters[1] - parameters[0] * traction[0]) * z[1]
    scale = 1.0 if norm <= limit else limit / norm
    for i in range(1, 3):
        traction[i] = scale * jump[i] / z[1]


@kernel
def tangent(
    jump: Array,
    z: Array,
    reach: Array,
    rate: float,
    parameters: Array,
    proximal: float,
    columns: Array,
    rows: Array,
    softness: Array,
) -> int:
    """The pressure; both components where it sticks, the one across the direction of slip elsewhere."""
    closing = -(jump[0] + reach[0])
    if not (closing > 0.0 and z[0] > 0.0):
        return 0
    add_unknown(0, 0, proximal * z[0], columns, rows, softness)
    if len(jump) == 1 or z[1] <= 0.0:
        return 1
    norm, limit = np.hypot(jump[1], jump[2]), (parameters[0] * closing / z[0] + parameters[1]) * z[1]
    if norm <= limit:
        return sticking(1, proximal * z[1], columns, rows, softness)
    along, across = jump[1] / norm, jump[2] / norm
    columns[1], columns[2] = -parameters[0] * along, -parameters[0] * across
    if limit <= 0.0:
        return 1
    columns[4] = rows[4] = -across
    columns[5] = rows[5] = along
    softness[4] = z[1] * (norm / limit - 1.0)
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
EDITS = {  # file: what stands there, what stands there then
    "latin_fmu/laws/dispatch.py": [
        (
            "from .contact import Contact\n",
            "from .cohesive_contact import CohesiveContact\nfrom .contact import Contact\n",
        ),
        ("SoftContact, ViscousJoint)\n", "SoftContact, ViscousJoint, CohesiveContact)\n"),
    ],
    "latin_fmu/scene/interfaces.py": [
        (
            '    "no_slip": (',
            '    "cohesive_contact": ("friction_coefficient", "cohesion", "gap", "preload", "preload_force"),\n'
            '    "no_slip": (',
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


@pytest.mark.slow
def test_a_law_by_the_recipe(tmp_path: Path) -> None:
    for folder in ("latin_fmu", "fmu_build", "tests/interface"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "latin_fmu" / "laws" / "cohesive_contact.py").write_text(LAW)
    for name, edits in EDITS.items():
        text = (tmp_path / name).read_text()
        for before, after in edits:
            assert text.count(before) == 1, (name, before)
            text = text.replace(before, after)
        (tmp_path / name).write_text(text)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "LATIN_FMU_COMPILE": "setup", "LATIN_FMU_LIBRARY": "0"}
    for command in (["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/interface"], ["-c", RUN]):
        done = subprocess.run(
            [sys.executable, *command], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
