"""Effects inside substructures: inertia, elasticity, damping, what drives and holds them."""

from __future__ import annotations

from dataclasses import replace

from ..propagator.seconds import SECONDS
from ..scene.boundaries import Absorbing, PrescribedDisplacement, PrescribedVelocity
from ..scene.time_settings import StaticStart
from .effect import Effect
from .sizes import Sizes


def inertia(sizes: Sizes) -> Effect:
    """Mass times acceleration."""
    off = bool(getattr(sizes.scene.time, "quasi_static", False))
    entries = sum(c.n_member * c.size.mass_entries for c in sizes.classes)
    if off:
        return Effect(
            "inertia",
            False,
            ("time.quasi_static",),
            "a sequence of equilibria is asked for",
            "time.quasi_static = false",
        )
    return Effect(
        "inertia",
        True,
        ("time.scheme",),
        f"motion is integrated by the scheme {sizes.scene.time.scheme.type}",
        "time.quasi_static = true (loads slow against the waves)",
        kernels=("mass product",),
        memory=12 * entries,
        cost=sizes.saved(sizes.run.resized(mass_entries=0.0)),
    )


def elasticity(sizes: Sizes) -> Effect:
    """Deformable substructures."""
    elastic = [n for n, b in sizes.discretised.bodies.items() if not b.rigid]
    classes = [c for c in sizes.classes if not c.rigid]
    if not elastic:
        return Effect(
            "elastic bodies",
            False,
            ("substructure.*.rigid",),
            "every substructure is rigid",
            "rigid = false on a substructure",
        )
    reason = f"{len(elastic)} deformable substructure(s) in {len(classes)} class(es) of identical ones"
    return Effect(
        "elastic bodies",
        True,
        tuple(f"substructure.{n}" for n in elastic),
        reason,
        "rigid = true on bodies that only move",
        unknowns=sum(c.n_member * c.size.unknowns for c in classes),
        kernels=("factorisation", "half solves", "stiffness product"),
        memory=int(sum(8 * (c.size.factor_entries + c.size.interface**2) + 12 * c.size.entries for c in classes)),
        cost=sizes.saved(sizes.run.resized(entries=0.0, factor_entries=0.0)),
    )


def rigidity(sizes: Sizes) -> Effect:
    """Undeformable substructures."""
    rigid = [n for n, b in sizes.discretised.bodies.items() if b.rigid]
    classes = [c for c in sizes.classes if c.rigid]
    if not rigid:
        return Effect(
            "rigid bodies",
            False,
            ("substructure.*.rigid",),
            "no substructure is rigid",
            "rigid = true on a substructure",
        )
    return Effect(
        "rigid bodies",
        True,
        tuple(f"substructure.{n}.rigid" for n in rigid),
        f"{len(rigid)} substructure(s) of six unknowns at most",
        "rigid = false",
        unknowns=sum(c.n_member * c.size.unknowns for c in classes),
        kernels=("rigid march",),
        cost=sizes.saved(replace(sizes.run, classes=tuple(c for c in sizes.classes if not c.rigid))),
    )


def damping(sizes: Sizes) -> Effect:
    """Rayleigh damping."""
    materials = {b.description.material for b in sizes.discretised.bodies.values()}
    keys = tuple(
        f"material.{n}.{key}"
        for n, m in sizes.scene.material.items()
        if n in materials
        for key in ("rayleigh_mass", "rayleigh_stiffness")
        if getattr(m, key) > 0
    )
    entries = sum(c.n_member * c.size.damping_entries for c in sizes.classes)
    if not keys:
        return Effect(
            "damping",
            False,
            ("material.*.rayleigh_mass", "material.*.rayleigh_stiffness"),
            "no material has any",
            "rayleigh_mass or rayleigh_stiffness > 0",
        )
    return Effect(
        "damping",
        True,
        keys,
        f"{len(keys)} Rayleigh coefficient(s)",
        "set them to 0",
        kernels=("damping product",),
        memory=12 * entries,
        cost=sizes.saved(sizes.run.resized(damping_entries=0.0)),
    )


def absorbing_ends(sizes: Sizes) -> Effect:
    """Dashpots that let waves out."""
    found = [n for n, b in sizes.scene.boundary.items() if isinstance(b, Absorbing)]
    if not found:
        return Effect(
            "absorbing ends", False, ("boundary.*.type",), "no boundary absorbs", 'a boundary with type = "absorbing"'
        )
    nodes = sum(
        len(sizes.discretised.bodies[f.split(".")[0]].face(f.split(".", 1)[1]).nodes)
        for n in found
        if isinstance(b := sizes.scene.boundary[n], Absorbing) and (f := b.face)
    )
    return Effect(
        "absorbing ends",
        True,
        tuple(f"boundary.{n}" for n in found),
        f"dashpots on {nodes} nodes",
        "remove the boundary",
        kernels=("damping product",),
        memory=12 * 9 * nodes,
        cost=SECONDS["sparse"] * 9 * nodes,
    )


def body_force(sizes: Sizes) -> Effect:
    """Force per volume."""
    keys = tuple(f"substructure.{n}.body_force" for n, s in sizes.scene.substructure.items() if any(s.body_force))
    found = _driven(sizes, "body force", keys, "substructure.*.body_force", "a constant nodal force", "a body_force")
    return replace(found, cost=sizes.saved(replace(sizes.run, unbalanced=False))) if keys else found


def loads(sizes: Sizes) -> Effect:
    """Surface loads."""
    keys = tuple(f"load.{n}" for n in sizes.scene.load)
    return _driven(sizes, "surface loads", keys, "load", "nodal forces times their laws", "a [load.NAME]")


def initial_motion(sizes: Sizes) -> Effect:
    """Initial velocities, spins and displacements."""
    keys = tuple(
        f"substructure.{n}.{key}"
        for n, s in sizes.scene.substructure.items()
        for key in ("initial_velocity", "initial_spin", "initial_displacement")
        if any(getattr(s, key))
    )
    if not keys:
        return Effect(
            "initial motion",
            False,
            ("substructure.*.initial_velocity",),
            "everything starts at rest",
            "initial_velocity, initial_spin or initial_displacement",
        )
    return Effect("initial motion", True, keys, "initial values that are not zero", "set them to zero")


def static_start(sizes: Sizes) -> Effect:
    """A static equilibrium before the motion."""
    start = sizes.scene.time.start
    if not isinstance(start, StaticStart):
        return Effect(
            "static start",
            False,
            ("time.start",),
            "bodies start as given",
            'time.start = "static" (bolts, weight, dead loads first)',
        )
    n = sizes.n_dof
    return Effect(
        "static start",
        True,
        ("time.start",),
        f"an equilibrium in {start.increments} increment(s) before the first instant",
        'time.start = "given"',
        kernels=("static factorisation", "static solution"),
        memory=8 * n,
        cost=sizes.saved(replace(sizes.run, increments=0)),
    )


def prescribed_motion(sizes: Sizes) -> Effect:
    """Faces moved from outside."""
    driven = tuple(
        f"boundary.{n}"
        for n, b in sizes.scene.boundary.items()
        if isinstance(b, PrescribedVelocity | PrescribedDisplacement)
    )
    ground = tuple(f"interface.{n}.ground_velocity" for n, i in sizes.scene.interface.items() if i.ground_velocity)
    return _driven(
        sizes,
        "prescribed motion",
        (*driven, *ground),
        "boundary.*.type",
        "motions that follow the recursion of the time scheme",
        'type = "velocity" or "displacement", ground_velocity',
    )


def _driven(sizes: Sizes, name: str, keys: tuple[str, ...], none: str, what: str, on: str) -> Effect:
    if not keys:
        return Effect(name, False, (none,), "the scene has none", on)
    return Effect(name, True, keys, what, "remove it", kernels=("forcing",), memory=8 * sizes.n_dof)
