"""The runtime in C (``runtime``) as the engine of a session in this process."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from ctypes import POINTER, Structure, byref, c_char_p, c_double, c_int, c_int64, c_size_t, c_uint32, c_void_p
from typing import Any, Final, NamedTuple

import numpy as np

from ..errors import InputError, Problem, SolverError
from ..latin.outcome import Array
from . import c_runtime
from .handed_run import HandedRun, address

OK, WARNING, DISCARD, ERROR = range(4)
STEP: Final = 6
"""State of an instance that steps, as in runtime/instance.h."""
_LOG: Final = ctypes.CFUNCTYPE(None, c_int, c_char_p)
_LONGEST: Final = 200  # bytes of a sentence
_CANNOT: Final = "the session cannot be used so"


class _History(Structure):
    """``History`` of runtime/runtime.h."""

    _fields_ = [("n", c_int64), ("t", POINTER(c_double)), ("value", POINTER(c_double)), ("from_process", c_int64)]


class _View(Structure):
    """``View`` of runtime/process.c."""

    _fields_ = [
        *((name, c_int64) for name in ("phase", "row", "n_row", "n_fields", "size_of_fields")),
        *((name, c_double) for name in ("time", "start")),
        *((name, POINTER(c_double)) for name in ("given", "first", "now", "times", "fields")),
        ("histories", POINTER(_History)),
    ]


class Step(NamedTuple):
    """A communication step: status, why it was refused, where it ended, s, its time steps, -1 where it moved the clock
    alone."""

    status: int
    message: str
    end: float
    n: int


class Engine:
    """An instance of the runtime on the image of a run.

    Parameters
    ----------
    handed : the run. n_input, n_output : of it. at_work : context of calls that the threads of the run share; None
        where there is one thread.

    Attributes
    ----------
    row : scalar outputs now, (n_output,); another array after every change.

    Raises
    ------
    InputError : the library is missing. SolverError : there is no memory.
    """

    def __init__(
        self,
        handed: HandedRun,
        n_input: int,
        n_output: int,
        at_work: Callable[[], AbstractContextManager[None]] | None = None,
    ) -> None:
        self._at_work = at_work
        self._messages: list[tuple[int, str]] = []
        messages = self._messages
        self._log = _LOG(lambda status, text: messages.append((status, text.decode(errors="replace"))))
        self._handed = handed
        self._n_input = n_input
        self._n_output = n_output
        self._library: Any = c_runtime.loaded()
        self._functions = {name: self._function(name) for name in ("open", "view", "step", "initialize", "derivative")}
        self._functions["open"].restype = c_void_p
        instance: int | None = self._functions["open"](byref(handed.process), self._log)
        if instance is None:
            raise SolverError(self._message())
        self._handle = c_void_p(instance)
        self._free = weakref.finalize(self, _freed, self._library, instance, (handed, self._log))
        self._end, self.row = np.zeros(2), np.zeros(self._n_output)
        self._end_at = address(self._end)
        self._functions["step"].argtypes = [c_void_p, c_double, c_double, c_int, c_void_p, c_void_p, c_void_p]
        self._functions["step"].restype = c_int

    def _function(self, name: str) -> Any:
        return getattr(self._library, f"latin_fmu_{name}")

    def close(self) -> None:
        """Free the instance."""
        self._free()
        self._handle = c_void_p(None)

    def _call(self, name: str, *arguments: Any) -> int:
        """A function on the instance; its status. Raises what a call back has raised."""
        function = self._functions.get(name) or self._functions.setdefault(name, self._function(name))
        self._messages.clear()
        if self._at_work is None:
            status = int(function(self._handle, *arguments))
        else:
            with self._at_work():
                status = int(function(self._handle, *arguments))
        if status > WARNING or self._handed.raised:
            self._handed.check()
        return status

    def _of_fmi(self, name: str, *arguments: Any) -> int:
        """As ``_call``, a function of FMI 3."""
        if name not in self._functions:
            self._functions[name] = getattr(self._library, f"fmi3{name}")
        return self._call(name, *arguments)

    def _message(self) -> str:
        if self._messages:
            return self._messages[-1][1]
        return "the runtime gives no reason"

    @property
    def warnings(self) -> list[str]:
        """Warnings of the last call."""
        return [text for status, text in self._messages if status == WARNING]

    # -- steps ----------------------------------------------------------------------------------------------------
    def initialize(
        self, start: float, inputs: Array, histories: Mapping[int, tuple[Array, Array]], parameters: Mapping[int, float]
    ) -> None:
        """Begin a simulation, from whatever state.

        Parameters
        ----------
        start : time of the simulation, s. inputs : (n_input, 2) value and rate of the inputs. histories : times and
            amplitudes by number of an input, for prescribed mode, which solves the interval here. parameters : values
            by reference of those that are not at their start values.

        Raises
        ------
        InputError : inputs or choices that cannot be. SolverError : no convergence.
        """
        self._call("renew")
        set_numbers(self, parameters)
        for i, (times, values) in histories.items():
            t, a = (np.ascontiguousarray(part, dtype=float) for part in (times, values))
            self._done(self._call("history", c_int64(i), c_int64(len(t)), c_void_p(address(t)), c_void_p(address(a))))
        row, block = np.zeros(self._n_output), np.ascontiguousarray(inputs, dtype=float)
        arguments = c_double(start), c_void_p(address(block)), c_void_p(address(row))
        status = self._call("initialize", *arguments)
        if status == DISCARD:
            raise InputError([Problem("session", self._message())], "the session cannot start")
        self._done(status)
        self.row = row

    def _done(self, status: int) -> None:
        if status > WARNING:
            raise SolverError(self._message())

    def step(self, t: float, h: float, early: bool, inputs: Array) -> Step:
        """Make a communication step.

        inputs : (n_input, 2) value and rate of the inputs, C-contiguous.
        """
        row = np.empty(self._n_output)
        status = self._call("step", t, h, early, inputs.ctypes.data, self._end_at, row.ctypes.data)
        if status > WARNING:
            return Step(status, self._message(), 0.0, 0)
        self.row = row
        return Step(status, "", float(self._end[0]), int(self._end[1]))

    def derivative(self, unknowns: Sequence[int], knowns: Sequence[int], seed: Sequence[float]) -> Array:
        """Directional derivative (n_unknown,) at the end of the last step, of variables by their references.

        Raises
        ------
        InputError : no outputs or inputs, no step so far. SolverError : there is no derivative.
        """
        n = len(unknowns)
        m = len(knowns)
        values = np.zeros(len(unknowns))
        places = ((c_uint32 * n)(*unknowns), c_int64(n), (c_uint32 * m)(*knowns), c_int64(m))
        status = self._call("derivative", *places, (c_double * m)(*seed), c_void_p(address(values)))
        if status == DISCARD:
            raise InputError([Problem("session", self._message())], _CANNOT)
        self._done(status)
        return values

    # -- what there is --------------------------------------------------------------------------------------------
    def _view(self) -> _View:
        view = _View()
        self._functions["view"](self._handle, byref(view))
        return view

    @property
    def phase(self) -> int:
        """State of the state machine of the FMI."""
        return int(self._view().phase)

    def times(self) -> tuple[float, float]:
        """Present time and time of the start, s."""
        view = self._view()
        return view.time, view.start

    def instant(self) -> tuple[int, int]:
        """Row of the present instant in ``window``, and number of rows there."""
        view = self._view()
        return int(view.row), int(view.n_row)

    def inputs(self) -> tuple[Array, Array]:
        """Value and rate of the inputs as they are, and at the start, (n_input, 2) each, copies."""
        view = self._view()
        n = 2 * self._n_input
        now, first = (np.array([part[i] for i in range(n)]).reshape(-1, 2) for part in (view.given, view.first))
        return now, first

    def histories(self) -> dict[int, tuple[Array, Array]]:
        """Histories of prescribed mode by number of the input."""
        view, histories = self._view(), dict[int, tuple[Array, Array]]()
        for i in range(self._n_input):
            of = view.histories[i]
            if of.n:
                histories[i] = np.array(of.t[: of.n]), np.array(of.value[: of.n])
        return histories

    def window(self) -> tuple[Array, Array]:
        """Instants (n,) of the last step, s since the start, and fields of the points at them, (n, n_field), copies."""
        view = self._view()
        n, size = int(view.n_row), int(view.size_of_fields)
        times = np.array([view.times[i] for i in range(n)])
        if not n or not size:
            return times, np.zeros((n, size))
        return times, np.ctypeslib.as_array(view.fields, (n, size)).copy()

    # -- states ---------------------------------------------------------------------------------------------------
    def snapshot(self, inputs: Array) -> bytes:
        """Everything that determines the next steps and the outputs, with these inputs (n_input, 2), as bytes."""
        block = np.ascontiguousarray(inputs, dtype=float)
        self._function("give")(self._handle, c_void_p(address(block)))
        state, size = c_void_p(), c_size_t()
        self._done(self._of_fmi("GetFMUState", byref(state)))
        try:
            self._done(self._of_fmi("SerializedFMUStateSize", state, byref(size)))
            content = ctypes.create_string_buffer(size.value)
            self._done(self._of_fmi("SerializeFMUState", state, content, size))
        finally:
            self._of_fmi("FreeFMUState", byref(state))
        return content.raw

    def restore(self, content: bytes) -> None:
        """Restore what ``snapshot`` returned.

        Raises
        ------
        InputError : bytes that are no such state. SolverError : histories of prescribed mode that do not converge.
        """
        state = c_void_p()
        if self._of_fmi("DeserializeFMUState", content, c_size_t(len(content)), byref(state)) > WARNING:
            raise InputError([Problem("state", self._message())], "unusable state")
        try:
            self._done(self._of_fmi("SetFMUState", state))
        finally:
            self._of_fmi("FreeFMUState", byref(state))
        now = self._view().now
        self.row = np.array([now[i] for i in range(self._n_output)])


def set_numbers(engine: Engine, numbers: Mapping[int, float]) -> None:
    """Set variables of an engine by reference.

    Raises
    ------
    InputError : a value that cannot be, or a variable that cannot be set now; none is set.
    """
    n = len(numbers)
    references, values = (c_uint32 * n)(*numbers), (c_double * n)(*numbers.values())
    if n and engine._of_fmi("SetFloat64", references, c_size_t(n), values, c_size_t(n)) > WARNING:
        raise InputError([Problem("session", engine._message())], _CANNOT)


def numbers_of(engine: Engine, references: Sequence[int]) -> dict[int, float]:
    """Values of variables of an engine by reference.

    Raises
    ------
    SolverError : they are not known now.
    """
    n = len(references)
    values = (c_double * n)()
    if n:
        engine._done(engine._of_fmi("GetFloat64", (c_uint32 * n)(*references), c_size_t(n), values, c_size_t(n)))
    return dict(zip(references, values, strict=True))


def wrong_history(times: Array, values: Array) -> str:
    """What is wrong with a history (n,) for the runtime; empty where nothing is."""
    text = ctypes.create_string_buffer(_LONGEST)
    t, a = (np.ascontiguousarray(part) for part in (times, values))
    places = c_int64(len(t)), c_void_p(address(t)), c_void_p(address(a)), text, c_size_t(_LONGEST)
    if c_runtime.loaded().latin_fmu_wrong_history(*places):
        return text.value.decode()
    return ""


def _freed(shared: Any, instance: int, _kept: object) -> None:
    """Free an instance; what it was handed over is kept until here."""
    shared.fmi3FreeInstance(c_void_p(instance))
