"""``latin-fmu mesh``: a CAD assembly as a mesh and a scene; ``latin-fmu scene``: the scene of a mesh from elsewhere."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ..errors import InputError, MeshError, Problem
from . import CONVERGED, Quiet, Waiting, output_file
from .options import Argument, Option, command

if TYPE_CHECKING:
    from ..cad.cutting import CutPlane
    from ..cad.facts import CadAssembly
    from ..cad.making import MeshJob

_Length = Literal["mm", "cm", "m", "in", "ft", "um"]
Unit = Annotated[
    _Length | None, Option("unit of length of the file (default: the one that it names; .brep names none)")
]
_EXAMPLES = """\
examples:
  latin-fmu mesh bracket.step               bracket.msh, and bracket.toml if it is not there
  latin-fmu mesh bracket.step -o joint      joint.msh, joint.toml
  latin-fmu mesh bracket.step --figure screws.png
  latin-fmu mesh bracket.step --finer 1.5   screws and contacts by smaller edges
  latin-fmu mesh bracket.step --cut y       the half beyond the middle along y
  latin-fmu mesh housing.brep --unit mm
"""


@dataclass(frozen=True, kw_only=True)
class MeshOptions:
    """Options of ``latin-fmu mesh``."""

    file: Annotated[Path, Argument("CAD file (.step, .stp, .brep, .iges)", "ASSEMBLY.step")]
    output: Annotated[
        Path | None,
        Option("name of mesh and scene (default: that of the file, in the current folder)", "NAME", "-o", output_file),
    ] = None
    unit: Unit = None
    size: Annotated[float | None, Option("largest edge, mm (default: by the thickness of each part)", "MM")] = None
    finer: Annotated[float, Option("factor by which edges at screws and contacts are smaller", "FACTOR")] = 1.0
    contacts: Annotated[int, Option("unknowns of contacts to aim at, by larger edges there", "N")] = 4000
    max_cpu: Annotated[float, Option("processor time, at most, s", "SECONDS")] = 600.0
    cut: Annotated[
        tuple[str, ...],
        Option("plane of symmetry: half of the model is meshed, that of larger coordinates; may be repeated", "y[=MM]"),
    ] = ()
    figure: Annotated[Path | None, Option("picture of the screws here: png, pdf or svg", "FILE", read=output_file)] = (
        None
    )
    quiet: Quiet = False


@command(_EXAMPLES)
def mesh(options: MeshOptions) -> int:
    """Mesh a CAD assembly, part by part, and write a scene with its materials, contacts and screws to go on with."""
    from ..cad.making import MeshJob
    from ..cad.meshing import MeshWishes
    from ..cad.record import changes, read_record
    from ..cad.report import report_lines
    from ..mesh_files.formats import MESHED

    file = options.file
    planes = _check(options)
    target = _stem(options.output or Path(file.stem))
    before = read_record(target.with_suffix(".parts.json"))
    draft = target.with_name(f".{target.name}.{os.getpid()}{MESHED}")
    wishes = MeshWishes(options.size, options.finer, options.contacts)
    parts = tuple(before.whole or before.parts) if before is not None else ()
    job = MeshJob(file.absolute(), draft.absolute(), options.unit, wishes, parts, planes)
    try:
        with Waiting(f"meshing {file.name}", quiet=options.quiet):
            assembly = _in_process(job, options.max_cpu)
        # in one piece: a run may read it at the same time
        draft.replace(target.with_suffix(MESHED))
    finally:
        with suppress(OSError):
            draft.unlink()
    lines = report_lines(assembly)
    if before is not None:
        changed = list(changes(before, assembly))
        lines += [f"since it was read before: {len(changed) or 'no'} change{'s' * (len(changed) != 1)}"]
        lines += [f"  {line}" for line in changed]
    lines += _written(assembly, target, wishes.touch)
    if options.figure is not None:
        from ..pictures.screw_picture import screw_figure
        from ..pictures.style import save_figure

        save_figure(screw_figure(assembly), options.figure)
        lines.append(f"screws: {options.figure}")
    print("\n".join(lines))
    return CONVERGED


_OF_MESHES = """\
examples:
  latin-fmu scene bracket.msh               bracket.toml
  latin-fmu scene data/bracket.vtu -o joint --unit mm
  latin-fmu scene deck.inp --part base --part lid
"""


@command(_OF_MESHES)
def scene(
    file: Annotated[Path, Argument("mesh file of any format that a scene may name", "MESH")],
    output: Annotated[
        Path | None,
        Option("name of the scene (default: that of the mesh, in the current folder)", "NAME", "-o", output_file),
    ] = None,
    unit: Annotated[
        _Length | None, Option("unit of length of the file (default: the one that it names, else by its size)")
    ] = None,
    parts: Annotated[
        tuple[str, ...],
        Option("volume group that is a part; may be repeated (default: those that share the cells)", "GROUP", "--part"),
    ] = (),
) -> int:
    """Write a scene of a mesh to go on with: a material for each part, contacts, a support; never over one that is
    there."""
    from ..cad.from_mesh import assembly_of_mesh, sketch_of_mesh
    from ..cad.report import report_lines
    from ..cad.scene_text import scene_text
    from ..mesh_files.reading import read_content
    from ..results.writing import check_target
    from ..scene.substructures import part_name

    target = _stem(output or Path(file.stem))
    check_target(target.with_suffix(".toml"))
    if not file.is_file():
        raise InputError.of("bad argument", str(file), "no such file")
    content = read_content(file)
    assembly = assembly_of_mesh(content, file.name, part_name(target.name), unit, parts)
    relative = _relative(file, target.parent)
    text = scene_text(sketch_of_mesh(assembly, content, target.name, relative, parts))
    print("\n".join([*report_lines(assembly), *_with_scene(target, text)]))
    return CONVERGED


def _relative(file: Path, folder: Path) -> str:
    """A file as a scene of this folder names it."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive
        return file.absolute().as_posix()


def _check(options: MeshOptions) -> list[CutPlane]:
    """Refuse what is no CAD file, and numbers that are not above zero; the planes of symmetry.

    Raises
    ------
    InputError : with all that is wrong.
    """
    from ..cad.cutting import cut_plane
    from ..cad.geometry import SUFFIXES
    from ..pictures.style import check_figure_path
    from ..results.writing import check_target

    file, numbers = options.file, {name: getattr(options, name) for name in ("size", "finer", "contacts", "max_cpu")}
    problems = [
        Problem(f"--{name.replace('_', '-')}", "not a number above zero", f"{value:g}")
        for name, value in numbers.items()
        if value is not None and not 0.0 < value < float("inf")
    ]
    if not file.is_file():
        problems.append(Problem(str(file), "no such file"))
    elif file.suffix.lower() not in SUFFIXES:
        remedy = f"of a mesh: latin-fmu scene {file}"
        problems.append(Problem(str(file), "no CAD file", file.suffix or None, ", ".join(SUFFIXES), remedy))
    planes = []
    for text in options.cut:
        try:
            planes.append(cut_plane(text))
        except ValueError:
            problems.append(Problem("--cut", "no plane", text, "x, y or z, or with its coordinate in mm: y=12.5"))
    if len({plane.axis for plane in planes}) < len(planes):
        problems.append(Problem("--cut", "two planes across one axis", " ".join(options.cut), "one along each axis"))
    if problems:
        raise InputError(problems, "bad argument")
    if options.figure is not None:
        check_figure_path(options.figure)
        check_target(options.figure)
    return planes


def _stem(output: Path) -> Path:
    """The name without a suffix of a mesh or a scene, as a path to which suffixes are added."""
    from ..mesh_files.formats import MESHED

    if output.suffix.lower() in (MESHED, ".toml"):
        return output.with_suffix("")
    if "." in output.name:
        # with_suffix would take the rest of the name for one
        return output.with_name(output.name.replace(".", "_"))
    return output


def _in_process(job: MeshJob, seconds: float) -> CadAssembly:
    """Mesh in a process of its own, with limits.

    Raises
    ------
    MeshError : see ``mesh_assembly``; the process dies or takes too long.
    """
    from ..cad.making import mesh_assembly
    from ..machine import memory_room
    from ..mesh_files.child import Limits, in_child
    from ..results.writing import check_target

    check_target(job.target)

    def refused(what: str) -> MeshError:
        remedy = "simplify the parts in CAD, mesh with larger edges (--size), or allow more time (--max-cpu)"
        return MeshError.of("not meshed", job.source.name, f"the process of gmsh {what}", remedy=remedy)

    free, _ = memory_room()
    return in_child(mesh_assembly, job, Limits(seconds, int(max(free, 4e9))), refused)


def _written(assembly: CadAssembly, target: Path, touch: float) -> list[str]:
    """Write record and scene; never over a scene that is there with another text."""
    from ..cad.record import record_text
    from ..cad.scene_text import scene_text, sketch_of
    from ..mesh_files.formats import MESHED
    from ..results.writing import write_bytes

    write_bytes(target.with_suffix(".parts.json"), record_text(assembly).encode())
    text = scene_text(sketch_of(assembly, target.name, f"{target.name}{MESHED}", touch))
    return [f"mesh: {target.with_suffix(MESHED)}", *_with_scene(target, text)]


def _with_scene(target: Path, text: str) -> list[str]:
    """Write a scene, or one beside it where it is there with another text; what is said of it.

    Raises
    ------
    SceneError : what was written cannot be used as a scene.
    """
    from ..reader import load_scene
    from ..results.writing import write_bytes

    scene, new = target.with_suffix(".toml"), target.with_suffix(".new.toml")
    if not scene.is_file():
        write_bytes(scene, text.encode())
        load_scene(scene)
        return [f"scene: {scene}; next: fill in what is marked (?), latin-fmu check {scene}"]
    if scene.read_text(encoding="utf-8", errors="replace") == text:
        load_scene(scene)
        return [f"scene: {scene}, as it was"]
    write_bytes(new, text.encode())
    load_scene(new)
    lines = [f"scene: {scene} is yours and stays; what would be written now: {new}"]
    try:
        load_scene(scene)
    except InputError as error:
        lines += ["the scene does not fit the mesh any more:", *(f"  {problem}" for problem in error.problems)]
    return lines
