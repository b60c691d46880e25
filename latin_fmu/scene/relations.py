"""Checks that span several keys or tables: unknown names, alternatives, contradictions.

They work on the scene as written (see raw_scene), beside the checks of each field, so that one message
lists everything. A value that is wrong by itself is reported there and ignored here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from ..errors import Problem, shown
from .attachments import attachment_problems
from .boundaries import boundary_problems
from .fields import GROUND
from .initial_fields import field_problems
from .interfaces import key_problems
from .number_files import QUANTITIES, UNITS, si_unit
from .ports import port_laws, port_problems
from .raw_scene import (
    CENTRAL,
    RawTable,
    chosen_type,
    face_problems,
    given,
    named_tables,
    number,
    single_table,
    text_list,
    unknown_name,
)
from .sensors import sensor_problems
from .settings import MAX_INSTANTS, STATIC_TOLERANCE
from .substructures import DAMPING_KEYS
from .units import system_named

_EXPLICIT, _REDUCED, _REDUCIBLE = "explicit", "reduced", ("hht", "newmark")
_AUTOMATIC = "automatic"
_SHORTEST, _LONGEST = 1e-60, 1e60  # s; squares of steps, and what they divide, are numbers
_STEP_ROUND_OFF = 1e-6


def relation_problems(raw: Any, base_dir: Path) -> list[Problem]:
    """All problems between keys and tables of a scene as written."""
    return [
        *_substructure_problems(raw, base_dir),
        *_interface_problems(raw),
        *_contact_problems(raw),
        *boundary_problems(raw),
        *_load_problems(raw),
        *_bolt_problems(raw),
        *_unit_problems(raw),
        *sensor_problems(raw),
        *port_problems(raw),
        *attachment_problems(raw),
        *_time_problems(single_table(raw, "time")),
        *propagator_problems(raw),
        *_accuracy_problems(raw),
        *static_problems(raw),
        *field_problems(raw),
        *_output_problems(single_table(raw, "output")),
    ]


def _output_problems(output: RawTable) -> Iterator[Problem]:
    every = number(output, "interfaces_every")
    if output.get("energy") is True and every is not None and every > 1:
        yield Problem(
            "output.interfaces_every",
            "the energies of the interfaces need every instant (output.energy = true)",
            f"{every:g}",
            "1",
            "leave one of the two out",
        )


def _exactly_one(table: RawTable, where: str, *keys: str) -> Iterator[Problem]:
    known, named = [f"{key!r}" for key in keys if given(table, key)], [f"{key!r}" for key in keys]
    if len(known) != 1:
        what = f"neither {' nor '.join(named)} is given"
        if known:
            what = f"both {known[0]} and {known[1]} are given"
        yield Problem(where, what, None, f"exactly one of {', '.join(named[:-1])} and {named[-1]}")


def _substructure_problems(raw: Any, base_dir: Path) -> Iterator[Problem]:
    materials = named_tables(raw, "material")
    for name, table in named_tables(raw, "substructure").items():
        where = f"substructure.{name}"
        yield from _exactly_one(table, where, "box", "mesh")
        material = table.get("material")
        if materials and isinstance(material, str) and material not in materials:
            yield unknown_name(f"{where}.material", "material", material, materials)
        if table.get("rigid") is True and chosen_type(single_table(raw, "time"), "scheme") == "massless_contact":
            yield Problem(
                f"{where}.rigid",
                "massless_contact takes the mass from contact nodes, which a rigid body does not have",
                'time.scheme = "massless_contact"',
                "hht or newmark",
                "choose another scheme, or leave the body elastic",
            )
        if given(table, "modal_damping"):
            yield from _modal_problems(raw, where, table)
        mesh = table.get("mesh")
        file = mesh.get("file") if isinstance(mesh, dict) else None
        if isinstance(file, str) and not _is_file(base_dir, file):
            yield Problem(
                f"{where}.mesh.file", "no such file", shown(file), None, "file names are relative to the scene file"
            )


def _modal_problems(raw: Any, where: str, table: RawTable) -> Iterator[Problem]:
    """Modal damping of a body that has no modes in the run."""
    if table.get("rigid") is True:
        yield Problem(f"{where}.modal_damping", "a rigid body has no elastic modes", None, None, "remove it")
    kind = chosen_type(single_table(raw, "solver"), "propagator")
    if kind != _REDUCED:
        yield Problem(
            f"{where}.modal_damping",
            "modes are known to the reduced propagator only",
            f"solver.propagator = {shown(kind or _AUTOMATIC)}",
            'solver.propagator = "reduced"',
            "choose it, or damp the material by damping_ratios at two frequencies",
        )


def _is_file(base_dir: Path, name: str) -> bool:
    try:
        return (base_dir / name).is_file()
    except (OSError, ValueError):  # a name the system refuses, e.g. too long or with a null character
        return False


def _interface_problems(raw: Any) -> Iterator[Problem]:
    for name, table in named_tables(raw, "interface").items():
        where = f"interface.{name}"
        sides = text_list(table.get("sides"))
        for index, side in enumerate(sides):
            yield from face_problems(raw, f"{where}.sides[{index}]", side)
        if len(sides) == 2:
            yield from _pair_problems(where, table, sides)
        behaviour = table.get("behaviour")
        if isinstance(behaviour, str):
            yield from key_problems(where, table, behaviour)
        else:
            yield from key_problems(where, table, "contact")


def _contact_problems(raw: Any) -> Iterator[Problem]:
    """Keys of a search that its behaviour does not take; names that no substructure has."""
    substructures = named_tables(raw, "substructure")
    for name, table in named_tables(raw, "contact").items():
        where, behaviour = f"contact.{name}", table.get("behaviour", "contact")
        if isinstance(behaviour, str):
            yield from key_problems(where, table, behaviour)
        pairs = table.get("except")
        named = [("parts", part) for part in text_list(table.get("parts"))]
        named += [("except", n) for pair in (pairs if isinstance(pairs, list | tuple) else ()) for n in text_list(pair)]
        for key, part in named:
            if substructures and part not in substructures:
                yield unknown_name(f"{where}.{key}", "substructure", part, substructures)


def _pair_problems(where: str, table: RawTable, sides: list[str]) -> Iterator[Problem]:
    if sides[0] == GROUND:
        remedy = "name the ground second" if sides[1] != GROUND else "name a face of a substructure first"
        yield Problem(f"{where}.sides[0]", "the first side cannot be the ground", None, "a substructure face", remedy)
    elif sides[0] == sides[1]:
        yield Problem(f"{where}.sides", "a face cannot meet itself", shown(sides), "two different faces")
    for key in ("ground_velocity", "ground"):
        if given(table, key) and GROUND not in sides:
            yield Problem(
                f"{where}.{key}",
                "there is no ground on this interface",
                None,
                f'only where the second side is "{GROUND}"',
            )
    for key in ("points_from", "search"):
        if given(table, key) and table[key] != "automatic" and GROUND in sides:
            yield Problem(
                f"{where}.{key}",
                "there is no second face on this interface",
                shown(table[key]),
                None,
                f'remove it: the second side is "{GROUND}"',
            )
    if table.get("gap") in ("measured", "closed") and GROUND in sides and not given(table, "ground"):
        yield Problem(
            f"{where}.gap",
            "the gap cannot be measured: the ground has no place",
            shown(table["gap"]),
            "a number >= 0 [m]",
            "give the distance, or the place: ground = {point = [...], normal = [...]}",
        )


def _load_problems(raw: Any) -> Iterator[Problem]:
    for name, table in named_tables(raw, "load").items():
        if not given(table, "moment"):
            yield from _exactly_one(table, f"load.{name}", "pressure", "traction", "force")
        for key in ("moment", "point"):
            others = [k for k in ("pressure", "traction") if given(table, k)]
            if given(table, key) and others:
                what = f"a {others[0]} has no {key}"
                yield Problem(f"load.{name}.{key}", what, None, "with 'force'", f"leave out {key!r} or {others[0]!r}")
        if given(table, "pressure") and given(table, "axes"):
            what = "a pressure acts along the normal"
            yield Problem(f"load.{name}.axes", what, None, "with 'traction' or 'force'", "leave the axes out")
        if isinstance(table.get("face"), str):
            yield from face_problems(raw, f"load.{name}.face", table["face"])


def _bolt_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the bolts of a scene as written; the cuts of their shanks are checked with the meshes."""
    substructures = named_tables(raw, "substructure")
    for name, table in named_tables(raw, "bolt").items():
        where, body = f"bolt.{name}", table.get("substructure")
        yield from _exactly_one(table, where, "force", "shortening")
        if not isinstance(body, str) or not substructures:
            continue
        if body not in substructures:
            yield unknown_name(f"{where}.substructure", "substructure", body, substructures)
            continue
        if substructures[body].get("rigid") is True:
            yield Problem(
                f"{where}.substructure",
                "a rigid body cannot be stretched",
                shown(body),
                "an elastic substructure",
                f"leave out substructure.{body}.rigid",
            )
        for key in ("initial_velocity", "initial_spin"):
            if _moves(substructures[body].get(key)):
                yield Problem(
                    f"{where}.substructure",
                    f"bolts are tightened at rest, before t = 0, and {body} has the {key} {substructures[body][key]}",
                    shown(body),
                    "a substructure that is at rest at t = 0",
                    f"remove substructure.{body}.{key}, or the bolt",
                )
    if named_tables(raw, "bolt") and chosen_type(single_table(raw, "time"), "start") == "given":
        yield Problem(
            "time.start",
            "bolts are tightened in the static equilibrium that a scene with bolts starts from",
            "given",
            '"static"',
            "leave time.start out, or remove the bolts",
        )


_UNITS_OF: Final = {"velocity": "m s-1", "displacement": "m", "acceleration": "m s-2"}  # by type of boundary


def _laws(raw: Any) -> Iterator[tuple[str, Any, str | None]]:
    """Place of every law, the law as written, and the unit of what it multiplies."""
    for name, load in named_tables(raw, "load").items():
        yield f"load.{name}.law", load.get("law"), "N" if given(load, "force") else "Pa"
    for name, boundary in named_tables(raw, "boundary").items():
        yield f"boundary.{name}.law", boundary.get("law"), _UNITS_OF.get(str(boundary.get("type")))
    yield from port_laws(raw)
    for name, body in named_tables(raw, "substructure").items():
        yield f"substructure.{name}.body_force_law", body.get("body_force_law"), "N m-3"
    for name, interface in named_tables(raw, "interface").items():
        ground = single_table(interface, "ground_velocity")
        yield f"interface.{name}.ground_velocity.law", ground.get("law"), "m s-1"
    yield "gravity.law", single_table(raw, "gravity").get("law"), "m s-2"


def _unit_problems(raw: Any) -> Iterator[Problem]:
    """Units of laws that are not those of what the law multiplies."""
    for where, law, unit in _laws(raw):
        name = law.get("value_unit") if isinstance(law, Mapping) else None
        own = si_unit(name) if isinstance(name, str) else None
        if own not in (None, "1") and not system_named(raw.get("units")).measurable:
            yield Problem(
                f"{where}.value_unit", "the numbers of the scene have no units", shown(name), "1, or a factor"
            )
            continue
        if own is not None and unit is not None and own not in (unit, "1"):
            what = f"{QUANTITIES[own]}, but the law multiplies {QUANTITIES[unit]}"
            yield Problem(f"{where}.value_unit", what, shown(name), ", ".join((*UNITS[unit], *UNITS["1"])))


def _accuracy_problems(raw: Any) -> Iterator[Problem]:
    """The owner of the quantity aimed at must exist."""
    quantity = single_table(raw, "accuracy").get("quantity")
    owner, _, key = quantity.rpartition(".") if isinstance(quantity, str) else ("", "", "")
    kind = "sensor" if key == "displacement" else "interface"
    owners = named_tables(raw, kind)
    if kind == "interface" and named_tables(raw, "contact"):
        return  # interfaces are found on the meshes
    if owner and owner not in owners:
        yield unknown_name("accuracy.quantity", kind, owner, owners)


def _time_problems(time: RawTable) -> Iterator[Problem]:
    if not time:
        return
    yield from _exactly_one(time, "time", "step", "instants")
    end, step, instants = number(time, "end"), number(time, "step"), number(time, "instants")
    if end is not None and instants is not None and end > 0.0 and instants > 0.0:
        yield from _length_problems("time.end", end, end / instants)
    if given(time, "instants") or end is None or step is None or end <= 0.0 or step <= 0.0:
        return
    ratio = end / step
    if not ratio <= MAX_INSTANTS:
        yield Problem("time.step", f"more than {MAX_INSTANTS} steps", shown(step), None, "a longer step")
        return
    yield from _length_problems("time.step", step, step)
    n_step = max(1, round(ratio))
    if abs(ratio - n_step) > _STEP_ROUND_OFF:
        yield Problem(
            "time.end",
            f"not a whole number of steps ({ratio:.9g} of them)",
            shown(end),
            f"a multiple of step = {step:.12g}",
            f"nearest: end = {n_step * step:.12g}, or instants = {n_step} instead of step",
        )


def _length_problems(where: str, value: float, step: float) -> Iterator[Problem]:
    if not _SHORTEST <= step <= _LONGEST:
        allowed = f"steps of {_SHORTEST:g} to {_LONGEST:g} s"
        yield Problem(where, "a step of a length that cannot be computed with", shown(value), allowed)


def with_defaults(raw: Any) -> Any:
    """The scene with the defaults that depend on other keys: without inertia a tighter tolerance, because set-up takes
    most of the time there; with the explicit propagator its time scheme; with bolts a static start."""
    if named_tables(raw, "bolt") and (time := single_table(raw, "time")) and not given(time, "start"):
        raw = {**raw, "time": {**time, "start": {"type": "static"}}}
    time, solver = single_table(raw, "time"), single_table(raw, "solver")
    if _is_static(raw) and not given(solver, "tolerance"):
        return {**raw, "solver": {**solver, "tolerance": STATIC_TOLERANCE}}
    own = given(time, "scheme") and chosen_type(time, "scheme") != _AUTOMATIC
    if chosen_type(single_table(raw, "solver"), "propagator") != _EXPLICIT or not time or own:
        return raw
    return {**raw, "time": {**time, "scheme": CENTRAL}}


def _is_static(raw: Any) -> bool:
    """Whether a readable scene is without inertia."""
    readable = isinstance(raw, Mapping) and isinstance(raw.get("solver", {}), Mapping)
    return readable and single_table(raw, "time").get("quasi_static") is True


def propagator_problems(raw: Any) -> Iterator[Problem]:
    """Propagators and time schemes that exclude each other."""
    kind = chosen_type(single_table(raw, "solver"), "propagator")
    scheme = chosen_type(single_table(raw, "time"), "scheme")
    if kind == _EXPLICIT and scheme not in (None, _AUTOMATIC, CENTRAL):
        yield Problem(
            "solver.propagator",
            "the explicit propagator has its own time scheme",
            shown(scheme),
            f'time.scheme = "{CENTRAL}", or none',
            "leave out time.scheme, or choose another propagator",
        )
    if kind == _REDUCED and scheme not in (None, _AUTOMATIC, CENTRAL, *_REDUCIBLE):
        yield Problem(
            "solver.propagator",
            "the reduced propagator needs a scheme in which every node has mass",
            shown(scheme),
            " or ".join(f'time.scheme = "{name}"' for name in _REDUCIBLE),
            "choose another time scheme or propagator",
        )
    precision = single_table(raw, "solver").get("precision")
    if precision == "float32" and (scheme == CENTRAL or kind in (_EXPLICIT, _REDUCED, "cg")):
        yield Problem(
            "solver.precision",
            "this is the precision of factors, which only the direct propagator has",
            shown(precision),
            'solver.propagator = "direct" or "automatic"',
            "leave out solver.precision",
        )
    form, window = (single_table(raw, "solver").get(name) for name in ("interface_operator", "window"))
    if form == "sparse" and (window not in (None, 1) or _is_static(raw)):
        what = "a force reaches the points around it only within an instant, and not without inertia"
        remedy = 'use solver.interface_operator = "exact" or "automatic"'
        yield Problem("solver.interface_operator", what, shown(form), "solver.window = 1, with inertia", remedy)
    if form in ("exact", "sparse") and (scheme == CENTRAL or kind in (_EXPLICIT, _REDUCED, "cg")):
        yield Problem(
            "solver.interface_operator",
            "interfaces are solved with by substitution through factors, which only the direct propagator has",
            shown(form),
            'solver.propagator = "direct" or "automatic"',
            "leave out solver.interface_operator",
        )
    if scheme == CENTRAL and kind not in (None, "automatic", _EXPLICIT):
        yield Problem(
            "time.scheme",
            "central differences need the explicit propagator",
            shown(kind),
            'solver.propagator = "explicit" or "automatic"',
            "choose another time scheme, or that propagator",
        )


def static_problems(raw: Any) -> Iterator[Problem]:
    """All contradictions of a scene as written with ``time.quasi_static``."""
    time = single_table(raw, "time")
    if time.get("quasi_static") is not True:
        return
    scheme = time.get("scheme")
    if scheme is not None and chosen_type(time, "scheme") != _AUTOMATIC:  # but for the default
        yield _refused("time.scheme", "a time scheme integrates inertia", scheme, "leave the scheme out")
    start = time.get("start")
    requested = (start.get("type", "static") if isinstance(start, dict) else start) == "static"
    if requested and not named_tables(raw, "bolt"):  # bolts are tightened before the first increment
        yield _refused("time.start", "every step is an equilibrium already", start, "leave the start out")
    for name, table in named_tables(raw, "substructure").items():
        for key in ("initial_velocity", "initial_spin"):
            if _moves(table.get(key)):
                yield _refused(f"substructure.{name}.{key}", "a velocity needs inertia", table[key], "remove it")
    for name, table in named_tables(raw, "boundary").items():
        if table.get("type") == "absorbing":
            yield _refused(
                f"boundary.{name}",
                "an absorbing boundary acts on velocities only",
                "absorbing",
                "remove it, or hold the face",
            )
        elif table.get("type") == "acceleration":
            what = "an acceleration needs inertia"
            yield _refused(
                f"boundary.{name}", what, "acceleration", "load the bodies by [gravity], or displace the face"
            )
    for name, table in named_tables(raw, "material").items():
        for key in DAMPING_KEYS:
            if table.get(key):
                yield _refused(f"material.{name}.{key}", "damping acts on rates", table[key], "remove it")
    yield from _solver_problems(single_table(raw, "solver"))


def _solver_problems(solver: RawTable) -> Iterator[Problem]:
    if given(solver, "window") and solver["window"] != 1:
        yield _refused(
            "solver.window", "increments of load are solved one by one", solver["window"], "leave the window out"
        )
    kind = chosen_type(solver, "propagator")
    if kind not in (None, "automatic", "direct"):
        yield _refused(
            "solver.propagator", "static steps are solved by the direct propagator", kind, "leave the propagator out"
        )


def _moves(value: object) -> bool:
    return isinstance(value, list | tuple) and any(isinstance(v, int | float) and v != 0 for v in value)


def _refused(where: str, what: str, value: object, remedy: str) -> Problem:
    return Problem(
        where, f"{what}: not with quasi_static = true", shown(value), None, f"{remedy}, or leave quasi_static out"
    )
