"""Tasks of a kernel done by several threads: a region of tasks is opened, claimed task by task, and closed.

The first thread runs the march and opens the regions; the others wait in ``entries.SERVE`` for the next ticket. A task
is claimed by an atomic maximum of its mark with the ticket of its region, so that every task is done once, by whichever
thread is there: a thread that is late, or whose core is taken, holds up nothing that it has not begun. Each thread
begins with tasks of its own, the same ones in every region, so that their data stay in its cache.

Tasks of one region write to places of their own, and sums over tasks are taken by the first thread in the order of the
tasks: results are equal to the last bit with any number of threads. A waiting thread reads the ticket some thousand
times, then yields its core after every read.

Numbers of the team, from ``run.team`` on, in lines of the cache:

    0 ticket   1 tasks done, in all   2 whether the threads are dismissed   3, 4 arguments of even and odd tickets
    5 tasks opened, in all   6 ... a mark for every task, a line each   then the classes in the order of the threads
"""

from __future__ import annotations

from typing import Any, Final

from ..compiled import Intrinsic, kernel

LINE: Final = 8
"""Numbers in a line of the cache: arrays begin on one."""
TICKET = 0
DONE = LINE
DISMISSED = 2 * LINE
ARGUMENTS = 3 * LINE
OPENED = 5 * LINE
MARKS = 6 * LINE
"""Places of the numbers of the team."""
PATIENCE: Final = 4000
"""Reads of a number before a waiting thread yields its core."""
PARTS: Final = 4
"""Parts of a product with a large matrix: one for each thread, of four at most."""


def _pointer(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Address of entry ``values[1]`` of the array ``values[0]``."""
    from numba.core import cgutils
    from numba.np import arrayobj

    tools: Any = cgutils
    arrays: Any = arrayobj
    array = arrays.make_array(signature.args[0])(context, builder, values[0])
    return tools.gep(builder, array.data, values[1])


def _load(_context: Any, numbers: Any, _at: Any) -> Any:
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.load_atomic(_pointer(context, builder, signature, values), "acquire", 8)

    return types.int64(numbers, types.int64), generate


def _store(_context: Any, numbers: Any, _at: Any, _value: Any) -> Any:
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.store_atomic(values[2], _pointer(context, builder, signature, values), "release", 8)
        return context.get_dummy_value()

    return types.void(numbers, types.int64, types.int64), generate


def _changed(operation: str) -> Any:
    def change(_context: Any, numbers: Any, _at: Any, _value: Any) -> Any:
        from numba import types

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.atomic_rmw(operation, _pointer(context, builder, signature, values), values[2], "seq_cst")

        return types.int64(numbers, types.int64, types.int64), generate

    return change


def _yield(_context: Any) -> Any:
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils

    def generate(context: Any, builder: Any, _signature: Any, _values: Any) -> Any:
        tools: Any = cgutils
        shape = ir.FunctionType(ir.IntType(32), [])
        builder.call(tools.get_or_insert_function(builder.module, shape, "latin_fmu_yield"), [])
        return context.get_dummy_value()

    return types.void(), generate


def _place(_context: Any, block: Any, part: Any) -> Any:
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        from numba.np import arrayobj

        arrays: Any = arrayobj
        first, second = (
            builder.ptrtoint(arrays.make_array(kind)(context, builder, value).data, context.get_value_type(types.int64))
            for kind, value in zip(signature.args, values, strict=True)
        )
        return builder.sdiv(builder.sub(second, first), context.get_constant(types.int64, 8))

    return types.int64(block, part), generate


def _load_in_python(numbers: Any, at: int) -> int:
    return int(numbers[at])


def _store_in_python(numbers: Any, at: int, value: int) -> None:
    numbers[at] = value


def _add_in_python(numbers: Any, at: int, value: int) -> int:
    old, numbers[at] = int(numbers[at]), numbers[at] + value
    return old


def _largest_in_python(numbers: Any, at: int, value: int) -> int:
    old, numbers[at] = int(numbers[at]), max(numbers[at], value)
    return old


def _place_in_python(block: Any, part: Any) -> int:
    return int(part.ctypes.data - block.ctypes.data) // 8


read_shared: Any = Intrinsic(_load, _load_in_python)
write_shared: Any = Intrinsic(_store, _store_in_python)
add_shared: Any = Intrinsic(_changed("add"), _add_in_python)
raise_shared: Any = Intrinsic(_changed("max"), _largest_in_python)
give_way: Any = Intrinsic(_yield, lambda: None)
place_in: Any = Intrinsic(_place, _place_in_python)
"""Place of an array in a block of memory, both of numbers of 8 bytes: ``place_in(block, array)``."""


@kernel
def open_region(pools: Any, n: int, action: int, c: int, a: int, b: int, d: int, factor: float) -> int:
    """Open a region of n tasks of an action with its arguments; its ticket."""
    team, numbers = pools.run[0].team, pools.moving_int
    ticket = numbers[team + TICKET] + 1
    # a thread that is late may still read those of the region before
    at = team + ARGUMENTS + LINE * (ticket % 2)
    numbers[at] = n
    numbers[at + 1] = action
    numbers[at + 2] = c
    numbers[at + 3] = a
    numbers[at + 4], numbers[at + 5] = b, d
    pools.moving[at + 6] = factor
    numbers[team + OPENED] += n
    # last: a thread that reads the ticket reads these arguments
    write_shared(numbers, team + TICKET, ticket)
    return int(ticket)


@kernel
def claimed(pools: Any, ticket: int, n: int, home: int, k: int) -> int:
    """The k-th task or one behind it, counted from the task ``home`` on, that this thread has claimed; n where none is
    left."""
    team, numbers = pools.run[0].team, pools.moving_int
    while k < n:
        mark = team + MARKS + LINE * ((home + k) % n)
        if read_shared(numbers, mark) < ticket and raise_shared(numbers, mark, ticket) < ticket:
            # a thread that is late may have read the arguments of a later region
            return k if read_shared(numbers, team + TICKET) == ticket else n
        k += 1
    return n


@kernel
def end_task(pools: Any) -> None:
    """Count a task as done."""
    add_shared(pools.moving_int, pools.run[0].team + DONE, 1)


@kernel
def close_region(pools: Any) -> None:
    """Wait until all tasks are done."""
    team = pools.run[0].team
    numbers = pools.moving_int
    looks = 0
    # counts of all regions so far, never set back: no thread can be a region behind
    while read_shared(numbers, team + DONE) < numbers[team + OPENED]:
        looks += 1
        if looks > PATIENCE:
            give_way()


@kernel
def next_ticket(pools: Any, last: int) -> int:
    """Ticket of the next region after ``last``, as soon as there is one; 0 where the threads are dismissed."""
    team = pools.run[0].team
    numbers = pools.moving_int
    looks = 0
    while True:
        ticket = read_shared(numbers, team + TICKET)
        if ticket > last:
            return int(ticket)
        if read_shared(numbers, team + DISMISSED) == 1:
            return 0
        looks += 1
        if looks > PATIENCE:
            give_way()
