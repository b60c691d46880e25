"""Which effects of a scene matter, found in a coarse run of it: half the elements along every edge, half the steps.

Interfaces: the area and the instants at which points touch, slip and open. Bodies: their
energies, the kinetic energy of what is left of its velocities without their rigid part, against the largest strain
energy. Where it stays below 2 % a body deforms as if its inertia only accelerated it as a whole: waves have crossed it
often enough, and steps and elements that resolve a wave gain nothing there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .. import api
from ..assembly.problem import DiscretisedProblem
from ..building import discretise
from ..fem.elements import rigid_modes
from ..interface.laws import SEPARATION, SLIP
from ..latin.outcome import Array, InterfaceHistory, SubstructureHistory
from ..results.solution import Solution
from ..scene.schema import Scene
from .runs import Resolution, at_resolution, coarsens_mesh, mesh_factor

COARSE = 0.5
"""Elements along an edge and steps of the run, over those of the scene."""
QUASI_STATIC = 0.02  # vibration energy over the largest strain energy below which a body follows its loads
NEGLIGIBLE = 1e-3  # share of an energy, or of the contact, that does not matter
QUIET = 0.25  # share of the time with strain that a body has to be without vibrations
ROUND_OFF = 1e-9  # of the largest energy
STIFF = 1e-3  # strain energy over the largest energy of the assembly, below which a body is practically rigid


@dataclass(frozen=True)
class CoarseRun:
    """Findings of a coarse run.

    Attributes
    ----------
    description : resolution and cost, in words. findings : a sentence each. converged : whether the run did.
    interrupted : by which limit it was stopped; empty where it was not. Its findings are those until then.
    """

    description: str
    findings: list[str]
    converged: bool
    interrupted: str = ""

    def report(self) -> dict[str, object]:
        """Plain data for JSON."""
        plain = {"description": self.description, "converged": self.converged, "findings": self.findings}
        return plain | ({"interrupted": self.interrupted} if self.interrupted else {})

    def text(self) -> str:
        """The findings as lines of text."""
        lines = [f"Effects that matter, {self.description}:", *(f"  * {finding}" for finding in self.findings)]
        return "\n".join(lines if self.findings else [*lines, "  every effect of the scene"])


def coarse_run(scene: Scene, max_cpu: float | None = None) -> CoarseRun:
    """Solve the scene at half its resolution and list which of its effects matter; ``max_cpu`` : as for ``api.solve``.

    Raises
    ------
    SceneError : the scene cannot be built.
    """
    if coarsens_mesh(scene):
        mesh = mesh_factor(scene, COARSE)
    else:
        mesh = 1.0
    if scene.time.quasi_static:
        time = 1.0
    else:
        time = COARSE
    coarse = at_resolution(scene, Resolution(mesh, time))
    # fields: the energy of vibrations needs the velocities of all nodes
    coarse = coarse.model_copy(update={"output": type(scene.output)(fields=not scene.time.quasi_static, energy=True)})
    solution = api.solve(coarse, max_cpu=max_cpu)
    description = (
        f"in a run with {mesh:.2g} of the elements along an edge and {time:.2g} of the steps "
        f"({solution.timings.total:.2g} s of CPU time)"
    )
    if solution.interrupted:
        seen = [*_of_interfaces(solution), *_of_energies(solution)] if len(solution.time) > 1 else []
        return CoarseRun(description, [f"{solution.status}. Until then:", *seen], False, solution.interrupted)
    if not solution.converged:
        return CoarseRun(description, [solution.status], converged=False)
    findings = [*_of_interfaces(solution), *_of_energies(solution)]
    if not scene.time.quasi_static:
        findings += _of_bodies(discretise(coarse), solution)
    return CoarseRun(description, findings, converged=True)


# -- interfaces -------------------------------------------------------------------------------------------------------
def _of_interfaces(solution: Solution) -> Iterator[str]:
    for name, history in solution.interfaces.items():
        if history.contact_status is not None:
            yield from _of_contact(name, history, solution)


def _of_contact(name: str, history: InterfaceHistory, solution: Solution) -> Iterator[str]:
    """Whether the sides touch, slip and open."""
    status = history.contact_status
    assert status is not None
    # area times number of instants, m2: only ratios of them have a meaning
    touching, slipping = (float((flags @ history.areas).sum()) for flags in (status != SEPARATION, status == SLIP))
    if touching == 0.0:
        if history.gap is None:
            gap = ""
        else:
            gap = f": the smallest gap is {history.gap.min():.3g} {solution.units['m']}"
        yield f"interface {name} is always open{gap}"
        return
    mu, share = history.mu, slipping / touching
    if mu and share <= NEGLIGIBLE:
        yield f"interface {name}: no point slips at mu = {mu:g} (at most {100 * share:.2g} % of the contact)"
    elif mu and share >= 1.0 - NEGLIGIBLE:
        yield f"interface {name}: all points slip at mu = {mu:g}, so that the friction force is mu times the pressure"
    elif mu:
        yield f"interface {name}: {100 * share:.2g} % of the contact slips at mu = {mu:g}"
    open_ = 1.0 - touching / (history.areas.sum() * len(solution.time))
    if open_ <= NEGLIGIBLE and mu and share <= NEGLIGIBLE:
        yield f'interface {name} neither opens nor slips: behaviour = "perfect" gives the same changes of forces'
    elif open_ <= NEGLIGIBLE:
        yield f"interface {name} never opens"


# -- energies ---------------------------------------------------------------------------------------------------------
def _of_energies(solution: Solution) -> Iterator[str]:
    """Terms of the balance that do not matter."""
    energy = solution.energy or {}
    largest = max((float(np.abs(values).max(initial=0.0)) for values in energy.values()), default=0.0)
    for key, name in (("friction_dissipation", "friction"), ("damping_dissipation", "damping")):
        if key in energy:
            lost = float(np.abs(energy[key]).max(initial=0.0))
        else:
            lost = 0.0
        # below it the scene does not have the effect: nothing could be left out
        if ROUND_OFF * largest < lost <= NEGLIGIBLE * largest:
            yield f"{name} dissipates {100 * lost / largest:.2g} % of the largest energy"


def _of_bodies(problem: DiscretisedProblem, solution: Solution) -> Iterator[str]:
    """Bodies that stay at rest, that are practically rigid, or that follow their loads without vibrating."""
    histories = solution.substructures
    strains = {n: float(h.energy["elastic"].max()) for n, h in histories.items() if h.energy is not None}
    totals = {n: float((h.energy["elastic"] + h.energy["kinetic"]).max()) for n, h in histories.items() if h.energy}
    largest = max(totals.values(), default=0.0)
    if largest == 0.0:
        return
    supported = {n for n, c in problem.conditions.items() if c.held.any()}
    for name, history in histories.items():
        if problem.bodies[name].rigid:
            continue
        # energies are squares: velocities of some 1e-6 of those of the others
        if totals[name] <= 1e-12 * largest:
            yield f"substructure {name} stays at rest"
        elif strains[name] <= STIFF * largest and name not in supported:
            yield (
                f"substructure {name} is practically rigid: its strain energy is {100 * strains[name] / largest:.2g} % "
                "of the largest energy"
            )
        elif strains[name] > 0.0:
            yield _crossings(problem, name, history, _vibration(problem, name, history) / strains[name])


def _vibration(problem: DiscretisedProblem, name: str, history: SubstructureHistory) -> Array:
    """Kinetic energy (n_time,) without that of the rigid part of the velocities, J.

    v^T M v / 2 - p^T M_R^-1 p / 2, with the momenta p = R^T M v of the rigid motions R and M_R = R^T M R.
    """
    model = next(m for c in problem.classes for m in c.members if m.name == name)
    mass, nodes = model.mass, history.nodes
    assert mass is not None
    assert history.velocity is not None
    rigid = rigid_modes(nodes, nodes.mean(axis=0), problem.bodies[name].mesh.size)
    momenta = mass @ rigid
    inertia = np.linalg.inv(rigid.T @ momenta)
    velocity = history.velocity.reshape(len(history.velocity), -1)
    p = velocity @ momenta
    whole = np.einsum("td,dt->t", velocity, mass @ velocity.T)
    # a difference: exact to round-off of the whole, which QUASI_STATIC is far above
    return np.asarray(0.5 * (whole - np.einsum("ti,ij,tj->t", p, inertia, p)))


def _crossings(problem: DiscretisedProblem, name: str, history: SubstructureHistory, share: Array) -> str:
    """The number of wave crossings after which a body follows its loads, in words."""
    body, energy = problem.bodies[name], history.energy
    assert energy is not None
    speed = body.shape.elasticity.wave_speeds[0]
    strained = np.flatnonzero(energy["elastic"] > NEGLIGIBLE * energy["elastic"].max())
    first = history.time[strained[0]]
    late = np.flatnonzero(share > QUASI_STATIC)
    if not len(late):
        return (
            f"substructure {name} is quasi-static: its vibrations have at most {100 * share.max():.2g} % of its "
            "largest strain energy"
        )
    last = min(int(late[-1]) + 1, len(share) - 1)
    if history.time[-1] - history.time[last] < QUIET * (history.time[-1] - first):
        return (
            f"substructure {name} vibrates until the end: its vibrations have up to {100 * share[late].max():.2g} % of "
            "its largest strain energy"
        )
    crossings = float(history.time[last] - first) * speed / body.mesh.size
    return (
        f"substructure {name} is quasi-static after {crossings:.2g} crossings of a wave ({history.time[last]:.3g} s): "
        f"its vibrations have less than {100 * QUASI_STATIC:g} % of its largest strain energy"
    )
