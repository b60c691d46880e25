"""A host that has run FMUs ends in good order: the exporter's library gives back what it holds once."""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/self/maps")

_CODE = """
    import atexit, ctypes, json, sys
    from pathlib import Path
    sys.path[:0] = [{root!r}]
    from tests.fmu.host import Host


    def holds(library):
        \"\"\"Shared pointers in its data, to what was made on the heap together with its counters of 16 bytes.\"\"\"
        areas, last, heap = [], 0, range(0)
        for line in Path("/proc/self/maps").read_text().splitlines():
            span, kind, _, _, node, *name = line.split(None, 5)
            begin, end = (int(number, 16) for number in span.split("-"))
            own = bool(name) and name[0].startswith(library)
            if kind.startswith("rw") and (own or (node == "0" and not name and begin == last)):
                areas.append((begin, end))
            last = end if own or begin == last else 0
            heap = range(begin, end) if name == ["[heap]"] else heap
        words = [word for begin, end in areas
                 for word in (ctypes.c_uint64 * ((end - begin) // 8)).from_address(begin)]
        return sum(second in heap and first == second + 16 for first, second in zip(words, words[1:]))


    hosts = [Host(Path({fmu!r}), Path({folder!r}) / str(i)) for i in range(2)]
    libraries = [str(next((host.folder / "binaries").glob("*linux*/*.so"))) for host in hosts]
    begun = [holds(library) for library in libraries]
    for host in hosts:
        host.close()
    kept = [holds(library) for library in libraries]
    atexit._run_exitfuncs()
    print(json.dumps([begun, kept, [holds(library) for library in libraries]]))
"""


@pytest.mark.parametrize("open_at_exit", [False, True])
def test_the_library_holds_nothing_when_the_interpreter_has_ended(fmus, fmi, tmp_path, open_at_exit):
    """Else it gives it back a second time when the process ends, in memory that others own by then."""
    root = str(Path(__file__).parents[2])
    code = textwrap.dedent(_CODE.format(root=root, fmu=str(fmus[fmi]), folder=str(tmp_path)))
    if open_at_exit:
        code = code.replace("    host.close()\n", "    pass\n")
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=200, check=False)
    assert process.returncode == 0, process.stderr
    assert json.loads(process.stdout.splitlines()[-1]) == [[1, 1], [1, 1], [0, 0]]
