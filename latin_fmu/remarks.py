"""Remarks: sentences on a scene or a run that are no errors, each with a code."""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType
from typing import Final, Self

REMARKS: Final = MappingProxyType(
    {
        "accuracy": "the basis or the histories leave something out",
        "area": "faces that hardly have a part in common",
        "balance": "forces on a body out of balance",
        "damping": "the band in which a damping ratio holds, or whose modes have it",
        "deck": "content of a mesh file that is not used",
        "drift": "bonded sides that have come apart",
        "friction": "a friction coefficient that no dry pair has",
        "edge": "contact at one point or along an edge only",
        "free": "a body without support whose place is chosen",
        "gap": "a gap of the size of the bodies, or one that its meshes do not have",
        "history": "a measured history whose times do not suit the run",
        "initial_state": "initial fields that supports or the mesh change",
        "load": "a pressure or force of doubtful size, sign or place, or none",
        "locking": "linear elements that are too stiff",
        "lumping": "lumped masses that do not suit the loads",
        "material": "material constants that no solid has",
        "memory": "a slower propagator, for lack of memory",
        "motion": "slip, rotation or strain beyond small perturbations",
        "never_touched": "faces that may touch and never do",
        "overlap": "an overlap that has been closed, or that is a press fit or a bond",
        "points": "sides that nothing but their order tells apart, one of which gives the points",
        "prestress": "a state whose stress changes natural frequencies, or is near buckling",
        "propagator": "an assembly that is not marched as the scene asks",
        "redundant": "interfaces that join the same faces",
        "resolution": "steps or elements that do not resolve a wave",
        "sampling": "laws whose impulse the instants change",
        "screw": "parts with names of screws that no bolt table tightens",
        "scheme": "a time scheme that does not suit the contacts",
        "sinking": "sides that loads press together and that approach by errors of the iteration",
        "size": "bodies of doubtful size",
        "start": "a static start that has not converged far enough",
        "step": "a step of doubtful length",
        "thread": "a thread whose length is not the one asked for",
        "torn": "a part in several pieces",
        "unjoined": "bodies, or faces that touch, without an interface",
        "yield": "bodies beyond their yield stress",
    }
)
"""Codes of remarks, and what each is about."""


class Remark(str):
    """A sentence on a scene or a run that is no error, remedy included.

    Attributes
    ----------
    code : one of ``REMARKS``, by which programs tell remarks apart.
    """

    __slots__ = ("code",)
    code: str

    def __new__(cls, code: str, text: str) -> Self:
        """A remark of this code; a text that is a remark keeps its own."""
        remark = super().__new__(cls, text)
        if isinstance(text, Remark):
            remark.code = text.code
        else:
            remark.code = code
        assert remark.code in REMARKS, remark.code
        return remark

    def __reduce__(self) -> tuple[type[Self], tuple[str, str]]:
        return type(self), (self.code, str(self))


def remarks_of(code: str, texts: Iterable[str]) -> list[Remark]:
    """Remarks of one code."""
    return [Remark(code, text) for text in texts]
