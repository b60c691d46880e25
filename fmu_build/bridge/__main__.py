"""Compile the libraries of FMUs for all platforms, or for those named, into ``build/``."""

import sys

from . import BUILD, PLATFORMS, compiled, zig

for name in sys.argv[1:] or PLATFORMS:
    sys.stdout.write(f"{compiled(name, BUILD, zig(name))}\n")
