"""Starts whose stress has a stiffness: geometric stiffness of the equilibrium of t = 0, and the motion about it.

The static start u_0 is found with the elastic stiffness K, bolts and loads in their order (``statics``). Its stress
gives every body the geometric stiffness K_sigma (``fem.geometric_stiffness``), which is kept: the motion has

    M a + C v + (K + K_sigma) u = f

Its start is the equilibrium of the same stiffness under what acts at t = 0, one increment more from u_0, friction
included: the first correction of the equilibrium by its tangent, as in the deflection of a beam-column. A body alone
may have a negative stiffness while the assembly is stable, so that this increment is solved over the whole assembly
(``static_run``).

Where stress counts is measured (``joined.stress_ratios``): K_sigma is left out where no natural frequency of the
clamped assembly changes by more than ``NEGLIGIBLE``. An assembly that would buckle at less than all that acts is
refused.

K_sigma is that of t = 0: loads, bolts and contacts that change it much during the motion do not change it here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..assembly.body import Body, body_sides
from ..assembly.conditions import RigidConditions
from ..assembly.initial_state import InitialState
from ..assembly.models import Kept, load_terms
from ..assembly.prestress import Cuts, Prestress, body_stiffness, cut_stresses, rigid_stiffness
from ..assembly.problem import DiscretisedProblem, settings_of
from ..errors import SceneError, SolverError, listed
from ..fem.elements import rigid_modes
from ..fem.mesh import Array
from ..joined.joined_assembly import JoinedAssembly, pressed_of
from ..joined.stress_ratios import StressRatios, known_ratio, stress_ratios
from ..joined.tied_assembly import TieError
from ..remarks import remarks_of
from ..scene.fields import ALL_OF_IT
from .equilibrium import equilibrium_at_once
from .places_at_rest import least_displaced
from .starts import undisplaced_equilibrium
from .statics import static_problem, static_scene, static_size

NEGLIGIBLE: Final = 0.01
"""Change of a natural frequency below which stress is left out."""
_STOUT: Final = 6.0
"""Strain times square of slenderness over mu: columns that are clamped at one end have less."""
_SURE: Final = 0.75  # of that, with the modes of another run
_NEAR: Final = 2.0  # load factor of buckling below which a linear equilibrium is doubtful
_UNMOVED: Final = 1e-6
"""Of the largest motion of a mode, that of sides which keep touching."""
_FAR: Final = 100.0  # load factor of buckling above which it is not named


def with_prestress(
    problem: DiscretisedProblem, state: InitialState | None, amplitudes: Mapping[str, float]
) -> tuple[DiscretisedProblem, InitialState | None]:
    """The problem with the geometric stiffness of an equilibrium, and that equilibrium with it; both as they are where
    stress does not count, or the scene leaves it out.

    Parameters
    ----------
    state : of ``starts.undisplaced_equilibrium``. amplitudes : at t = 0, of loads that are set from outside.

    Raises
    ------
    SceneError : the state has buckled.
    """
    stressed = stressed_problem(problem, state)
    if state is None or stressed.prestress is None:
        return problem, state
    return stressed, corrected(stressed, state, amplitudes)


def stressed_problem(
    problem: DiscretisedProblem, state: InitialState | None, restricted: bool = False
) -> DiscretisedProblem:
    """``with_prestress`` without the correction of the equilibrium: for modes about it. Refused with a SceneError where
    stress counts and the problem is ``restricted``, as its derivatives are taken without those of the equilibrium."""
    scene = problem.scene
    choice = scene.effects.prestress
    if state is None or choice == "off" or scene.time.quasi_static:
        return problem
    automatic, kept = choice == "automatic", problem.kept
    if automatic and _stout(problem, state):
        return problem
    stiffness = _stiffnesses(problem, state)
    if not stiffness or (automatic and _known_to_be_small(problem, stiffness)):
        return problem
    ratios = _ratios(problem, state, stiffness)
    _refuse_buckled(ratios)
    if kept is not None:
        kept.stress_modes = ratios.shapes
    if automatic and ratios.largest < 2.0 * NEGLIGIBLE:
        return problem
    if restricted:
        raise SceneError.of(
            "derivatives cannot be taken",
            "effects.prestress",
            "from initial values derivatives do not know the geometric stiffness of what acts at t = 0, which changes "
            f"natural frequencies by up to {_change(ratios)}",
            choice,
            "off",
            'set time.start = "static", or effects.prestress = "off" to take the derivatives of the scene without it',
        )
    words = _words(ratios)
    remarks = (*problem.remarks, *remarks_of("prestress", [words]))
    period = ratios.period if ratios.largest >= 2.0 * NEGLIGIBLE else np.inf
    pressure = {name: -traction[:, 0] for name, traction in state.traction.items()}
    prestress = Prestress(stiffness, words, period, _drives(problem, stiffness), pressure)
    of_cuts = _cuts(problem, state)
    stressed = {name: cut.stressed(of_cuts[name]) for name, cut in problem.cuts.items() if name in of_cuts}
    cuts = {**problem.cuts, **stressed}
    return replace(problem, prestress=prestress, cuts=cuts, remarks=remarks).with_classes()


def _drives(problem: DiscretisedProblem, stiffness: Mapping[str, sp.csr_array]) -> dict[str, float]:
    """Largest acceleration over the angle, s-2, that K_sigma gives every body alone in a rigid rotation."""
    drives = {}
    for model in (m for c in problem.classes for m in c.members if m.name in stiffness):
        body = problem.bodies[model.name]
        if body.rigid:
            motions = np.eye(model.n_full)
        else:
            nodes = body.mesh.nodes
            motions = rigid_modes(nodes, nodes.mean(axis=0), body.mesh.size)
        inertia, moment = motions.T @ (model.inertia @ motions), motions.T @ (stiffness[model.name] @ motions)
        drives[model.name] = float(np.abs(la.eigvalsh(0.5 * (moment + moment.T), inertia)).max())
    return drives


def stressed_by_loads(
    problem: DiscretisedProblem, at_rest: DiscretisedProblem, amplitudes: Mapping[str, float], restricted: bool = False
) -> DiscretisedProblem:
    """The problem of a scene that starts from initial values with the geometric stiffness of the equilibrium that what
    acts at t = 0 would have without them, bodies in flight left out; as it is where there is no such equilibrium, where
    its stress does not count, or the scene leaves it out (``restricted``, errors: ``stressed_problem``).

    at_rest : from ``loaded_at_rest``. The motion is about that state and does not begin in it: loads that are there at
    t = 0 act at once.
    """
    try:
        state = undisplaced_equilibrium(at_rest, amplitudes)
        assert state is not None, "something acts"
    except (SceneError, SolverError) as error:
        words = f"what acts at t = 0 has no equilibrium whose stress would have a stiffness: {error}"
        return replace(problem, remarks=(*problem.remarks, *remarks_of("prestress", [words])))
    stressed = stressed_problem(at_rest, state, restricted)
    if stressed.prestress is None:
        return problem
    words = "the motion begins from initial values, and the stress is that of the equilibrium of what acts at t = 0"
    if flying := [name for name in problem.bodies if name not in state.displacement]:
        words += f"; in flight, without stress: {listed(flying)}"
    remarks = (*stressed.remarks, *remarks_of("prestress", [words]))
    return replace(problem, prestress=stressed.prestress, cuts=stressed.cuts, remarks=remarks).with_classes()


def _ratios(problem: DiscretisedProblem, state: InitialState, stiffness: Mapping[str, sp.csr_array]) -> StressRatios:
    """What stress does to the assembly whose closed points are joined; where it buckles into what it touches without
    pressure, whichever the sign of the mode, with these points joined as well."""
    pressed = pressed_of(problem, state)
    joined = JoinedAssembly.of(problem, "sticking", pressed)
    # squares of frequencies
    ratios = stress_ratios(joined, stiffness, 2.0 * NEGLIGIBLE)
    if ratios.load_factor > _NEAR:
        return ratios
    gaps = joined.nearly_closed(pressed, state)
    touching = {name: gap == 0.0 for name, gap in gaps.items() if (gap == 0.0).any()}
    closes = opens = False
    for unit in problem.units:
        if unit.name in touching:
            # of the owner of the points less the other side
            apart = (joined.parts.jump(unit, True) @ ratios.shapes[:, 0])[::3][touching[unit.name]]
            opening = (2 * unit.geometry.owner - 1) * apart
            limit = _UNMOVED * float(np.abs(ratios.shapes[:, 0]).max())
            closes, opens = closes or bool((opening < -limit).any()), opens or bool((opening > limit).any())
    if not (closes and opens):
        return ratios
    both = {name: pressed.get(name, False) | points for name, points in touching.items()}
    return stress_ratios(JoinedAssembly.of(problem, "sticking", pressed | both), stiffness, 2.0 * NEGLIGIBLE)


def _known_to_be_small(problem: DiscretisedProblem, stiffness: Mapping[str, sp.csr_array]) -> bool:
    """Whether stress does not count in the modes of a run of the same study."""
    shapes = None if problem.kept is None else problem.kept.stress_modes
    models = {m.name: m for c in problem.classes for m in c.members}
    if shapes is None or len(shapes) != sum(m.n_full for m in models.values()):
        return False
    ratio = known_ratio(shapes, stiffness, [models[name] for name in problem.bodies])
    return ratio < _SURE * 2.0 * NEGLIGIBLE


def corrected(problem: DiscretisedProblem, state: InitialState, amplitudes: Mapping[str, float]) -> InitialState:
    """The equilibrium with the geometric stiffness of a problem, from that without it.

    Raises
    ------
    SceneError : none is found.
    """
    assert problem.prestress is not None
    scene = static_scene(problem.scene, amplitudes)
    # all of it acts already: one increment
    scene = scene.model_copy(update={"time": scene.time.model_copy(update={"instants": 1})})
    static = static_problem(problem, scene, (), state.left_out, problem.prestress)
    operators: Kept = {}
    try:
        found = equilibrium_at_once(static, state, settings_of(problem.scene), operators)
    except (TieError, SolverError, np.linalg.LinAlgError) as error:
        raise _lost(str(error)) from error
    converged, sentence = found.run.status()
    if not converged:
        raise _lost(sentence)
    after = found.state(amplitudes)
    change = _distance(after, state)
    remarks = [*state.remarks, *after.remarks]
    words = f"{state.message}; with the stiffness of its stress it moves by {100 * change:.2g} %"
    present = {unit.name for unit in static.units}
    others = {name: traction for name, traction in state.traction.items() if name not in present}
    after = replace(
        after,
        traction={**after.traction, **others},
        bolts=state.bolts,
        message=words,
        remarks=tuple(dict.fromkeys(remarks)),
        left_out=state.left_out,
    )
    return least_displaced(problem, after, static_size(problem, amplitudes))


def _distance(first: InitialState, second: InitialState) -> float:
    """Largest difference of the displacements of two states, over the largest displacement."""
    apart, largest = 0.0, float(np.finfo(float).tiny)
    for name, moved in second.displacement.items():
        apart = max(apart, float(np.abs(first.displacement[name] - moved).max(initial=0.0)))
        largest = max(largest, float(np.abs(moved).max(initial=0.0)))
    return apart / largest


def _stiffnesses(problem: DiscretisedProblem, state: InitialState) -> dict[str, sp.csr_array]:
    """K_sigma of every body that the state stresses, by name."""
    matrices: dict[str, sp.csr_array] = {}
    for name, body in problem.bodies.items():
        if name not in state.displacement:
            continue
        matrix: sp.csr_array | None
        if body.rigid:
            matrix = _of_rigid(problem, state, body)
        else:
            opened = problem.opened(name, state.bolts.shortening)
            matrix = body_stiffness(body, state.displacement[name], _unstrained(problem, body), opened)
        if matrix is not None and matrix.count_nonzero():
            matrices[name] = matrix
    return matrices


def _cuts(problem: DiscretisedProblem, state: InitialState) -> Cuts:
    """What K_sigma adds to the cuts of bolts, by bolt."""
    cuts: Cuts = {}
    for name, body in problem.bodies.items():
        opened = problem.opened(name, state.bolts.shortening) if name in state.displacement else None
        if opened is not None and not body.rigid:
            cuts |= cut_stresses(body, state.displacement[name], _unstrained(problem, body), opened)
    return cuts


def _unstrained(problem: DiscretisedProblem, body: Body) -> Array:
    """Stress (n_cell or 1, 6), Pa, of a body at t = 0 that its displacements do not make."""
    find = problem.unstrained(body)
    if find is None:
        return np.zeros((1, 6))
    return np.asarray(find(np.zeros(1))[0])


def _of_rigid(problem: DiscretisedProblem, state: InitialState, body: Body) -> sp.csr_array | None:
    """K_sigma of a rigid body that nothing holds but interfaces; None of one with supports, whose forces have no known
    places."""
    held = problem.conditions[body.name]
    if not isinstance(held, RigidConditions) or held.expansion.shape[1] < 6:
        return None
    centre, length = held.body.centre, held.body.length
    points, forces = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for i, side, name in body_sides(problem.units):
        unit = problem.units[i]
        traction = state.traction.get(unit.name)
        if name != body.name or traction is None:
            continue
        sign = 1.0 - 2.0 * side
        local = np.zeros((len(traction), 3))
        local[:, : traction.shape[1]] = sign * traction * unit.geometry.areas[:, None]
        points.append(unit.geometry.points - centre)
        forces.append(np.einsum("pc,pcj->pj", local, unit.geometry.frames))
    at_start = {name: float(law.sample(np.zeros(1))[0]) for name, law in problem.scene.force_laws.items()}
    at_start |= state.amplitudes
    for load in load_terms(problem.scene, body.name, body, None, straining=False):
        # weight acts through the centre
        if load.name in problem.scene.loads:
            points.append(body.mesh.nodes - centre)
            forces.append(at_start[load.name] * load.pattern.reshape(-1, 3))
    turns = held.basis[3:] / length
    return rigid_stiffness(np.concatenate(points), np.concatenate(forces), turns)


def _stout(problem: DiscretisedProblem, state: InitialState) -> bool:
    """Whether stress cannot count, as for all bodies strain x (length of the assembly / thickness)^2 is too small."""
    nodes = np.concatenate([body.mesh.nodes for body in problem.bodies.values()])
    size = float(np.linalg.norm(np.ptp(nodes, axis=0)))
    for name, body in problem.bodies.items():
        if name not in state.displacement:
            continue
        # a rigid body turns on what it touches
        if body.rigid:
            return False
        opened = problem.opened(name, state.bolts.shortening)
        nodal = state.displacement[name].reshape(-1, 3)
        recovery = body.shape.recovery if opened is None else opened.recovery(body.shape)
        stress = recovery.nodal_stress(nodal[None])[0]
        largest = float(np.abs(stress).max() + np.abs(_unstrained(problem, body)).max())
        strain = largest / body.shape.elasticity.young_moduli[0]
        if _STOUT * strain * (size / _thickness(body)) ** 2 > 2.0 * NEGLIGIBLE:
            return False
    return True


def _thickness(body: Body) -> float:
    """Twice the volume over the surface, m: that of a plate."""
    return 2.0 * float(body.shape.elements.volume.sum()) / float(body.face(ALL_OF_IT).areas.sum())


def _refuse_buckled(ratios: StressRatios) -> None:
    """Raises SceneError where the assembly buckles at less than what acts."""
    factor = ratios.load_factor
    if factor <= 1.0:
        raise SceneError.of(
            "the scene cannot be built",
            "time.start",
            f"the state at t = 0 does not exist: substructure {ratios.moves_most} buckles before all that acts at "
            "t = 0 does, bolts and changes of temperature among it",
            f"load factor of buckling {factor:.3g}",
            "a load factor above 1",
            "reduce the loads, preloads or temperatures, hold the slender parts, or see what is left without this "
            'effect with effects.prestress = "off"',
        )


def _change(ratios: StressRatios) -> str:
    """Largest change of the frequencies, in words."""
    ends = [np.sqrt(max(1.0 + mu, 0.0)) - 1.0 for mu in (ratios.lowest, ratios.highest)]
    largest = max(ends, key=abs)
    return f"{100 * largest:+.3g} %"


def _words(ratios: StressRatios) -> str:
    """What the stress of t = 0 does."""
    factor = ratios.load_factor
    if ratios.largest < 2.0 * NEGLIGIBLE:
        return "effects.prestress gives the stress of t = 0 its stiffness; it hardly changes natural frequencies"
    words = (
        f"the stress of t = 0 changes natural frequencies by up to {_change(ratios)}, and its stiffness is part of this"
    )
    if factor > _FAR:
        return words
    words += f"; it buckles at {factor:.3g} times what acts"
    if factor > _NEAR:
        return words
    return (
        f"{words}, near which a linear start is doubtful: reduce the loads or temperatures, or hold the slender parts"
    )


def _lost(why: str) -> SceneError:
    return SceneError.of(
        "the scene cannot be built",
        "time.start",
        f"the equilibrium of t = 0 is lost with the stiffness of its stress: {why}",
        "static",
        "a start that is stable",
        'hold the parts that rock or buckle, or set effects.prestress = "off"',
    )
