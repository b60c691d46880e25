"""Names of parts from their paths in the assembly, and the same names when the file is read again.

A STEP file names products and their occurrences, ``as1/l-bracket-assembly_1/l-bracket-assembly/bolt_1/bolt``, with
marks of the programs that wrote it. The name of a part is that of its product; several of one product are counted in
the order of their paths, then of their places.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from ..scene.substructures import part_name
from .facts import CadPart

_ROOT: Final = "Shapes"
_TRAILING: Final = re.compile(r"(?:\s*&)+\s*\w*$")  # "bolt & & 256"
_MARK: Final = re.compile(r"=>\[.*\]$")
_SHAPELESS: Final = frozenset({"solid", "compound", "compsolid", "shell", "open_cascade_step_translator", "body"})
_VERSION: Final = re.compile(r"^(open[ _]cascade.*|none|unnamed|no[ _]name)$", re.IGNORECASE)


def path_of(label: str) -> tuple[str, ...]:
    """The path in the assembly from the label of a shape, without marks of programs.

    >>> path_of("Shapes/as1/l-bracket-assembly_1/l-bracket-assembly/bolt_1/bolt & & 256")
    ('as1', 'l-bracket-assembly_1', 'l-bracket-assembly', 'bolt_1', 'bolt')
    >>> path_of("Shapes/ASM/BOLT/BOLT/=>[0:1:1:11]/SOLID")
    ('ASM', 'BOLT', 'BOLT')
    """
    steps = [_TRAILING.sub("", step).strip() for step in label.split("/")]
    if steps[:1] == [_ROOT]:
        steps = steps[1:]
    kept = [step for step in steps if step and not _MARK.match(step) and not _VERSION.match(step)]
    while len(kept) > 1 and kept[-1].lower() in _SHAPELESS:
        kept.pop()
    return tuple(kept)


def stem_of(path: Sequence[str]) -> str:
    """The name of a product as that of a substructure, in small letters.

    >>> stem_of(("as1", "l-bracket_1", "l-bracket")), stem_of(("ASM", "M6x20")), stem_of(())
    ('l_bracket', 'm6x20', 'part')
    """
    if not path or path[-1].lower() in _SHAPELESS:
        return "part"
    name = re.sub("_+", "_", part_name(path[-1].lower())).strip("_")
    return name or "part"


def named(parts: Sequence[CadPart], before: Iterable[CadPart] = ()) -> list[str]:
    """Names of the parts, each of them once.

    A part whose path, shape and place are those of a part that was read ``before`` has its name; then one with the same
    path and place, or path and shape, if there is one alone; the others the next ones of their product.
    """
    names: dict[int, str] = {}
    free = list(before)
    tests: tuple[Callable[[CadPart, CadPart], bool], ...] = (
        lambda a, b: a.path == b.path and a.same_place(b) and a.same_shape(b),
        lambda a, b: a.path == b.path and a.same_place(b),
        lambda a, b: a.path == b.path and a.same_shape(b),
        lambda a, b: a.path == b.path,
    )
    for test in tests:
        for i, part in enumerate(parts):
            if i in names:
                continue
            found = [old for old in free if test(part, old)]
            if found:
                nearest = min(found, key=lambda old: _distance(part, old))
                names[i] = nearest.name
                free.remove(nearest)
    counts: dict[str, int] = {}
    for part in parts:
        counts[stem_of(part.path)] = counts.get(stem_of(part.path), 0) + 1
    taken = set(names.values())
    order = sorted((i for i in range(len(parts)) if i not in names), key=lambda i: _place(parts[i]))
    for i in order:
        stem = stem_of(parts[i].path)
        names[i] = _next(stem, counts[stem] > 1, taken)
        taken.add(names[i])
    return [names[i] for i in range(len(parts))]


def _next(stem: str, many: bool, taken: set[str]) -> str:
    """The next free name of a product."""
    if not many and stem not in taken:
        return stem
    number = 1
    while f"{stem}_{number}" in taken:
        number += 1
    return f"{stem}_{number}"


def _distance(one: CadPart, other: CadPart) -> float:
    return sum((a - b) ** 2 for a, b in zip(one.centre, other.centre, strict=True))


def part_order(part: CadPart) -> tuple[object, ...]:
    """Order of parts by their names, numbers as such."""
    stem, _, number = part.name.rpartition("_")
    return (stem, int(number), "") if number.isdigit() else (part.name, 0, "")


def _place(part: CadPart) -> tuple[object, ...]:
    """Order of parts: their paths, numbers as such, then their places."""
    words = tuple(
        tuple((int(piece) if piece.isdigit() else -1, piece) for piece in re.split(r"(\d+)", step))
        for step in part.path
    )
    return words, tuple(round(x, 3) for x in part.centre)
