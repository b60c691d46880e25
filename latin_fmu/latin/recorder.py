"""Keeps the accepted fields of a run; histories and energies of interfaces at its end.

recorder
--------
Keeps the accepted fields of a run and turns them into histories at its end.

interface_energy
----------------
What interfaces give and take, from their own histories: impact losses, work of a moving ground.

Works over a step use the time scheme's weights of the instants n-1, n, n+1, as the substructures' accounts do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..interface.behaviour import SEPARATION, as_layer
from ..kernels.energy import TERMS
from ..propagator.image import Image
from .assembly import Array, Assembly, InterfaceUnit
from .record import InterfaceHistory, SubstructureHistory
from .run_image import SlideProbes

_NO_CONTACT = 1e-6
_NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Wanted:
    """What to keep: displacement and velocity fields, mean stress, energies; fields every ``every`` instants.

    nodes : displacement and velocity of these nodes only, by substructure; None for all.
    """

    fields: bool = False
    stress: bool = False
    energy: bool = False
    every: int = 1
    nodes: Mapping[str, np.ndarray] | None = None


@dataclass(frozen=True)
class SubstructureInfo:
    """Mesh of a substructure for the results, and its stress recovery (displacements (n_node, 3) -> (n_cell, 6),
    None where no stress is wanted)."""

    nodes: Array
    cells: np.ndarray
    cell_type: str
    stress: Callable[[Array], Array] | None


class Recorder:
    """Histories of interfaces (always) and substructures (as wanted)."""

    def __init__(self, assembly: Assembly, wanted: Wanted, substructures: dict[str, SubstructureInfo]) -> None:
        self._wanted, self._info = wanted, substructures
        n_time, layout = len(assembly.time), assembly.layout
        self.f_hat = np.zeros((n_time, layout.n_flat))
        self.w_hat = np.zeros((n_time, layout.n_flat))
        self.gaps = [np.zeros((n_time, g.n_point)) if g.behaviour.opens else None for g in layout.groups]
        # Frictionless interfaces carry no tangential unknowns: their tangential velocities come from the sides.
        self._slide = {
            i: np.zeros((n_time, 2, u.geometry.n_point, 3))
            for i, u in enumerate(assembly.interfaces)
            if u.behaviour.n_component == 1
        }
        self._where = {name: (p, m) for p in assembly.propagators for m, name in enumerate(p.names)}
        self._classes = range(len(assembly.propagators))
        self._numbers = {name: c for c, p in enumerate(assembly.propagators) for name in p.names}
        self._stored: dict[str, dict[str, list[Array]]] = {name: {} for name in self._where}
        self._stored_time: list[float] = []
        self._energy: list[list[Array]] = [[] for _ in assembly.propagators]  # (n, 6, n_member) each
        self._instant = 0

    def start(self, assembly: Assembly, image: Image, probes: SlideProbes) -> None:
        """Keep t = 0, the first row of the image's output."""
        self._instant = -1
        self.kept(assembly, image, probes, 1)

    def kept(self, assembly: Assembly, image: Image, probes: SlideProbes, n: int, row: int = 0) -> None:
        """Keep the next n instants, rows of the image's output from ``row`` on."""
        rows, now = slice(row, row + n), slice(self._instant + 1, self._instant + 1 + n)
        self.f_hat[now] = image.field("history_f", image.rows, image.n_flat)[rows]
        self.w_hat[now] = image.field("history_w", image.rows, image.n_flat)[rows]
        gaps = image.field("history_gap", image.rows, int(image.run[0]["n_point"]))[rows]
        at = 0
        for group, gap in zip(assembly.layout.groups, self.gaps, strict=True):
            if gap is not None:
                gap[now] = gaps[:, at : at + group.n_point]
            at += group.n_point
        if self._slide:
            probes.read(assembly, now, [image.output(c, "probed", "n_probe")[rows] for c in self._classes], self._slide)
        if self._wanted.energy:
            for c, kept in enumerate(self._energy):
                kept.append(image.output(c, "energies", 6)[rows].copy())
        self._instant += n
        if (self._wanted.fields or self._wanted.stress) and self._instant % self._wanted.every == 0:
            self._store_fields(float(assembly.time[self._instant]))

    def instants_unseen(self) -> int:
        """Instants that may pass before the recorder has to see the substructures again."""
        if self._wanted.fields or self._wanted.stress:
            return self._wanted.every - self._instant % self._wanted.every
        return len(self.f_hat)

    @property
    def sliding(self) -> list[int]:
        """Interfaces whose tangential velocities come from the substructures."""
        return sorted(self._slide)

    def _member_energy(self, name: str) -> Array:
        """Terms (n_time, 6) of a substructure, J."""
        member, c = self._where[name][1], self._numbers[name]
        return np.concatenate([part[:, :, member] for part in self._energy[c]])

    def _store_fields(self, time: float) -> None:
        self._stored_time.append(time)
        for name, (propagator, member) in self._where.items():
            stored = self._stored[name]
            u = propagator.full_displacement(member)
            if self._wanted.fields:
                v = propagator.full_velocity(member)
                if self._wanted.nodes is not None:
                    nodes = self._wanted.nodes.get(name, _NONE)
                    u_kept, v = u[nodes], v[nodes]
                else:
                    u_kept = u
                stored.setdefault("displacement", []).append(u_kept)
                stored.setdefault("velocity", []).append(v)
            recover = self._info[name].stress
            if self._wanted.stress and recover is not None:
                stored.setdefault("stress", []).append(recover(u))

    @property
    def n_kept(self) -> int:
        """Instants kept so far, t = 0 included."""
        return self._instant + 1

    # -- histories --------------------------------------------------------------------------------------------
    def interfaces(self, assembly: Assembly) -> dict[str, InterfaceHistory]:
        """Interface histories over the kept instants."""
        return {u.name: self._interface(assembly, i, u) for i, u in enumerate(assembly.interfaces)}

    def _interface(self, assembly: Assembly, index: int, unit: InterfaceUnit) -> InterfaceHistory:
        n = self._instant + 1
        group = assembly.layout.group(index)
        points = group.members[index]
        f_hat = group.block(self.f_hat[:n])[:, 0, points]
        w_hat = group.block(self.w_hat[:n])[:, :, points]
        return interface_history(
            unit,
            f_hat,
            w_hat,
            self._slide.get(index),
            self._gap_of(assembly, index, n),
            group.parameters[points],
            assembly.characteristic_traction,
        )

    def _gap_of(self, assembly: Assembly, index: int, n: int) -> Array | None:
        group = assembly.layout.group(index)
        gap = self.gaps[assembly.layout.groups.index(group)]
        return None if gap is None else gap[:n, group.members[index]]

    def substructures(self) -> dict[str, SubstructureHistory]:
        """Histories of the substructures for which something was wanted."""
        if not (self._wanted.fields or self._wanted.stress or self._wanted.energy):
            return {}
        time = np.array(self._stored_time)
        histories = {}
        for name, info in self._info.items():
            stored = {key: np.stack(values) for key, values in self._stored[name].items()}
            energy = None
            if self._wanted.energy:
                table = self._member_energy(name)
                energy = {term: table[:, j] for j, term in enumerate(TERMS)}
            histories[name] = SubstructureHistory(
                name,
                info.nodes,
                info.cells,
                info.cell_type,
                time,
                stored.get("displacement"),
                stored.get("velocity"),
                stored.get("stress"),
                energy,
            )
        return histories

    def assembly_energy(self, assembly: Assembly) -> dict[str, Array] | None:
        """Sums over the substructures, what the interfaces dissipate, balance; None unless wanted.

        balance = change of (kinetic + elastic) + damping + scheme - work of loads - interface work. The interface
        work is - friction - contact dissipation + ground work - joint dissipation - change of layer energy, but for
        the iteration tolerance and the different weights of the instants in these terms (friction takes the end of
        each instant, so that it never decreases).
        """
        if not self._wanted.energy:
            return None
        n = self._instant + 1
        tables = [self._member_energy(name) for name in self._where]
        total = {t: sum((table[:, j] for table in tables), np.zeros(n)) for j, t in enumerate(TERMS)}
        histories = list(self.interfaces(assembly).values())
        total["friction_dissipation"] = np.zeros(n)
        for history in histories:
            if history.friction_power is not None:
                total["friction_dissipation"][1:] += np.cumsum(history.friction_power[1:]) * assembly.dt
        weights, lead = assembly.scheme.energy_weights()[0], assembly.scheme.gap_offset(assembly.dt)
        total["contact_dissipation"] = sum((impact_losses(h, weights, lead) for h in histories), np.zeros(n))
        total.update(yielding_terms(histories, assembly.dt))
        if any(g.any() for g in assembly.ground.values()):
            works = [ground_work(histories[i], assembly.ground_path(i)[:n], weights) for i in assembly.ground]
            total["ground_work"] = sum(works, np.zeros(n))
        stored = total["kinetic"] + total["elastic"]
        total["balance"] = (
            stored
            - stored[0]
            + total["damping_dissipation"]
            + total["scheme_dissipation"]
            - total["work_of_loads"]
            - total["interface_work"]
        )
        return total


def interface_history(
    unit: InterfaceUnit,
    f_hat: Array,
    w_hat: Array,
    slide: Array | None,
    gap: Array | None,
    parameters: Array,
    characteristic: float,
) -> InterfaceHistory:
    """History in global axes from local-frame fields.

    Parameters
    ----------
    f_hat : (n, n_point, n_component) on side E. w_hat : (n, 2, n_point, n_component).
    slide : (n_time, 2, n_point, 3) velocities of the sides where tangential unknowns are absent, else None.
    gap : (n, n_point) or None. parameters : (n_point, n_parameter).
    characteristic : traction the loads can bring, Pa; a pressure below 1e-6 of it (the round-off and the numerical
        forerunners of a wave that has not arrived) does not count as contact.
    """
    geometry, n_component = unit.geometry, unit.behaviour.n_component
    frames = geometry.frames[:, :n_component]
    traction, velocity = _in_global_axes(f_hat, frames), _in_global_axes(w_hat, frames)
    if slide is not None:
        normal = geometry.frames[:, 0]
        kept = slide[: len(f_hat)]
        velocity = velocity + kept - np.einsum("tspi,pi,pj->tspj", kept, normal, normal)
    power = None
    if unit.behaviour.opens and n_component > 1:
        density = np.zeros(f_hat.shape[:-1])
        for c in range(1, n_component):
            density += f_hat[..., c] * (w_hat[:, 1, :, c] - w_hat[:, 0, :, c])
        power = density @ geometry.areas
    layer, joint_power = as_layer(unit.behaviour), None
    layer_energy = None if layer is None else layer.stored_energy(f_hat, parameters) @ geometry.areas
    if unit.behaviour.compliant and layer is None:
        joint_power = (f_hat * (w_hat[:, 1] - w_hat[:, 0])).sum(axis=-1) @ geometry.areas
    opens = unit.behaviour.opens
    status = None
    if opens:
        status = unit.behaviour.status(f_hat, parameters)
        status[-f_hat[..., 0] <= _NO_CONTACT * characteristic] = SEPARATION
    return InterfaceHistory(
        name=unit.name,
        behaviour=unit.behaviour.name,
        sides=unit.sides,
        points=geometry.points,
        areas=geometry.areas,
        normals=geometry.frames[:, 0],
        initial_gap=geometry.gap,
        friction_coefficient=getattr(unit.behaviour, "friction_coefficient", None),
        traction=traction,
        velocity=velocity,
        gap=gap,
        contact_status=status,
        friction_power=power,
        layer_energy=layer_energy,
        joint_power=joint_power,
    )


def _in_global_axes(values: Array, frames: Array) -> Array:
    """Vectors (..., n_point, n_component) in the axes of their points, frames (n_point, n_component, 3), turned."""
    if len(frames) and (frames == frames[0]).all():
        return _in_one_frame(values, frames[0])
    turned: Array = np.einsum("...pc,pci->...pi", values, frames)
    return turned


def _in_one_frame(values: Array, frame: Array) -> Array:
    """Vectors (..., n_component) in one frame (n_component, 3), turned."""
    if (np.count_nonzero(frame, axis=0) <= 1).all():  # along the global axes: nothing to add up
        turned = np.empty((*values.shape[:-1], 3))
        for axis, column in enumerate(frame.T):
            row = int(np.argmax(np.abs(column)))
            np.multiply(values[..., row], column[row], out=turned[..., axis])
        return turned
    product: Array = values.reshape(-1, len(frame)) @ frame  # one product instead of one per instant
    return product.reshape(*values.shape[:-1], 3)


def impact_losses(history: InterfaceHistory, weights: tuple[float, float, float], lead: float) -> Array:
    """Energy (n_time,) lost to the normal contact law since the start, J: - sum of pressure x change of gap.

    A closed point that stays closed loses nothing; a closing one loses what the end-of-instant law takes out: the
    kinetic energy of the layer of elements that meets the other side, which goes to zero under refinement. ``lead``:
    how far ahead of the instants the gaps are, s.
    """
    if history.gap is None or history.layer_energy is not None:
        return np.zeros(len(history.traction))
    pressure = -np.einsum("tpc,pc->tp", history.traction, history.normals)
    gap = history.gap
    if lead:
        opening = history.velocity[:, 1] - history.velocity[:, 0]
        gap = gap - lead * np.einsum("tpc,pc->tp", opening, history.normals)
    power = -_weighted(pressure, weights) * np.diff(gap, axis=0)
    return _running(power @ history.areas)


def yielding_terms(histories: Sequence[InterfaceHistory], dt: float) -> dict[str, Array]:
    """Energy of elastic layers and dissipation of viscous joints, (n_time,) each, J; only what there is."""
    terms = {}
    layers = [h.layer_energy for h in histories if h.layer_energy is not None]
    joints = [h.joint_power for h in histories if h.joint_power is not None]
    if layers:
        terms["layer_energy"] = np.sum(layers, axis=0)
    if joints:
        power = np.sum(joints, axis=0)
        terms["joint_dissipation"] = _running(0.5 * dt * (power[1:] + power[:-1]))
    return terms


def ground_work(history: InterfaceHistory, path: Array, weights: tuple[float, float, float]) -> Array:
    """Work (n_time,) that a moving ground does on side E since the start, J; ``path`` (n_time, 3) its travel, m."""
    force = _weighted(history.force(), weights)
    return _running(np.einsum("tc,tc->t", force, np.diff(path, axis=0)))


def _weighted(values: Array, weights: tuple[float, float, float]) -> Array:
    """Weighted values of each step, (n_time - 1, ...); the first step counts its start twice."""
    before = np.concatenate([values[:1], values[:-2]])
    combined: Array = weights[0] * before + weights[1] * values[:-1] + weights[2] * values[1:]
    return combined


def _running(steps: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(steps)])
