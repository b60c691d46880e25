"""Table [interface.NAME]: how two substructures, or a substructure and the ground, act on each other."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator

from .behaviours import BEHAVIOUR_NAMES
from .fields import GROUND, Direction, Real, Side, Table, Text, _as_list, about, refusal
from .laws import ConstantLaw, Law
from .wording import did_you_mean


def _check_behaviour(name: str) -> str:
    if name not in BEHAVIOUR_NAMES:
        raise refusal(
            "unknown behaviour",
            value=name,
            allowed=", ".join(BEHAVIOUR_NAMES),
            remedy=did_you_mean(name, BEHAVIOUR_NAMES),
        )
    return name


Behaviour = Annotated[Text, AfterValidator(_check_behaviour)]
Sides = Annotated[tuple[Side, Side], BeforeValidator(_as_list)]


class GroundVelocity(Table):
    """Translation of the rigid ground: velocity(t) = amplitude a(t) direction / |direction|."""

    direction: Annotated[Direction, about("direction of the motion (its length does not count)", "1")]
    amplitude: Annotated[Real, about("velocity where the law is 1", "m s-1")]
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()

    @property
    def vector(self) -> tuple[float, float, float]:
        """Velocity of the ground where the law is 1, m s-1."""
        x, y, z = self.direction
        scale = max(abs(x), abs(y), abs(z))  # keeps the squares below from over- or underflowing
        factor = self.amplitude / math.hypot(x / scale, y / scale, z / scale)
        return (x / scale * factor, y / scale * factor, z / scale * factor)


class Interface(Table):
    """Two faces that meet. The normal N points from the first side (E) to the second (E')."""

    sides: Annotated[Sides, about('two faces "substructure.face"; the second may be "ground" (rigid)')]
    behaviour: Annotated[Behaviour, about(f"what happens there: {', '.join(BEHAVIOUR_NAMES)}")] = "contact"
    friction_coefficient: Annotated[
        Real, about("Coulomb's coefficient mu (contact, soft_contact)", "1", ge=0)
    ] = 0.0
    gap: Annotated[
        Real | None,
        about(
            "initial distance along N (where it may open); measured on the meshes where left out", "m", ge=0
        ),
    ] = None
    preload: Annotated[
        Real, about("pressure already there at t = 0, in equilibrium (contacts, elastic_layer)", "Pa", ge=0)
    ] = 0.0
    preload_force: Annotated[
        Real, about("the same as a normal force, spread evenly over the face (a tightened bolt)", "N", ge=0)
    ] = 0.0
    interference: Annotated[
        Real, about("the same as a compression of the layer (soft_contact)", "m", ge=0)
    ] = 0.0
    normal_stiffness: Annotated[
        Real | None, about("stiffness per area along N (elastic_layer, soft_contact)", "N m-3", ge=0)
    ] = None
    tangential_stiffness: Annotated[
        Real | None, about("stiffness per area across N (elastic_layer)", "N m-3", ge=0)
    ] = None
    normal_viscosity: Annotated[
        Real | None, about("viscosity per area along N (viscous_joint)", "N s m-3", ge=0)
    ] = None
    tangential_viscosity: Annotated[
        Real | None, about("viscosity per area across N (viscous_joint)", "N s m-3", ge=0)
    ] = None
    ground_velocity: Annotated[
        GroundVelocity | None, about("motion of the ground; at rest where left out")
    ] = None

    @property
    def against_ground(self) -> bool:
        """True where the second side is the rigid ground."""
        return self.sides[1] == GROUND

    def initial_pressure(self, area: float) -> float:
        """Pressure at t = 0 on a face of the given area, m2; Pa."""
        squeezed = self.interference * (self.normal_stiffness or 0.0)
        return self.preload + self.preload_force / area + squeezed
