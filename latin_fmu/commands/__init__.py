"""Subcommands of ``latin-fmu``: one file each, with a ``register`` that declares it and sets what runs it.

A subcommand takes the parsed arguments, prints, and returns one of the exit codes below; whatever it does not
handle (bad input, an interruption) is turned into an exit code by ``cli``. Imports are made when it runs, so
that ``--help`` stays immediate.
"""

from __future__ import annotations

CONVERGED, NOT_CONVERGED, BAD_INPUT, SOLVER_FAILED, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit codes; CONVERGED also means "done" for a subcommand that solves nothing."""
