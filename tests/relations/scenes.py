"""All relations on random scenes, from seed to seed, or on seeds that nobody has seen before.

    python -m tests.relations.scenes 1000 2000 --log scenes.jsonl
    python -m tests.relations.scenes --draw 1000 --log drawn.jsonl

The log has a line for each seed; a second call goes on where it ends, and calls with other seeds may add to it at the
same time. Drawn seeds are those of the log, and as many new ones as are missing. The table is printed at the end.
Relations that build an FMU take one scene in 25.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import tempfile
import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from .pairs import Pairs
from .random_scenes import random_scene
from .relations import RELATIONS, load_of, run

FEW = 25
"""Of so many scenes one is taken by relations that are costly."""


def all_relations(seed: int, folder: Path) -> Pairs:
    """All relations on the scene of a seed."""
    pairs, tables = Pairs(), random_scene(seed)
    base = run(tables, folder)
    pairs.open_points(seed, base, load_of(tables))
    for relation in RELATIONS.values():
        if not relation.costly or seed % FEW == 0:
            pairs.add(seed, tables, base, relation, folder)
    return pairs


def on_seeds(seeds: Iterable[int], log: Path) -> Pairs:
    """Pairs of seeds, those that are in the log read from it, the others added to it."""
    known, every = _logged(log), Pairs()
    for seed in seeds:
        if seed not in known:
            with tempfile.TemporaryDirectory() as folder:
                try:
                    pairs = all_relations(seed, Path(folder))
                except Exception:
                    # a traceback is a fault, and the others go on
                    pairs = Pairs(faults=[f"{seed}: {traceback.format_exc()}"])
            known[seed] = pairs.as_data()
            with log.open("a") as file:
                file.write(json.dumps({"seed": seed, "pairs": known[seed]}) + "\n")
        every.merge(Pairs.of_data(known[seed]))
    return every


def _logged(log: Path) -> dict[int, dict[str, Any]]:
    """Pairs of each seed in a log, as plain data."""
    lines = log.read_text().splitlines() if log.exists() else []
    return {entry["seed"]: entry["pairs"] for entry in map(json.loads, lines)}


def drawn(count: int, log: Path) -> Iterator[int]:
    """The seeds of a log, and numbers of the machine's own source of chance until there are ``count``."""
    seeds, source = list(_logged(log)), random.SystemRandom()
    yield from seeds
    for _ in range(count - len(seeds)):
        yield source.randrange(2**31, 2**32)


def main() -> int:
    """Run the command; 1 where pairs are apart."""
    parser = argparse.ArgumentParser(description="all relations on random scenes")
    parser.add_argument("first", type=int, nargs="?", default=0, help="first seed")
    parser.add_argument("end", type=int, nargs="?", default=0, help="seed behind the last one")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="N seeds by chance, in place of a range")
    parser.add_argument("--log", type=Path, required=True, help="file with a line for each seed")
    arguments = parser.parse_args()
    seeds = drawn(arguments.draw, arguments.log) if arguments.draw else range(arguments.first, arguments.end)
    pairs = on_seeds(seeds, arguments.log)
    sys.stdout.write(f"{pairs.report()}\n")
    return int(bool(pairs.faults))


if __name__ == "__main__":
    sys.exit(main())
