"""Small substructures with every kind of condition, and a dense march of theirs written from the equations alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray

from latin_fmu.fem.dissection import nested_dissection
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh import Mesh, box_mesh
from latin_fmu.interface.geometry import local_frames
from latin_fmu.propagator import DirectPropagator, Histories, LoadTerm, SubstructureModel
from latin_fmu.propagator.base import channel_velocity, full_displacement, full_velocity
from latin_fmu.time_scheme import HHT, Newmark, TimeScheme
from tests.alone import alone_of, started_alone

Array = NDArray[np.float64]

E, NU, RHO = 5.0, 0.3, 1.2
DT, N = 0.11, 24
SCHEMES = {
    "hht": HHT(alpha=-0.1),
    "hht_third": HHT(alpha=-1 / 3),
    "average": Newmark(),
    "damped_newmark": Newmark(beta=0.3025, gamma=0.6),
}
KINDS = ("free", "held", "damped", "driven", "periodic", "everything")


def histories(n_time: int, count: int, seed: int) -> Array:
    """Smooth random histories (n_time, count) with values and slopes at t = 0."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_time)[:, None] * DT
    waves = (
        rng.normal(size=count) * np.sin(t * rng.uniform(0.5, 6.0, count) + rng.uniform(0, 6, count)) for _ in range(3)
    )
    return np.sum(list(waves), axis=0)


def selection(mesh: Mesh, held: Array, ties: tuple[Array, Array] | None) -> sp.csr_array:
    """Expansion that drops the held dofs and merges the tied ones."""
    leader = np.arange(3 * mesh.n_node)
    if ties is not None:
        leader[ties[1]] = ties[0]
        leader = leader[leader]
    gone = np.isin(leader, leader[held.astype(np.int64)])
    rows = np.flatnonzero(~gone)
    kept, columns = np.unique(leader[rows], return_inverse=True)
    return sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(leader), len(kept)))


def dofs(nodes: Array, *components: int) -> Array:
    """Dofs of some components of nodes."""
    return np.sort(np.concatenate([3 * nodes + c for c in components]))


def periodic_pairs(mesh: Mesh) -> tuple[Array, Array]:
    """Dofs of xmin and of the opposite nodes of xmax."""
    low = face(mesh, "xmin").nodes
    high = face(mesh, "xmax").nodes
    return dofs(low, 0, 1, 2), dofs(high, 0, 1, 2)


def channels(mesh: Mesh, tilt: float) -> tuple[sp.csr_array, Array]:
    """Two interfaces: three components in tilted frames on zmax, normals only on ymax."""
    blocks, areas = [], []
    for name, count in (("zmax", 3), ("ymax", 1)):
        surface = face(mesh, name)
        frames = local_frames(surface.normals + tilt * np.array([1.0, 0.5, 0.0]))
        pick = sp.csr_array(
            (np.ones(3 * len(surface.nodes)), (np.arange(3 * len(surface.nodes)), dofs(surface.nodes, 0, 1, 2))),
            shape=(3 * len(surface.nodes), 3 * mesh.n_node),
        )
        blocks.append(sp.csr_array(sp.block_diag([sp.coo_array(f[:count]) for f in frames]) @ pick))
        areas.append(np.repeat(surface.areas, count))
    return sp.csr_array(sp.vstack(blocks)), np.concatenate(areas)


@dataclass(frozen=True)
class Driven:
    """A substructure and what drives it."""

    model: SubstructureModel
    histories: Histories


def make_model(kind: str, seed: int = 0, n: int = N, elements: tuple[int, int, int] = (2, 2, 3)) -> Driven:
    """A box of hexahedra with loads, initial motion, and the conditions of ``kind``."""
    mesh = box_mesh(np.zeros(3), np.array([1.0, 0.9, 1.6]), elements)
    basis = Elements(mesh)
    m, k = mass(basis, RHO), stiffness(basis, Isotropic(1.0, E, NU))
    everything = kind == "everything"
    bottom, side = face(mesh, "zmin").nodes, face(mesh, "ymin").nodes
    held = dofs(bottom, 0, 1) if kind == "held" or everything else np.zeros(0, dtype=np.int64)
    ties = periodic_pairs(mesh) if kind == "periodic" or everything else None
    driven = [dofs(bottom, 2), dofs(side, 1)] if kind == "driven" or everything else []
    gone = np.unique(np.concatenate([held, *driven])).astype(np.int64)
    expansion = selection(mesh, gone, ties)
    pattern = np.zeros((3 * mesh.n_node, len(driven)))
    for column, moved in enumerate(driven):
        pattern[np.setdiff1d(moved, held), column] = 1.0
    if everything:  # the edge of both driven faces has different components: no dof is driven twice
        assert pattern.sum(axis=1).max() == 1.0
    damping = sp.csr_array(0.3 * m + 0.02 * k) if kind == "damped" or everything else None
    trace, area = channels(mesh, tilt=0.3 if everything else 0.0)
    rng = np.random.default_rng(seed)
    free = np.asarray(expansion.sum(axis=1)).ravel()
    loads = [LoadTerm(name, rng.normal(size=3 * mesh.n_node)) for name in ("one", "two", "")]
    amplitudes = [*histories(n + 1, 2, seed + 3).T, np.ones(n + 1)]
    tied = expansion @ rng.normal(size=(expansion.shape[1], 2))
    velocity = histories(n + 1, len(driven), seed + 20)
    model = SubstructureModel(
        name=f"{kind}{seed}",
        mass=m,
        damping=damping,
        stiffness=k,
        expansion=expansion,
        trace=trace,
        channel_area=area,
        loads=loads,
        displacement=0.1 * free * tied[:, 0],
        velocity=free * tied[:, 1] + pattern @ velocity[0],
        imposed_pattern=pattern,
        imposed_start=np.zeros(len(driven)),
        ordering=np.repeat(nested_dissection(mesh), 3),
    )
    return Driven(model, Histories(DT * np.arange(n + 1), amplitudes, velocity))


@dataclass(frozen=True)
class Motion:
    """Full displacements, velocities and accelerations, (n + 1, n_full)."""

    u: Array
    v: Array
    a: Array


def prescribed(driven: Driven, scheme: Any) -> Array:
    """Full accelerations of the prescribed motions, (n + 1, n_full): Newmark's relation for the given velocities."""
    v = driven.histories.imposed
    a = np.zeros_like(v)
    a[0] = (v[1] - v[0]) / DT
    for i in range(len(v) - 1):
        a[i + 1] = ((v[i + 1] - v[i]) / DT - (1 - scheme.gamma) * a[i]) / scheme.gamma
    return a @ driven.model.imposed_pattern.T


def dense_march(driven: Driven, scheme: Any, incoming: Array, k: Array) -> Motion:
    """HHT in the full space, dense, one plain solve per instant: tractions q - k W on the channels.

    P^T [M a_{n+1} - (1 + alpha) R_{n+1} + alpha R_n] = 0,  R = f + T^T A (q - k T v) - C v - K u,
    u = P x + prescribed. With k = 0 the tractions are given.
    """
    model = driven.model
    p, m, stiff = model.expansion.toarray(), model.mass.toarray(), model.stiffness.toarray()
    t, area = model.trace.toarray(), model.channel_area
    damp = np.zeros_like(m) if model.damping is None else model.damping.toarray()
    damp = damp + t.T @ ((area * k)[:, None] * t)
    terms = zip(driven.histories.amplitudes, model.loads, strict=True)
    loads = sum(np.outer(amplitude, term.pattern) for amplitude, term in terms) + (incoming * area) @ t
    a_p = prescribed(driven, scheme)
    al, be, ga = scheme.alpha, scheme.beta, scheme.gamma
    n = len(loads) - 1
    u, v, a = (np.zeros((n + 1, model.n_full)) for _ in range(3))
    u[0], v[0] = model.displacement, model.velocity
    residual = loads[0] - damp @ v[0] - stiff @ u[0]
    a[0] = a_p[0] + p @ np.linalg.solve(p.T @ m @ p, p.T @ (residual - m @ a_p[0]))
    operator = p.T @ (m + (1 + al) * (ga * DT * damp + be * DT**2 * stiff)) @ p
    for i in range(n):
        # the prescribed part of u, v is known; a = P x + a_p is the unknown
        u_free = u[i] + DT * v[i] + DT**2 * (0.5 - be) * a[i] + be * DT**2 * a_p[i + 1]
        v_free = v[i] + DT * (1 - ga) * a[i] + ga * DT * a_p[i + 1]
        force = (1 + al) * (loads[i + 1] - damp @ v_free - stiff @ u_free) - al * residual - m @ a_p[i + 1]
        x = p @ np.linalg.solve(operator, p.T @ force)
        a[i + 1] = x + a_p[i + 1]
        u[i + 1], v[i + 1] = u_free + be * DT**2 * x, v_free + ga * DT * x
        residual = loads[i + 1] - damp @ v[i + 1] - stiff @ u[i + 1]
    return Motion(u, v, a)


def started(members: list[Driven], scheme: TimeScheme, traction: Array | None = None) -> DirectPropagator:
    """Propagator with energies, at t = 0 with tractions (n_channel, n_member)."""
    propagator = DirectPropagator([d.model for d in members], scheme, DT, energy=True)
    propagator.begin([d.histories for d in members], DT)
    at_start = np.zeros((propagator.n_channel, len(members))) if traction is None else traction
    started_alone(propagator, at_start, propagator.mass_factor())
    return propagator


def commit_all(propagator: DirectPropagator, tractions: Array) -> Motion:
    """Commit tractions (n + 1, n_channel, n_member) from the present instant on; full motion of member 0."""
    fields = [_state(propagator)]
    for traction in tractions[propagator.instant + 1 :]:
        alone_of(propagator).predict()
        alone_of(propagator).commit(traction)
        fields.append(_state(propagator))
    return Motion(*(np.array(f) for f in zip(*fields, strict=True)))


def _state(propagator: DirectPropagator) -> tuple[Array, Array, Array]:
    a = (
        propagator.members[0].expansion @ propagator.state.a[:, 0]
        + propagator.forcing.imposed_a(propagator.instant)[:, 0]
    )
    return full_displacement(propagator, 0).ravel(), full_velocity(propagator, 0).ravel(), a


@pytest.fixture(params=SCHEMES)
def scheme(request: pytest.FixtureRequest) -> TimeScheme:
    """Schemes of the dense march (alpha, beta, gamma)."""
    return SCHEMES[request.param]


@pytest.fixture
def hht() -> TimeScheme:
    """The default scheme."""
    return HHT()


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    """Kinds of conditions."""
    return str(request.param)


@pytest.fixture
def model() -> Callable[..., Driven]:
    """See ``make_model``."""
    return make_model


@pytest.fixture
def reference() -> Callable[..., Motion]:
    """See ``dense_march``."""
    return dense_march


@pytest.fixture
def begin() -> Callable[..., DirectPropagator]:
    """See ``started``."""
    return started


@pytest.fixture
def advance() -> Callable[..., Motion]:
    """See ``commit_all``."""
    return commit_all


@pytest.fixture
def tractions() -> Callable[..., Array]:
    """Random smooth channel tractions (N + 1, n_channel, n_member)."""

    def make(n_channel: int, n_member: int = 1, seed: int = 50) -> Array:
        return histories(N + 1, n_channel * n_member, seed).reshape(N + 1, n_channel, n_member)

    return make


@pytest.fixture
def changed() -> Callable[..., Driven]:
    """A driven substructure with some attributes of its model or histories replaced."""

    def change(driven: Driven, model: dict[str, Any] | None = None, histories: dict[str, Any] | None = None) -> Driven:
        return Driven(replace(driven.model, **(model or {})), replace(driven.histories, **(histories or {})))

    return change


@pytest.fixture
def answers(tractions: Callable[..., Array]) -> Callable[..., None]:
    """Check the velocities W that a propagator has under tractions of one instant, relative to the largest:
    W - W_0 = D q; with dashpots k in parallel Y q, Y = (1 + D k)^-1 D, where ``commit`` of q - k W ends with W too."""

    def check(propagator: Any, limit: float) -> None:
        member, n = alone_of(propagator), propagator.n_channel
        velocities = {}
        for j in (-1, 0, 4, n - 1):  # -1: none
            traction = np.zeros((n, 1))
            if j >= 0:
                traction[j] = 1.0
            snapshot = member.snapshot()
            member.predict()
            member.commit(traction)
            velocities[j] = channel_velocity(propagator)[:, 0]
            member.restore(snapshot)
        free, d = velocities.pop(-1), propagator.operators.admittance
        for j, column in velocities.items():
            np.testing.assert_allclose(column - free, d[:, j], rtol=0, atol=limit * np.abs(d[:, j]).max())
        k = np.random.default_rng(3).uniform(0.0, 4.0, n)
        k[1] = 0.0
        propagator.bind(0.5 * k)  # one direction after another
        propagator.bind(k)
        condensed = propagator.condensed * propagator.operators.area
        np.testing.assert_allclose(condensed, np.linalg.solve(np.eye(n) + d * k, d), rtol=0, atol=1e-12 * d.max())
        by_area = condensed / propagator.operators.area
        np.testing.assert_allclose(by_area, by_area.T, rtol=0, atol=1e-13 * by_area.max())
        for q in tractions(n)[1:6]:
            member.predict()
            w = member.respond(q)
            member.commit(q - propagator.k * w)
            np.testing.assert_allclose(channel_velocity(propagator), w, rtol=0, atol=limit * np.abs(w).max())

    return check


@pytest.fixture
def unbalanced() -> Callable[..., float]:
    """Largest error of the energy balance over a march with given tractions, relative to the largest term."""

    def march(propagator: Any, tractions: Array) -> float:
        start, worst = dict(alone_of(propagator).totals), 0.0
        for traction in tractions:
            alone_of(propagator).predict()
            alone_of(propagator).commit(traction)
            now = alone_of(propagator).totals
            change = {t: now[t] - start[t] for t in now}
            balance = (
                change["kinetic"]
                + change["elastic"]
                + change["damping_dissipation"]
                + change["scheme_dissipation"]
                + change["landing_dissipation"]
                - change["work_of_loads"]
                - change["interface_work"]
            )
            worst = max(worst, float((np.abs(balance) / np.max([np.abs(v) for v in now.values()], axis=0)).max()))
        return worst

    return march


def continue_from(propagator: Any, other: Any) -> None:
    """Let a propagator go on from where another one is, as a run does: from the state of its image and the motions."""
    image = alone_of(propagator).image()
    image.state[:] = alone_of(other).image().state
    propagator.resume(image, 0, other.motions())


@pytest.fixture
def resumes(tractions: Callable[..., Array]) -> Callable[..., None]:
    """Check that a march taken up again is the same to the last bit: from a snapshot, and from the state in another
    propagator that is given the rest of the histories. ``start`` : gives the propagator at t = 0, over steps ``dt``."""

    def check(m: Any, start: Callable[[], Any], dt: float) -> None:
        given = tractions(len(m.model.channel_area))

        def on(propagator: Any) -> Array:
            for traction in given[5:9]:
                alone_of(propagator).predict()
                alone_of(propagator).commit(traction)
            terms = [alone_of(propagator).totals[t] for t in sorted(alone_of(propagator).totals)]
            fields = full_displacement(propagator, 0), full_velocity(propagator, 0)
            return np.concatenate([*(field.ravel() for field in fields), *terms])

        propagator = start()
        for traction in given[1:5]:
            alone_of(propagator).predict()
            alone_of(propagator).commit(traction)
        kept, other = alone_of(propagator).snapshot(), start()
        continue_from(other, propagator)
        whole = on(propagator)
        alone_of(propagator).restore(kept)
        np.testing.assert_array_equal(on(propagator), whole)
        rest = type(m.histories)(m.histories.time[4:], [a[4:] for a in m.histories.amplitudes], m.histories.imposed[4:])
        other.begin([rest], dt)
        np.testing.assert_array_equal(on(other), whole)

    return check
