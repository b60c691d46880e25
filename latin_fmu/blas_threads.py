"""One thread for the dense linear algebra inside the solver.

Threads on small dense products cost more than they give, and the sums would depend on their number.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[object]:
    """Context in which BLAS uses one thread."""
    limited: AbstractContextManager[object] = _controller().limit(limits=1)
    return limited


@cache
def _controller() -> ThreadpoolController:
    """The libraries of this process: looking for them takes longer than a small run, so it is done once."""
    import scipy.linalg.cython_blas  # noqa: F401, loads the library that the kernels call

    return ThreadpoolController()
