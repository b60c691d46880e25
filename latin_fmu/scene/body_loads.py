"""Kinds of loads of whole bodies: each says its tables, nodal forces, size and words itself.

Body forces, gravity, rotations and changes of temperature; `Scene.body_loads` are those of a scene. A new kind is a
table of the scene, a class here and its row in `BODY_LOADS`.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from .laws import TimeLaw
from .raw_scene import named_tables, single_table
from .substructures import ALL, Gravity, RotationTable, Substructure, Temperature

Array = NDArray[np.float64]
Tables = dict[str, Any]


class LoadedBody(Protocol):
    """The body of a load; forces are (3 n_node,), N."""

    @property
    def size(self) -> float:
        """Length of the body, m."""

    @property
    def places(self) -> Array:
        """Nodes (n_node, 3), m."""

    @property
    def density(self) -> float:
        """Mass per volume, kg m-3."""

    @property
    def stress_per_kelvin(self) -> tuple[float, float]:
        """Largest expansion, K-1, and Young's modulus, Pa."""

    def volume_forces(self, per_volume: Sequence[float]) -> Array:
        """Forces of a force per volume (3,), N m-3, where the mass of the mesh is."""

    def weight(self, acceleration: Sequence[float] | Array) -> Array:
        """Forces of an acceleration (3,) or (n_node, 3), m s-2, on all mass."""

    def expansion(self, change: float) -> Array:
        """Forces that strain the free body by a change of temperature, K."""


class BodyLoadKind(ABC):
    """A kind of load of whole bodies.

    Attributes
    ----------
    name : of a load in ``Scene.force_laws``, with that of its table in braces. tables : of the scene, by name, or one.
    key : of a table that holds the load; the table itself where empty. law_key : that holds its law. meaning : of its
        amplitude, for inputs. unit : of what the law multiplies. strains : whether it strains a free body and moves
        none, rather than the other way round. settable : whether its law may be set from outside.
    """

    name: ClassVar[str]
    tables: ClassVar[str]
    key: ClassVar[str] = ""
    law_key: ClassVar[str] = "law"
    meaning: ClassVar[str]
    unit: ClassVar[str]
    strains: ClassVar[bool] = False
    settable: ClassVar[bool] = True

    @abstractmethod
    def value(self, table: Any, /) -> Any:
        """Number or vector that the law multiplies."""

    @abstractmethod
    def acts_on(self, table: Any, name: str, body: str, described: Substructure, /) -> bool:
        """Whether the load of the table of this name acts on a body."""

    @abstractmethod
    def nodal_forces(self, table: Any, body: LoadedBody, /) -> Array:
        """Forces (3 n_node,) where the law is 1, N."""

    @abstractmethod
    def largest_traction(self, table: Any, body: LoadedBody, amplitude: float, /) -> float:
        """Largest traction that it can bring in the body where the law has this amplitude, Pa."""

    def acts(self, table: Any) -> bool:
        """Whether the law multiplies anything."""
        return bool(np.any(self.value(table)))

    def arrow(self, table: Any) -> Array | None:
        """Direction (3,) of the arrow of a picture; None where it has none."""
        value = self.value(table)
        if isinstance(value, tuple):
            return np.asarray(value, dtype=float)
        return None

    def owner(self, _name: str, /) -> str | None:
        """The body that a load is described with; None where it has a table of its own."""
        return None

    def tables_of(self, scene: Any) -> Mapping[str, Any]:
        """Tables of a scene by name, one without a name by an empty one, whether they act or not."""
        tables = getattr(scene, self.tables)
        if isinstance(tables, dict):
            return tables
        if tables is None:
            return {}
        return {"": tables}

    def written_laws(self, raw: Any) -> Iterator[tuple[str, Any]]:
        """Place of every law of a scene as written, and the law."""
        if "{}" in self.name:
            tables = named_tables(raw, self.tables)
        else:
            tables = {"": single_table(raw, self.tables)}
        for name, table in tables.items():
            yield self.place(name), table.get(self.law_key)

    def place(self, name: str) -> str:
        """Place of the law in the scene."""
        return ".".join(part for part in (self.tables, name, self.law_key) if part)

    def at_rest(self, data: Tables, name: str, _still: Sequence[str], law: Tables | None, /) -> None:
        """Give a load another law in the tables ``data`` of a scene of these bodies; None takes the load out."""
        tables, key = data, self.tables
        if name:
            tables, key = data[self.tables], name
        if law is None:
            tables.pop(key)
        else:
            tables[key][self.law_key] = law


class BodyForceKind(BodyLoadKind):
    """A force per volume of one body."""

    name = "body_force.{}"
    tables = "substructure"
    key = "body_force"
    law_key = "body_force_law"
    meaning = "the body force of {}"
    unit = "N m-3"

    def value(self, table: Substructure, /) -> tuple[float, float, float]:
        """The force per volume."""
        return table.body_force

    def acts_on(self, _table: Substructure, name: str, body: str, _described: Substructure, /) -> bool:
        """On its own body."""
        return name == body

    def nodal_forces(self, table: Substructure, body: LoadedBody, /) -> Array:
        """Where the mass of the mesh is: a free body is not strained."""
        return body.volume_forces(table.body_force)

    def largest_traction(self, table: Substructure, body: LoadedBody, amplitude: float, /) -> float:
        """Over the length of the body."""
        return float(np.linalg.norm(table.body_force)) * amplitude * body.size

    def owner(self, name: str, /) -> str | None:
        """The body itself."""
        return name

    def at_rest(self, data: Tables, name: str, _still: Sequence[str], law: Tables | None, /) -> None:
        """The keys of the body alone are taken out."""
        table = data[self.tables].get(name, {})
        if law is not None and table:
            table[self.law_key] = law
        else:
            table.pop(self.key, None)
            table.pop(self.law_key, None)


class GravityKind(BodyLoadKind):
    """An acceleration of all bodies."""

    name = "gravity.acceleration"
    tables = "gravity"
    meaning = "the gravity of all bodies, its acceleration"
    unit = "m s-2"

    def value(self, table: Gravity, /) -> tuple[float, float, float]:
        """The acceleration along x, y, z, m s-2."""
        return table.acceleration

    def acts_on(self, _table: Gravity, _name: str, _body: str, _described: Substructure, /) -> bool:
        """On every body."""
        return True

    def nodal_forces(self, table: Gravity, body: LoadedBody, /) -> Array:
        """Where the mass is, added masses included."""
        return body.weight(table.acceleration)

    def largest_traction(self, table: Gravity, body: LoadedBody, amplitude: float, /) -> float:
        """The weight over the length of the body."""
        weight = body.density * float(np.linalg.norm(table.acceleration))
        return weight * amplitude * body.size


class ListedBodiesKind(BodyLoadKind):
    """A load of the bodies that its table lists."""

    def at_rest(self, data: Tables, name: str, still: Sequence[str], law: Tables | None, /) -> None:
        """Bodies that are left out are not named."""
        table = data[self.tables][name]
        everywhere = ALL in table["substructures"]
        if everywhere:
            listed = list(still)
        else:
            listed = [body for body in still if body in table["substructures"]]
        super().at_rest(data, name, still, law if listed else None)
        if not everywhere:
            table["substructures"] = listed


class RotationKind(ListedBodiesKind):
    """The centrifugal force of bodies that turn."""

    name = "rotation.{}"
    tables = "rotation"
    meaning = "the centrifugal force of the rotation {}"
    unit = "1"  # of the force: a square of speeds has no name among the units of a record

    def value(self, table: RotationTable, /) -> float:
        """The square of the angular velocity."""
        return float(table.angular_velocity**2)

    def acts_on(self, table: RotationTable, _name: str, body: str, _described: Substructure, /) -> bool:
        """On bodies that it names."""
        return table.turns(body)

    def nodal_forces(self, table: RotationTable, body: LoadedBody, /) -> Array:
        """Where the mass is, added masses included."""
        return body.weight(table.acceleration(body.places))

    def largest_traction(self, table: RotationTable, body: LoadedBody, amplitude: float, /) -> float:
        """The largest acceleration over the length of the body."""
        largest = float(np.linalg.norm(table.acceleration(body.places), axis=1).max())
        return body.density * largest * amplitude * body.size


class TemperatureKind(ListedBodiesKind):
    """A change of temperature of elastic bodies."""

    name = "temperature.{}"
    tables = "temperature"
    meaning = "the temperature {}"
    unit = "K"
    strains = True
    settable = False  # stresses follow its law

    def value(self, table: Temperature, /) -> float:
        """The change of temperature."""
        return table.change

    def acts_on(self, table: Temperature, _name: str, body: str, described: Substructure, /) -> bool:
        """On elastic bodies that it names."""
        return not described.rigid and table.heats(body)

    def nodal_forces(self, table: Temperature, body: LoadedBody, /) -> Array:
        """Those of the expansion."""
        return body.expansion(table.change)

    def largest_traction(self, table: Temperature, body: LoadedBody, amplitude: float, /) -> float:
        """In a body that is held."""
        expansion, modulus = body.stress_per_kelvin
        return modulus * (abs(table.change) * expansion * amplitude)


BODY_LOADS: Final = (BodyForceKind(), GravityKind(), RotationKind(), TemperatureKind())
"""In the order of their terms and inputs."""


@dataclass(frozen=True)
class BodyLoad:
    """A load of whole bodies of a scene: its kind, the name of its table, the table."""

    kind: BodyLoadKind
    of: str
    table: Any

    @property
    def name(self) -> str:
        """Name in ``Scene.force_laws``."""
        return self.kind.name.format(self.of)

    @property
    def law(self) -> TimeLaw:
        """Its law over time."""
        law: TimeLaw = getattr(self.table, self.kind.law_key)
        return law

    @property
    def key(self) -> str:
        """Place in the scene."""
        return ".".join(part for part in (self.kind.tables, self.of, self.kind.key) if part)

    @property
    def amount(self) -> float:
        """Size of what the law multiplies."""
        return float(np.linalg.norm(np.atleast_1d(self.kind.value(self.table))))

    def acts_on(self, body: str, described: Substructure) -> bool:
        """Whether it acts on a body."""
        return self.kind.acts_on(self.table, self.of, body, described)

    def nodal_forces(self, body: LoadedBody) -> Array:
        """Forces (3 n_node,) where the law is 1, N."""
        return self.kind.nodal_forces(self.table, body)

    def largest_traction(self, body: LoadedBody, amplitude: float) -> float:
        """Largest traction that it can bring in the body where the law has this amplitude, Pa."""
        return self.kind.largest_traction(self.table, body, amplitude)


def body_loads_of(scene: Any) -> Iterator[BodyLoad]:
    """Loads of whole bodies of a scene, those that multiply their law by 0 among them."""
    for kind in BODY_LOADS:
        for name, table in kind.tables_of(scene).items():
            yield BodyLoad(kind, name, table)
