"""A law of an interface written in NumPy: friction whose shear cannot exceed a strength.

Coulomb's law lets the shear grow with the pressure without end; here it yields at tau_max,

    |F_t| <= min(mu P, tau_max),

as faces do under pressures near the yield stress of their material. ``CappedFriction.local`` is the whole law:
tractions on side E for the velocities that both sides would take without them, all points at once. It is handed to
``solve`` in the place of the law that the scene names; the iteration then calls it from Python.

    python examples/own_law.py
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

import latin_fmu
from latin_fmu.interface import PointLaw

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CappedFriction(PointLaw):
    """Unilateral contact with Coulomb's friction up to a strength; see ``latin_fmu.interface.laws``."""

    friction_coefficient: float
    strength: float  # tau_max, Pa
    name: ClassVar[str] = "capped_friction"
    compiled: ClassVar[bool] = False
    opens: ClassVar[bool] = True  # it has a gap

    @staticmethod
    def local(jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:  # noqa: ARG004
        """Tractions (n_point, 3) on side E.

        Parameters
        ----------
        jump : (n_point, 3) velocity of E' relative to E without tractions, m s-1; a traction F changes it by - z F.
        z : (n_point, 2) normal and tangential, m3 N-1 s-1. normalised_gap : (n_point,) gap over the time step, m s-1.
        rate : 1 / time step, s-1. parameters : (n_point, 2).
        """
        traction = np.zeros_like(jump)
        free = z[:, 0] > 0  # both sides held: no traction
        pressure = np.zeros(len(jump))
        pressure[free] = np.maximum(0.0, -(jump[free, 0] + normalised_gap[free])) / z[free, 0]
        traction[:, 0] = -pressure
        limit = np.minimum(parameters[:, 0] * pressure, parameters[:, 1])
        speed = np.linalg.norm(jump[:, 1:], axis=1)
        moves = (speed > 0) & (z[:, 1] > 0)
        stop = np.divide(speed, z[:, 1], out=np.zeros_like(speed), where=moves)  # what would stop the sliding
        shear = np.minimum(stop, limit)
        traction[moves, 1:] = (shear[moves] / speed[moves])[:, None] * jump[moves, 1:]
        return traction

    @staticmethod
    def status(traction: Array, parameters: Array) -> NDArray[np.int8]:
        """0 open, 1 stuck, 2 sliding."""
        pressure = -traction[..., 0]
        shear = np.linalg.norm(traction[..., 1:], axis=-1)
        sliding = shear >= (1 - 1e-10) * np.minimum(parameters[:, 0] * pressure, parameters[:, 1])
        return np.where(pressure <= 0, 0, np.where(sliding, 2, 1)).astype(np.int8)


def scene() -> latin_fmu.Scene:
    """A block pressed on the ground and pushed sideways."""
    tables: dict[str, Any] = {
        "name": "own_law",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {
            "block": {
                "material": "steel",
                "box": {"origin": [0.0, 0.0, 0.0], "size": [0.01, 0.01, 0.01], "elements": [3, 3, 3]},
            }
        },
        "interface": {"floor": {"sides": ["block.zmin", "ground"], "friction_coefficient": 0.5}},
        "load": {
            "press": {
                "face": "block.zmax",
                "traction": [1e8, 0.0, -3e8],
                "law": {"type": "half_sine", "duration": 6e-6},
            }
        },
        "time": {"end": 8e-6, "instants": 40},
    }
    return latin_fmu.scene_from_dict(tables)


def shear(solution: latin_fmu.Solution) -> Array:
    """Shear (n, n_point) on the floor, Pa."""
    traction: Array = solution.outcome.interfaces["floor"].traction
    return np.linalg.norm(traction[..., :2], axis=-1)


def main() -> dict[str, float]:
    """Largest shear with Coulomb's law of the package, with a strength out of reach, and with one that is met, Pa."""
    coulomb = latin_fmu.solve(scene())
    found = {"Coulomb": float(shear(coulomb).max())}
    for name, strength in (("strength out of reach", 1e12), ("strength 40 MPa", 40e6)):
        law = CappedFriction(0.5, strength)
        found[name] = float(shear(latin_fmu.solve(scene(), behaviours={"floor": law})).max())
    for name, largest in found.items():
        print(f"{name:24s} largest shear {largest / 1e6:8.3f} MPa")
    return found


if __name__ == "__main__":
    main()
