"""The image of a run as the runtime in C takes it: in the memory of Python, beside the functions that it calls back.

The engine marches on the moving block of the image itself, where functions of Python that the kernels call
(``kernels.callouts``: laws, factors) find their numbers. Before and after each call of the kernels it calls back: laws
of the scene are tabulated, time steps recorded, and an interruption or an error in Python stops the step, which then
has changed nothing.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable
from ctypes import POINTER, Structure, c_char_p, c_int32, c_int64, c_void_p
from typing import Any, Final

import numpy as np

from ..compiled import PLAIN, library
from ..kernels import entries
from ..kernels.records import CLASS, GROUP, RUN
from ..propagator.image import pools_of, work_on
from .communication import WORDS, CommunicationRun, header

ABOUT_TO, HAVE_MADE, WORKS_ON = range(3)
"""Moments of a call back, as in runtime/runtime.h."""
Notify = Callable[[int, int, int, int], None]
_NOTIFY: Final = ctypes.CFUNCTYPE(c_int64, c_int64, c_int64, c_int64, c_int64)
_KERNELS: Final = ctypes.CFUNCTYPE(c_int32, POINTER(c_int64), c_void_p)
_LONGEST: Final = 1000  # bytes of a message


class Process(Structure):
    """``Process`` of runtime/runtime.h."""

    _fields_ = [
        ("table", c_void_p),
        ("n_table", c_int64),
        ("head", c_void_p),
        ("records", c_void_p * 3),
        ("fixed", c_void_p),
        ("moving", c_void_p),
        ("kernels", c_void_p),
        ("notify", c_void_p),
        ("trouble", c_char_p),
        ("whole", c_int64),
        ("always", c_int64),
        ("answered", c_void_p),
    ]


def address(array: Any) -> int:
    """Address of the first number of an array."""
    return int(array.ctypes.data)


def _kernels() -> Any:
    """The entry of the kernels for C: that of their library, or, plain Python, a function that calls them."""
    if not PLAIN:
        return ctypes.cast(library.needed().kernels_entries_call_0, c_void_p)

    def call(slots: Any, result: Any) -> int:
        block = [(slots[2 * i], slots[2 * i + 1]) for i in range(9)]
        kinds: tuple[Any, ...] = (RUN, CLASS, GROUP, np.dtype(float), np.dtype(float))
        arrays = [
            np.frombuffer((ctypes.c_char * (item.itemsize * n)).from_address(at), item) if n else np.zeros(0, item)
            for item, (at, n) in zip(kinds, (*block[:4], block[7]), strict=True)
        ]
        records = (array.view(np.recarray) for array in arrays[:3])  # plain Python reads fields as attributes
        try:
            done = entries.call(pools_of(*records, *arrays[3:]), *(slots[18 + i] for i in range(5)))
        except MemoryError:
            return 1
        c_int64.from_address(result).value = done
        return 0

    return _KERNELS(call)


class HandedRun:
    """A run in the hands of the runtime.

    Parameters
    ----------
    run : nothing but the runtime may change its image as long as this lives. table : of its variables
        (``table_file.table_file``). notify : called with ABOUT_TO or HAVE_MADE and its numbers, around each call of the
        kernels, or None; what it raises ends the step. A method of an object that is not kept alive. most : time steps
        of a call of the kernels. whole : whether the fields of the points are kept at all instants of a step.

    Attributes
    ----------
    process : what C is given. raised : whether a call back has raised something.
    """

    def __init__(
        self, run: CommunicationRun, table: bytes, notify: Notify | None = None, most: int = 0, whole: bool = False
    ) -> None:
        self._run = run
        run.image.write()
        self._raised: BaseException | None = None
        self._method = None
        if notify is not None:
            self._method = weakref.WeakMethod(notify)
        self._answered = np.ones(1, dtype=np.int64)
        this, answered = weakref.ref(self), self._answered

        def called(what: int, a: int, b: int, c: int) -> int:
            handed = this()
            if handed is None:
                stops = 1
            else:
                stops = handed._called(what, a, b, c)
            answered[0] = 1  # C has set 0, for a signal that ends this function before here
            return stops

        self._notify, self._entry = _NOTIFY(called), _kernels()
        self._words = np.frombuffer(table, dtype=np.uint64).copy()
        self._head = np.frombuffer(header(run), dtype=np.uint64).copy()
        if most:
            self._head[1 + WORDS.index("most_steps")] = most  # behind the magic number
        self._trouble = ctypes.create_string_buffer(_LONGEST)
        image = run.image
        self.raised = False
        self.process = Process(
            address(self._words),
            len(self._words),
            address(self._head),
            (c_void_p * 3)(*map(address, (image.run, image.classes, image.groups))),
            address(image.fixed),
            address(image.moving),
            ctypes.cast(self._entry, c_void_p),
            ctypes.cast(self._notify, c_void_p),
            ctypes.cast(self._trouble, c_char_p),
            int(whole),
            int(notify is not None or bool(image.run[0]["callout"])),
            address(self._answered),
        )

    def _called(self, what: int, a: int, b: int, c: int) -> int:
        """Called by C; not 0: the step is stopped."""
        try:
            if what == WORKS_ON:
                self._work_on(a, b)
            else:
                self._raised, self.raised = None, False  # of a step before
                self._take_part(what, a, b, c)
        except BaseException as error:  # of any kind, an interruption among them: no exception passes through C
            self._raised, self.raised = self._raised or error, True
            text = f"{type(error).__name__}: {error}".encode(errors="replace")
            self._trouble.value = text[: _LONGEST - 1]
        return int(self.raised)

    def _work_on(self, a: int, b: int) -> None:
        """The kernels go on in the moving block of b numbers at the address a."""
        image = self._run.image
        try:
            image.callouts.check()  # of what was done in the block before
        finally:
            work_on(image, np.ctypeslib.as_array((ctypes.c_double * b).from_address(a)))

    def _take_part(self, what: int, a: int, b: int, c: int) -> None:
        """Before and after a call of the kernels."""
        if what == ABOUT_TO:
            self._tabulate(a, b)
        else:
            self._run.image.callouts.check()
        method = None
        if self._method is not None:
            method = self._method()
        if method is not None:
            method(what, a, b, c)

    def _tabulate(self, steps: int, n: int) -> None:
        """Let the table of the laws of the scene hold the next n time steps, beyond the end of the scene too."""
        sources, image = self._run.sources, self._run.image
        first, end = int(image.run[0]["law_first"]), sources.end
        if end < 0 or first <= steps <= first + end - n:
            return
        # the table of the scene where it reaches, else one that begins here
        if steps + n <= end:
            first = 0
        else:
            first = steps
        instants = self._run.drives.dt * np.arange(first, first + end + 1.0)
        if first == 0:
            table = sources.table
        else:
            table = sources.law_amplitudes(self._run.scene, instants)
        at = image.run_fields["law_table"]
        image.fixed[at : at + table.size] = table.ravel()
        image.set({"law_first": first})

    def check(self) -> None:
        """Raise what a call back has raised."""
        if self._raised is not None or not self._answered[0]:
            # without an error a signal came before the first line of the function that was called
            raised = self._raised or KeyboardInterrupt()
            self._raised = None
            self.raised = False
            self._answered[0] = 1
            raise raised
        self._run.image.callouts.check()
