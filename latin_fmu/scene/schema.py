"""The scene: everything the user describes, checked as a whole."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Self

from pydantic import BaseModel, Field, PrivateAttr, ValidationError, ValidationInfo, model_validator
from pydantic.functional_validators import ModelWrapValidatorHandler

from ..errors import Problem, SceneError, shown
from .attachments import CouplingTable, PointMass, Spring, attachment_problems, joints_of
from .body_loads import BODY_LOADS, BodyLoad, body_loads_of
from .bolts import Bolt, bolt_problems, with_screws
from .boundaries import Boundary, Periodic, boundary_problems
from .damping import DampingTable
from .describe import is_named, path_text, validation_problems
from .fields import BodyName, Name, SceneTable, Text, about, entry, split_face, units_in
from .histories import history_problems
from .initial_fields import InitialStateTable, field_problems
from .interfaces import MEANINGLESS, ContactSearch, Interface, interface_problems
from .laws import TimeLaw, base_dir_of
from .limits import Limit, limit_problems, range_problems, useless_keys
from .loads import Load, load_problems, load_unit
from .materials import MaterialTable, material_problems
from .overrides import apply_overrides, no_number, number_at, with_value
from .ports import Port, port_laws, port_problems
from .random_bases import random_problems, with_durations, without_durations
from .raw_scene import named_tables, oversized_integers, plain, single_table
from .sensors import Sensor, sensor_problems
from .settings import Accuracy, Effects, Fmu, Output, Solver, Time, settings_problems, with_defaults
from .spread import Distribution, SpreadTable, flat, spread_problems
from .substructures import (
    Gravity,
    MeshParts,
    Motion,
    RotationTable,
    Substructure,
    Temperature,
    rotation_problems,
    substructure_problems,
    temperature_problems,
)
from .unit_texts import names_for, si_unit, words_for
from .unit_values import Misfit, in_scene_units, value_in_scene_units
from .units import SystemName, UnitSystem, system_named

WITHOUT_MESHES: Final = "without_meshes"
"""Key of the context of a scene whose mesh files may be away."""


def toml_text(data: Mapping[str, Any]) -> str:
    """TOML of a scene: plain values first, then [table] and [table.name]; deeper tables stay inline."""
    blocks = ["\n".join(_line(key, value) for key, value in data.items() if not isinstance(value, Mapping))]
    for key, value in data.items():
        if not isinstance(value, Mapping):
            continue
        if value and all(isinstance(item, Mapping) for item in value.values()) and key not in _SINGLE:
            blocks += [_block(f"{key}.{name}", table) for name, table in value.items()]
        elif value:
            blocks.append(_block(key, value))
    return "\n\n".join(blocks) + "\n"


_SINGLE = ("gravity", "damping", "motion", "initial_state", "time", "solver", "output", "accuracy", "fmu")


def _block(header: str, table: Mapping[str, Any]) -> str:
    return "\n".join([f"[{header}]", *(_line(key, value) for key, value in table.items())])


def _line(key: str, value: Any) -> str:
    return f"{key} = {toml_value(value)}"


def toml_value(value: Any) -> str:
    """One value on one line."""
    # before int, of which bool is a kind
    if isinstance(value, bool):
        if value:
            return "true"
        return "false"
    if isinstance(value, (int, float)):
        # the shortest text that is read back as the same number
        return repr(value)
    if isinstance(value, str):
        # JSON and TOML escape alike, but for DEL, which JSON leaves as it is
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{" + ", ".join(_line(key, item) for key, item in value.items()) + "}"
    return "[" + ", ".join(toml_value(item) for item in value) + "]"


_HEADING = "the scene cannot be used"


def _of_parts(problem: Problem) -> bool:
    """Whether a problem comes from parts that could not be had: no substructures or materials, or incomplete ones, or
    bolts with patterns of parts."""
    if problem.where.startswith("bolt.") and problem.where.endswith(".substructure") and not problem.value:
        return True
    return problem.what == "this key is missing" and problem.where.startswith(("substructure", "material"))


def _with_numbers(root: type[BaseModel], raw: Any) -> tuple[Any, list[Problem]]:
    """The scene with numbers in its units in the place of texts such as "5.5 N m", and what is wrong with texts."""
    if not isinstance(raw, Mapping):
        return raw, []
    system = system_named(raw.get("units"))
    tables, misfits = in_scene_units(root, raw, system)
    problems = [Problem(path_text(m.place), m.what, m.value, m.allowed, m.remedy) for m in misfits]
    spread = flat(single_table(raw, "spread"))
    numbers: dict[str, Any] = {}
    for name, written in spread.items():
        many = isinstance(written, list | tuple)
        items = [written]
        if many:
            items = list(written)
        found = [_spread_number(root, raw, name, item, system) for item in items]
        wrong = [misfit for _, misfits in found for misfit in misfits]
        problems += [Problem(f"spread.{name}", m.what, m.value, m.allowed, m.remedy) for m in wrong]
        if not wrong:
            values = [value for value, _ in found]
            if many:
                numbers[name] = values
            else:
                numbers[name] = values[0]
    if numbers != spread:
        tables = {**tables, "spread": numbers}
    return tables, problems


def _spread_number(
    root: type[BaseModel], raw: Any, name: str, written: Any, system: UnitSystem
) -> tuple[Any, list[Misfit]]:
    """A number of a spread in the units of what scatters; a share of the value stays as it is."""
    if not isinstance(written, str) or written.strip().endswith("%"):
        return written, []
    return value_in_scene_units(root, raw, name, written, system)


def _with_parts(raw: Any, base_dir: Path, context: Any) -> tuple[Any, list[Problem]]:
    """The scene with the parts of its mesh files as substructures, by the reader that the context names."""
    reader = entry(context, "with_parts")
    if reader is not None:
        written, problems = reader(raw, base_dir)
        return written, problems
    remedy = "make the scene with load_scene or scene_from_dict"
    files = {"mesh": "mesh", "initial_state": "results"}
    unread = [key for key in files if isinstance(raw, Mapping) and raw.get(key)]
    return raw, [Problem(key, f"{files[key]} files are not read here", remedy=remedy) for key in unread]


def _in_unknown_units(raw: Any, context: Any) -> list[Problem]:
    """Files with named units in a scene that is not in SI and not made by the reader, which hands its system on."""
    system = system_named(entry(raw, "units"))
    if system is units_in(context):
        return []
    what, remedy = "units of files are not converted here", "make the scene with load_scene or scene_from_dict"
    return [Problem(where, what, system.name, remedy=remedy) for where in _units_named(raw)]


def _units_named(raw: Any, where: str = "") -> Iterator[str]:
    """Keys of a scene as written that name units of files."""
    if not isinstance(raw, Mapping):
        return
    for key, value in raw.items():
        if isinstance(value, Mapping):
            yield from _units_named(value, f"{where}{key}.")
        elif key in ("value_unit", "length_unit", "unit") and isinstance(value, str) and value != "1":
            yield f"{where}{key}"


_UNITS_OF: Final = {"velocity": "m s-1", "displacement": "m", "acceleration": "m s-2"}  # by type of boundary


def _laws(raw: Any) -> Iterator[tuple[str, Any, str | None]]:
    """Place of every law, the law as written, and the unit of what it multiplies."""
    for name, load in named_tables(raw, "load").items():
        yield f"load.{name}.law", load.get("law"), load_unit(load)
    for name, boundary in named_tables(raw, "boundary").items():
        yield f"boundary.{name}.law", boundary.get("law"), _UNITS_OF.get(str(boundary.get("type")))
    yield from port_laws(raw)
    for name, interface in named_tables(raw, "interface").items():
        ground = single_table(interface, "ground_velocity")
        yield f"interface.{name}.ground_velocity.law", ground.get("law"), "m s-1"
    for kind in BODY_LOADS:
        yield from ((place, law, kind.unit) for place, law in kind.written_laws(raw))


def _unit_problems(raw: Any) -> Iterator[Problem]:
    """Units of laws that are not those of what the law multiplies."""
    for where, law, unit in _laws(raw):
        name = entry(law, "value_unit")
        quantity = None
        if isinstance(name, str):
            quantity = si_unit(name)
        if quantity not in (None, "1") and not system_named(raw.get("units")).measurable:
            yield Problem(
                f"{where}.value_unit", "the numbers of the scene have no units", shown(name), "1, or a factor"
            )
            continue
        if quantity is not None and unit is not None and quantity not in (unit, "1"):
            what = f"{words_for(quantity)}, but the law multiplies {words_for(unit)}"
            yield Problem(f"{where}.value_unit", what, shown(name), f"{names_for(unit)}, {names_for('1')}")


_CHECKS: Final = (
    material_problems,
    interface_problems,
    boundary_problems,
    load_problems,
    rotation_problems,
    temperature_problems,
    bolt_problems,
    _unit_problems,
    sensor_problems,
    limit_problems,
    port_problems,
    attachment_problems,
    settings_problems,
    field_problems,
)


def _relation_problems(raw: Any, base_dir: Path | None) -> list[Problem]:
    """All problems between keys and tables of a scene as written, so that one message lists everything, beside those of
    single fields: a value that is wrong by itself is ignored here. base_dir : of mesh files, None: they may be away."""
    return [*substructure_problems(raw, base_dir), *(problem for check in _CHECKS for problem in check(raw))]


def faces_of(boundary: Boundary) -> tuple[str, ...]:
    """Faces that a boundary condition names."""
    if isinstance(boundary, Periodic):
        return tuple(boundary.faces)
    return (boundary.face,)


class Scene(SceneTable):
    """A scene; building one, from a file or in Python, raises `SceneError` listing every problem found.

    The named tables are dictionaries by name. Files named in it are relative to `base_dir`.

    Examples
    --------
    >>> from latin_fmu import tables
    >>> steel = tables.Material(young_modulus=210e9, poisson_ratio=0.3, density=7800.0)
    >>> box = tables.Box(size=(0.02, 0.02, 0.02), elements=(4, 4, 4))
    >>> cube = tables.Substructure(material="steel", box=box)
    >>> push = tables.Load(face="cube.zmax", pressure=1e6)
    >>> time = tables.Time(end=40e-6, step=0.5e-6)
    >>> scene = latin_fmu.Scene(
    ...     name="one", material={"steel": steel}, substructure={"cube": cube}, load={"push": push}, time=time
    ... )
    >>> latin_fmu.solve(scene).converged
    True
    """

    name: Annotated[Name, about("name of the scene")]
    description: Annotated[Text, about("free text")] = ""
    units: Annotated[SystemName, about("system of units of all numbers: labels results, scales checks")] = "SI"
    material: Annotated[dict[Name, MaterialTable], about("materials by name"), Field(min_length=1)]
    mesh: Annotated[
        dict[Name, MeshParts], about("mesh files with several parts; the effective scene has them as substructures")
    ] = Field(default_factory=dict)
    substructure: Annotated[dict[BodyName, Substructure], about("substructures by name"), Field(min_length=1)]
    damping: Annotated[
        DampingTable | None, about("damping ratio of all materials, springs and elastic layers without their own")
    ] = None
    interface: Annotated[dict[Name, Interface], about("interfaces by name")] = Field(default_factory=dict)
    contact: Annotated[
        dict[Name, ContactSearch], about("interfaces found between boundaries, by name of the search")
    ] = Field(default_factory=dict)
    boundary: Annotated[dict[Name, Boundary], about("boundary conditions by name")] = Field(default_factory=dict)
    load: Annotated[dict[Name, Load], about("loads by name")] = Field(default_factory=dict)
    point_mass: Annotated[dict[Name, PointMass], about("masses at points and on faces, by name")] = Field(
        default_factory=dict
    )
    gravity: Annotated[Gravity | None, about("acceleration acting on every body")] = None
    motion: Annotated[Motion | None, about("initial velocity of the assembly at t = 0")] = None
    rotation: Annotated[dict[Name, RotationTable], about("rotations of bodies by name")] = Field(default_factory=dict)
    temperature: Annotated[dict[Name, Temperature], about("changes of temperature by name")] = Field(
        default_factory=dict
    )
    bolt: Annotated[dict[Name, Bolt], about("bolts by name")] = Field(default_factory=dict)
    spring: Annotated[dict[Name, Spring], about("springs and dashpots by name")] = Field(default_factory=dict)
    coupling: Annotated[dict[Name, CouplingTable], about("couplings by name")] = Field(default_factory=dict)
    sensor: Annotated[dict[Name, Sensor], about("sensors by name")] = Field(default_factory=dict)
    limit: Annotated[dict[Name, Limit], about("limits by name, that the run is judged by")] = Field(
        default_factory=dict
    )
    port: Annotated[dict[Name, Port], about("faces connected to other models, by name")] = Field(default_factory=dict)
    initial_state: Annotated[InitialStateTable | None, about("initial state of bodies from an earlier run")] = None
    time: Annotated[Time, about("interval, instants, time scheme")]
    solver: Annotated[Solver, about("settings of the iteration")] = Solver()
    output: Annotated[Output, about("contents of the results")] = Output()
    accuracy: Annotated[Accuracy, about("error estimate of a run, target accuracy")] = Accuracy()
    effects: Annotated[Effects, about("effects of second order")] = Effects()
    fmu: Annotated[Fmu, about("author, version, copyright and licence of an FMU of the scene")] = Fmu()
    spread: Annotated[
        SpreadTable,
        about(
            "table [spread]: how numbers of the scene scatter, independently of each other, by their dotted names as "
            'in `--set`: standard deviation, the same as a share of the value ("5 %"), or the ends [low, high] of a '
            "range in which all values are equally likely. A run has the bands of its results at 95 %, to first order",
            "unit of the number",
        ),
    ] = Field(default_factory=dict)

    _base_dir: Path = PrivateAttr(default=Path())
    _context: dict[str, Any] = PrivateAttr(default_factory=dict)  # what its files are read with

    @model_validator(mode="wrap")
    @classmethod
    def _report_all_problems(cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        """Field errors and contradictions between fields in one `SceneError`."""
        raw = plain(data)
        # first: Python does not print such integers, as the messages below would
        if oversized := [Problem(path_text(path), "too large for a number") for path in oversized_integers(raw)]:
            raise SceneError(oversized, _HEADING)
        base_dir = base_dir_of(info.context)
        if isinstance(data, Scene):
            base_dir = data.base_dir
        # where mesh files must be; a scene that is read for its tables alone does without
        mesh_dir = None if entry(info.context, WITHOUT_MESHES) else base_dir
        numbers, unreadable = _with_numbers(cls, raw)
        places = {problem.where for problem in unreadable}
        written, unread = _with_parts(numbers, base_dir, info.context)
        written, unmatched = with_screws(written)
        unreadable += [*unread, *_in_unknown_units(raw, info.context), *unmatched]
        try:
            completed = with_durations(with_defaults(written))
            if completed is raw:
                scene = handler(data)
            else:
                scene = handler(completed)
        except ValidationError as error:
            problems = [p for p in validation_problems(cls, error, written) if p.where not in places]
            if named_tables(written, "mesh"):  # its parts are not known, so neither are names and faces
                problems = [p for p in problems if not _of_parts(p)] + unreadable
            else:
                problems += _relation_problems(written, mesh_dir) + unreadable
            raise SceneError(problems, _HEADING) from None
        problems = unreadable or _relation_problems(written, mesh_dir)
        problems = problems or history_problems(scene) + range_problems(scene.limit, scene.time.time_step)
        problems = problems or list(random_problems(scene)) or _named_numbers(scene)
        if problems:
            raise SceneError(problems, _HEADING)
        scene._base_dir = base_dir
        scene._context = dict(info.context or {})
        if isinstance(data, Scene):
            scene._context = data._context
        return scene

    def replace(self, key: str, value: Any) -> Self:
        """The scene with the value of one key, for instance ``scene.replace("solver.tolerance", 1e-4)``.

        Parameters
        ----------
        key : as in the file, tables and names joined by dots; a number picks an item of a list. value : as in the file,
            or a table of ``latin_fmu.tables``. Files of parts and of an initial state are read already: what belongs to
            ``mesh`` and ``initial_state`` is set by ``load_scene(path, ["mesh.joint.scale=2e-3"])``.

        Raises
        ------
        SceneError : the key or the value does not fit, with every problem.

        Examples
        --------
        >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
        >>> scene.replace("time.instants", 800).replace("output.energy", True).time.instants
        800
        """
        if (first := key.partition(".")[0]) in ("mesh", "initial_state"):
            remedy = 'set it when the scene is read: load_scene(path, ["mesh.joint.scale=2e-3"])'
            problem = Problem(key, f"the files of {first!r} are read already", remedy=remedy)
            raise SceneError([problem], "the scene cannot be changed")
        return self.model_validate(with_value(self.tables(), key, value, NAMED), context=self._context)

    def __eq__(self, other: object) -> bool:
        """Whether all keys and the folder are equal; how the files were read does not count."""
        same = isinstance(other, Scene) and self.base_dir == other.base_dir
        return same and self.__dict__ == other.__dict__

    @property
    def base_dir(self) -> Path:
        """Folder that mesh and law files are relative to."""
        return self._base_dir

    @property
    def unit_system(self) -> UnitSystem:
        """Units of all numbers of the scene and of its results, and how accelerations are shown."""
        return system_named(self.units, self.output.acceleration == "g")

    @property
    def force_laws(self) -> dict[str, TimeLaw]:
        """Laws of all that acts by forces on nodes: loads by their name (see ``loads``), ``body_force.SUBSTRUCTURE``,
        ``gravity.acceleration``, ``rotation.NAME`` and ``temperature.NAME``; a name without dot is a load."""
        laws: dict[str, TimeLaw] = {name: load.law for name, load in self.loads.items()}
        return laws | {load.name: load.law for load in self.body_loads}

    @property
    def body_loads(self) -> list[BodyLoad]:
        """Loads of whole bodies that multiply their laws by anything."""
        return [load for load in body_loads_of(self) if load.kind.acts(load.table)]

    @property
    def standing(self) -> list[str]:
        """What loads or moves bodies beside laws over time, in words."""
        words = [f"bolt {name}" for name in self.bolt]
        if self.thrown:
            words += ["motion of all bodies"]
        # 1 m2: whether there is any
        words += [f"preload of {name}" for name, joint in self.joints.items() if joint.initial_pressure(1.0)]
        return words + [f"initial motion of {name}" for name, body in self.substructure.items() if body.initial_keys]

    @property
    def thrown(self) -> bool:
        """Whether all substructures start with a common velocity."""
        return self.motion is not None and any(self.motion.velocity)

    def moving(self, substructure: str) -> Substructure:
        """A substructure whose initial velocity has that of the whole assembly added."""
        table = self.substructure[substructure]
        if self.motion is None or not self.thrown:
            return table
        velocity = tuple(a + b for a, b in zip(table.initial_velocity, self.motion.velocity, strict=True))
        return table.model_copy(update={"initial_velocity": velocity})

    @property
    def loads(self) -> dict[str, Load]:
        """Loads by name, and those that act through ports, by the names of ``Port.inputs``."""
        loads = dict(self.load)
        for name, port in self.port.items():
            loads |= port.loads(name)
        return loads

    @property
    def differentiated(self) -> tuple[str, ...]:
        """Numbers that results are differentiated by: those of ``output.sensitivities``, then those that scatter."""
        return tuple(dict.fromkeys((*self.output.sensitivities, *self.spread)))

    @property
    def undifferentiated(self) -> Self:
        """The scene for a run without derivatives by parameters, and without bands."""
        output = self.output.model_copy(update={"sensitivities": ()})
        return self.model_copy(update={"output": output, "spread": {}})

    @property
    def distributions(self) -> dict[str, Distribution]:
        """Distributions of the numbers in ``spread``, by name."""
        tables = {}
        if self.spread:
            tables = self.tables()
        return {name: Distribution.of(number_at(tables, name) or 0.0, d) for name, d in self.spread.items()}

    def boundaries_of(self, substructure: str) -> dict[str, Boundary]:
        """Boundary conditions on the faces of a substructure."""
        return {n: b for n, b in self.boundary.items() if split_face(faces_of(b)[0])[0] == substructure}

    def temperatures_of(self, substructure: str) -> dict[str, Temperature]:
        """Changes of temperature of a substructure, by their names in ``force_laws``."""
        described = self.substructure[substructure]
        temperatures = [load for load in self.body_loads if load.kind.strains and load.acts_on(substructure, described)]
        return {load.name: load.table for load in temperatures}

    def ports_of(self, substructure: str) -> dict[str, Port]:
        """Ports on the faces of a substructure."""
        return {name: port for name, port in self.port.items() if port.body == substructure}

    @property
    def joints(self) -> dict[str, Interface]:
        """Interfaces, and those that stand for springs and couplings, by name."""
        damped = any(interface.damping_ratios is not None for interface in self.interface.values())
        if self.spring or self.coupling or damped:
            return joints_of(self)
        return self.interface

    def text(self) -> str:
        """The effective scene as TOML, defaults written out; reading it back gives an equal scene."""
        return toml_text(self.tables())

    def tables(self) -> dict[str, Any]:
        """The effective scene as tables (fresh ones), of the shape that ``scene_from_dict`` reads."""
        # TOML has no value for None
        return _without_meaningless(self.model_dump(exclude_none=True))


def _without_meaningless(data: dict[str, Any]) -> dict[str, Any]:
    """Tables of a scene, in place, without the defaults of keys that mean nothing beside the others."""
    for table in (*data["interface"].values(), *data["contact"].values()):
        for key in MEANINGLESS.get(table["behaviour"], ()):
            table.pop(key, None)
    without_durations(data)
    for table in data["limit"].values():
        for key in useless_keys(table):
            table.pop(key, None)
    return data


def _named_numbers(scene: Scene) -> list[Problem]:
    """Problems of the numbers that [spread] and ``fmu.parameters`` name."""
    problems: list[Problem] = []
    if scene.spread:
        problems = list(spread_problems(scene.spread, scene.tables()))
    if scene.fmu.parameters and not problems:
        tables = scene.tables()
        missing = [name for name in scene.fmu.parameters if number_at(tables, name) is None]
        problems = [no_number("fmu.parameters", tables, name) for name in missing]
    return problems


NAMED: Final = frozenset(key for key, field in Scene.model_fields.items() if is_named(field))
"""Keys of a scene whose tables have names."""


def with_settings(data: Mapping[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """A copy of the tables of a scene with settings ``a.b.c=value`` applied in order.

    Raises
    ------
    SceneError : with every setting that cannot be applied.
    """
    return apply_overrides(data, settings, NAMED)


def straining_loads(scene: Scene) -> frozenset[str]:
    """Names of loads that strain free bodies and move none."""
    return frozenset(load.name for load in scene.body_loads if load.kind.strains)
