"""Half models: an assembly cut by planes of symmetry across x, y or z, of which the side of larger coordinates stays.

Names and screws are those of the whole assembly, which is read and searched first. A plane of symmetry leaves half of
each part that it cuts, and one of each pair of parts beside it; where it does not, that is said, by part.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from ..errors import MeshError
from .facts import CadPart, Screw
from .geometry import part_of
from .step_text import StepText

AXES: Final = "xyz"
ON_PLANE: Final = 1e-4  # of the diagonal of a part: its end is on the plane
_ALIKE: Final = 1e-3  # of volumes and places of mirror images


@dataclass(frozen=True)
class CutPlane:
    """A plane of symmetry.

    Attributes
    ----------
    axis : 0, 1 or 2, along its normal. at : coordinate, mm; None: the middle of the assembly.
    """

    axis: int
    at: float | None = None

    @property
    def face(self) -> str:
        """Name of the faces that it leaves: the end of the parts along the axis."""
        return f"{AXES[self.axis]}min"


@dataclass
class HalfModel:
    """What planes of symmetry leave.

    Attributes
    ----------
    parts, screws : those of the side that stays. faces : part and face of those on a plane, "ymin". remarks : what
        is not symmetric, in words.
    """

    parts: list[CadPart]
    screws: list[Screw]
    faces: list[tuple[str, str]]
    remarks: list[str]


def cut_plane(text: str) -> CutPlane:
    """A plane from the text of an option, "y" or "y=12.5".

    Raises
    ------
    ValueError : another text.

    Examples
    --------
    >>> cut_plane("y=12.5")
    CutPlane(axis=1, at=12.5)
    """
    letter, equals, number = text.strip().partition("=")
    if letter.strip() not in tuple(AXES):
        raise ValueError(text)
    at = None
    if equals:
        at = float(number)
        if not np.isfinite(at):
            raise ValueError(text)
    return CutPlane(AXES.index(letter.strip()), at)


def cut_assembly(gmsh: Any, parts: Sequence[CadPart], screws: Sequence[Screw], planes: Sequence[CutPlane]) -> HalfModel:
    """Cut the parts by the planes, one after another.

    Raises
    ------
    MeshError : a plane beside the assembly; a part that it leaves in several pieces, or that cannot be cut.
    """
    half = HalfModel(list(parts), list(screws), [], [])
    low, high = np.min([part.low for part in parts], axis=0), np.max([part.high for part in parts], axis=0)
    for plane in planes:
        at = plane.at
        if at is None:
            at = float(0.5 * (low[plane.axis] + high[plane.axis]))
        # boxes are wider than their parts by 1e-7 mm
        name, ends = AXES[plane.axis], (round(float(low[plane.axis]), 6), round(float(high[plane.axis]), 6))
        if not ends[0] < at < ends[1]:
            where = f"between {ends[0] + 0.0:.6g} and {ends[1] + 0.0:.6g} mm"
            raise MeshError.of("not meshed", f"--cut {name}", "the plane is beside the assembly", f"{at:g}", where)
        reach = 2.0 * float(np.linalg.norm(high - low))
        _cut(gmsh, half, replace(plane, at=at), (low - reach, high + reach))
    names = {part.name for part in half.parts}
    half.screws = [_among(screw, names) for screw in half.screws if screw.part in names]
    half.faces = [(part, face) for part, face in half.faces if part in names]
    gmsh.model.occ.synchronize()
    return half


def _cut(gmsh: Any, half: HalfModel, plane: CutPlane, around: tuple[Any, Any]) -> None:
    """Cut by one plane; ``around`` : corners of a box that holds the assembly, mm."""
    assert plane.at is not None
    kept, whole = [], half.parts
    for part in whole:
        slack = ON_PLANE * part.diagonal
        if part.low[plane.axis] >= plane.at - slack:
            kept.append(part)
        elif part.high[plane.axis] > plane.at + slack:
            kept.append(_piece(gmsh, part, plane, around))
    half.remarks += _not_symmetric(whole, kept, plane)
    gone = [part.number for part in whole if part.name not in {p.name for p in kept}]
    gmsh.model.occ.remove([(3, number) for number in gone], recursive=True)
    half.parts = kept
    half.faces += [
        (part.name, plane.face) for part in kept if part.low[plane.axis] <= plane.at + ON_PLANE * part.diagonal
    ]


def _piece(gmsh: Any, part: CadPart, plane: CutPlane, around: tuple[Any, Any]) -> CadPart:
    """The side of a part that stays.

    Raises
    ------
    MeshError : it is in several pieces, or the library cannot cut it.
    """
    occ, low = gmsh.model.occ, np.array(around[0], dtype=float)
    low[plane.axis] = plane.at
    tool = occ.addBox(*low.tolist(), *(np.array(around[1]) - low).tolist())
    try:
        found, _ = occ.intersect([(3, part.number)], [(3, tool)], removeObject=True, removeTool=True)
    except Exception as error:  # the library raises plain exceptions
        what = f"{part.name} cannot be cut: {error}"
        raise MeshError.of("not meshed", f"--cut {AXES[plane.axis]}", what, remedy="cut it in CAD") from None
    solids = [tag for dim, tag in found if dim == 3]
    if len(solids) != 1:
        what = f"{part.name} is in {len(solids)} pieces on the side that stays, so that the plane is none of symmetry"
        raise MeshError.of("not meshed", f"--cut {AXES[plane.axis]}", what, f"{plane.at:g}", remedy="cut elsewhere")
    occ.synchronize()
    new = part_of(gmsh, solids[0], StepText())
    return replace(
        new, name=part.name, path=part.path, colour=part.colour, material=part.material, density=part.density
    )


def _not_symmetric(whole: Sequence[CadPart], kept: Sequence[CadPart], plane: CutPlane) -> Iterator[str]:
    """What is said of parts that are not half on each side, and of parts without a mirror image."""
    assert plane.at is not None
    by_name, where = {part.name: part for part in kept}, f"{AXES[plane.axis]} = {plane.at:.6g} mm"
    sides = [part for part in whole if by_name.get(part.name) is part], [p for p in whole if p.name not in by_name]
    for one, other, what in ((*sides, "stays"), (*sides[::-1], "is left out")):
        for part in one:
            image = np.array(part.centre)
            image[plane.axis] = 2.0 * plane.at - image[plane.axis]
            on_it = part.low[plane.axis] <= plane.at + ON_PLANE * part.diagonal and what == "stays"
            if not any(_is_image(p, part.volume, image) for p in other):
                yield f"{part.name} has no mirror image across {where}, and {what}"
            elif on_it:
                yield f"{part.name} ends on {where}: its contact with its mirror image becomes a plane of symmetry"
    for part in whole:
        share = by_name.get(part.name, part).volume / part.volume
        if by_name.get(part.name, part) is not part and abs(share - 0.5) > _ALIKE:
            yield f"{part.name}: {share:.1%} of it stay, so that {where} is no plane of its symmetry"


def _is_image(part: CadPart, volume: float, centre: Any) -> bool:
    """Whether a part has the volume and the place of a mirror image."""
    near = float(np.abs(np.array(part.centre) - centre).max()) <= _ALIKE * part.diagonal
    return near and abs(part.volume / volume - 1.0) <= _ALIKE


def _among(screw: Screw, names: set[str]) -> Screw:
    """A screw with the parts around it that stay."""
    threads = tuple(name for name in screw.threads if name in names)
    return replace(screw, threads=threads, clamped=tuple(name for name in screw.clamped if name in names))
