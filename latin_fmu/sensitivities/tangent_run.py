"""March of the derivatives of a run by parameters (``kernels.tangent_march``), from its fields at the interfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import SolverError
from ..interface.laws import NoSlip
from ..kernels import entries
from ..kernels.callouts import DERIVATIVES, TANGENTS
from ..latin.assembly import Array, Assembly, Group
from ..latin.interface_rows import InterfaceRows
from ..latin.outcome import Timings
from ..latin.recorder import Recorder
from ..latin.run_state import RunState
from ..latin.search_direction import LARGEST, Direction, relative_operator
from ..latin.settings import SolverSettings
from ..laws.dispatch import LAWS, apply_law, law_tangents
from .reduced_solution import ReducedSolution

_PROXIMAL = 1e-8  # share of z in the relative operator: a step leaves as much, redundant points a regular matrix
_UNLIKE = 1e-2  # difference of both one-sided differences of a law, over the larger one, from which a state changes


@dataclass(frozen=True)
class SolvedFields:
    """Fields of a run at its interfaces, and how the parameters of their laws change.

    Attributes
    ----------
    assembly, rows : of the run. changes : by parameter and group of interfaces, parameters of the laws (n_point,
    n_parameter) with the parameter a little larger and a little smaller, and the difference of both; None where they
    do not change, and for the run itself in the place of its derivatives.
    """

    assembly: Assembly
    rows: InterfaceRows
    changes: Sequence[Sequence[tuple[Array, Array, float] | None] | None]


class TangentRun(RunState):
    """Derivatives of a run by parameters.

    Parameters
    ----------
    assembly : copies of the substructures and interfaces of the run, those of the first parameter first, with the
        derivatives of loads, initial values and gaps. settings : of the run. solved : its fields. forced : whether
        forces of each instant act (``march``).
    """

    def __init__(
        self,
        assembly: Assembly,
        settings: SolverSettings,
        recorder: Recorder,
        solved: SolvedFields,
        forced: bool = False,
    ) -> None:
        self._solved = solved
        settings = replace(settings, newton=True, window=1, tables=0.0, threads=1, anderson_depth=1)
        linear = {"linear": len(solved.changes), "deepest": -np.inf, "make_up": 0.0}
        linear |= {"given": int(solved.changes[0] is None), "forced": int(forced)}
        # the matrices of a reduced assembly are in patches
        self._solution = None
        if any(p.members[0].face is not None for p in assembly.propagators):
            self._solution = ReducedSolution(assembly, len(solved.changes))
            linear["by_caller"] = 1
        super().__init__(assembly, settings, recorder, Timings(), linear)
        # the tangents are in the image already
        self.image.callouts.add({TANGENTS: lambda *_: None})
        if (solution := self._solution) is not None:
            self.image.callouts.add({DERIVATIVES: lambda row, *_: solution.solve(self.image, row)})
        self.image.set({"proximal": _PROXIMAL})

    def made_direction(self, settings: SolverSettings, n: int) -> Direction:
        """Search direction whose Newton steps solve the linear system of an instant: by its matrix, or where there is
        none by products of the linear stage."""
        direction = super().made_direction(settings, n)
        # places and matrix of the first copy, whose factors serve all; that of all may be too large where it is not
        one = relative_operator(self._solved.assembly) if direction.relative.get("n_matrix") else None
        if self._solution is not None:
            direction.relative, direction.newton = {}, False
            return direction
        if one is not None and (direction.newton or (direction.too_large and one["n_matrix"] <= LARGEST)):
            arrays = {name: direction.relative[name] for name in ("owner", "owner_class", "live_row")}
            direction.relative, direction.newton = one | arrays, True
        elif not direction.newton:
            direction.relative, direction.newton = {"on_iteration": 1}, True
        direction.newton_z = direction.z
        return direction

    def march(
        self, forces: Callable[[int, int], None] | None = None, progress: Callable[[int, int], None] | None = None
    ) -> None:
        """March all instants; errors and ``forces`` as for ``block``, ``progress`` is called with the instants done and
        their number."""
        while self.assembly.instant < self.assembly.n_instant:
            self.block(forces)
            if progress is not None:
                progress(self.assembly.instant, self.assembly.n_instant)

    def block(self, forces: Callable[[int, int], None] | None = None) -> tuple[int, int, int]:
        """March the next instants, as many as one call of the kernels takes: their first, number and first row.

        forces : writes ``forces`` of n instants into the image, from a row on, before they are marched.

        Raises
        ------
        SolverError : an instant has no unique derivative.
        """
        image, first = self.image, self.assembly.instant + 1
        n = min(image.rows, self.assembly.n_instant + 1 - first)
        self._set_first_row(first)
        image.write()
        for g, group in enumerate(self._solved.assembly.layout.groups):
            self._give(g, group, first, slice(0, n))
        if forces is not None:
            forces(n, 0)
        done = image.call(entries.TANGENT, first, n)
        if done < n:
            time = self.assembly.time[first + done]
            raise SolverError(f"the derivatives by parameters have no unique value at t = {time:.6g} s")
        self._set_instant(first + n - 1)
        self._record(n)
        return first, n, 0

    def _give(self, g: int, group: Group, first: int, rows: slice) -> None:
        """Write what the kernels take of the laws of a group at the instants from ``first`` on into rows of the
        image."""
        image = self.image
        p = group.n_point
        h = group.n_component
        n, copies = rows.stop - rows.start, len(self._solved.changes)
        if group.behaviour.elastic:
            width = h
        else:
            width = 1
        slopes, sources, follows = (
            image.group_field(g, name, image.rows, copies * p, *shape)[rows]
            for name, shape in (("slopes", (3, 3)), ("sources", (h,)), ("follows", (width,)))
        )
        arguments, moves = self._arguments(g, group, first, n)
        parameters = np.tile(group.parameters, (n, 1))
        law = group.behaviour.name
        tangents = law_tangents(LAWS[law], *arguments, parameters)
        slopes[:], sources[:] = 0.0, 0.0
        for copy, changes in enumerate(self._solved.changes):
            points = slice(copy * p, (copy + 1) * p)
            if changes is None:
                sources[:] = group.block(self._solved.rows.f_hat[first : first + n])[:, 0]
                continue
            slopes[:, points, :h, :h] = tangents.reshape(n, p, h, h)
            follows[:, points] = moves
            if (change := changes[g]) is not None:
                sources[:, points] = _source(law, arguments, parameters, tangents, change).reshape(n, p, h)

    def _arguments(self, g: int, group: Group, first: int, n: int) -> tuple[tuple[Array, Array, Array, float], Array]:
        """Arguments of the law of a group (``laws.dispatch``) in the run at n instants, one after the other, and
        whether its tractions follow the gaps (n, n_point, width)."""
        solved = self._solved
        image = self.image
        p = group.n_point
        h = group.n_component
        instants, behaviour = slice(first, first + n), group.behaviour
        place = int(image.groups[g]["z_sum"])
        z = image.fixed[place : place + 2 * p].reshape(p, 2)
        f, w = group.block(solved.rows.f_hat[instants])[:, 0], group.block(solved.rows.w_hat[instants])
        jump = w[:, 1] - w[:, 0] + z[:, [0, 1, 1][:h]] * f
        gaps, run = solved.rows.gaps.get(g), image.run[0]
        if behaviour.elastic:
            rate = float(run["layer_rate"])
            reach = np.zeros((n, p, h))
            moves = np.ones((n, p, h))
            if gaps is not None:
                # the compression at the end of the instant, whatever reach and jump it is made of
                jump[..., 0] = rate * gaps[instants] + z[:, 0] * f[..., 0]
                moves[..., 1:] = 0.0
        else:
            rate = float(1.0 / run["dt"])
            reach = np.zeros((n, p, 1))
            moves = np.zeros((n, p, 1))
            if gaps is not None:
                before, deepest = gaps[first - 1 : first + n - 1], -np.inf if solved.assembly.quasi_static else 0.0
                reach[..., 0], moves[..., 0] = np.maximum(before, deepest) * rate, before >= deepest
                # pressed points are at the gap of the law but for the tolerance of the iteration
                closed = f[..., 0] < 0.0
                jump[..., 0] = np.where(closed, z[:, 0] * f[..., 0], np.maximum(jump[..., 0] + reach[..., 0], 0.0))
                jump[..., 0] -= reach[..., 0]
                if isinstance(behaviour, NoSlip):
                    # closed as they were pressed: their gap is part of the jump (``kernels.local_stage``)
                    pressed = group.block(solved.rows.f_hat[first - 1 : first + n - 1])[:, 0, :, 0] < 0.0
                    jump[..., 0] += np.where(pressed, reach[..., 0], 0.0)
                    reach[..., 0] = np.where(pressed, 0.0, reach[..., 0])
        flat = jump.reshape(n * p, h), np.tile(z, (n, 1)), reach.reshape(n * p, -1), rate
        return flat, moves


def _source(
    law: str,
    arguments: tuple[Array, Array, Array, float],
    parameters: Array,
    tangents: Array,
    change: tuple[Array, Array, float],
) -> Array:
    """Derivative (n_point, h) of the tractions of points by a parameter at given arguments of their law.

    The difference of the law is central, but where a point that slips would stick with one of both values, or the other
    way round: there it is that of the side on which the state stays.
    """
    jump, z = arguments[:2]
    repeat = len(jump) // len(change[0])
    now = apply_law(law, *arguments, parameters)
    up = apply_law(law, *arguments, np.tile(change[0], (repeat, 1))) - now
    down = now - apply_law(law, *arguments, np.tile(change[1], (repeat, 1)))
    slope = (up + down) / change[2]
    if jump.shape[1] == 1:
        return slope
    sizes = np.linalg.norm(up[:, 1:], axis=1), np.linalg.norm(down[:, 1:], axis=1)
    unlike = np.abs(sizes[0] - sizes[1]) > _UNLIKE * np.maximum(*sizes)
    sliding = jump[:, 1:] / np.maximum(np.linalg.norm(jump[:, 1:], axis=1), np.finfo(float).tiny)[:, None]
    # along the slip the tangent of a point that slips is that of the pressure alone
    slips = np.einsum("pa,pab,pb->p", sliding, tangents[:, 1:, 1:], sliding) * z[:, 1] < 0.5
    taken = np.where(((sizes[0] > sizes[1]) == slips)[:, None], up, down)
    return np.where(unlike[:, None], 2.0 * taken / change[2], slope)
