"""Calls out of the kernels for what only the caller of a run has: messages between its processes, laws in NumPy,
factors that the kernels do not hold.

``run.callout`` is the address of a function of the caller, 0 where there is none. It is given with a run, is never part
of a state, and takes what is to be done, one of the numbers below, and three arguments. It returns no error: the caller
keeps it, and leaves ``failed`` set, on which the loops over iterations and instants end. It is set before each call, so
that one which a signal ends before its first line has failed, too.
"""

from __future__ import annotations

from typing import Any

from ..compiled import Intrinsic, kernel

MESSAGES, PARTS_OF_ALL, NORMS_OF_ALL, COARSE, CHANGES, UNKNOWNS, MATRIX, SUM = range(8)
LAW, TANGENTS, FORWARD, BACKWARD, OBSERVE, DERIVATIVES = range(8, 14)
"""What is done. By several processes (``latin.exchange``): messages of a number of fields to the neighbours; ``parts``
from the ``own_parts`` of all; ``all_norms`` likewise; ``coarse_parts``; ``changes`` of divided classes; unknowns of a
Newton step ``elsewhere``; sum of its matrix, of a size, and of its right-hand side; sums of numbers at a place of
``moving``. By any (``latin.run_image``, ``propagator.image``): tractions of a group by its law, for the points from one
to another; derivatives of that law; half solutions of a class from its load, and from that of its interfaces; a look at
an iterate, with the bits of its verdict; q and W of the derivatives of an instant, of a row of the tangents
(``tangent_march``)."""


def _called(_context: Any, _address: Any, _what: Any, _a: Any, _b: Any, _c: Any) -> Any:
    from numba import types

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        from llvmlite import ir

        word = ir.IntType(64)
        shape = ir.FunctionType(word, [word] * 4)
        return builder.call(builder.inttoptr(values[0], shape.as_pointer()), values[1:])

    return types.int64(*[types.int64] * 5), generate


def _called_in_python(address: int, what: int, a: int, b: int, c: int) -> int:
    from ctypes import CFUNCTYPE, c_int64

    return int(CFUNCTYPE(c_int64, *[c_int64] * 4)(int(address))(int(what), int(a), int(b), int(c)))


_call: Any = Intrinsic(_called, _called_in_python)


@kernel
def call_out(pools: Any, what: int, a: int, b: int, c: int) -> None:
    """Let the caller do ``what`` with these arguments."""
    pools.moving[pools.run[0].failed] = 1.0
    _call(pools.run[0].callout, what, a, b, c)


@kernel
def has_failed(pools: Any) -> bool:
    """Whether a call of the caller has failed."""
    return bool(pools.moving[pools.run[0].failed] == 1.0)
