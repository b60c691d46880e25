"""Table [bolt.NAME]: screws that are tightened, one by one or many by one table, and their threads."""

import math
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ..errors import Problem, listed, shown
from .fields import Count, Direction, Name, Real, SceneTable, Text, Vector, about, entry, refusal
from .raw_scene import (
    RawTable,
    chosen_type,
    exactly_one,
    given,
    moves,
    named_tables,
    number,
    reference_problems,
    single_table,
    text_list,
)
from .threads import CLASSES, ThreadSize, class_yield, thread_named
from .units import UnitSystem, system_named

NUT_FACTOR: Final = 0.2
"""Of dry steel."""
_BEARING: Final = 1.3  # mean diameter of the bearing surface of a head over the nominal one, where it is not given
LARGEST_STRESS: Final = 1e9
"""Mean stress, Pa, above which a screw without a class and a yield stress is taken for a slip of the keyboard."""
_SAME_DIAMETER: Final = 0.05  # relative difference of a diameter from that of the thread


def _check_size(thread: str) -> str:
    if thread_named(thread) is None:
        raise refusal(
            "no metric or unified thread",
            value=thread,
            allowed='"M6" (coarse) or with a pitch, "M10x1"; "1/4-20", "1/4 UNC", "#10-32", "#10 UNF"',
        )
    return thread


def _check_class(name: str) -> str:
    if class_yield(name) is None:
        raise refusal("unknown property class", value=name, allowed=", ".join(CLASSES))
    return name


Size = Annotated[Text, AfterValidator(_check_size)]
PropertyClass = Annotated[Text, AfterValidator(_check_class)]


class ThreadTable(SceneTable):
    """A thread: its size, and the part that it engages, where no interface bonds it.

    With `part` the round faces of shank and hole are bonded over the part of their overlap along the axis that begins
    at the mouth of the hole, over `length` at most; chamfers do not count. Holes of 0.75 to 1.1 of the diameter fit: at
    the core, tap drill or nominal diameter. The rest of the shank has no contact. Of a free shank that is drawn thicker
    the core of the thread carries alone; of one in contact the modulus is scaled to the area of the core.
    """

    size: Annotated[
        Size | None, about('metric or unified thread, "M6", "M10x1", "1/4-20", "#10 UNF"; a string alone is its size')
    ] = None
    part: Annotated[
        Text | None,
        about(
            'substructure with the hole, or a pattern such as "nut_*", which selects those around the shank, '
            "for example both nuts of a stud"
        ),
    ] = None
    length: Annotated[
        Real | None,
        about("load-bearing length from the mouth of the hole, with `part`; default: the whole overlap", "m", gt=0),
    ] = None
    plain: Annotated[
        Real,
        about(
            "length of the unthreaded shank, whose full section carries: under the head, for a stud in its middle",
            "m",
            ge=0,
        ),
    ] = 0.0
    modulus: Annotated[
        Literal["core", "drawn"],
        about('"core": only the core of the thread carries in the free shank, "drawn": its full section'),
    ] = "core"

    @model_validator(mode="after")
    def _check_thread(self) -> Self:
        if self.size is None and self.part is None:
            raise refusal("a thread has a size or a part", allowed="'size', 'part' or both")
        if self.length is not None and self.part is None:
            raise refusal("'length' needs 'part', the substructure with the hole", value=self.length)
        return self

    @property
    def named(self) -> ThreadSize | None:
        """Its size, None where it has none."""
        if self.size is None:
            return None
        return thread_named(self.size)


def _as_thread(value: object) -> object:
    if isinstance(value, str):
        return {"size": value}
    return value


Thread = Annotated[ThreadTable, BeforeValidator(_as_thread)]


def _check_diameters(pair: tuple[float, float]) -> tuple[float, float]:
    if not 0.0 <= pair[0] < pair[1]:
        raise refusal("no ring", value=list(pair), allowed="[inner, outer], 0 <= inner < outer")
    return pair


Diameters = Annotated[tuple[Real, Real], AfterValidator(_check_diameters)]


Patterns = Text | Annotated[tuple[Text, ...], Field(min_length=1)]


class Bolt(SceneTable):
    """A bolt that is tightened before t = 0, to a force, by a torque or a shortening; then the shortening is kept.

    A torque T gives the force T / (K d) with the nut factor K and the nominal diameter d (Bickford, Introduction to the
    Design and Behavior of Bolted Joints, section 7.1.1), or with coefficients of friction that of VDI 2230-1 (R13/1).
    The shank is cut by a plane across the axis. Where the cut is in the shank does not matter. Its stress is its
    tension over the tensile stress area of `thread` (ISO 898-1), which property classes are about; over the meshed
    section of the cut where no thread is named (a waisted shank). Of a bolt that planes of symmetry cut along its axis,
    `force` is that of the modelled part; torque, thread and yield force are those of the whole screw. With `parts` one
    table stands for many screws, which are named table_part.
    """

    substructure: Annotated[Name, about("name of the [substructure.NAME] table of the shank")] = ""
    parts: Annotated[
        Patterns | None,
        about(
            'several screws instead of one `substructure`: those whose names match "m4_*", or one of several patterns, '
            '["m4_*", "m5_lid"]; the results use the names table_part'
        ),
    ] = None
    axis: Annotated[
        Direction | None,
        about("axis of the shank (length and sense are arbitrary); default: that of its round faces", "1"),
    ] = None
    force: Annotated[Real | None, about("tension of the modelled shank after tightening", "N", gt=0)] = None
    torque: Annotated[
        Real | None, about("tightening torque of the whole screw; its force follows from the next two", "N m", gt=0)
    ] = None
    diameter: Annotated[
        Real | None, about("nominal diameter d of the thread, with `torque`; default: that of `thread`", "m", gt=0)
    ] = None
    nut_factor: Annotated[
        Real | None,
        about("nut factor K, with `torque`; default: 0.2 (0.15 if oiled, with a scatter of a third)", "1", gt=0),
    ] = None
    thread: Annotated[
        Thread | None,
        about(
            'size of the thread, "M6", "M10x1", "1/4-20" (stresses are over its tensile stress area, not the meshed '
            'section), or a table {size = "M6", part = "base", length = 8e-3} that bonds it without an interface'
        ),
    ] = None
    property_class: Annotated[
        PropertyClass | None,
        about('property class, "8.8", "A2-70", "grade 5": its yield stress is the largest mean stress'),
    ] = None
    shank: Annotated[
        Literal["free", "contact"],
        about(
            'for a screw whose thread names a `part`: "free": only the thread of the shank is in contact; "contact": '
            "the shank is included in contact searches, except for a belt around its cut"
        ),
    ] = "free"
    share: Annotated[
        Real | None,
        about(
            "modelled share of the whole screw; default: 1/2 or 1/4 by the symmetry faces along the axis",
            "1",
            gt=0,
            le=1,
        ),
    ] = None
    shortening: Annotated[Real | None, about("shortening of the shank between head and nut", "m", gt=0)] = None
    point: Annotated[
        Vector | None,
        about("point near the shank on the plane of the cut; default: the middle of the thinnest section", "m"),
    ] = None
    hardening: Annotated[
        Real | None,
        about(
            "hardening of the yielding shank: tension per plastic elongation beyond yield_stress times stress area",
            "N m-1",
            ge=0,
        ),
    ] = None
    thread_friction: Annotated[
        Real | None,
        about(
            "friction coefficient mu_G of the thread: with `torque` it gives the force, in place of the nut factor, "
            "and the torsion of assembly; with `force` the torsion of a screw that is tightened by turning",
            "1",
            gt=0,
        ),
    ] = None
    head_friction: Annotated[
        Real | None,
        about("friction coefficient mu_K under the head, with `torque`; default: that of the thread", "1", gt=0),
    ] = None
    head_bearing: Annotated[
        Diameters | None,
        about(
            "inner and outer diameter of the bearing surface under head or washer; default: the area of its seat in "
            "the mesh, and a mean diameter of 1.3 d for the torque",
            "m",
        ),
    ] = None
    nut_bearing: Annotated[
        Diameters | None, about("the same of the nut; default: the area of its seat in the mesh", "m")
    ] = None
    permissible_pressure: Annotated[
        Real | None,
        about("permissible pressure p_G of the clamped part under head and nut; default: none, no margin", "Pa", gt=0),
    ] = None
    clamp_length: Annotated[
        Real | None, about("clamp length l_K; default: that between the ends of the free shank", "m", gt=0)
    ] = None
    rolled: Annotated[
        Literal["before", "after"],
        about('thread rolled "before" or "after" heat treatment, which its fatigue strength depends on'),
    ] = "before"
    order: Annotated[Count, about("bolts are tightened in ascending order, those of one order together", "1", ge=1)] = 1

    def tension(self, share: float) -> float | None:
        """Force that the modelled part of the screw, a ``share`` of it, is tightened to, N; None where its shortening
        is given."""
        if self.torque is not None and self.diameter is not None:
            return share * self.torque / self._lever
        return self.force

    @property
    def _lever(self) -> float:
        """Torque over force, m: K d, or with coefficients of friction that of VDI 2230-1 (R13/1)."""
        assert self.diameter is not None
        thread = self.named_thread
        if self.thread_friction is None or thread is None:
            return (self.nut_factor or NUT_FACTOR) * self.diameter
        lengths = 0.16 * thread.pitch + 0.58 * thread.flank_diameter * self.thread_friction
        under = 0.5 * (self.head_friction or self.thread_friction) * self._bearing
        return self.diameter / thread.diameter * lengths + under

    @property
    def _bearing(self) -> float:
        """Mean diameter D_Km of the bearing surface of the head, m."""
        if self.head_bearing is not None:
            return 0.5 * sum(self.head_bearing)
        return _BEARING * (self.diameter or 0.0)

    def friction_of_thread(self) -> float | None:
        """mu_G of the thread of a screw that is tightened by turning: as given, else what its nut factor means where
        thread and head have the same; None where no torque is known."""
        thread = self.named_thread
        if self.thread_friction is not None or self.torque is None or thread is None or self.diameter is None:
            return self.thread_friction
        mm = self.diameter / thread.diameter
        both = 0.58 * thread.flank_diameter * mm + 0.5 * self._bearing
        return max(0.0, (self._lever - 0.16 * thread.pitch * mm) / both)

    @property
    def size(self) -> str | None:
        """Size of its thread, None where it names none."""
        if self.thread is None:
            return None
        return self.thread.size

    @property
    def named_thread(self) -> ThreadSize | None:
        """Thread that the bolt names by its size, None where it names none."""
        if self.thread is None:
            return None
        return self.thread.named

    def nominal(self, units: UnitSystem) -> float | None:
        """Nominal diameter in these units, m; None where the bolt gives none."""
        named = self.named_thread
        if named is None:
            return self.diameter
        return 1e-3 * named.diameter / units.size("m")

    def thread_area(self, units: UnitSystem) -> float | None:
        """Tensile stress area of its thread in these units, m2; None where it names none."""
        named = self.named_thread
        if named is None:
            return None
        return 1e-6 * named.stress_area / units.size("m2")

    def class_stress(self, units: UnitSystem) -> float | None:
        """Yield stress of its property class in these units, Pa; None where it names none."""
        stress = None
        if self.property_class is not None:
            stress = class_yield(self.property_class)
        if stress is None:
            return None
        return 1e6 * stress / units.size("Pa")


# -- tables that stand for many screws ---
def with_screws(raw: Any) -> tuple[Any, list[Problem]]:
    """The scene as written with a table for every screw of those with ``parts``, and the diameter of the thread where a
    torque needs it; what is wrong with them."""
    tables = named_tables(raw, "bolt")
    bolts, problems = dict[str, Any](), list[Problem]()
    for name, table in tables.items():
        if isinstance(table.get("parts"), str):
            patterns = [table["parts"]]
        else:
            patterns = text_list(table.get("parts"))
        if not patterns:
            bolts[name] = _with_diameter(raw, table)
            continue
        bodies = list(named_tables(raw, "substructure"))
        found = [body for body in bodies if any(fnmatchcase(body, pattern) for pattern in patterns)]
        alone = [pattern for pattern in patterns if not any(fnmatchcase(body, pattern) for body in bodies)]
        for pattern in alone:
            what = "no substructure has a name like this"
            problems.append(Problem(f"bolt.{name}.parts", what, shown(pattern), listed(bodies)))
        if given(table, "substructure"):
            problems.append(Problem(f"bolt.{name}.parts", "given together with 'substructure'", None, "one of them"))
        if alone or given(table, "substructure"):
            bolts[name] = table
            continue
        one = {key: value for key, value in _with_diameter(raw, table).items() if key != "parts"}
        for body in found:
            # names have 100 characters
            bolts[f"{name}_{body}"[:100]] = {**one, "substructure": body}
    if all(bolts.get(name) is table for name, table in tables.items()) or not isinstance(raw, Mapping):
        return raw, problems
    # what is no table is reported by the check of the fields
    rest = {name: value for name, value in raw["bolt"].items() if name not in tables}
    return {**raw, "bolt": {**rest, **bolts}}, problems


def _with_diameter(raw: Any, table: RawTable) -> RawTable:
    """The table with the nominal diameter of its thread where its torque needs one."""
    named = _named(table)
    if named is None or not given(table, "torque") or given(table, "diameter"):
        return table
    return {**table, "diameter": _length(raw, named.diameter)}


def _named(table: RawTable) -> ThreadSize | None:
    """The thread that a bolt as written names."""
    thread = table.get("thread")
    if isinstance(thread, Mapping):
        size = thread.get("size")
    else:
        size = thread
    if isinstance(size, str):
        return thread_named(size)
    return None


def _length(raw: Any, millimetres: float) -> float:
    """A length in the units of the scene, m, as short a number as in mm."""
    system = system_named(raw.get("units"))
    metre = system.size("m")
    return float(f"{1e-3 * millimetres / metre:.12g}")


# -- checks with other tables ---
def _hardening_problems(raw: Any, where: str, bolt: RawTable, body: RawTable) -> Iterator[Problem]:
    """A bolt that yields needs the stress at which it does; fields that do not follow its plastic elongation."""
    if not given(bolt, "hardening"):
        return
    material = body.get("material")
    table: RawTable = {}
    if isinstance(material, str):
        table = named_tables(raw, "material").get(material, {})
    if table and not given(table, "yield_stress"):
        what = "a shank that yields needs the yield stress of its material"
        yield Problem(
            f"material.{material}.yield_stress", what, None, "number, > 0 [Pa]", f"or leave out {where}.hardening"
        )
    for key in ("strain", "nodal_stress"):
        if single_table(raw, "output").get(key) is True:
            what = "strains and stresses at nodes do not follow the plastic elongation of a bolt"
            yield Problem(f"output.{key}", what, None, "output.stress", f"omit it, or {where}.hardening")


def _size_problems(raw: Any, where: str, table: RawTable) -> Iterator[Problem]:
    """Sizes of a thread that contradict each other, or have no unit; a part that is the screw itself."""
    named = _named(table)
    diameter = number(table, "diameter")
    thread = table.get("thread")
    if raw.get("units") == "none":
        for key in ("thread", "property_class"):
            if given(table, key) and (key != "thread" or named is not None):
                what = "a thread has a size in mm, numbers of no unit have none"
                if key != "thread":
                    what = "a class has a stress in MPa, numbers of no unit have none"
                yield Problem(f"{where}.{key}", what, shown(table[key]), 'units other than "none"', "omit it")
    elif named is not None and diameter is not None and diameter > 0.0:
        wanted = _length(raw, named.diameter)
        if abs(math.log(diameter / wanted)) > _SAME_DIAMETER:
            yield Problem(
                f"{where}.diameter",
                f"not the diameter of the thread {_size_text(thread)}",
                f"{diameter:g} {system_named(raw.get('units'))['m']}",
                f"{wanted:g} {system_named(raw.get('units'))['m']}",
                "omit the diameter: it follows from the thread",
            )
    part = entry(thread, "part")
    bodies = list(named_tables(raw, "substructure"))
    if (
        isinstance(part, str)
        and bodies
        and not any(fnmatchcase(b, part) and b != table.get("substructure") for b in bodies)
    ):
        yield Problem(f"{where}.thread.part", "no other substructure has a name like this", shown(part), listed(bodies))
    if table.get("shank") == "contact" and part is None:
        what = "the shank is in contact wherever an interface has it: without thread.part there is nothing to ask for"
        yield Problem(f"{where}.shank", what, "contact", None, "omit it, or name thread.part")


def _size_text(thread: object) -> str:
    if isinstance(thread, Mapping):
        return str(thread.get("size"))
    return str(thread)


def _friction_problems(where: str, table: RawTable) -> Iterator[Problem]:
    """Coefficients of friction that miss what they need, or say the same as the nut factor."""
    if given(table, "thread_friction") and _named(table) is None:
        what = "the friction of a thread needs its size: pitch and diameters are in the formula"
        value = shown(table["thread_friction"])
        yield Problem(f"{where}.thread_friction", what, value, "with 'thread'", "name the thread")
    if given(table, "thread_friction") and given(table, "nut_factor"):
        what = "the nut factor stands for the friction of thread and head"
        yield Problem(f"{where}.nut_factor", what, shown(table["nut_factor"]), "one of the two", "omit one of them")
    if given(table, "head_friction") and not (given(table, "thread_friction") and given(table, "torque")):
        what = "the friction under the head counts with 'torque' and 'thread_friction' alone"
        value = shown(table["head_friction"])
        yield Problem(f"{where}.head_friction", what, value, None, "add both of them, or omit it")


def bolt_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the bolts of a scene as written; the cuts of their shanks are checked with the meshes."""
    substructures = named_tables(raw, "substructure")
    for name, table in named_tables(raw, "bolt").items():
        where, body = f"bolt.{name}", table.get("substructure")
        yield from exactly_one(table, where, "force", "torque", "shortening")
        if not given(table, "parts"):
            yield from exactly_one(table, where, "substructure", "parts")
        yield from _size_problems(raw, where, table)
        for key, need in (("torque", "diameter"), ("nut_factor", "torque")):
            if given(table, key) and not given(table, need):
                what = f"{key!r} needs {need!r}: force = torque / (nut_factor diameter)"
                remedy = f"add {need!r}, or leave {key!r} out"
                if need == "diameter":
                    remedy = "add 'thread', its size, or 'diameter'"
                yield Problem(f"{where}.{key}", what, None, "both of them", remedy)
        yield from _friction_problems(where, table)
        yield from reference_problems(raw, f"{where}.substructure", "substructure", body)
        if not isinstance(body, str) or body not in substructures:
            continue
        yield from _hardening_problems(raw, where, table, substructures[body])
        if substructures[body].get("rigid") is True:
            yield Problem(
                f"{where}.substructure",
                "a rigid body cannot elongate",
                shown(body),
                "an elastic substructure",
                f"omit substructure.{body}.rigid",
            )
        for key in ("initial_velocity", "initial_spin"):
            if moves(substructures[body].get(key)):
                yield Problem(
                    f"{where}.substructure",
                    f"bolts are tightened at rest, before t = 0, and {body} has the {key} {substructures[body][key]}",
                    shown(body),
                    "a substructure that is at rest at t = 0",
                    f"remove substructure.{body}.{key}, or the bolt; if all bodies move like that, give their velocity "
                    "as [motion] velocity, with which a tightened assembly starts",
                )
    if named_tables(raw, "bolt") and chosen_type(single_table(raw, "time"), "start") == "given":
        yield Problem(
            "time.start",
            "bolts are tightened in the static equilibrium that a scene with bolts starts from",
            "given",
            '"static"',
            "omit time.start, or remove the bolts",
        )
