"""What an Abaqus or CalculiX deck says beyond its mesh: materials, ties, supports, rigid bodies, clearances, and the
keywords of which nothing is used.

``*MATERIAL`` with ``*ELASTIC`` (isotropic) and ``*DENSITY`` at one temperature, by ``*SOLID SECTION``; ``*TIE``;
``*BOUNDARY`` held at zero (components 1 to 3, ENCASTRE, PINNED, words of symmetry) as the last step leaves it;
``*RIGID BODY`` of an element set; ``*CLEARANCE``. Numbers are in the units of the deck.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from .deck_card import Card, FileLine
from .deck_loads import degrees

_MESH: Final = frozenset(
    {
        "HEADING",
        "PREPRINT",
        "NODE",
        "ELEMENT",
        "NSET",
        "ELSET",
        "SURFACE",
        "SOLID SECTION",
        "PART",
        "END PART",
        "ASSEMBLY",
        "END ASSEMBLY",
        "INSTANCE",
        "END INSTANCE",
        "END STEP",
        "SYSTEM",
        "NGEN",
        "NFILL",
        "ELGEN",
        "NCOPY",
        "ELCOPY",
    }
)
KEYS: Final = ("young_modulus", "poisson_ratio", "density")
"""Constants of a material that a deck may give."""
_AXES: Final = "xyz"
_OTHER_MOTIONS: Final = ("TYPE", "USER", "SUBMODEL", "FIXED", "BASE NAME", "LOAD CASE", "MASS FLOW")
"""Parameters with which *BOUNDARY says something else than a displacement."""


@dataclass(frozen=True)
class HeldSet:
    """A set or node that is held at zero along the axes ``components`` (out of "xyz")."""

    name: str
    components: str
    line: int


@dataclass(frozen=True)
class Tie:
    """Two bonded surfaces; ``tolerance`` : distance up to which they are, None where the deck gives none."""

    name: str
    slave: str
    master: str
    tolerance: float | None


@dataclass
class DeckModel:
    """Materials, ties, supports and more of a deck.

    Attributes
    ----------
    materials : constants ``young_modulus``, ``poisson_ratio``, ``density`` by the name of the material in capitals.
    sections : (element set, material), both in capitals. ties, supports : see there.
    rigid : element sets, in capitals, of rigid bodies. couplers : number of the node of the first distributing coupling
    element of a set, by its name in capitals. clearances : (slave, master) -> initial distance. contacts :
    slave and master surfaces of contact pairs. transforms : node sets, in capitals, whose components of displacement
    are counted along axes of their own; the axes x and y where these are the same at all nodes. cards : all of them in
    order, those of the mesh without their lines. element_types : first place of each, by name. unused : number of the
    keywords that are not read. dropped : words on supports and pairs that are not taken.
    """

    materials: dict[str, dict[str, float]] = field(default_factory=dict)
    sections: list[tuple[str, str]] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    supports: list[HeldSet] = field(default_factory=list)
    rigid: list[str] = field(default_factory=list)
    couplers: dict[str, str] = field(default_factory=dict)
    clearances: dict[tuple[str, str], float] = field(default_factory=dict)
    contacts: list[tuple[str, str]] = field(default_factory=list)
    transforms: dict[str, tuple[list[float], list[float]] | None] = field(default_factory=dict)
    cards: list[Card] = field(default_factory=list)
    element_types: dict[str, FileLine] = field(default_factory=dict)
    unused: Counter[str] = field(default_factory=Counter)
    dropped: list[str] = field(default_factory=list)
    _material: str = ""
    _step: int = 0
    _renewed: int = 0

    def take(self, keyword: str, parameters: Mapping[str, str], rows: Sequence[Sequence[str]], line: int) -> None:
        """Add what a card says.

        keyword, parameters : in capitals. rows : fields of its data lines. line : of the keyword, from 1.
        """
        name = parameters.get("NAME", "")
        if keyword == "SOLID SECTION":
            self.sections.append((parameters.get("ELSET", "").upper(), parameters.get("MATERIAL", "").upper()))
        elif keyword == "MATERIAL":
            self._material = name.upper()
            self.materials.setdefault(self._material, {})
        elif keyword == "ELASTIC" and parameters.get("TYPE", "").upper() in ("", "ISOTROPIC", "ISO"):
            self._constants(keyword, rows, KEYS[:2])
        elif keyword == "DENSITY":
            self._constants(keyword, rows, KEYS[2:])
        elif keyword == "TIE":
            self._tie(name or "tie", parameters, rows)
        elif keyword == "BOUNDARY":
            self._boundary(parameters, rows, line)
        elif keyword == "RIGID BODY" and parameters.get("ELSET"):
            self.rigid.append(parameters["ELSET"].upper())
        elif keyword == "CLEARANCE":
            self._clearance(parameters)
        elif keyword == "TRANSFORM":
            self._transform(parameters, rows)
        elif keyword == "CONTACT PAIR":
            self._contact(parameters, rows)
        elif keyword not in _MESH:
            self.unused[keyword] += 1
        if keyword == "STEP":
            self._step += 1

    def _constants(self, keyword: str, rows: Sequence[Sequence[str]], keys: tuple[str, ...]) -> None:
        """Numbers of the first data line, of a material that does not depend on temperature."""
        values = None
        if len(rows) == 1:
            values = numbers(rows[0][: len(keys)])
        if values is not None and len(values) == len(keys) and self._material:
            self.materials[self._material].update(zip(keys, values, strict=True))
        else:
            self.unused[keyword] += 1

    def _tie(self, stem: str, parameters: Mapping[str, str], rows: Sequence[Sequence[str]]) -> None:
        reach = None
        if "POSITION TOLERANCE" in parameters and (tolerance := numbers([parameters["POSITION TOLERANCE"]])):
            reach = tolerance[0]
        for names in rows:
            if len(names) > 1:
                others = {tie.name for tie in self.ties}
                # one card may tie several pairs: names of ties stay different
                if stem not in others:
                    name = stem
                else:
                    name = f"{stem}_{len(others) + 1}"
                self.ties.append(Tie(name, names[0], names[1], reach))

    def _contact(self, parameters: Mapping[str, str], rows: Sequence[Sequence[str]]) -> None:
        """A pair of surfaces: the scene has its law; ADJUST is said, as it moves nodes."""
        pairs = [(names[0], names[1]) for names in rows if len(names) > 1]
        self.contacts += pairs
        if "ADJUST" not in parameters:
            self.unused["CONTACT PAIR"] += 1
            return
        self.dropped += [
            f'*CONTACT PAIR {slave}, {master} (ADJUST={parameters["ADJUST"]}: gap = "closed" of the interface)'
            for slave, master in pairs
        ]

    def _clearance(self, parameters: Mapping[str, str]) -> None:
        """An initial distance of two surfaces; one by nodes, or of a pair that is named elsewhere, is not used."""
        value = numbers([parameters.get("VALUE", "")])
        pair = (parameters.get("SLAVE", ""), parameters.get("MASTER", ""))
        if value and value[0] >= 0.0 and all(pair):
            self.clearances[pair] = value[0]
        else:
            self.unused["CLEARANCE"] += 1

    def _transform(self, parameters: Mapping[str, str], rows: Sequence[Sequence[str]]) -> None:
        axes, values = None, None
        if rows and parameters.get("TYPE", "R").upper() == "R":
            values = numbers(rows[0])
        if values is not None and len(values) == 6:
            axes = values[:3], values[3:]
        self.transforms[parameters.get("NSET", "").upper()] = axes

    def _boundary(self, parameters: Mapping[str, str], rows: Sequence[Sequence[str]], line: int) -> None:
        if any(key in parameters for key in _OTHER_MOTIONS):
            self.unused["BOUNDARY"] += max(len(rows), 1)
            return
        # the first such card of a step removes what was held before it, the others of that step add
        if parameters.get("OP", "").upper() == "NEW" and self._step > 0 and self._renewed != self._step:
            self._renewed = self._step
            self.dropped += [
                f"*BOUNDARY {s.name} of line {s.line} (released by OP=NEW in line {line})" for s in self.supports
            ]
            self.supports.clear()
        for fields in rows:
            self._fix(fields, line)

    def _fix(self, fields: Sequence[str], line: int) -> None:
        """Add a set or node that is held at zero, or note that it is moved."""
        try:
            name = fields[0]
            held = list(degrees(list(fields[1:])))
        except (ValueError, IndexError):
            self.unused["BOUNDARY"] += 1
            return
        still = not any(value for _, value in held)
        if all(1 <= degree <= 6 for degree, _ in held):
            components = "".join(_AXES[degree - 1] for degree, _ in held if degree <= 3)
        else:
            components = ""
        if still and components:
            self.supports.append(HeldSet(name, components, line))
            return
        # rotations alone hold nothing of a solid
        self.unused["BOUNDARY"] += 1
        if not still:
            self._release(name, components, line)

    def _release(self, name: str, components: str, line: int) -> None:
        """Take the components of a set that this line moves from what holds it."""
        for i, support in enumerate(self.supports):
            rest = "".join(axis for axis in support.components if axis not in components)
            if support.name.upper() == name.upper() and rest != support.components:
                self.supports[i] = HeldSet(support.name, rest, support.line)
                self.dropped.append(f"*BOUNDARY {name} of line {support.line} (moved by that of line {line})")
        self.supports = [support for support in self.supports if support.components]

    def material_of(self, sections: list[str]) -> tuple[str, dict[str, float]] | None:
        """Name and constants of the one material of these element sets (in capitals); None where there are several."""
        names = {material for elset, material in self.sections if elset in sections}
        if len(names) != 1:
            return None
        name = names.pop()
        if name in self.materials:
            return (name, self.materials[name])
        return None

    def unused_words(self) -> list[str]:
        """Keywords that are not used, with their number, as they stand in the deck."""
        return [f"*{keyword}" + (f" ({count})" if count > 1 else "") for keyword, count in sorted(self.unused.items())]


def numbers(fields: Sequence[str]) -> list[float] | None:
    """Numbers as a deck writes them (``1.D0`` is 1), None where a field is none."""
    try:
        return [float(text.upper().replace("D", "E")) for text in fields]
    except ValueError:
        return None
