"""Effects on what a run keeps: fields, stress, energies."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect
from .sizes import Sizes


def fields(sizes: Sizes) -> Effect:
    """Displacement and velocity histories of the nodes."""
    nodes = sum(c.n_member * c.nodes for c in sizes.classes)
    output = sizes.scene.output
    asked = tuple(f"output.{key}" for key in ("fields", "strain", "nodal_stress") if getattr(output, key))
    if not asked:
        return Effect("interior history", False, ("output.fields",), "not asked for", "output.fields = true")
    return Effect(
        "interior history",
        True,
        (*asked, "output.every"),
        f"displacements and velocities of {nodes} nodes at {sizes.n_stored} instants",
        ", ".join(f"{key} = false" for key in asked),
        kernels=("field storage",),
        memory=48 * nodes * sizes.n_stored,
        cost=sizes.saved(replace(sizes.run, fields=False)),
    )


def stress(sizes: Sizes) -> Effect:
    """Mean stress of the elements."""
    cells = sum(c.n_member * c.cells for c in sizes.classes if not c.rigid)
    if not sizes.scene.output.stress:
        return Effect("stress", False, ("output.stress",), "not asked for", "output.stress = true")
    return Effect(
        "stress",
        True,
        ("output.stress", "output.every"),
        f"{cells} elements at {sizes.n_stored} instants",
        "output.stress = false",
        kernels=("stress recovery",),
        memory=48 * cells * sizes.n_stored,
        cost=sizes.saved(replace(sizes.run, stress=False)),
    )


def energy(sizes: Sizes) -> Effect:
    """Energy balance."""
    if not sizes.scene.output.energy:
        return Effect("energy balance", False, ("output.energy",), "not asked for", "output.energy = true")
    return Effect(
        "energy balance",
        True,
        ("output.energy",),
        "every term from the fields of every instant",
        "output.energy = false",
        kernels=("energy meter",),
        memory=8 * (sizes.n_instant + 1) * 7 * (1 + sum(c.n_member for c in sizes.classes)),
        cost=sizes.saved(replace(sizes.run, energy=False)),
    )
