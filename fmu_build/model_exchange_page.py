"""documentation/index.html of a Model Exchange FMU."""

from __future__ import annotations

from html import escape

from latin_fmu.model_exchange.system import Names

from .documentation import STYLE
from .facts import Facts

_TEXT = """\
<h2>What it is</h2>
<p>A <b>reduced</b> model of the scene below, as ordinary differential equations with state and time events. It is
meant to <b>cross-check</b> the co-simulation FMU of the same scene, which solves the full mesh by the LATIN method:
the two share meshes and matrices, not the treatment of contact nor the integration in time.</p>
<ul>
<li>Every body moves in {n_mode} elastic modes, its rigid motions, and its static answers to the loads and to the
interfaces. Bonded substructures are one body.</li>
<li>Faces in contact are cut into {n_patch} patches (fewer where a face has fewer nodes) of uniform pressure.</li>
<li>Contact is a stiff spring with damping: patches penetrate by 1/<code>contactStiffness</code> of the static
shortening of the two bodies. Friction is Coulomb's, but sticking patches creep at less than
<code>slidingVelocity</code>.</li>
<li>Patches open, close, stick and slip at state events; the time laws of the scene jump at time events.</li>
</ul>
<h2>What to expect of it</h2>
<p>Impulses, momentum, and the times of contact and separation agree with the full model within a few per cent.
Fronts of waves, pressures at points, and what happens after many bounces do not: modes above the last one are
missing. Compare two numbers of modes before trusting a detail. (Patches were fine enough for the loads: with contacts
closed, the deflection under each is that of the mesh within 10 %.)</p>
<h2>Use</h2>
<ul>
<li>Any importer with an integrator for stiff systems and root finding (e.g. CVode, BDF); relative tolerance 1e-5.</li>
<li>A load with the law <code>input</code> is <code>value + rate * (t - time it was set)</code>: an importer that hands
inputs over at every evaluation leaves <code>rate</code> at 0.</li>
<li>Time counts from 0; the laws of the scene do too.</li>
<li>An input that is not a finite number is logged as an error, derivatives become NaN and the next event ends the
simulation. Saving and restoring the state (serialised or not) is exact.</li>
<li>Extract the FMU to a path in plain ASCII: the exporter's library cannot open another one.</li>
</ul>
"""


def model_exchange_page(facts: Facts, names: Names, scene_text: str, n_mode: int, n_patch: int) -> str:
    """The page: what it is, use, variables, scene."""
    rows = [
        (v.name, v.causality, v.unit or "", "" if v.start is None else str(v.start), v.description) for v in names.table
    ] + [(v.name, "local", v.unit, "" if v.start is None else f"{v.start:g}", v.description) for v in names.locals]
    table = "\n".join(
        f"<tr><td>{number}</td><td><code>{escape(row[0])}</code></td>"
        + "".join(f"<td>{escape(text)}</td>" for text in row[1:])
        + "</tr>"
        for number, row in enumerate(rows)
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(facts.model)}</title>\n'
        f"<style>{STYLE}</style></head><body>\n<h1>{escape(facts.model)}</h1>\n<p>{escape(facts.description)}</p>\n"
        f"<p>FMI 3.0 for Model Exchange, made by latin_fmu {facts.version}. SI units; components are counted from 1, "
        f"along x, y, z.</p>\n{_TEXT.format(n_mode=n_mode, n_patch=n_patch)}<h2>Variables</h2>\n<table><tr>"
        "<th>reference</th><th>name</th><th>causality</th><th>unit</th><th>start</th><th>meaning</th></tr>\n"
        f"{table}\n</table>\n<h2>Scene</h2>\n<pre>{escape(scene_text)}</pre>\n</body></html>\n"
    )
