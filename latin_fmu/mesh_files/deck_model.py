"""What an Abaqus deck says beyond its mesh: materials, tied surfaces, fixed sets; keywords of which nothing is used.

``*MATERIAL`` with ``*ELASTIC`` (isotropic) and ``*DENSITY`` at one temperature, by ``*SOLID SECTION``; ``*TIE``;
``*BOUNDARY`` of node sets held at zero (components 1 to 3, ENCASTRE, PINNED). Numbers are in the units of the deck.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

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
    }
)
_KEYS: Final = ("young_modulus", "poisson_ratio", "density")
_AXES: Final = "xyz"
_NAMED: Final = {"ENCASTRE": (1, 3), "PINNED": (1, 3)}  # first and last component of displacement


@dataclass
class DeckModel:
    """Materials, ties and supports of a deck.

    Attributes
    ----------
    materials : constants ``young_modulus``, ``poisson_ratio``, ``density`` by the name of the material in capitals.
    sections : (element set, material), both in capitals. ties : (name, slave surface, master surface).
    fixed : (node set, components out of "xyz"), held at zero. unused : number of the keywords that are not read.
    """

    materials: dict[str, dict[str, float]] = field(default_factory=dict)
    sections: list[tuple[str, str]] = field(default_factory=list)
    ties: list[tuple[str, str, str]] = field(default_factory=list)
    fixed: list[tuple[str, str]] = field(default_factory=list)
    unused: Counter[str] = field(default_factory=Counter)
    _material: str = ""

    def take(self, keyword: str, parameters: Mapping[str, str], rows: Sequence[Sequence[str]]) -> None:
        """Add what a card says: its keyword and parameters, in capitals, and the fields of its data lines."""
        name = parameters.get("NAME", "")
        if keyword == "SOLID SECTION":
            self.sections.append((parameters.get("ELSET", "").upper(), parameters.get("MATERIAL", "").upper()))
        elif keyword == "MATERIAL":
            self._material = name.upper()
            self.materials.setdefault(self._material, {})
        elif keyword == "ELASTIC" and parameters.get("TYPE", "").upper() in ("", "ISOTROPIC", "ISO"):
            self._constants(keyword, rows, _KEYS[:2])
        elif keyword == "DENSITY":
            self._constants(keyword, rows, _KEYS[2:])
        elif keyword == "TIE":
            for names in rows:
                if len(names) > 1:
                    stem, known = name or "tie", {tie[0] for tie in self.ties}
                    own = stem if stem not in known else f"{stem}_{len(known) + 1}"
                    self.ties.append((own, names[0], names[1]))
        elif keyword == "BOUNDARY" and "TYPE" not in parameters:
            for fields in rows:
                if not self._fix(fields):
                    self.unused["BOUNDARY"] += 1
        elif keyword not in _MESH:
            self.unused[keyword] += 1

    def _constants(self, keyword: str, rows: Sequence[Sequence[str]], keys: tuple[str, ...]) -> None:
        """Numbers of the first data line, of a material that does not depend on temperature."""
        try:
            values = [float(text.upper().replace("D", "E")) for text in rows[0][: len(keys)]]
        except (ValueError, IndexError):
            values = []
        if len(rows) == 1 and len(values) == len(keys) and self._material:
            self.materials[self._material].update(zip(keys, values, strict=True))
        else:
            self.unused[keyword] += 1

    def _fix(self, fields: Sequence[str]) -> bool:
        """Add a set that is held at zero; False for anything else."""
        try:
            name, first, *rest = fields
            if first.upper() in _NAMED:
                low, high = _NAMED[first.upper()]
            else:
                low = int(first)
                high = int(rest[0]) if rest and rest[0] else low
            still = len(rest) < 2 or not rest[1] or float(rest[1]) == 0.0
        except ValueError:
            return False
        if not still or not 1 <= low <= high <= 6 or low > 3 or name.rpartition(".")[2].isdigit():
            return False
        self.fixed.append((name, _AXES[low - 1 : min(high, 3)]))
        return True

    def material_of(self, sections: list[str]) -> tuple[str, dict[str, float]] | None:
        """Name and constants of the one material of these element sets (in capitals); None where it is not whole."""
        names = {material for elset, material in self.sections if elset in sections}
        if len(names) != 1:
            return None
        constants = self.materials.get(name := names.pop(), {})
        return (name, constants) if set(constants) == set(_KEYS) else None

    def unused_words(self) -> list[str]:
        """Keywords that are not used, with their number, as they stand in the deck."""
        return [f"*{keyword}" + (f" ({count})" if count > 1 else "") for keyword, count in sorted(self.unused.items())]
