"""March of one class of substructures by itself, on an image of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from latin_fmu.kernels import entries
from latin_fmu.kernels.energy_parts import TERMS
from latin_fmu.kernels.instants import OPENINGS
from latin_fmu.kernels.substructure import linear_response
from latin_fmu.propagator.image import Image, ImageClass

from .plain_kernels import call

Array = NDArray[np.float64]


def alone_of(propagator: Any) -> Alone:
    """The march of a propagator by itself."""
    made: Alone = vars(propagator).setdefault("_alone", Alone(propagator))
    return made


def started_alone(propagator: Any, traction: Array, factor: Any) -> None:
    """Start a propagator, and the account of its energies, with tractions (n_channel, n_member), Pa."""
    propagator.start(traction, factor)
    alone_of(propagator).opening = np.array(traction)


class Alone:
    """March of a propagator by itself: ``predict``, then ``respond`` for one or more q, then ``commit``.

    Parameters
    ----------
    propagator : begun and started; its search direction is that of its last ``bind``.
    """

    def __init__(self, propagator: Any) -> None:
        self._propagator = propagator
        self._made: Image | None = None  # of this class only
        self._token: Any = None  # histories that it has begun with
        self._bound: Array | None = None  # its search direction
        self.opening: Array | None = None  # tractions that the account of energies opens with

    def image(self) -> Image:
        """The image of the run, or one of this class only, with the operators of now."""
        p, state = self._propagator, self._propagator.state
        if state.image is None:
            m = len(p.members)
            flat = np.arange(p.n_channel * m, dtype=np.int64).reshape(p.n_channel, m)
            run = {"area": np.repeat(p.operators.area, m), "static": int(p.scheme.name == "quasi_static")}
            self._made = Image([ImageClass(p, flat)], np.ones(flat.size, dtype=bool), run=run)
            self._token, self._bound = object(), None
        image: Image = state.image
        if image is not self._made:
            return image
        if self._bound is not p.k:
            image.bind(0, afresh=True)
            self._bound = p.k
        if self._token is not p.forcing.amplitudes:
            image.begin(p.forcing.n_time, {})
            self._token = p.forcing.amplitudes
        if self.opening is not None:
            image.field("f_hat", self.opening.size)[:] = self.opening.reshape(-1)
            image.set({"first_row": 0})
            image.call(entries.START, 1)
            self.opening = None
        return image

    def predict(self) -> Array:
        """March to the next instant without interface forces; velocities of the channels (n_channel, n_member)."""
        image, p = self.image(), self._propagator
        image.set({"first_row": p.instant + 1})
        image.call(entries.BEGIN, 1, p.instant + 1, OPENINGS)
        shape = p.n_channel, len(p.members)
        free: Array = p.state.part("w_free", shape[0] * shape[1]).reshape(shape).copy()
        return free

    def respond(self, q: Array) -> Array:
        """W for q = F + k W after ``predict``, both (n_channel, n_member)."""
        image = self.image()
        image.field("q", q.size)[:] = q.reshape(-1)
        call(linear_response, image, self._propagator.state.number, image.field("q", q.size), image.field("w", q.size))
        return image.field("w", *q.shape).copy()

    def commit(self, traction: Array) -> None:
        """End the instant with tractions (a quasi-static class: incoming quantities q), Pa."""
        image, p = self.image(), self._propagator
        image.field("local_f", *traction.shape)[:] = traction
        if p.scheme.name == "quasi_static":  # tractions are what the springs leave of q
            image.field("f", *traction.shape)[:] = traction - p.k * self.respond(traction)
        image.call(entries.END, p.instant + 1, 0, 1)
        p.instant += 1

    @property
    def totals(self) -> dict[str, Array]:
        """Terms of the account of energies at the present instant, (n_member,) each, J."""
        account, m = self._account(), len(self._propagator.members)
        assert account is not None, "energies are not accounted for"
        return {term: account[i * m : (i + 1) * m].copy() for i, term in enumerate(TERMS)}

    def _account(self) -> Array | None:
        """The account of energies, begun where it is not yet."""
        p = self._propagator
        if p.energy and p.begun and p.state.account is None:
            self.image()
        account: Array | None = p.state.account
        return account

    def snapshot(self) -> tuple[int, list[Array], Array | None]:
        """All that determines the next instants of this segment."""
        account = self._account()
        fields = [field.copy() for field in self._propagator.state.fields]
        return self._propagator.instant, fields, None if account is None else account.copy()

    def restore(self, snapshot: tuple[int, list[Array], Array | None]) -> None:
        """Return to the state and the energies of a ``snapshot``."""
        self._propagator.instant, fields, account = snapshot
        self._propagator.state.set(*fields)
        if account is not None:
            self._propagator.state.part("energy", len(account))[:] = account
