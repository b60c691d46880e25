"""Compile the libraries of FMUs for all platforms, or for those named, into ``build/``."""

import sys

from . import BUILD, KINDS, PLATFORMS, compiled, zig

for name in sys.argv[1:] or PLATFORMS:
    for kind in KINDS:
        sys.stdout.write(f"{compiled(name, kind, BUILD, zig(name))}\n")
