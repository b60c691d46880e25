"""The image of a run: records and blocks of memory that hold everything its kernels read and write.

The layout is that of ``kernels.records``. ``fixed`` is filled when the operators of a time step and the search
directions are known. ``moving`` holds state, work, output and the histories of the present segment, in this order, so
that a new segment changes its end only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from ctypes import CFUNCTYPE, c_int64, c_void_p
from ctypes import cast as pointer_to
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from typing import Any, NamedTuple, cast
from weakref import ReferenceType, proxy, ref

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..compiled import PLAIN, bound
from ..kernels import entries
from ..kernels.callouts import BACKWARD, FORWARD
from ..kernels.entries import Pools
from ..kernels.records import CLASS, GROUP, RUN
from ..time_scheme.scheme import coefficients
from . import class_record, layout
from .class_record import BlockLayout
from .model import Array, Index

Fields = dict[str, Any]
CallOut = Callable[[int, int, int], None]
_CALLOUT = CFUNCTYPE(c_int64, *[c_int64] * 4)
_coefficients = lru_cache(maxsize=64)(coefficients)
_DIRECTIONS = 2  # further search directions that there is room for from the start


@dataclass
class _Direction:
    """Places of a search direction: ``start`` and ``end`` in the fixed block, fields of the records."""

    start: int
    end: int
    run: Fields
    rows: list[Fields]
    groups: list[Fields]


def _placed(fields: Mapping[str, Any], block: BlockLayout) -> Fields:
    """Numbers as they are, arrays and matrices by their places in a block."""
    placed: Fields = {}
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            kind: type[np.generic] = np.float64
            if value.dtype == np.float32:
                kind = np.float32
            elif value.dtype.kind in "iub":
                kind = np.int64
            placed[name] = block.put(value, kind)
        elif sp.issparse(value):
            class_record.put_matrix(block, placed, name, cast(sp.csr_array, value))
        else:
            placed[name] = value
    return placed


class CallOuts:
    """Functions that the kernels of an image call (``kernels.callouts``), by what is to be done, with three arguments.

    Parameters
    ----------
    image : whose record holds the address of the function that calls them.
    """

    def __init__(self, image: Image) -> None:
        self._image: ReferenceType[Image] = ref(image)  # no circle: the blocks are given back with the image
        self._functions: dict[int, CallOut] = {}
        self._raised: BaseException | None = None
        self._called: Any = None

    def add(self, functions: Mapping[int, CallOut]) -> None:
        """Let the kernels call these, too. What they raise ends the loops of the kernels, and ``Image.call`` raises
        it."""
        self._functions |= functions
        image = self._image()
        if self._called is None and image is not None:
            self._called = _CALLOUT(self._call)  # kept as long as its address is in use
            image.set({"callout": int(pointer_to(self._called, c_void_p).value or 0)})

    @contextmanager
    def within(self, functions: Mapping[int, CallOut]) -> Iterator[None]:
        """Context of calls of the kernels that may call these."""
        self.add(functions)
        try:
            yield
        finally:
            for what in functions:
                del self._functions[what]

    def _call(self, what: int, a: int, b: int, c: int) -> int:
        image = self._image()
        assert image is not None
        # after an error the kernels are on their way out: nothing is called any more
        if self._raised is None:
            try:
                # ``call_out`` has set 1, for a signal that ends this function before here
                image.field("failed", 1)[0] = 0.0
                with np.errstate(all="ignore"):  # of a thread of its own, maybe
                    self._functions[what](a, b, c)
            except BaseException as error:
                self._raised = error
                image.field("failed", 1)[0] = 1.0
        return 0

    def check(self) -> None:
        """Raise what a function has raised."""
        image = self._image()
        if self._called is None or image is None or image.field("failed", 1)[0] != 1.0:
            return
        # without an error a signal came before the first line of the function that was called
        raised, self._raised = self._raised or KeyboardInterrupt(), None
        image.field("failed", 1)[0] = 0.0
        raise raised


class OtherFactors:
    """Solutions with factors that the kernels do not hold, which they call out for.

    Parameters
    ----------
    image : of the classes; not kept alive.
    """

    def __init__(self, image: Image) -> None:
        self._image, self._half = image, dict[int, Array]()

    @property
    def functions(self) -> dict[int, CallOut]:
        """By what is to be done."""
        return {FORWARD: self._forward, BACKWARD: self._backward}

    def _forward(self, c: int, *_: int) -> None:
        """Half solution of a class from its load."""
        image, row = self._image, self._image.row(c)
        factor = image.propagators[c].operators.factor
        self._half[c], inner = factor.forward(image.class_field(c, "load", row["n"], row["m"]))
        image.class_field(c, "inner", row["n_inner"], row["m"])[:] = inner

    def _backward(self, c: int, rested: int, *_: int) -> None:
        """The other half, with the unknowns at the interfaces; of a class that has ``rested`` there is no first one."""
        image, row = self._image, self._image.row(c)
        if rested:
            y = np.zeros((row["n"] - row["n_inner"], row["m"]))
        else:
            y = self._half[c]
        last = image.class_field(c, "inner_answer", row["n_inner"], row["m"])
        solution = image.propagators[c].operators.factor.backward(y, last)
        image.class_field(c, "load", row["n"], row["m"])[:] = solution


def pools_of(run: Any, classes: Any, groups: Any, fixed: Array, moving: Array) -> Pools:
    """Records and blocks, with the views of the blocks that kernels take."""
    views = fixed.view(np.int64), fixed.view(np.uint32), fixed.view(np.float32)
    return Pools(run, classes, groups, fixed, *views, moving, moving.view(np.int64))


class ImageClass(NamedTuple):
    """What an image is made from, of one class of substructures.

    Attributes
    ----------
    propagator : begun. channels : places (n_channel, m) of its channels among those of the run.
    probes : rows (n_probe, n) whose velocities are kept, or None; sensors : likewise of their displacements, velocities
        and accelerations. divided : whether other processes hold members of it.
    """

    propagator: Any
    channels: Index
    probes: sp.csr_array | None = None
    sensors: sp.csr_array | None = None
    divided: bool = False


class Image:
    """Records and blocks of the classes of substructures of a run and of the interfaces between them.

    Parameters
    ----------
    classes : see ``ImageClass``. normal : (n_flat,) True where a channel is normal to its interface.
    run, groups : further fields of the records by name: numbers, arrays and matrices.
    window : instants of the longest window. n_time, histories : as for ``begin``, where the segment is known.
    """

    def __init__(
        self,
        classes: Sequence[ImageClass],
        normal: NDArray[np.bool_],
        run: Mapping[str, Any] | None = None,
        groups: Sequence[Mapping[str, Any]] = (),
        window: int = 1,
        n_time: int = 0,
        histories: Mapping[str, Array] | None = None,
    ) -> None:
        # the states of propagators hold the image they stand in: no circle, all is given back with the last of them
        self.propagators, self.channels = [proxy(c.propagator) for c in classes], [c.channels for c in classes]
        self.n_flat, self.window = len(normal), window
        first = classes[0].propagator
        self.run = np.zeros(1, dtype=RUN)
        self.classes = np.zeros(len(classes), dtype=CLASS)
        self.groups = np.zeros(len(groups), dtype=GROUP)
        fixed = BlockLayout()
        halves: class_record.Halves = {}
        self._directions: dict[int, _Direction] = {}
        self._run: Fields = {
            "n_flat": self.n_flat,
            "n_class": len(classes),
            "longest_window": window,
            "max_iterations": 1,
            "reuse": -1.0,
            "rest_traction": -1.0,
            "relaxation": 1.0,
            "threads": 1,
            "longest_step": np.inf,
            **_coefficients(first.scheme, first.dt),
            **_placed(run or {}, fixed),
        }
        self._groups = [_placed(group, fixed) for group in groups]
        self._rows = [
            class_record.constants(fixed, *image_class[:4], normal, halves)
            | {"divided": int(image_class.divided), "split": 1}
            for image_class in classes
        ]
        self.fixed = self.moving = np.zeros(0)  # room is made when their sizes are known
        self.n_fixed, self._waiting = fixed.size, [fixed]  # numbers of the block in use, what is to be written to it
        self.bound: int | None = None  # key of the search direction in use
        self.callouts = CallOuts(self)
        self._views: dict[tuple[str, tuple[int, ...]], Array] = {}  # of fields of the run that were read
        self._written = False
        self._lay_out_moving()
        if histories is None:
            self.moving = np.zeros(self._tail)
        else:
            self.begin(n_time, histories)
        self.moving[self._run["carry"]] = 1.0
        if not self.factored:
            self.callouts.add(OtherFactors(proxy(self)).functions)
        for c, propagator in enumerate(self.propagators):
            propagator.state.attach(self, c)

    # -- the moving block ---------------------------------------------------------------------------------------
    def _lay_out_moving(self) -> None:
        """Places of state, work and output."""
        block = BlockLayout()
        self.rows, self._n_state = layout.place_moving(block, self._run, self._groups, self._rows)
        self._run["state_size"] = self._n_state
        self._tail = block.size

    def begin(self, n_time: int, histories: Mapping[str, Array]) -> None:
        """Take over loads and prescribed motions of the classes in a segment of time, and ``histories`` of the run."""
        block = BlockLayout(self._tail)
        fields = [class_record.histories(block, row, p) for row, p in zip(self._rows, self.propagators, strict=True)]
        self._kinds = [propagator.forcing.kind for propagator in self.propagators]
        fields.append({"n_time": n_time, **{name: block.put(values) for name, values in histories.items()}})
        if block.size > len(self.moving):
            # views and pools are those of the block that was left
            self.moving, self._written, self._views = class_record.grown(self.moving, block.size), False, {}
        block.fill(self.moving)
        for row, new in zip((*self._rows, self._run), fields, strict=True):
            if not new.items() <= row.items():  # else the records hold them
                row.update(new)
                self._written = False

    def begin_alike(self, n_time: int) -> bool:
        """Begin a segment in which, but for the amplitudes of the loads, nothing differs from the last one; False where
        more differs than that, in the loads or the number of instants: it needs ``begin``."""
        forcings = [propagator.forcing for propagator in self.propagators]
        kinds = [forcing.kind for forcing in forcings]
        if n_time != self._run.get("n_time") or kinds != self._kinds or None in kinds:
            return False
        for c, (row, forcing) in enumerate(zip(self._rows, forcings, strict=True)):
            constant, loads = forcing.loads_over_time()
            self.class_field(c, "constant", row["n"], row["m"])[:] = constant
            for t, amplitude in enumerate(loads.amplitudes):
                self.class_field(c, "force_amplitudes", n_time, len(loads.amplitudes))[:, t] = amplitude
        return True

    # -- directions ---------------------------------------------------------------------------------------------
    def bind(
        self,
        key: int,
        run: Mapping[str, Any] | None = None,
        groups: Sequence[Mapping[str, Any]] = (),
        afresh: bool = False,
    ) -> None:
        """Use a search direction: that under ``key``, or, where there is none yet (or ``afresh``), the one bound to the
        propagators with these fields of the records."""
        placed = old = self._directions.get(key)
        if placed is None or afresh:
            self.bound = None
            placed, block = self._place(self.n_fixed if old is None else old.start, run or {}, groups)
            if old is not None and placed.end > old.end < self.n_fixed:  # longer than its place
                # others begin behind it: this one moves to the end of the block
                placed, block = self._place(self.n_fixed, run or {}, groups)
            elif old is not None:
                placed.end = max(placed.end, old.end)
            self._directions[key] = placed
            self.n_fixed = max(self.n_fixed, placed.end)
            self._waiting.append(block)
        if key != self.bound:
            self.bound = key
            self._run |= placed.run
            for into, fields in zip((*self._rows, *self._groups), (*placed.rows, *placed.groups), strict=False):
                into.update(fields)
            # the tables are longer, places in them new: records have to be written
            self._written = False
            if self._run.get("n_unknown", 0) and len(self.moving):
                self.moving[self._run["factored"]] = 0.0  # factors of Newton steps are those of a direction

    def _place(
        self, start: int, run: Mapping[str, Any], groups: Sequence[Mapping[str, Any]]
    ) -> tuple[_Direction, BlockLayout]:
        """The direction that is bound to the propagators, from ``start`` on in the fixed block."""
        block = BlockLayout(start)
        own_run = _placed(run, block)
        rows = [
            class_record.direction(block, p, row, own_run) for p, row in zip(self.propagators, self._rows, strict=True)
        ]
        own_groups = [_placed(group, block) for group in groups]
        return _Direction(start, block.size, own_run, rows, own_groups), block

    def _write_records(self) -> None:
        if self.n_fixed > len(self.fixed):  # with room for further directions
            longest = max((d.end - d.start for d in self._directions.values()), default=0)
            larger = np.zeros(self.n_fixed + _DIRECTIONS * longest)
            larger[: len(self.fixed)] = self.fixed
            self.fixed = larger
            # factors read their panels in the block: they move with it
            for row, propagator in zip(self._rows, self.propagators, strict=True):
                class_record.move_panels(larger, row, propagator.operators.factor)
        for block in self._waiting:
            block.fill(self.fixed)
        self._waiting.clear()
        for records, rows in ((self.run, [self._run]), (self.classes, self._rows), (self.groups, self._groups)):
            blank = dict.fromkeys(cast(tuple[str, ...], records.dtype.names), 0)
            for i, row in enumerate(rows):
                records[i] = tuple({**blank, **row}.values())  # in the order of the record
        # plain Python reads fields as attributes
        kind = np.recarray if PLAIN else np.ndarray
        tables = self.run.view(kind), self.classes.view(kind), self.groups.view(kind)
        self.pools = pools_of(*tables, self.fixed, self.moving)
        self._entry = bound(entries.call, self.pools)
        self._written = True

    def write(self) -> None:
        """Bring the records up to date."""
        if not self._written:
            self._write_records()

    # -- use ----------------------------------------------------------------------------------------------------
    def call(self, action: int, a: int = 0, b: int = 0, c: int = 0, d: int = 0) -> int:
        """Do an action of ``kernels.entries``; what it returns."""
        self.write()
        result = int(self._entry(action, a, b, c, d))
        self.callouts.check()
        return result

    def use_threads(self, count: int, alone: Sequence[Index]) -> None:
        """March with so many threads, the caller's among them; ``alone`` : classes of each that have one thread, the
        others are shared by all."""
        order = np.concatenate([np.zeros(0, dtype=np.int64), *alone])
        self._run |= {"threads": count, "n_alone": len(order)}
        for c, row in enumerate(self._rows):
            row["split"] = int(c not in order)
        self.counts("order", len(self._rows))[: len(order)] = order
        self._written = False

    @property
    def run_fields(self) -> Fields:
        """Numbers and places of the record of the run."""
        return self._run

    def class_field(self, c: int, name: str, *shape: int) -> Array:
        """An array of a class in the moving block, a view of this shape."""
        at = self._rows[c][name]
        return self.moving[at : at + prod(shape)].reshape(shape)

    @property
    def factored(self) -> bool:
        """Whether the kernels hold every factor."""
        return all(row["factored"] for row in self._rows)

    def set(self, fields: Mapping[str, float]) -> None:
        """Change numbers of the run."""
        self._run |= fields
        # in the fields and in the record: the next ``write`` starts from the fields
        for name, value in fields.items():
            self.run[0][name] = value

    def field(self, name: str, *shape: int) -> Array:
        """An array of the run in the moving block, a view of this shape."""
        if (name, shape) not in self._views:
            at = self._run[name]
            self._views[name, shape] = self.moving[at : at + prod(shape)].reshape(shape)
        return self._views[name, shape]

    def counts(self, name: str, n: int) -> Index:
        """An array of integers of the run in the moving block, a view."""
        at = self._run[name]
        return self.moving[at : at + n].view(np.int64)

    def row(self, c: int) -> Fields:
        """Sizes and places of a class."""
        return self._rows[c]

    def group_field(self, g: int, name: str, *shape: int) -> Array:
        """An array of a group in the moving block."""
        at = self._groups[g][name]
        return self.moving[at : at + prod(shape)].reshape(shape)

    def output(self, c: int, name: str, width: str | int) -> Array:
        """An output (rows, width, m) of a class; ``width`` : a number, or the name of a size."""
        row = self._rows[c]
        return self.class_field(c, name, self.rows, row[width] if isinstance(width, str) else width, row["m"])

    @property
    def state(self) -> Array:
        """All that the next instant depends on, one range of the moving block."""
        return self.moving[: self._n_state]


def work_on(image: Image, moving: Array) -> None:
    """Let functions that the kernels call find their numbers in another moving block of this layout, which a caller
    beside Python hands to the kernels."""
    image.moving, image._views = moving, {}


def take_marched(image: Image) -> tuple[int, int]:
    """Substructure-instants marched, and solved through the condensed operator, since the last time."""
    total = image.field("counts", 2)
    marched, solved = int(total[0]), int(total[1])
    total[:] = 0.0
    for c in range(len(image.classes)):
        at = image.row(c)["marched"]
        marched += int(image.moving[at])
        image.moving[at] = 0.0
    return marched, solved
