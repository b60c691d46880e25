"""What a scene becomes while it is written as a deck: numbers of its meshes, names, and what becomes of each table.

Every key of a scene that is not at its default is written, left out with its consequence, or refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from ..assembly.problem import DiscretisedProblem
from ..errors import Problem
from ..fem.mesh import Index
from ..scene.schema import Scene
from .card_text import node_set_card, surface_card
from .deck_mesh import NumberedMesh
from .translation import LEFT_OUT, USED

EVERY_NODE = "NALL"
"""Set of all nodes."""
SETS = "sets"
"""Sets of nodes and surfaces have one room for their names: a deck that is read has faces of both."""


@dataclass(frozen=True)
class DeckChoices:
    """What a scene leaves open, and what is printed beyond its own output.

    Attributes
    ----------
    penalty : of contact, in units of E/h of the softer side, h the size of its facets: CalculiX has no exact contact.
    stick : slope of the friction before slip, in units of the penalty. alpha : of the HHT scheme; that of the scene
    where None. direct : increments of the scene alone, which CalculiX may not cut. every : nodes that print their
    displacements are all of them. last : printed at the end of a step alone. stresses : at the nodes.
    """

    penalty: float = 100.0
    stick: float = 0.1
    alpha: float | None = None
    direct: bool = False
    every: bool = False
    last: bool = False
    stresses: bool = False


@dataclass(frozen=True)
class TableUse:
    """A line of the summary.

    Attributes
    ----------
    verdict : ``translation.USED`` or LEFT_OUT. where : table or key of the scene. text : cards, or what changes.
    """

    verdict: str
    where: str
    text: str

    @property
    def line(self) -> str:
        """Verdict, table and text in one."""
        return f"{self.verdict}: {self.where}: {self.text}"


@dataclass
class DeckDraft:
    """A scene and what its deck says so far.

    Attributes
    ----------
    ready : the scene on its meshes. mesh : with numbers. choices : see there. bonded : whether nodes of one number
    stand for the interfaces. uses : lines of the summary. problems : reasons why it is refused. surfaces : names by
    face of the scene. pairs : slave and master surface by interface. bolts : numbers of the nodes of the sections.
    part_sets : sets of all nodes of a body. boundary_sets, sensor_sets : sets of nodes by their tables. more_nodes :
    number of the nodes that are of no mesh.
    """

    ready: DiscretisedProblem
    mesh: NumberedMesh
    choices: DeckChoices
    bonded: bool = False
    uses: list[TableUse] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    surfaces: dict[str, str] = field(default_factory=dict)
    pairs: dict[str, tuple[str, str]] = field(default_factory=dict)
    bolts: dict[str, int] = field(default_factory=dict)
    part_sets: dict[str, str] = field(default_factory=dict)
    boundary_sets: dict[str, str] = field(default_factory=dict)
    sensor_sets: dict[str, str] = field(default_factory=dict)
    more_nodes: int = 0
    _names: dict[str, set[str]] = field(default_factory=dict)

    @property
    def scene(self) -> Scene:
        """The scene, interfaces that were found among its own."""
        return self.ready.scene

    @property
    def inertia(self) -> bool:
        """Whether bodies have inertia."""
        return not self.scene.time.quasi_static

    @property
    def static_start(self) -> bool:
        """Whether the motion starts from an equilibrium."""
        return self.inertia and self.scene.time.start.type == "static"

    # -- what is used ------------------------------------------------------------------------------------------------
    def used(self, where: str, cards: str) -> None:
        """A table becomes cards."""
        self.uses.append(TableUse(USED, where, cards))

    def left_out(self, where: str, consequence: str) -> None:
        """A key is left out, with what that changes."""
        self.uses.append(TableUse(LEFT_OUT, where, consequence))

    def refuse(self, where: str, what: str, value: Any = None, remedy: str | None = None) -> None:
        """A key without which the answer would be another one."""
        self.problems.append(Problem(where, what, None if value is None else str(value), None, remedy))

    # -- names -------------------------------------------------------------------------------------------------------
    def free_name(self, kind: str, stem: str) -> str:
        """A name of this kind that no other has, whatever the case of its letters: with a number where it is taken."""
        taken = self._names.setdefault(kind, {EVERY_NODE})
        free, count = stem, 1
        while free.upper() in taken:
            count += 1
            free = f"{stem}_{count}"
        taken.add(free.upper())
        return free

    def new_node(self) -> int:
        """Number of a node that is of no mesh."""
        self.more_nodes += 1
        return self.mesh.last_node + self.more_nodes

    def node_set(self, stem: str, body: str, nodes: Index) -> tuple[str, Iterator[str]]:
        """Name and card of a set of nodes of a body."""
        name = self.free_name(SETS, stem)
        return name, node_set_card(name, self.mesh.nodes[body][nodes])

    def surface(self, stem: str, faces: list[tuple[int, int]]) -> tuple[str, Iterator[str]]:
        """Name and card of a surface of faces of elements."""
        name = self.free_name(SETS, stem)
        return name, surface_card(name, faces)
