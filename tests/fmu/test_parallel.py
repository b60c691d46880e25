"""Instances of one library in threads, whose functions a host may call at the same time (FMI 3, 2.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Barrier, Thread

import numpy as np

from .host import Host

N = 8
H = 0.7e-6
"""No multiple of the time step: steps end between instants."""


def work_of(host: Host, load: float, rows: list[np.ndarray], meet: Callable[[], object]) -> None:
    """A whole simulation with a step that is rolled back, a state as bytes and a derivative."""
    host.start()
    places = [[host.reference(name)] for name in ("interface.crush.force[3]", "load.press.value")]
    for i in range(5):
        meet()  # the calls of all instances that follow begin at once
        host.set(load__press__value=load * (1 + i), load__press__rate=1e4 * load)
        before = host.from_bytes(host.to_bytes(host.save()))
        assert host.step(i * H, H)
        host.restore(before)
        assert host.step(i * H, H)
        rows.append(np.append(host.read(), host.fmu.getDirectionalDerivative(*places, [1.0])))
    host.fmu.terminate()


def rows_of(fmu: Path, folder: Path, together: bool) -> list[list[np.ndarray]]:
    """Outputs of instances with unlike loads, all at once or one after the other."""
    hosts = [Host(fmu, folder / f"{together} {i}", name=f"number {i}") for i in range(N)]
    rows: list[list[np.ndarray]] = [[] for _ in hosts]
    meet: Callable[[], object] = Barrier(N, timeout=30).wait if together else int
    threads = [Thread(target=work_of, args=(host, 0.1 * (i + 1), rows[i], meet)) for i, host in enumerate(hosts)]
    for thread in threads:
        thread.start()
        if not together:
            thread.join()
    for thread in threads:
        thread.join()
    for host in hosts:
        host.close()
    return rows


def bits(rows: Sequence[Sequence[np.ndarray]]) -> list[list[bytes]]:
    return [[row.tobytes() for row in of_instance] for of_instance in rows]


def test_eight_instances_in_eight_threads_have_the_bits_of_one_thread(made, fmi, tmp_path):
    alone, together = (bits(rows_of(made[fmi], tmp_path, how)) for how in (False, True))
    assert [len(rows) for rows in together] == [5] * N
    assert together == alone
    assert len({rows[-1] for rows in alone}) == N  # unlike loads, unlike outputs
