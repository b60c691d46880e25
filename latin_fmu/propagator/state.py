"""Motion and account of energies of a class of substructures: kept for an image, or a view of the image of a run."""

from __future__ import annotations

import numpy as np

from .image import Image
from .model import Array

_FIELDS = ("u", "v", "a", "residual")


class ClassState:
    """Motion of a class, (n_dof, n_member) each: displacements, velocities, accelerations, residual forces; m, m s-1,
    m s-2, N.

    Parameters
    ----------
    n_dof, n_member : shape of the fields. energy : whether energies are accounted for.

    Attributes
    ----------
    image : that the fields stand in; None: they are kept here. number : of the class in the image.
    """

    def __init__(self, n_dof: int, n_member: int, energy: bool) -> None:
        self._shape, self._energy = (n_dof, n_member), energy
        self.image: Image | None = None
        self.number = 0
        self._own: dict[str, Array] = {name: np.zeros(self._shape) for name in _FIELDS}
        self._account: Array | None = None  # of energies, where a state was set before there is an image

    @property
    def u(self) -> Array:
        """Displacements, a view where they stand in an image; likewise the others."""
        return self._field("u")

    @property
    def v(self) -> Array:
        """Velocities at the present instant."""
        return self._field("v")

    @property
    def a(self) -> Array:
        """Accelerations at the present instant."""
        return self._field("a")

    @property
    def residual(self) -> Array:
        """Residual forces at the present instant."""
        return self._field("residual")

    @property
    def fields(self) -> list[Array]:
        """All four, in the order of the arguments of ``set``."""
        return [self._field(name) for name in _FIELDS]

    def set(self, u: Array, v: Array, a: Array | None = None, residual: Array | None = None) -> None:
        """Set the motion; zeros for what is not given."""
        zero = np.zeros_like(u)
        new = (u, v, zero if a is None else a, zero if residual is None else residual)
        if self.image is None:
            self._own = dict(zip(_FIELDS, (np.array(x) for x in new), strict=True))
            return
        for into, x in zip(self.fields, new, strict=True):
            into[...] = x
        self.part("rest", 1)[0] = float(not any(x.any() for x in new))

    @property
    def account(self) -> Array | None:
        """The account of energies, in the image or kept for one; None where there is none, or none yet."""
        if not self._energy or self.image is None:
            return self._account
        return self.part("energy", self.image.row(self.number)["n_energy"])

    def set_account(self, account: Array) -> None:
        """Set the account of energies."""
        if self.image is None:
            self._account = account.copy()
        else:
            self.part("energy", len(account))[:] = account

    def part(self, first: str, size: int) -> Array:
        """View of numbers of the class in the image, from the field ``first`` of its record on."""
        assert self.image is not None
        at = self.image.row(self.number)[first]
        return self.image.moving[at : at + size]

    def _field(self, name: str) -> Array:
        if self.image is None:
            return self._own[name]
        return self.part(name, self._shape[0] * self._shape[1]).reshape(self._shape)

    # -- from image to image ------------------------------------------------------------------------------------
    def attach(self, image: Image, number: int) -> None:
        """Move the motion into an image, as its class ``number``."""
        own, account = self.fields, self.account
        self.stand_in(image, number)
        self.set(*own)
        there = self.account
        if account is not None and there is not None and account.size == there.size:
            there[:] = account

    def stand_in(self, image: Image, number: int) -> None:
        """Take the motion that stands in an image, as its class ``number``."""
        self.image, self.number, self._own = image, number, {}

    def detach(self) -> None:
        """Keep a copy of the motion: the image belongs to other operators."""
        if self.image is None:
            return
        account = self.account
        kept = {name: field.copy() for name, field in zip(_FIELDS, self.fields, strict=True)}
        self._account = None if account is None else account.copy()
        self._own, self.image = kept, None
