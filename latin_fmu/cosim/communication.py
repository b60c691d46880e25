"""A run whose communication steps are kernels, and its image as one file that any program can map or read.

The file holds records and blocks as the kernels take them, but for the bytes of the fixed block: of every ``PLANE``
words the first bytes come first, then the second ones, ... A factor in a zip is 8 % smaller so. Tables that are
products of others have zeros in their place, and their factors stand at the end (``product_tables``).

Little endian throughout. Numbers are counted in words of 8 bytes; a place is the number of a word in the moving block.

======================  ==============================================================================================
bytes                   content
======================  ==============================================================================================
0 to 7                  ``LATINIMG``
8 to 8 + 8 x 32         int64 words, ``WORDS`` in their order, zeros behind them
264 to 264 + 8 x 8      float64 words, ``NUMBERS`` in their order, zeros behind them
from 328 on             the record of the run, the records of the classes, those of the groups (each array padded to
                        8 bytes), the fixed block by planes, the moving block, the products
======================  ==============================================================================================

The entry of the library of kernels, ``kernels_entries_call_0(slots, result)``, takes slots of 8 bytes: nine arrays,
each an address and a length (run 1, classes, groups, fixed block as float64, int64, uint32, float32, moving block as
float64, int64; uint32 and float32 have twice as many numbers), then five int64: action, a, b, c, d. It writes one int64
and returns 0. The fixed block and the records are read only: instances share them. All that the next step depends on
are the first ``n_state`` words of the moving block.

``COMMUNICATE`` (a time steps to make, at most ``most_steps``; b rule of interpolation; c time steps of the
communication step made before; d time steps of the whole one) reads value and rate of the inputs, which stay the same
during a communication step, and returns the time steps that converged, or a negative status
(``kernels.communication``). After fewer than a the state is that after those which converged: the caller goes on from
it with the next time step, by a copy of the record of the run without differences and with a relaxation of 1/2, or
restores the state before. After a negative status, or where that time step stalls too, it restores it. ``PLACE`` before
it returns d for a communication step of any length, which may be 0: the step of none has to be made, too. ``PRESENT``
puts the present outputs into row 0; where no time step has been made it begins the simulation with the inputs as they
are, held; a second call (a rule, b = 1) gives the outputs at t = 0 as a first time step by this rule would have them.
``DERIVE`` (a 2 e for the value, 2 e + 1 for the rate of the input e; b rule; c time steps that the communication step
ended after; d of the whole one) needs a copy of the record of the run, and a moving block with as many numbers behind
it as it returns for a = -1, with inputs, place and state before the step: it writes the derivatives of the outputs at
the end into row 0 (``kernels.derivatives``).
``FIELDS`` (a row of the last call) gathers what describes the points of the interfaces at that instant: of one
interface after the other tractions (n_point, 3), velocities (2, n_point, 3), and where it can open gaps and contact
states (n_point,), global axes.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, NeedsPythonError, Problem
from ..kernels import entries
from ..kernels.entries import Pools
from ..kernels.records import CLASS, GROUP, RUN
from ..latin.outcome import Array, Timings
from ..latin.recorder import Recorder
from ..latin.run_image import all_in_kernels
from ..latin.windows import Run
from ..machine import one_thread
from ..propagator.image import Image, pools_of
from ..propagator.layout import COMMUNICATION_ROWS
from ..scene.schema import Scene
from .drives import Drives, Sources, history_fields, opening_fields
from .output_table import measured
from .product_tables import multiply, settled, shorten, without
from .segments import SegmentedRun
from .signals import Signals

MAGIC: Final = b"LATINIMG"
VERSION: Final = 3
PLANE: Final = 1 << 16
WORDS: Final = (
    "version",
    "run_size",  # bytes of the record of the run
    "n_class",
    "class_size",  # bytes of one record
    "n_group",
    "group_size",
    "n_fixed",  # words of the fixed block
    "n_moving",
    "n_state",
    "n_input",
    "n_output",
    "n_row",  # rows of outputs, fields and drives
    "most_steps",  # of one call
    "input_value",  # places: (n_input,)
    "input_rate",
    "output",  # (n_row, n_output)
    "progress",  # (9,), see ``kernels.communication``; the caller may set number 6
    "last_step",  # time steps that laws of the scene are tabulated for, -1 where any number can be made
    "n_field",
    "field",  # (n_field,) of the points of the interfaces, after FIELDS
    "communicate",  # number of the action
    "present",
    "fields",
    "run_digest",  # of the names of the fields of the records
    "of_event",  # place of the outputs of contact events: pairs of a count and an instant
    "place",  # (3,) of the next communication step, for PLACE
    "placing",  # number of the action
    "derive",
    "depth_at",  # byte of the number of differences of the acceleration in the record of the run
    "relaxation_at",  # likewise of the relaxation
    "n_product",  # words of the products
)
"""Words of the header."""
NUMBERS: Final = ("dt", "end")
"""Time step and end of the scene, s."""
_N_WORD, _N_NUMBER = 32, 8


class CommunicationRun:
    """A run advanced by communication steps in one call of the kernels each.

    Parameters
    ----------
    scene : with names for its interfaces (``assembly.interfaces.completed``). tolerance : replaces that of the scene.
    python : whether Python is there when steps are made: the kernels call out for laws and factors that they do not
        hold, and have the threads of the scene.

    Attributes
    ----------
    image : of the run. sources, drives : inputs and own laws. steps : time steps that one call can make at most.
    problem : what is solved. products : tables of the image that a file leaves out.

    Raises
    ------
    NeedsPythonError : a scene that the kernels do not hold; SceneError : it cannot be built.
    """

    def __init__(self, scene: Scene, tolerance: float | None = None, python: bool = False) -> None:
        self.scene, self.sources = scene, Sources.of(scene)
        segmented = SegmentedRun(measured(scene), tolerance)
        segmented.settle({})
        self.problem = segmented.problem
        with one_thread():
            if self.problem.reduced is not None:
                cast(Any, self.problem.reduced).follow_strains()
            self.drives = Drives(segmented, self.sources)
            signals = self._signals()
            fields = signals.fields() | history_fields(self.drives)
            fields |= opening_fields(self.drives, segmented.starts_static)
            self._make(self.drives, fields, python)

    def _signals(self) -> Signals:
        """What outputs follow from."""
        problem = self.problem
        if problem.reduced is None:
            self._request, self._info = problem.output, problem.info
            return Signals(self.scene, self.drives, self._recorder())
        from .reduced_signals import ReducedSignals

        signals = ReducedSignals(self.scene, self.drives, cast(Any, problem.reduced), problem.output)
        self._request, self._info = signals.request, {}
        return signals

    def _recorder(self) -> Recorder:
        """One of what the signals are read from."""
        return Recorder(self.problem.marched, self._request, self._info)

    def _make(self, drives: Drives, fields: Mapping[str, Any], python: bool) -> None:
        problem, start = self.problem, self.sources.initial()
        amplitudes = np.concatenate(
            [start, np.ones((COMMUNICATION_ROWS - 2, start.shape[1]))]
        )  # the last rows lay out what varies
        drives.begin(amplitudes)
        # what a call of the kernels alone can do: windows of one instant, its own thread
        settings = replace(problem.settings, window=1, threads=problem.settings.threads if python else 1)
        if problem.reduced is not None:
            settings = problem.reduced.settings(settings)
        self.run = Run(problem.marched, settings, self._recorder(), Timings(), communication=fields)
        self.run.open_bonds()
        if not self.run.marches:  # perfect interfaces that are too many, or redundant, for one matrix in the kernels
            settings = replace(settings, direct_bonds=False)
            self.run = Run(problem.marched, settings, self._recorder(), Timings(), communication=fields)
        if not (python or all_in_kernels(self.run.image)):
            raise _solved_by_python(self.run)
        self.image: Image = self.run.image
        self.image.set({"first_row": 0})
        for g, group in enumerate(self.run.assembly.layout.groups):
            if self.image.groups[g]["tunable"]:
                self.image.group_field(g, "tuned", *group.parameters.shape)[:] = group.parameters
        self.steps = self.image.rows - 1
        self.image.write()
        self.products = settled(self.image.classes, _fixed(self.image))
        if problem.reduced is not None:
            shorten(self.image.run[0], self.image.classes, self.image.fixed, settings.tolerance)
        self.image.call(entries.PRESENT)

    def set(self, name: str, value: float, rate: float) -> None:
        """Set value and rate of an input for the next communication step."""
        e = self.sources.inputs.index(name)
        n = len(self.sources.inputs)
        self.image.field("input_value", n)[e], self.image.field("input_rate", n)[e] = value, rate

    def outputs(self, row: int = 0) -> Array:
        """A row of outputs of the last call, a view."""
        n = int(self.image.run[0]["n_output"])
        values: Array = self.image.field("output", self.image.rows, n)[row]
        return values


def _solved_by_python(run: Run) -> NeedsPythonError:
    """What of a run the kernels do not hold, by name."""
    problems = []
    for propagator, row in zip(run.assembly.propagators, run.image.classes, strict=True):
        if not row["factored"]:
            what, remedy = "has a propagator that runs in Python", 'use "direct", "explicit" or "reduced"'
            problems += [Problem(f"substructure.{name}", what, None, None, remedy) for name in propagator.names]
    for group, row in zip(run.assembly.layout.groups, run.image.groups, strict=True):
        if row["law"] < 0:
            names = [run.assembly.interfaces[i].name for i in group.members]
            what, remedy = "has a user-defined law in Python", "use a law of the package"
            problems += [Problem(f"interface.{name}", what, None, None, remedy) for name in names]
    return NeedsPythonError(problems, "the scene needs Python at run time")


# -- the file ---------------------------------------------------------------------------------------------------
def write(run: CommunicationRun) -> bytes:
    """The file of a run in its present state."""
    image = run.image
    image.write()
    run_record = image.run.copy()
    run_record["callout"] = 0  # an address of this process
    records = (part.tobytes() for part in (run_record, image.classes, image.groups))
    words = [product.words.tobytes() for product in run.products]
    head = header(run, sum(map(len, words)) // 8)
    return b"".join([head, *records, *_planes(without(_fixed(image), run.products)), image.moving.tobytes(), *words])


def _fixed(image: Image) -> Array:
    """The fixed block without its room for further search directions, which no communication step takes."""
    return image.fixed[: image.n_fixed]


def header(run: CommunicationRun, n_product: int = 0) -> bytes:
    """Magic, words and numbers at the beginning of the file of a run whose records are up to date; ``n_product`` :
    words of its products."""
    image = run.image
    record, fixed = image.run[0], _fixed(image)
    words: dict[str, int] = {
        "version": VERSION,
        "run_size": RUN.itemsize,
        "n_class": len(image.classes),
        "class_size": CLASS.itemsize,
        "n_group": len(image.groups),
        "group_size": GROUP.itemsize,
        "n_fixed": len(fixed),
        "n_moving": len(image.moving),
        "n_state": len(image.state),
        "n_row": image.rows,
        "n_field": int(record["field_rows"]),
        "most_steps": run.steps,
        "last_step": int(record["law_end"]),
        "communicate": entries.COMMUNICATE,
        "present": entries.PRESENT,
        "fields": entries.FIELDS,
        "placing": entries.PLACE,
        "derive": entries.DERIVE,
        "depth_at": cast(Any, RUN.fields)["depth"][1],
        "relaxation_at": cast(Any, RUN.fields)["relaxation"][1],
        "run_digest": _digest(),
        "n_product": n_product,
    }
    words |= {name: int(record[name]) for name in WORDS if name not in words}
    places = np.zeros(_N_WORD, dtype="<i8")
    places[: len(WORDS)] = [words[name] for name in WORDS]
    numbers = np.zeros(_N_NUMBER, dtype="<f8")
    numbers[: len(NUMBERS)] = record["dt"], run.scene.time.end
    return b"".join([MAGIC, places.tobytes(), numbers.tobytes()])


def _planes(words: Array) -> Iterator[bytes]:
    """The fixed block as it is in the file."""
    for at in range(0, len(words), PLANE):
        yield words[at : at + PLANE].view(np.uint8).reshape(-1, 8).T.tobytes()


def _from_planes(content: Array) -> Array:
    """The fixed block from the file, a copy."""
    parts = [content[at : at + PLANE].view(np.uint8).reshape(8, -1) for at in range(0, len(content), PLANE)]
    return np.concatenate([np.zeros(0), *(np.ascontiguousarray(part.T).reshape(-1).view(float) for part in parts)])


def read(content: bytes) -> tuple[dict[str, int], dict[str, float], Pools]:
    """Words and numbers of the header, and the arrays of the kernels (fresh copies).

    Raises
    ------
    InputError : bytes that are no such file, or one of another version of the package.
    """
    start = len(MAGIC) + 8 * (_N_WORD + _N_NUMBER)
    if len(content) < start or content[: len(MAGIC)] != MAGIC:
        raise _unreadable("is no image of a run")
    header = np.frombuffer(content, "<i8", len(WORDS), len(MAGIC))
    words = dict(zip(WORDS, map(int, header), strict=True))
    if (words["version"], words["run_digest"]) != (VERSION, _digest()):
        raise _unreadable("was written by another version of this package")
    numbers = np.frombuffer(content, "<f8", len(NUMBERS), len(MAGIC) + 8 * _N_WORD)
    sizes: tuple[tuple[Any, int], ...] = (
        (RUN, 1),
        (CLASS, words["n_class"]),
        (GROUP, words["n_group"]),
        (np.dtype(np.float64), words["n_fixed"]),
        (np.dtype(np.float64), words["n_moving"]),
        (np.dtype(np.float64), words["n_product"]),
    )
    if len(content) != start + sum(kind.itemsize * n for kind, n in sizes):
        raise _unreadable("is cut off or too long")
    arrays: list[NDArray[Any]] = []
    for kind, n in sizes:
        arrays.append(np.frombuffer(content, kind, n, start).copy())  # what ``frombuffer`` gives is read only
        start += kind.itemsize * n
    arrays[3] = _from_planes(arrays[3])
    multiply(arrays.pop(), arrays[3])
    pools = pools_of(*arrays)
    return words, dict(zip(NUMBERS, map(float, numbers), strict=True)), pools


def _digest() -> int:
    """A number for the names and places of the fields of the records."""
    return zlib.crc32(repr((RUN.descr, CLASS.descr, GROUP.descr)).encode())


def _unreadable(what: str) -> InputError:
    return InputError([Problem("image of a run", what, None, None, "export the FMU again")], "the image cannot be read")
