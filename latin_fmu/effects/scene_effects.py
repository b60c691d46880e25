"""Effects of a scene: on or off, the keys that decide, and the unknowns, memory and CPU time of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..assembly.problem import DiscretisedProblem
from ..building import discretise
from ..errors import InputError
from ..interface.laws import FRICTION, bonds
from ..latin.assembly import InterfaceUnit
from ..reader import scene_from_dict
from ..scene.boundaries import Absorbing, Driven
from ..scene.fields import split_face
from ..scene.materials import DAMPING_KEYS
from ..scene.readable_numbers import readable
from ..scene.schema import Scene, with_settings
from ..scene.settings import StaticStart
from .cost import CONTACT, Prediction, RunSize, expected_iterations, march_counts, numbers, seconds


@dataclass(frozen=True)
class Effect:
    """An effect as it stands in one scene.

    Attributes
    ----------
    name : of the effect. on : whether the scene calls for it.
    why : keys of the scene that decide, e.g. ``interface.crush.behaviour``; a key that is not written
        stands for its default.
    reason : the same in words. switch : what would turn it the other way.
    kernels : functions that are called because of it. cost : predicted CPU seconds per instant.
    unknowns : unknowns it adds (dofs of substructures, or interface unknowns), over all substructures or interfaces.
    memory : bytes it holds during a run or leaves in the results.
    """

    name: str
    on: bool
    why: tuple[str, ...]
    reason: str
    switch: str
    kernels: tuple[str, ...] = ()
    cost: float = 0.0
    unknowns: int = 0
    memory: int = 0

    def report(self, instant: float) -> dict[str, Any]:
        """Plain data; ``instant``: predicted CPU time of one instant, s."""
        return {
            "name": self.name,
            "on": self.on,
            "why": list(self.why),
            "reason": self.reason,
            "switch": self.switch,
            "unknowns": self.unknowns,
            "kernels": list(self.kernels),
            "memory_bytes": self.memory,
            "share_of_time": round(self.cost / instant, 4) if instant > 0 else 0.0,
        }


Units = list[InterfaceUnit]


def _off(name: str, why: Sequence[str], reason: str, switch: str) -> Effect:
    return Effect(name, False, tuple(why), reason, switch)


def scene_with(scene: Scene, edit: Callable[[dict[str, Any]], dict[str, Any] | None]) -> Scene:
    """The scene whose tables are edited in place, or are those that ``edit`` returns.

    Raises
    ------
    SceneError : it is none.
    """
    tables = scene.tables()
    if "scheme" not in scene.time.model_fields_set:  # a default that may depend on the rest
        tables["time"].pop("scheme", None)
    result = edit(tables)
    return scene_from_dict(tables if result is None else result, scene.base_dir)


def changed(p: Prediction, settings: Sequence[str]) -> DiscretisedProblem | None:
    """The scene with other settings (as for ``--set``), discretised; None where it is refused."""
    try:
        return discretise(scene_with(p.scene, lambda tables: with_settings(tables, settings)))
    except InputError:
        return None


def saved(p: Prediction, run: RunSize) -> float:
    """CPU seconds per instant that a run takes less than the predicted one."""
    return max(0.0, p.march - seconds(march_counts(run))) / p.run.n_instant


def without(p: Prediction, units: Units) -> RunSize:
    """The run without some of its interfaces."""
    rest = [u for u in p.discretised.units if u not in units]
    fewer = _fewer(p.run, sum(2 * u.geometry.n_point * u.behaviour.n_component for u in units))
    return replace(
        fewer, iterations=expected_iterations(p.scene, rest, p.run.effort), at_once=p.run.at_once and bool(rest)
    )


def without_friction(p: Prediction, units: Units) -> RunSize:
    """The run without the tangential unknowns of some of its interfaces."""
    rest = [u for u in p.discretised.units if u not in units]
    fewer = _fewer(p.run, sum(2 * u.geometry.n_point * (u.behaviour.n_component - 1) for u in units))
    iterations = max(p.run.effort * CONTACT, expected_iterations(p.scene, rest, p.run.effort))
    # taking tangential unknowns away never costs iterations
    return replace(fewer, iterations=min(iterations, p.run.iterations))


def _fewer(run: RunSize, gone: int) -> RunSize:
    """A run with ``gone`` interface unknowns less."""
    # unknowns of all classes shrink alike: which class they belong to is not looked up
    share = 1.0 - gone / max(run.n_flat, 1)
    sizes = dict.fromkeys(("channels", "interface", "swept", "product", "columns"), share)
    return replace(run.scaled(**sizes), n_flat=round(share * run.n_flat))


# -- inside substructures ---------------------------------------------------------------------------------------------
def inertia(p: Prediction) -> Effect:
    """Mass times acceleration."""
    if p.run.static:
        return _off("inertia", ["time.quasi_static"], "the scene is quasi-static", "time.quasi_static = false")
    reason = f"motion is integrated by the scheme {p.discretised.scheme_in_words}"
    switch = "time.quasi_static = true (loads slow against the waves)"
    cost, kernels = saved(p, p.run.scaled(mass=0.0)), ("mass product",)
    # an entry is a number of 8 bytes and an index of 4
    return Effect("inertia", True, ("time.scheme",), reason, switch, kernels, cost, memory=12 * p.total("mass"))


def elasticity(p: Prediction) -> Effect:
    """Deformable substructures: factors and stiffness."""
    name, keys = "elastic bodies", [f"substructure.{n}" for n, b in p.discretised.bodies.items() if not b.rigid]
    if not keys:
        off = "every substructure is rigid"
        return _off(name, ["substructure.*.rigid"], off, "rigid = false on a substructure")
    sizes = [c.size for c in p.run.classes if not c.rigid]
    reason = f"{len(keys)} deformable substructure(s) in {len(sizes)} class(es) of identical ones"
    kernels = "factorisation", "half solves", "stiffness product"
    still = p.run.static or p.scene.time.start.type == "static"
    if still:
        switch = "none: an equilibrium needs elastic bodies"
    else:
        switch = "rigid = true for bodies that do not deform"
    cost = saved(p, p.run.scaled(stiffness=0.0, factor=0.0))
    unknowns = sum(s.members * s.unknowns for s in sizes)
    memory = int(sum(8 * (s.factor + s.interface**2) + 12 * s.stiffness for s in sizes))
    return Effect(name, True, tuple(keys), reason, switch, kernels, cost, unknowns, memory)


def rigidity(p: Prediction) -> Effect:
    """Substructures that cannot deform."""
    name, rigid = "rigid bodies", [n for n, b in p.discretised.bodies.items() if b.rigid]
    if not rigid:
        return _off(name, ["substructure.*.rigid"], "no substructure is rigid", "rigid = true on a substructure")
    why = tuple(f"substructure.{n}.rigid" for n in rigid)
    reason = f"{len(rigid)} substructure(s) of six unknowns at most"
    cost = saved(p, replace(p.run, classes=tuple(c for c in p.run.classes if not c.rigid)))
    unknowns = sum(c.size.members * c.size.unknowns for c in p.run.classes if c.rigid)
    return Effect(name, True, why, reason, "rigid = false", ("rigid march",), cost, unknowns)


def damping(p: Prediction) -> Effect:
    """Damping of materials and modes, whichever keys give it."""
    used = {b.description.material for b in p.discretised.bodies.values()}
    materials = {n: m for n, m in p.scene.material.items() if n in used}
    keys = tuple(f"material.{n}.{key}" for n, m in materials.items() for key in m.damping_keys)
    keys += tuple(f"substructure.{n}.modal_damping" for n, s in p.scene.substructure.items() if s.modal_damping)
    if not keys:
        why = [f"material.*.{key}" for key in DAMPING_KEYS]
        return _off("damping", why, "no material has any", "rayleigh_mass or rayleigh_stiffness > 0")
    reason, memory = f"damping by {len(keys)} key(s)", p.total("damping")
    # of the reduced propagator they are a few numbers
    modal = [c.size for c in p.run.classes if c.size.modal and p.run.propagator.kind != "reduced"]
    if modal:
        vectors = readable(sum(24.0 * s.modal * s.unknowns for s in modal), "B", 3)
        reason += f"; {sum(s.modal * s.members for s in modal)} modes in modal damping, {vectors} of vectors"
        reason += " that every instant reads"
    layers = sum(
        len(c.members) * (m.expansion.T @ m.landing @ m.expansion).nnz
        for c in p.discretised.classes
        # landing dashpots are part of the damping matrix, and go on without damping of materials
        if (m := c.members[0]).landing is not None
    )
    cost = saved(p, p.run.scaled(damping=layers / memory if memory else 0.0, modal=0.0))  # contact layers stay
    memory = 12 * memory + sum(24 * s.modal * s.unknowns for s in modal)
    return Effect("damping", True, keys, reason, "set them to 0", ("damping product",), cost, memory=memory)


def absorbing_ends(p: Prediction) -> Effect:
    """Dashpots that let waves out."""
    name = "absorbing ends"
    ends = {f"boundary.{n}": b.face for n, b in p.scene.boundary.items() if isinstance(b, Absorbing)}
    ends |= {f"port.{n}": port.face for n, port in p.scene.port.items() if port.causality == "wave"}
    if not ends:
        return _off(name, ["boundary.*.type"], "no boundary absorbs", 'a boundary with type = "absorbing"')
    faces = [split_face(face) for face in ends.values()]
    nodes = sum(len(p.discretised.bodies[body].face(face).nodes) for body, face in faces)
    why, reason = tuple(ends), f"dashpots on {nodes} nodes"
    cost, kernels = seconds(numbers(sparse=9.0 * nodes)), ("damping product",)  # 3 x 3 blocks
    return Effect(name, True, why, reason, "remove the boundary or port", kernels, cost, memory=108 * nodes)


def body_force(p: Prediction) -> Effect:
    """Forces per volume and gravity; without them the accelerations at t = 0 need no solution."""
    keys = [load.key for load in p.scene.body_loads if not load.kind.strains]
    none = "substructure.*.body_force"
    reason = "nodal forces times their laws"
    switch = "a body_force, [gravity] or a [rotation.NAME]"
    effect = _driven(p, "body force", keys, none, reason, switch)
    if keys:
        return replace(effect, cost=saved(p, replace(p.run, unbalanced=False)))
    return effect


def loads(p: Prediction) -> Effect:
    """Loads on the surface."""
    keys = [f"load.{n}" for n in p.scene.load] + [f"port.{n}" for n, q in p.scene.port.items() if q.loads(n)]
    return _driven(p, "surface loads", keys, "load", "nodal forces times their laws", "a [load.NAME]")


def temperature(p: Prediction) -> Effect:
    """Changes of temperature."""
    keys = [load.key for load in p.scene.body_loads if load.kind.strains]
    reason = "nodal forces of hindered expansion, one vector for each body, times their laws"
    return _driven(p, "temperature", keys, "temperature", reason, "a [temperature.NAME]")


def bolts(p: Prediction) -> Effect:
    """Bolts: shortened shanks, tightened before t = 0."""
    keys = [f"bolt.{n}" for n in p.scene.bolt]
    reason = "shanks shortened before t = 0, nodal forces that keep them so"
    return _driven(p, "bolts", keys, "bolt", reason, "a [bolt.NAME]")


def initial_motion(p: Prediction) -> Effect:
    """Initial velocities, spins and displacements."""
    keys = tuple(f"substructure.{n}.{k}" for n, s in p.scene.substructure.items() for k in s.initial_keys)
    if p.scene.thrown:
        keys += ("motion.velocity",)
    if not keys:
        switch = "initial_velocity, initial_spin, initial_displacement or [motion]"
        return _off("initial motion", ["substructure.*.initial_velocity"], "all bodies start at rest", switch)
    return Effect("initial motion", True, keys, "initial values that are not zero", "set them to zero")


def static_start(p: Prediction) -> Effect:
    """A static equilibrium before the motion."""
    name = "static start"
    start = p.scene.time.start
    why = ("time.start",)
    if not isinstance(start, StaticStart):
        switch = 'time.start = "static" (bolts, weight, dead loads first)'
        return _off(name, why, "bodies start as given", switch)
    reason = f"an equilibrium in {start.increments} increment(s) before the first instant"
    cost, kernels = saved(p, replace(p.run, increments=0)), ("static factorisation", "static solution")
    return Effect(name, True, why, reason, 'time.start = "given"', kernels, cost, memory=8 * p.total("unknowns"))


def prestress(p: Prediction) -> Effect:
    """Geometric stiffness of the stress of t = 0."""
    from ..statics.loads_at_start import loaded_at_rest

    name, why, choice = "stiffness of stress", ("effects.prestress",), p.scene.effects.prestress
    if choice == "off":
        return _off(name, why, "the scene leaves it out", 'effects.prestress = "automatic"')
    if p.run.static or not (isinstance(p.scene.time.start, StaticStart) or loaded_at_rest(p.discretised, {})):
        words = "no motion about a stressed state"
        return _off(name, ("time.start",), words, 'time.start = "static"')
    reason = {
        "automatic": "taken if the stress of t = 0 changes a natural frequency by more than 1 %, which the start shows",
        "on": "taken whatever it changes",
    }[choice]
    # in the matrices of the bodies: nothing is added per instant
    return Effect(name, True, why, reason, 'effects.prestress = "off"', ("static factorisation", "static solution"))


def prescribed_motion(p: Prediction) -> Effect:
    """Faces moved from outside."""
    keys = [f"boundary.{n}" for n, b in p.scene.boundary.items() if isinstance(b, Driven)]
    keys += [f"port.{n}" for n, port in p.scene.port.items() if port.causality == "motion_in"]
    keys += [f"interface.{n}.ground_velocity" for n, i in p.scene.interface.items() if i.ground_velocity]
    reason = "motions that follow the recursion of the time scheme"
    switch = 'type = "velocity", "displacement" or "acceleration", ground_velocity'
    return _driven(p, "prescribed motion", keys, "boundary.*.type", reason, switch)


def _driven(p: Prediction, name: str, keys: Sequence[str], none: str, reason: str, switch: str) -> Effect:
    if not keys:
        return _off(name, [none], "the scene has none", switch)
    return Effect(name, True, tuple(keys), reason, "remove it", ("forcing",), memory=8 * p.total("unknowns"))


# -- at interfaces ----------------------------------------------------------------------------------------------------
def contact(p: Prediction) -> Effect:
    """Interfaces that may open: their normal unknowns and the iteration on them."""
    units = [u for u in p.discretised.units if u.behaviour.opens]
    points = sum(u.geometry.n_point for u in units)
    words = f"{points} points may open", "an interface that may open", 'behaviour = "perfect" (no opening)'
    return _interface(p, "unilateral contact", units, "behaviour", 2 * points, "local stage, normal part", words)


def friction(p: Prediction) -> Effect:
    """Coulomb friction: the tangential unknowns of contacts."""
    units = [u for u in p.discretised.units if u.behaviour.opens and u.behaviour.n_component > 1]
    n = sum(4 * u.geometry.n_point for u in units)
    words = "tangential unknowns where mu > 0, or where nothing slips", f"{FRICTION} > 0", f"{FRICTION} = 0"
    return _interface(p, "friction", units, FRICTION, n, "local stage, cone projection", words)


def gap(p: Prediction) -> Effect:
    """Contacts that are open at the start."""
    units = [u for u in p.discretised.units if u.behaviour.opens and bool((u.geometry.gap > 0).any())]
    if not units:
        touches = "every contact touches at the start"
        return _off("initial gap", ["interface.*.gap"], touches, "gap > 0, or meshes apart")
    reason = (
        f"open at the start, up to {max(float(u.geometry.gap.max()) for u in units):.4g} {p.scene.unit_system['m']}"
    )
    formed = tuple(f"interface.{u.name}.form" for u in units if p.discretised.scene.joints[u.name].form is not None)
    if formed:
        return Effect("initial gap", True, formed, reason, "faces without a form")
    keys = tuple(f"interface.{u.name}.gap" for u in units)
    # lazily: each way builds the whole scene, the first that is accepted ends the search
    ways = (value for value in ("0", '"closed"') if changed(p, [f"{key}={value}" for key in keys]) is not None)
    switch = next((f"gap = {value}" for value in ways), "meshes that touch")
    return Effect("initial gap", True, keys, reason, switch)


def bond(p: Prediction) -> Effect:
    """Interfaces that are perfect connections."""
    units = [u for u in p.discretised.units if bonds(u.behaviour)]
    n = sum(6 * u.geometry.n_point for u in units)
    words = "faces with one velocity", 'behaviour = "perfect"', "one mesh for both bodies"
    return _interface(p, "perfect bond", units, "behaviour", n, "local stage, bonds", words)


def layers(p: Prediction) -> Effect:
    """Elastic layers, soft contacts and viscous joints."""
    units = [u for u in p.discretised.units if u.behaviour.compliant]
    n = sum(2 * u.geometry.n_point * u.behaviour.n_component for u in units if not u.behaviour.opens)
    reason = "tractions that follow the jump of displacement or velocity"
    words = reason, 'behaviour = "elastic_layer", ...', 'behaviour = "perfect"'
    return _interface(p, "layers and joints", units, "behaviour", n, "local stage, layers", words)


def preload(p: Prediction) -> Effect:
    """Pressure at the start."""
    units, kinds = [u for u in p.discretised.units if u.preload > 0], ("preload", "preload_force", "interference")
    if not units:
        switch = "preload, preload_force or interference > 0"
        return _off("preload", ["interface.*.preload"], "no interface is pressed at the start", switch)
    interfaces = p.scene.interface
    keys = tuple(f"interface.{u.name}.{k}" for u in units for k in kinds if getattr(interfaces[u.name], k) > 0)
    reason = f"up to {max(u.preload for u in units):.4g} {p.scene.unit_system['Pa']} at the start"
    return Effect("preload", True, keys, reason, "set it to 0", ("forcing",))


def _interface(
    p: Prediction, name: str, units: Units, key: str, n: int, kernel: str, words: tuple[str, str, str]
) -> Effect:
    """An effect that adds ``n`` interface unknowns: its share of the iteration goes with them; ``words``: the reason,
    what turns it on, what turns it off."""
    reason, on, off = words
    if not units:
        return _off(name, [f"interface.*.{key}"], "no interface has it", on)
    # products of the iteration are with condensed matrices, whose size is the square of the unknowns
    share = 1 - (1 - n / max(p.run.n_flat, 1)) ** 2
    condensed = share * sum(24 * c.size.channels**2 for c in p.run.classes)
    memory = int(8 * n * (2 * p.run.n_instant + 30) + condensed)
    why = tuple(dict.fromkeys(u.attached or f"interface.{u.name}.{key}" for u in units))
    return Effect(name, True, why, reason, off, (kernel,), _cost(p, units, n), n, memory)


def _cost(p: Prediction, units: Units, n: int) -> float:
    """CPU seconds per instant of ``n`` unknowns of these interfaces; a contact with friction is split into the cost
    of its tangential unknowns and the rest."""
    if not n:
        return 0.0
    everything = sum(2 * u.geometry.n_point * u.behaviour.n_component for u in units)
    whole = saved(p, without(p, units))
    if n == everything:
        return whole
    rubbing = saved(p, without_friction(p, [u for u in units if u.behaviour.n_component > 1]))
    tangential = sum(2 * u.geometry.n_point * (u.behaviour.n_component - 1) for u in units)
    if n == tangential:
        return rubbing
    return max(0.0, whole - rubbing)


# -- stored quantities ------------------------------------------------------------------------------------------------
def fields(p: Prediction) -> Effect:
    """Displacement and velocity histories of the nodes."""
    name, output = "interior history", p.scene.output
    keys = [f"output.{key}" for key in ("fields", "strain", "nodal_stress") if getattr(output, key)]
    if not keys:
        return _off(name, ["output.fields"], "not requested", "output.fields = true")
    nodes, stored = sum(c.size.members * c.nodes for c in p.run.classes), _stored(p)
    reason = f"displacements and velocities of {nodes} nodes at {stored} instants"
    switch, cost = ", ".join(f"{key} = false" for key in keys), saved(p, replace(p.run, fields=False))
    why, kernels = (*keys, "output.every"), ("field storage",)
    return Effect(name, True, why, reason, switch, kernels, cost, memory=48 * nodes * stored)  # two vectors


def stress(p: Prediction) -> Effect:
    """Mean stress of the elements."""
    if not p.scene.output.stress:
        return _off("stress", ["output.stress"], "not requested", "output.stress = true")
    cells, stored = sum(c.size.members * c.cells for c in p.run.classes if not c.rigid), _stored(p)
    why, reason = ("output.stress", "output.every"), f"{cells} elements at {stored} instants"
    cost, memory = saved(p, replace(p.run, stress=False)), 48 * cells * stored  # six components
    return Effect("stress", True, why, reason, "output.stress = false", ("stress recovery",), cost, memory=memory)


def energy(p: Prediction) -> Effect:
    """Energy balance at every instant."""
    name, why = "energy balance", ("output.energy",)
    if not p.scene.output.energy:
        return _off(name, why, "not requested", "output.energy = true")
    reason, cost = "every term from the fields of every instant", saved(p, replace(p.run, energy=False))
    # seven terms, of every substructure and of the assembly
    memory = 8 * (p.run.n_instant + 1) * 7 * (1 + sum(c.size.members for c in p.run.classes))
    return Effect(name, True, why, reason, "output.energy = false", ("energy meter",), cost, memory=memory)


def _stored(p: Prediction) -> int:
    """Number of instants at which fields are kept."""
    # t = 0 is one of them
    return p.run.n_instant // p.run.every + 1


EFFECTS: tuple[Callable[[Prediction], Effect], ...] = (
    inertia,
    elasticity,
    rigidity,
    damping,
    absorbing_ends,
    body_force,
    loads,
    temperature,
    bolts,
    initial_motion,
    static_start,
    prestress,
    prescribed_motion,
    contact,
    friction,
    gap,
    bond,
    layers,
    preload,
    fields,
    stress,
    energy,
)
"""All effects, in the order of the report. A new one is one function and one line here."""
