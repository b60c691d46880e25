"""The reference of the scene file, generated from the tables themselves, and its JSON schema."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any, Final

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import PydanticUndefined

from .describe import allowed_text, is_named, tables_in, tag_of
from .schema import Scene, toml_value

INTRODUCTION = """\
A scene is a TOML file. Named tables such as [material.steel] are referred to by their name: a letter, then
letters, digits or underscores (no substructure may be called "ground"). A bare string may stand for a table
that only has a type: law = "constant". A key that is not listed here is an error; all errors of a scene are
reported at once. Settings on the command line follow the same path:
--set solver.tolerance=1e-4 or --set substructure.bar.box.elements.2=100.

Units are SI as stated with each key; a key without one has no dimension. A string is a value with its unit:
mass = "100 g", duration = "6 ms", torque = "5.5 N m" or "44 lbf in", force = [0, 0, "-2 kN"],
acceleration = [0, 0, "-1 g"]; it is converted into the units of the scene, also in [spread], with --set and
--vary, and in Python. A product is written with blanks or dots, powers behind names, brackets where several
names stand behind a stroke: "7.8 g/cm3", "3 N s/m", "5 kN/(m s)". g is the acceleration of gravity or a gram
by the unit of the key; "5 %" is a pure number.

units = "mm-t-s-MPa" or "in-lbf-s-psi" says that all numbers of the scene are in another system: nothing is
converted except strings with units and files with a stated unit; results, messages and figures have
its units, and checks of plausible numbers are scaled. Read mm for m, t for kg, MPa for Pa, mJ for J there,
or in, lbf s2/in, lbf, psi. units = "none" is for pure numbers, as in papers: no labels, no warnings on sizes,
gaps and strains, no strings with units; times are in s."""

CONVENTIONS = """\
Faces          "substructure.face". The faces of a box are xmin xmax ymin ymax zmin zmax; those of a mesh
               file are its named surface groups, surfaces of element faces, side sets, and node sets (facets with
               all corners in the set); "substructure.*" is the whole boundary. The second side of an interface may
               be "ground": rigid, unbounded, at rest unless ground_velocity is given.
Interface      The normal N points from the first side (E) to the second (E'). Forces and tractions in the
               results are those the interface exerts on side E, in global axes: two bodies pressed together
               along z, the first one below, give a negative z component.
Meshes         Nodes of the two faces that stand opposite each other one to one are the points of the interface, but
               where a quadrilateral faces triangles, say, with other shares of the area. Else the points are those of
               one side (points_from: the wholly covered one, else the one with the smaller facets on average, of the
               softer, of the smaller body; E where all are alike, which is said), over the part that the faces have
               in common, and the other side takes part through integrals over it (mortar). Faces may be curved and
               closed. Points with hardly any common area are merged into their neighbours. On facets of second order
               points_at = "corners" has points at corners alone, with pressures linear between them: a quarter of
               the points, at the same order of convergence; threads of bolts are bonded like that.
Gap            Distance of the two sides along N at the points, open > 0. Measured on the meshes if omitted or
               "measured", between curved facets of quadratic elements as they are curved; what is below their
               distance from a smooth face touches, and latin-fmu check names it. A number counts, whatever the
               distance of the meshes, which is said where it is another; "closed" is no gap. Flat facets of round
               faces are chords: a clearance or interference below their distance from the round face is not known
               and is refused unless it is given; faces touch where smooth surfaces through their nodes do.
Press fit      Meshes of faces that may open overlap by the interference of a press fit, up to 0.5 % of the radius of
               round faces or of the thickness behind them; interference gives it by its number, whatever the meshes.
               It is closed in a static start before t = 0, with preloads, before bolts are tightened and loads act;
               its largest strain is printed, above 0.01 refused. overlap = "ignore" or "refuse" is for meshes that
               overlap without being a fit. Bonded faces may overlap by the depth of a thread, a quarter of the
               radius, or be apart by up to search, which is printed.
Form of faces  form of an interface is what its faces deviate from their meshes, both together, and is added to the gap:
               a crown, a polynomial or a table over the face. Polynomials and tables count from their smallest
               value. Contact then begins where the faces are highest and spreads as they are pressed.
Ground         Without a place the ground lies behind the face, which must be plane where it may open; its gap is
               the number given, 0 without one. With ground = {point = [...], normal = [...]}, the normal out of
               the ground, the gap is measured from that plane.
Contact        A table [contact.NAME] makes an interface of every two boundaries that are nearer than search along
               the normal (less than the parts are thick), named part_part; pairs that have an interface in the
               scene are left as they are. latin-fmu check lists them, and the parts that touch nothing.
Preload        Contact pressure at t = 0, in equilibrium with initial stresses that the scene does not describe:
               displacements, velocities and stresses are counted from that state.
               preload_force is the same as a force on the whole face. Neither tightens a bolt, and neither is a press
               fit, whose bodies are strained.
Bolts          The shank is cut by a plane across its axis, through point or in the middle of the longest stretch of
               the thinnest sections; elements with their centres beyond the plane are moved along the axis. No node
               of the cut may belong to an interface, or be held along the axis; the section may not be wider than
               the body is long. Bolts are tightened at rest before t = 0, order after order, each from the force it
               has by then, with friction and nothing but preloads beside; the shortening that was reached is kept.
               Other loads come after that. A scene with bolts has a static start, a quasi-static one starts with
               tight bolts; time.start.increments is the number of increments of every order. The results hold the
               tension of every bolt at every instant and after every order. Displacements count from before the
               bolts were tightened; the elastic energy leaves the preload out.
Yielding       Below yield_stress of its material times its stress area (of its thread, or of the mesh) a bolt is
               elastic. With hardening H it yields there: bilinear, kinematic hardening, F - H q within the yield
               force; q, plastic elongation, lowers the clamp force for good. A run in which one yields is repeated
               until q stays, some three times in statics and four to ten in motion. A shank yields as a whole: its
               bending does not count. Not in FMUs and sessions.
Temperature    A change of temperature strains a free body by alpha times it. The vector of nodal forces is constant and
               the law scales it, in statics, a static start (the default with temperatures) and dynamics. Bolts are
               tightened before it acts: their tension follows from the different expansions of bolt and parts. Stresses
               are those of what is hindered; strains are total, and so is the elastic energy, of which the load of a
               free expansion does the work. Moduli do not depend on temperature.
Rotation       The centrifugal force is that of the places at t = 0, rho omega^2 r, times the law, with added masses: in
               statics, a static start and dynamics. It does not grow with displacements, and Coriolis forces are left
               out, which matter where motions relative to the turning frame are fast.
Thread         thread = {size = "M5", part = "base", length = 8e-3} bonds shank and hole of a screw from the mouth
               of the hole, chamfers left out, over length and at most over their overlap. The rest of the shank touches
               nothing unless shank = "contact"; of the free shank the core of the thread carries alone (VDI 2230)
               unless modulus = "drawn".
               With faces of its own a perfect interface of bolt and nut, matching or not, bonds a thread; in a tapped
               hole, on the threaded part of the shank and the wall of the hole. A part of the shank stays free for the
               cut.
Ends of bolts  Each end of a bolt with a tension is held by a bond, a thread, a spring, a coupling, a face held along
               the axis, a contact on facets within 60 degrees of the axis turned the way of the pull, or a contact that
               is pressed before (a press fit, a preload) with friction or along the axis; else it is refused by name.
Behaviours     perfect: one velocity. contact: unilateral, Coulomb friction. no_slip: unilateral, never slides:
               points that are closed at the start of an instant are held along the face in it, at zero pressure too,
               and contact_status is stick wherever there is a traction.
               elastic_layer: bonded, tractions proportional to the jump of displacement. soft_contact: unilateral,
               pressure proportional to the compression of a layer, Coulomb friction. viscous_joint: bonded,
               tractions proportional to the jump of velocity. maxwell_joint: springs with dashpots in series, which
               relax with relaxation_time, and carry nothing at rest. A layer or joint has no thickness and no mass; the
               distance of its faces does not count where they are apart, and they may not overlap unless
               overlap = "ignore".
Rigid          A rigid substructure keeps its mass and its mesh, which gives its faces and their points.
               Held and prescribed directions are taken out of its six motions; conditions that no rigid
               motion satisfies are refused. Its rotations are small ones.
Damping        damping_ratios of a material, a spring or an elastic layer: damping by strain whose ratio goes from the
               first to the second value over the band, on a line in the logarithms, within 5 %. It is a dashpot b K and
               up to five Maxwell branches of the stiffness K (springs with dashpots in series): a mode has the ratio
               whatever it is cut into, and a rigid motion none. Moduli rise with frequency; young_modulus is the static
               one. [damping] ratio gives all materials, springs and layers that say nothing the same. In the results
               the branches of a spring or layer are NAME_branch1, ..., its dashpot NAME_viscosity. A loss
               factor has no exact counterpart in time: loss_factor = eta with at_frequency = f is b = eta / (2 pi f),
               exact at f, in proportion to the frequency elsewhere. rayleigh_mass a and rayleigh_stiffness b give
               C = a M + b K, a damping ratio a / (2 w) + b w / 2 at the angular frequency w. The part of the mass
               brakes absolute velocities; where it takes more than 1 % of the force of a driven face or of the momentum
               of a free part, it is refused unless the material has frame = "absolute". modal_damping of a substructure
               gives each of its elastic modes, its interfaces free, up to a frequency one ratio.
Point masses   They are part of the mass of their substructure: in dynamics, modes, momentum, and the mass centre
               that initial_spin turns about; body_force, per volume, does not act on them. On a face without point
               and inertia a mass is spread evenly; with either it is a rigid mass on the mean motion of the face,
               whose inertia forces spread over it without stiffening it (not with the explicit propagator).
Springs        A spring has no mass. It acts on the motion of its ends: that of a point, or the mean motion of a face by
               area, at its centre or at a point on a rigid arm from it; the force on a face spreads by area. It is an
               interface with one point in the results, with the force in N on its first end; where it has stiffness
               and viscosity, the part of the latter is NAME_viscosity. For stiffnesses that differ in three
               directions, write three springs.
Couplings      A distributing coupling gives the mean motions of two places, translation and rotation, those of one
               rigid body; the faces still deform, and force and moment spread over them by area. With rigid = true
               the faces move as rigid bodies, as far as their held directions let them; one face alone, or node set,
               along the axes of its components only, its nodes free along the others. In the results a coupling is
               an interface of six rods about the point of its first end, whose forces N have its resultant and its
               moment; without rotations, or with a point of a solid, of one point. Loads with force, moment and point
               act on a face as through a distributing coupling.
Sensors        A point is interpolated in the element that holds it, a face has its mean by area; results keep
               displacement, velocity and acceleration at every instant. A filter adds the filtered motions. A
               spectrum is that of the unfiltered acceleration along x, y and z, the base at rest before t = 0.
Ports          A port connects a face to another model by the mean motion of the face, at its centre, in SI units along
               the global axes. In an FMU or session it has variables port.NAME.QUANTITY[i], i = 1, 2, 3 for x, y, z.
               force_in: inputs force, moment (on the body); outputs displacement, velocity, rotation,
               angularVelocity. motion_in: inputs velocity, angularVelocity; outputs force, moment that the face
               exerts on what moves it, so that it connects to a port with forces as inputs without a change of sign.
               The face is rigid along its components; a rotation needs the translations along which it moves nodes.
               wave: input incident (incidentMoment) = F + Z v; outputs reflected (reflectedMoment) = Z v - F, to be
               connected to incident of the other port, force F on the body, and the motion; impedance is Z. For a bar
               of density rho, wave speed c and section A, Z = rho c A lets waves out. Between the communication points
               an incident wave without a rate is the straight line from its last value: ports that exchange waves once
               a step are joined by a delay of one step, as by a strip of length c x step, and stay stable.
               Every input has a rate: port.NAME.forceRate[i]. Laws give components histories of their own; 1 is then
               1 N, 1 N m, 1 m/s or 1 rad/s.
Reactions      Force of a support on its body, from the equation of motion at the dofs that it holds or drives.
Gravity        It acts where the mass of the body is: a free body falls without strain. Damping by rayleigh_mass and
               absorbing faces act on velocities: where the acceleration stands for that of a moving frame, on those
               relative to the frame.
Signs          Pressure is positive in compression: traction -p n, n the outward normal. Tractions,
               forces and prescribed motions are along the global axes x, y, z; those of a load or boundary with axes
               along these.
Laws           A law a(t) has no dimension and multiplies the load or the prescribed motion. Before its
               first and after its last point a table keeps its end values. The values of a csv law may have the unit
               of what they multiply, which then only gives the direction: force = [0, 0, -1], value_unit = "kN".
               A run begins at t = 0: a record with samples before it needs start or shift.
Jumps          At a jump a law has the value before it. A step or a pulse that starts at 0 is 0
               at t = 0; a rectangular pulse is 1 for start < t <= start + duration. An instant closer to
               the jump than 1e-9 of its own value lies on it.
Sampling       The solver takes a(t) at its instants, linear in between. Pulses that start and end on
               instants keep their impulse exactly; a difference of more than 0.1 % is reported.
Instants       t_i = i end / n, i = 0 ... n, n = instants or end / step. Initial conditions hold at t = 0.
Quasi-static   time.quasi_static = true leaves inertia out: every step is an equilibrium under the loads of
               its end. At t = 0 nothing acts but preloads; loads that do not start from zero come with the
               first step. Time only orders the increments (only a viscous_joint depends on its rate). Where
               contact and friction cannot hold the loads, the run stops.
Nothing holds  Without inertia a substructure that nothing holds has an equilibrium where the loads on it, and on what
               is joined to it, are in balance: as many displacements of its nodes are held as it has free motions,
               without reactions. Loads out of balance by more than 1e-8 of their sum are an error, and so are those
               of a rigid substructure. A load that is set from outside must be in balance by itself.
Initial fields The initial values of a body add up: a uniform one, a spin, gradients G (u = G (x - mass centre)), and
               the fields of a file with a row x, y, z, u, v, w for every node of the mesh, in any order; rows of other
               bodies may be there. Supports override a field, with a warning. [initial_state] takes both fields from an
               instant of a results file, of bodies with the same names and meshes; laws start again at t = 0. Gaps and
               tractions of bonds and layers follow from the fields; those of contacts do not, so that an instant at
               which a contact of these bodies is loaded is refused. newmark with gamma = 0.5, massless_contact and
               central_difference continue a vibration from its displacements and velocities as if it had not been
               interrupted; hht and generalized_alpha start with another acceleration than that run had.
Static start   time.start = "static" solves the equilibrium under what acts at t = 0 first: loads at a(0) (a step or
               pulse that starts at 0 is a shock and not in it), body forces, gravity, temperatures, preloads,
               displaced faces; faces driven by a velocity or an acceleration and the ground stand still. The motion
               starts from its displacements, tractions, gaps, stick and slip. Substructures with an initial velocity
               are left out; [motion] gives one to all, and a tightened assembly starts in its equilibrium with it. A
               substructure that friction cannot hold is an error. Of bodies that only contacts without pressure hold,
               or nothing, the place is that of least displacement (mean square over the mass) without overlap. A
               contact with a gap that strains alone press, and friction alone could hold, carries nothing if its
               bodies find room.
Boundaries     fixed and symmetry block displacement; velocity, displacement and acceleration prescribe value *
               a(t) along the components. A face with an acceleration starts as fast as its body and moves as the
               time scheme would move a free body: after a pulse its velocity and path are the exact integrals of the
               straight lines between the instants. In the frame of that face the same motion is [gravity] with the
               opposite acceleration. With axes, components and values are along these. One condition per face and
               component; nodes of a common edge follow all conditions on them. Loads on one face add up.
Absorbing      Half of a traction on an absorbing face goes into its dashpots: a traction 2 t launches a
               wave t."""

EXAMPLE = """\
name = "two_blocks"
description = "A moving block strikes a resting one and rubs on it"

[material.steel]
young_modulus = 210e9
poisson_ratio = 0.3
density = 7800.0

[substructure.lower]
material = "steel"
box = {origin = [0.0, 0.0, 0.0], size = [0.01, 0.01, 0.01], elements = [4, 4, 4]}

[substructure.upper]
material = "steel"
box = {origin = [0.0, 0.0, 0.01], size = [0.01, 0.01, 0.01], elements = [4, 4, 4]}
initial_velocity = [1.0, 0.0, -5.0]

[interface.strike]
sides = ["lower.zmax", "upper.zmin"]
behaviour = "contact"
friction_coefficient = 0.2

[boundary.base]
type = "fixed"
face = "lower.zmin"

[load.press]
face = "upper.zmax"
pressure = 50e6
law = {type = "half_sine", duration = 5e-6}

[time]
end = 20e-6
step = 0.1e-6
scheme = {type = "generalized_alpha", landing_damping = 0.6}

[solver]
tolerance = 1e-3
window = 1

[output]
energy = true
"""


_WIDTH = 110
_INDENT = " " * 8


def reference_text() -> str:
    """Every table and key of a scene with kind, range, unit, default and meaning; conventions; an example."""
    top = "\n".join(
        line
        for key, field in Scene.model_fields.items()
        if not tables_in(field.annotation)
        for line in _field_lines(key, field)
    )
    parts = [_title("Scene file"), INTRODUCTION, "Top of the file", top]
    for key, field in Scene.model_fields.items():
        if tables := tables_in(field.annotation):
            if field.is_required():
                need = "required"
            else:
                need = "optional"
            if is_named(field):
                parts.append(_title(f"[{key}.NAME] ({need})"))
            else:
                parts.append(_title(f"[{key}] ({need})"))
            parts += [_table_text(table) for table in tables]
    for key, tables in inner_tables().items():
        parts.append(_title(f"{key} = {{...}}"))
        parts += [_table_text(table) for table in tables]
    parts += [_title("Conventions"), CONVENTIONS, _title("Example"), EXAMPLE]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


class _Schema(GenerateJsonSchema):
    """The schema of pydantic, with the names of tables that their titles have."""

    def normalize_name(self, name: str) -> str:
        """A name of a definition."""
        return super().normalize_name(name.removesuffix("Table"))


def reference_schema() -> dict[str, Any]:
    """JSON schema of a scene (units under "unit"); it does not hold the checks between tables."""
    schema: dict[str, Any] = _with_texts(Scene.model_json_schema(schema_generator=_Schema), False)
    return schema


_WITH_UNIT: Final = {"type": "string", "pattern": r"^\s*[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?\s*[^\s0-9.,]"}
_OF_NUMBERS: Final = ("type", "exclusiveMinimum", "minimum", "exclusiveMaximum", "maximum")


def _with_texts(node: Any, measured: bool) -> Any:
    """A JSON schema in which numbers with units may be texts; ``measured``: inside a key that has a unit."""
    if isinstance(node, list):
        # a number beside any text: these are among them
        free = {"type": "string"} in node
        return [item if free and item == {"type": "number"} else _with_texts(item, measured) for item in node]
    if not isinstance(node, dict):
        return node
    measured = measured or isinstance(node.get("unit"), str)
    schema = {key: _with_texts(value, measured) for key, value in node.items()}
    if not measured or node.get("type") != "number":
        return schema
    number = {key: schema.pop(key) for key in _OF_NUMBERS if key in schema}
    return {"anyOf": [number, _WITH_UNIT], **schema}


def _title(text: str) -> str:
    return f"{text}\n{'=' * len(text)}"


def inner_tables() -> dict[str, list[type[BaseModel]]]:
    """Tables inside tables, by the key that holds them, in the order met."""
    inner: dict[str, list[type[BaseModel]]] = {}
    waiting = [table for field in Scene.model_fields.values() for table in tables_in(field.annotation)]
    while waiting:
        for key, field in waiting.pop(0).model_fields.items():
            tables = tables_in(field.annotation)
            if tables and key not in inner:
                inner[key] = tables
                waiting += tables
    return inner


def _table_text(table: type[BaseModel]) -> str:
    tag = tag_of(table)
    meaning = textwrap.fill(" ".join((table.__doc__ or "").split()), _WIDTH)
    if tag is not None:
        lines = [f'type = "{tag}"', textwrap.indent(meaning, "    ")]
    else:
        lines = [meaning]
    for name, field in table.model_fields.items():
        if tag is None or name != "type":
            lines += _field_lines(name, field)
    return "\n".join(lines)


def _field_lines(name: str, field: FieldInfo) -> Iterator[str]:
    text = f"{name}: {allowed_text(field)}; {default_text(field)}"
    yield textwrap.fill(text, _WIDTH, initial_indent=" " * 4, subsequent_indent=" " * 12, break_long_words=False)
    yield textwrap.fill(field.description or "", _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT)


def default_text(field: FieldInfo) -> str:
    """Default of a key in words: required, optional, or the value."""
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True, validated_data={})
    if default is None or default is PydanticUndefined or default in ((), {}, ""):
        return "optional"
    if isinstance(default, BaseModel):
        if tag_of(type(default)):
            return f"default {toml_value(default.model_dump(exclude_none=True))}"
        return "optional"
    return f"default {toml_value(default)}"
