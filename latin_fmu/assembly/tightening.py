"""Tightening of bolts before t = 0: force control, order by order, friction included.

The bolts of each order are tightened together, in increments, from the tensions that they have by then to their forces
(or to their shortenings); the shortenings of all others are kept, so that their tensions follow. Every order is a
static problem of its own, which starts from the equilibrium of the order before. The shortening of a bolt that is being
tightened is eliminated (``bolts``), so that the tension is met exactly, whatever the contacts do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..errors import Problems, SceneError
from ..scene.units import UnitSystem
from .bolts import BoltCut, check_yield
from .initial_state import InitialState, TightBolts
from .kept_operators import Kept
from .problem import DiscretisedProblem, settings_of
from .statics import equilibrium, state_at_end, static_problem, static_scene

_Ramps = dict[str, tuple[float, float]]


def tightened(whole: DiscretisedProblem, kept: Kept) -> InitialState:
    """The equilibrium with all bolts tight and no other load acting.

    Parameters
    ----------
    kept : as for ``DiscretisedProblem.build``.

    Raises
    ------
    SceneError : no equilibrium with such a force was found, or the mean stress of a bolt is above the yield stress.
    """
    scene, cuts = static_scene(whole.scene, {}, loaded=False), whole.cuts
    state: InitialState | None = None
    bolts = TightBolts(dict.fromkeys(cuts, 0.0))
    increments, iterations, remarks = 0, 0, dict[str, None]()
    for order in sorted({cut.table.order for cut in cuts.values()}):
        group = [cut for cut in cuts.values() if cut.table.order == order]
        ramps = _ramps(group, bolts, _tensions(cuts, bolts.shortening, state))
        free = [cut.name for cut in group if cut.table.force is not None]
        problem = replace(static_problem(whole, scene, free), ramps=ramps)
        ready, run, tolerance = equilibrium(problem, state, settings_of(whole.scene), kept)
        converged, sentence = run.status()
        if not converged:
            share = sum(window.converged for window in run.windows) / scene.time.n_step
            raise _not_tight(group, ramps, share, sentence, scene.unit_system)
        increments += len(run.windows)
        iterations += sum(window.iterations for window in run.windows)
        state = state_at_end(ready, run, {}, tolerance)
        remarks |= dict.fromkeys(state.remarks)
        bolts = _locked(bolts, order, group, cuts, state)
    assert state is not None, "a scene without bolts"
    _check_yield(whole, bolts)
    words = f"{len(cuts)} bolt(s) tightened in {len(bolts.orders)} step(s)"
    words += f", {increments} increment(s), {iterations} iterations"
    return replace(state, bolts=bolts, message=words, remarks=tuple(remarks))


def _ramps(group: Sequence[BoltCut], bolts: TightBolts, tensions: Mapping[str, float]) -> _Ramps:
    """First and last amplitude of the load of each bolt: shortening, or tension of those that have a force to reach."""
    ramps = {name: (kept, kept) for name, kept in bolts.shortening.items()}
    for cut in group:
        force, shortening = cut.table.force, cut.table.shortening
        if force is not None:
            ramps[cut.name] = tensions[cut.name], force
        elif shortening is not None:
            ramps[cut.name] = 0.0, shortening
    return ramps


def _tensions(
    cuts: Mapping[str, BoltCut], shortening: Mapping[str, float], state: InitialState | None
) -> dict[str, float]:
    """Tension of each bolt in a state, N."""
    if state is None:
        return dict.fromkeys(cuts, 0.0)
    return {n: cut.force(shortening[n], state.displacement[cut.table.substructure]) for n, cut in cuts.items()}


def _locked(
    bolts: TightBolts, order: int, group: Sequence[BoltCut], cuts: Mapping[str, BoltCut], state: InitialState
) -> TightBolts:
    """The bolts with the shortenings that those of an order have in a state, and the tensions of all."""
    shortening = dict(bolts.shortening)
    for cut in group:
        force, given = cut.table.force, cut.table.shortening
        if force is not None:
            shortening[cut.name] = cut.shortening(force, state.displacement[cut.table.substructure])
        elif given is not None:
            shortening[cut.name] = given
    now = _tensions(cuts, shortening, state)
    return TightBolts(
        shortening, (*bolts.orders, order), {name: (*bolts.forces.get(name, ()), force) for name, force in now.items()}
    )


def _not_tight(group: Sequence[BoltCut], ramps: _Ramps, share: float, why: str, units: UnitSystem) -> SceneError:
    """The error of bolts that reached only a share of their force, or shortening."""
    reached = []
    for cut in group:
        first, last = ramps[cut.name]
        unit = units["m" if cut.table.force is None else "N"]
        reached.append(f"{cut.name} {first + share * (last - first):.6g} of {last:.6g} {unit}")
    return SceneError.of(
        "the scene cannot be built",
        f"bolt.{group[0].name}",
        f"bolts of order {group[0].table.order} cannot be tightened, no equilibrium was found; reached: "
        f"{', '.join(reached)}. {why[:1].upper()}{why[1:]}",
        None,
        "closed faces under head and nut and between the parts, which can hold the force",
        "check the gaps on the way of the force and what keeps the parts from sliding, or raise time.start.increments",
    )


def _check_yield(whole: DiscretisedProblem, bolts: TightBolts) -> None:
    """Refuse bolts whose mean stress was above the yield stress while they were tightened. Raises SceneError."""
    problems = Problems()
    for name, cut in whole.cuts.items():
        check_yield(name, max(bolts.forces[name]), cut, whole.bodies[cut.table.substructure], problems)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
