"""Global (linear) stage (9)-(14): each substructure over the window, loaded by q = F_hat + k W_hat and dashpots k.

A window of one instant is condensed on the interfaces: the substructures are marched once (``predict``), every
iteration is a product with Y. Longer windows are marched anew at each iteration.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..propagator import StaticPropagator
from .assembly import Assembly
from .coarse import Coarse
from .kernels import respond
from .layout import Array
from .resting import Resting
from .unchanged import Answers


class GlobalStage:
    """Global stage over the window that starts at the present state of the propagators.

    Parameters
    ----------
    assembly : with the search direction bound to its propagators. k : (n_flat,). n : instants of the window.
    coarse : coarse problem bound to k, None where there is none. answers : what the substructures have answered in this
        window, None where they are always asked.
    """

    def __init__(
        self,
        assembly: Assembly,
        k: Array,
        n: int,
        coarse: Coarse | None = None,
        answers: Answers | None = None,
    ) -> None:
        self.assembly, self.k, self.n, self._coarse, self.answers = assembly, k, n, coarse, answers
        self.first = assembly.propagators[0].state.instant + 1
        self.marched = 0  # substructure-instants marched
        self.condensed = 0  # substructure-instants solved through the condensed operator
        self._solved = 0  # substructures of the last condensed solve
        self._start = assembly.snapshot()
        self._w_0: list[Array] | None = None
        self._march_one = Resting(assembly)

    def __call__(self, q: Array) -> Array:
        """W (n, n_flat) at the channels for q (n, n_flat)."""
        return self.balanced(q)[1]

    def balanced(self, q: Array) -> tuple[Array, Array]:
        """q as it acts (a coarse problem changes it) and W at the channels for q; all (n, n_flat)."""
        if self.n > 1:
            return q, self._march(q, None) if self.answers is None else self._march_changed(q, self.answers)
        w = self._condensed(q, self.answers)
        self.condensed += self._solved
        if self._coarse is None:
            return q, w
        q = q.copy()
        self._coarse.balance(q[0], w[0])
        return q, w

    def free(self) -> Array:
        """W_0 (n_flat,), the answer to q = 0 at the first instant."""
        w: Array = self._condensed(np.zeros((1, len(self.k))))[0]
        return w

    def free_velocity(self) -> Array:
        """Velocities (1, n_flat) of the channels without any traction; windows of one instant only."""
        free = self.free()[None]
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            free[0, channels] += propagator.operators.admittance @ (self.k[channels] * free[0, channels])
        return free

    def _condensed(self, q: Array, answers: Answers | None = None) -> Array:
        assembly = self.assembly
        if self._w_0 is None:
            self._w_0 = self._march_one.predict()
        w = np.zeros_like(q)
        assembly.ground_velocity(w[0], self.first)
        self._solved = 0
        for c, (propagator, channels, w_0) in enumerate(
            zip(assembly.propagators, assembly.channels, self._w_0, strict=True)
        ):
            if not self._march_one.stays(c, q[0, channels]):
                if answers is not None and answers.first_changed(c, channels, q) == 1:
                    w[0, channels] = answers.answer(channels, slice(0, 1))[0]
                    continue
                respond(propagator.response, w_0, channels, q[0], w[0])
                self._solved += len(propagator.names)
            if answers is not None:
                answers.keep(c, channels, 0, q, w)
        return w

    def _march(self, q: Array, after: Callable[[int], None] | None) -> Array:
        assembly = self.assembly
        assembly.restore(self._start)
        w = np.zeros_like(q)
        for i in range(self.n):
            assembly.ground_velocity(w[i], self.first + i)
            free = self._march_one.predict()
            for c, (propagator, channels) in enumerate(
                zip(assembly.propagators, assembly.channels, strict=True)
            ):
                incoming = q[i, channels]
                velocity = propagator.respond(free[c], incoming)
                traction = incoming - propagator.k * velocity
                self.marched += self._march_one.commit(c, traction, account=after is not None)
                w[i, channels] = velocity
            if after is not None:
                after(i)
        return w

    def _march_changed(self, q: Array, answers: Answers) -> Array:
        """W (n, n_flat) for q, each class from the first instant on that has changed."""
        assembly, w = self.assembly, np.zeros_like(q)
        for i in range(self.n):
            assembly.ground_velocity(w[i], self.first + i)
        for c, (propagator, channels) in enumerate(zip(assembly.propagators, assembly.channels, strict=True)):
            changed = answers.first_changed(c, channels, q)
            w[:changed, channels] = answers.answer(channels, slice(0, changed))
            if changed == self.n:
                continue
            begin, state = answers.state_before(c, changed)
            propagator.restore(self._start[c] if state is None else state)
            for i in range(begin, self.n):
                if answers.wants_state(i):
                    answers.keep_state(c, i, propagator.snapshot())
                free = self._march_one.predict_one(c)
                incoming = q[i, channels]
                velocity = propagator.respond(free, incoming)
                self.marched += self._march_one.commit(c, incoming - propagator.k * velocity, account=False)
                if i >= changed:
                    w[i, channels] = velocity
            answers.keep(c, channels, changed, q, w)
        return w

    def commit(self, q: Array, f_hat: Array, after: Callable[[int], None]) -> None:
        """End the window: ``after(i)`` is called with the substructures at its instant i.

        One instant: the local-stage tractions are applied, action and reaction to round-off. Longer windows:
        the linear-stage fields of q, whose dashpots keep the two sides of an interface together.
        """
        assembly = self.assembly
        if self.n > 1:
            self._march(q, after)
            return
        if self._w_0 is None:
            self._march_one.predict()
        for c, (propagator, channels) in enumerate(zip(assembly.propagators, assembly.channels, strict=True)):
            if isinstance(propagator, StaticPropagator):
                propagator.settle(q[0, channels])
                self.marched += len(propagator.names)
            else:
                self.marched += self._march_one.commit(c, f_hat[0, channels])
        after(0)

    def trial(self, q: Array, f_hat: Array, after: Callable[[int], None]) -> None:
        """``commit`` without consequences: ``after(i)`` sees the state, then everything is put back."""
        marched, predicted = self.marched, self._w_0
        self.commit(q, f_hat, after)
        self.rewind()
        self.marched = marched
        if predicted is not None:
            self._w_0 = self._march_one.predict()

    def rewind(self) -> None:
        """Back to the start of the window."""
        self.assembly.restore(self._start)
        self._w_0 = None
        if self.answers is not None:
            self.answers.forget()
