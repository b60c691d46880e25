"""Rules of the iteration that both roads (``solver`` and the compiled one) follow."""

from __future__ import annotations

from typing import Final

# Stall: the best of the last RECENT residuals is above this fraction of the best before, after PATIENCE iterations.
RECENT: Final = 6
PATIENCE: Final = 12
STALL_ACCELERATED: Final = 0.7
STALL_PLAIN: Final = 0.99

# Below this fraction of the tolerance nothing happens and the warm start is the answer.
AT_REST: Final = 1e-2

# Relative size below which directions of the least-squares problem of the acceleration are dropped.
RANK: Final = 1e-12

# Tangential mismatch is measured against its own scale, at least this fraction of the normal one.
TANGENTIAL_FLOOR: Final = 1e-2
