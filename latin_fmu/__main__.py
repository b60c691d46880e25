"""``python -m latin_fmu`` and ``latin-fmu``: the command line."""

from __future__ import annotations

import signal
import sys


def main() -> int:
    """Run the command line of the process and return its exit code.

    Until the command line handles interruptions itself they end the process without a word: it holds nothing yet.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .cli import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())
