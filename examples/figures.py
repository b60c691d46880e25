"""Draw the figures of README and docs/ anew, each by its command: ``python examples/figures.py [NAME ...]``.

A figure carries the version it was drawn with and a digest of the code that it shows, in the text of the PNG file.
``tests/test_docs.py`` fails where that code has changed since and the figure is older than the last release. Without a
name all are drawn: hours, on a machine without other work for those with CPU times; ``--list`` prints what each needs.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import subprocess
import sys
from argparse import ArgumentParser
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from PIL.PngImagePlugin import PngInfo

import latin_fmu

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "examples" / "figures"
RUN = ("kernels", "laws", "latin", "time_scheme", "fem")


@dataclass(frozen=True)
class Drawing:
    """Command that draws a figure into the current folder, and the folders of ``latin_fmu`` that it shows.

    Commands run one after the other where ``&&`` joins them; ``-`` : the Python block of README.md. says : what there
    is to see, for the gallery, where no head of a script says it.
    """

    command: str
    shows: tuple[str, ...] = RUN
    says: str = ""

    def source(self) -> str:
        """The file that the gallery links to, from the top of the repository: the script, or the README of a model."""
        words = (word for word in self.command.split() if word.startswith(("examples/", "models/")))
        file = next(words, "README.md")
        return str(Path(file).with_name("README.md")) if file.startswith("models/") and file.endswith(".toml") else file

    def digest(self) -> str:
        """Of the sources of what it shows, and of its script."""
        files = [path for name in self.shows for path in sorted((ROOT / "latin_fmu" / name).glob("*.py"))]
        files += [ROOT / word for word in self.command.split() if word.startswith("examples/")]
        return hashlib.sha256(b"\0".join(path.read_bytes() for path in files)).hexdigest()[:16]


def _script(name: str, *shows: str) -> Drawing:
    return Drawing(f"python examples/{name} -o .", (*RUN, *shows))


DRAWINGS = {
    "lap_joint": Drawing(
        "latin-fmu run models/lap_joint/scene.toml -o lap_joint.nc --set output.fields=true "
        "&& latin-fmu plot lap_joint.nc --bodies --interface lower_upper --time 1 -o lap_joint.png",
        (*RUN, "pictures"),
        "A bolted lap joint: five parts, tightened and pulled; the pressure between the plates is a cone under the "
        "washer.",
    ),
    "lap_joint_stress": Drawing(
        "latin-fmu run models/lap_joint/shock.toml -o shock.nc --no-estimate --set output.nodal_stress=true "
        "&& latin-fmu plot shock.nc --bodies --stress -o lap_joint_stress.png",
        (*RUN, "pictures"),
        "The same joint under a shock, coloured by von Mises stress; colours end at the largest one away from edges of "
        "contacts.",
    ),
    "hammer_on_plate": Drawing(
        "latin-fmu plot models/hammer_on_plate/scene.toml -o hammer_on_plate.png",
        ("pictures",),
        "A scene before it runs: parts, interfaces, supports, velocities.",
    ),
    "friction_force": Drawing(
        "-", RUN, "A study in twelve lines of Python: friction force of a crushing for three coefficients."
    ),
    "cost_of_accuracy": Drawing(
        "latin-fmu cost models/beam_in_traction/scene.toml models/two_specimen_crushing/scene.toml "
        "models/hammer_on_plate/scene.toml --of peak_force --of impulse --budget 60 -o .",
        (*RUN, "accuracy"),
        "What accuracy costs: error against CPU time by what is refined, and the cheapest runs for 5, 2 and 1 %.",
    ),
    "waves_in_bars": _script("waves_in_bars.py"),
    "landing": _script("landing.py"),
    "front_through_joint": _script("front_through_joint.py"),
    "the_paper_beam": _script("the_paper.py"),
    "the_paper_crushing": _script("the_paper.py"),
    "convergence_friction": _script("convergence_friction.py"),
    "static_friction": _script("static_friction.py"),
    "prestress": _script("prestress.py", "assembly", "statics"),
    "base_history": Drawing(
        "latin-fmu base examples/base_history.csv -o base_history",
        ("shock",),
        "A base history from a specified shock response spectrum: band, spectrum reached, and the motion of the base.",
    ),
    "random_vibration": Drawing(
        "latin-fmu random examples/random_vibration.toml --windows 50 --jobs 1 -o random.nc && "
        "latin-fmu plot random.nc -o random_vibration.png",
        ("shock", "parametric"),
        "A bracket over a stop under a random vibration: spectra and crossings with bands, and the linear answer.",
    ),
    "joint_damping": _script("joint_damping.py", "assembly"),
    "thin_beam": _script("thin_beam.py", "assembly"),
    "electronics_box_parts": Drawing(
        "latin-fmu plot models/electronics_box/scene.toml -o electronics_box_parts.png",
        ("pictures",),
        "An electronics box of twelve parts, whole and apart, with its interfaces.",
    ),
    "electronics_box": _script("electronics_box.py", "assembly"),
    "stop": _script("fmu_stop.py", "cosim"),
    "port_signs": Drawing("python examples/port_signs.py -o .", ()),
    "estimated_error": _script("estimated_error.py", "accuracy"),
    "price_of_friction": _script("benchmarks/price_of_friction.py", "propagator", "cholesky"),
    "large_faces": _script("benchmarks/large_faces.py", "propagator", "cholesky"),
    "growth": _script("benchmarks/growth.py", "propagator", "cholesky"),
    "against_calculix": _script("benchmarks/against_calculix.py --static", "propagator", "cholesky"),
}


def drawn_with(figure: Path) -> tuple[str, str]:
    """Version of the package and digest of the code that a figure was drawn with."""
    with Image.open(figure) as image:
        text = image.info
    return str(text.get("latin_fmu", "")), str(text.get("code", ""))


def stamp(source: Path, target: Path, version: str, digest: str) -> None:
    """Write a figure with its version and digest."""
    with Image.open(source) as image:
        text = PngInfo()
        text.add_text("latin_fmu", version)
        text.add_text("code", digest)
        image.save(target, pnginfo=text, dpi=image.info.get("dpi", (150, 150)), optimize=True)


def draw(name: str) -> None:
    """Run the command of a figure in a folder of its own and keep the figure."""
    drawing = DRAWINGS[name]
    with TemporaryDirectory() as folder:
        for shared in ("models", "examples"):
            (Path(folder) / shared).symlink_to(ROOT / shared)
        for command in drawing.command.split(" && "):
            words = [sys.executable, *_words(command)]
            subprocess.run(
                words, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}, check=True
            )
        (made,) = Path(folder).rglob(f"{name}.png")
        stamp(made, FOLDER / f"{name}.png", latin_fmu.__version__, drawing.digest())


def _words(command: str) -> list[str]:
    """Arguments of Python for a command."""
    if command == "-":
        text = (ROOT / "README.md").read_text(encoding="utf-8")
        (block,) = re.findall(r"```python\n(.*?friction_force\.png.*?)```", text, re.S)
        return ["-c", block.replace("two_specimen_crushing/scene", "models/two_specimen_crushing/scene")]
    words = shlex.split(command)
    return ["-m", "latin_fmu", *words[1:]] if words[0] == "latin-fmu" else words[1:]


def main() -> None:
    """Draw what is named."""
    parser = ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("name", nargs="*", choices=[[], *DRAWINGS], default=[])
    parser.add_argument("--list", action="store_true", help="print version, state of the code and command of each")
    given = parser.parse_args()
    for name in given.name or DRAWINGS:
        if given.list:
            version, digest = drawn_with(FOLDER / f"{name}.png")
            state = "as it is now" if digest == DRAWINGS[name].digest() else "changed since"
            print(f"{name:22}{version:8}{state:15}{DRAWINGS[name].command}")
        else:
            draw(name)


if __name__ == "__main__":
    main()
