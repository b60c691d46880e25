"""Histories from recorders and oscilloscopes: what a file says of its columns and units, and where its times lie.

Units stand in brackets, behind a stroke, or in a line of their own: ``Time (ms)``, ``Zeit / s``, ``second,Volt``. The
unit of time that a header names is that of the times. A unit of values is compared with the one of the scene: numbers
with another unit than the scene takes them for are refused.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .fields import refusal
from .number_files import MULTIPLIED, Column, NumberTable, factor, number_table
from .unit_texts import DENSITY, QUANTITIES, plain_unit, unit_size
from .units import UnitSystem

STARTS: Final = ("file", "record", "cut")
GAPS: Final = ("refused", "linear")
FEWEST_SAMPLES: Final = 10
"""Points of a record; fewer are a table made by hand, which may have intervals of any length."""
_HOLE = 3.0  # medians of the intervals
_ROUND_OFF = 1e-9
_BEFORE = 1e-3  # of the median interval: round-off of a first sample at t = 0

_TIMES: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(("S", "sec", "secs", "second", "seconds", "sekunde", "sekunden", "seconde"), "s"),
        **dict.fromkeys(("mS", "msec", "millisecond", "milliseconds", "millisekunden"), "ms"),
        **dict.fromkeys(("uS", "usec", "microsecond", "microseconds", "mikrosekunden"), "us"),
        **dict.fromkeys(("nS", "nsec", "nanosecond", "nanoseconds"), "ns"),
        **dict.fromkeys(("minute", "minutes", "minuten"), "min"),
        **dict.fromkeys(("hour", "hours", "stunden"), "h"),
    }
)
_VALUES: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(("G", "gn", "g_n", "g0", "grav", "gravity"), "g"),
        **dict.fromkeys(("ms-2", "meter/s2", "m/sec2"), "m/s2"),
        **dict.fromkeys(("newton", "newtons"), "N"),
        **dict.fromkeys(("micron", "microns"), "um"),
        **dict.fromkeys(("inches",), "in"),
        **dict.fromkeys(("ms-1", "m/sec"), "m/s"),
        **dict.fromkeys(("pascal",), "Pa"),
    }
)
"""Words of recorders for units, beside the texts of units."""
_OTHERS: Final = ("V", "mV", "uV", "kV", "volt", "volts", "A", "mA", "dB", "Hz", "kHz", "degC")
_BRACKETS: Final = re.compile(r"[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")
_SQUARE: Final = re.compile(r"\[([^\[\]]*)\]\s*$")  # with brackets of a unit inside
_BEHIND: Final = re.compile(r"(?:/\s*|[,:;]\s*|\sin\s+)([^\s,:;]+)$")
_LAST_WORD: Final = re.compile(r"[\s_.]([^\s_.]+)$")


@dataclass(frozen=True)
class ColumnHead:
    """What a file says of one of its columns.

    Attributes
    ----------
    place : number of the column, from 1. title : its name, empty where it has none. unit : as written, empty where
    there is none. unit_name : the same as a scene names it, None where no scene does.
    """

    place: int
    title: str
    unit: str
    unit_name: str | None

    def words(self) -> str:
        """The column in messages."""
        if self.title:
            shown = f' "{self.title[:40]}"'
        else:
            shown = ""
        if self.unit and self.unit not in self.title:
            beside = f" in {self.unit[:20]}"
        else:
            beside = ""
        return f"column {self.place}{shown}{beside}"


@dataclass(frozen=True)
class History:
    """Times and values as they stand in a file, and what it says of them."""

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    along: ColumnHead
    of: ColumnHead
    remarks: tuple[str, ...] = ()


def named_unit(text: str, time: bool) -> str | None:
    """Name in a scene of a unit as people write it; None where a scene has none."""
    plain = plain_unit(text)
    for word in (plain, plain.casefold() if len(plain) > 2 else plain):
        name = (_TIMES if time else _VALUES).get(word, word)
        units = ("s",) if time else (*MULTIPLIED, DENSITY)
        unit = next((u for u in units if unit_size(name, u) is not None), None)
        # "1" in a header is a number of something
        if unit is not None and name != "1":
            # one spelling, so that names can be compared
            same = (n for n in QUANTITIES[unit].names if unit_size(n, unit) == unit_size(name, unit))
            return next(same, name)
    return None


def _is_unit(text: str) -> bool:
    """Whether a text is a unit, of whatever."""
    plain = plain_unit(text)
    others = plain in _OTHERS or plain.casefold() in _OTHERS
    return others or named_unit(text, True) is not None or named_unit(text, False) is not None


def _bare(cell: str) -> str:
    """A cell without brackets around the whole of it."""
    found = _SQUARE.fullmatch(cell.strip()) or _BRACKETS.fullmatch(cell.strip())
    if found:
        return found[1].strip()
    return cell.strip()


def _unit_in(title: str, time: bool) -> str:
    """Unit that a title names, as written; empty where it names none."""
    found = _SQUARE.search(title) or _BRACKETS.search(title)
    if found and _is_unit(found[1].strip()):
        return found[1].strip()
    for pattern in (_BEHIND, *([_LAST_WORD] if time else [])):
        found = pattern.search(title)
        if found and named_unit(found[1].strip(), time) is not None:
            return found[1].strip()
    return ""


def column_unit(table: NumberTable, i: int) -> str:
    """Unit of the i-th column as its header writes it, in a title or a cell of its own; empty where there is none."""
    place = table.places[i]
    for line in reversed(table.header[-2:]):
        if place < len(line):
            bare = _bare(line[place])
            unit = bare if _is_unit(bare) else _unit_in(line[place], False)
            if unit:
                return unit
    return ""


def heads(table: NumberTable) -> tuple[ColumnHead, ColumnHead]:
    """What the header of a file says of the columns of times and of values."""
    lines = [line for line in table.header[-2:] if max(table.places) < len(line) <= table.width]
    along = table.places[0]
    columns = []
    of_units = [line for line in lines if named_unit(_bare(line[along]), True) is not None]
    for i, place in enumerate(table.places):
        titles = [line[place] for line in lines if line not in of_units and line[place]]
        units = [_bare(line[place]) for line in of_units] + [_unit_in(title, i == 0) for title in titles]
        unit = next((u for u in units if u and _is_unit(u)), "")
        columns.append(ColumnHead(place + 1, titles[-1] if titles else "", unit, named_unit(unit, i == 0)))
    return columns[0], columns[1]


def read_history(base_dir: Path, name: str, time_column: Column | None, column: Column | None) -> History:
    """A history from a table of text, or from a universal file.

    Raises the refusal of the field that names the file.
    """
    from .universal_files import is_universal, universal_history

    if is_universal(base_dir, name):
        if time_column is not None:
            what = "the functions of a universal file have their times with them"
            raise refusal(what, value=time_column, remedy="omit time_column, and name the function by column")
        f = universal_history(base_dir, name, column)
        along = ColumnHead(f.number, "time", f.time_unit, named_unit(f.time_unit, True))
        return History(f.times, f.values, along, ColumnHead(f.number, f.name, f.unit, named_unit(f.unit, False)))
    columns = None
    if time_column is not None or column is not None:
        columns = [time_column or 1, column or 2]
    table = number_table(base_dir, name, columns)
    array = np.array(table.rows, dtype=np.float64).reshape(-1, 2)
    along, of = heads(table)
    said: tuple[str, ...] = ()
    if table.decimal_comma:
        said = ("decimal comma",)
    return History(array[:, 0], array[:, 1], along, of, said)


def _source(unit: object) -> str:
    """Where a unit comes from that the scene writes, or does not."""
    if unit is None:
        return " by the header"
    return ""


def filled(data: Mapping[str, Any], base_dir: Path, system: UnitSystem) -> dict[str, Any]:
    """The keys of a law of a file with its times, values and units, and in words what was read.

    Raises the refusal of the law: units that contradict the header, samples before t = 0, holes.
    """
    history = read_history(base_dir, data["file"], data.get("time_column"), data.get("column"))
    time_unit = _time_unit(data.get("time_unit"), history.along)
    value_unit = _value_unit(data.get("value_unit"), history.of, system)
    times = factor(time_unit) * history.times
    values = factor(value_unit, system) * history.values
    start, shift = data.get("start", STARTS[0]), float(data.get("shift", 0.0))
    # what is no record at all is refused by the law
    if len(times) > 1 and (np.diff(times) > 0.0).all():
        _check_axis(times, data.get("gaps", GAPS[0]), start, shift)
        times, values = _placed(times, values, start, shift)
    words = [f"{history.of.words()} over {history.along.words()}", *history.remarks]
    if time_unit is not None:
        words.append(f"times in {time_unit}{_source(data.get('time_unit'))}")
    if value_unit is not None:
        words.append(f"values in {value_unit}{_source(data.get('value_unit'))}")
    words.append(f"{len(history.times)} samples")
    # a scene of pure numbers has no units that values could be in
    of_values = ""
    if system.measurable:
        of_values = history.of.unit_name or ""
    units = (history.along.unit_name or "", of_values)
    points = {"times": tuple(times.tolist()), "values": tuple(values.tolist())}
    return {**data, **points, "header_units": units, "read_as": ", ".join(words)}


def _time_unit(named: Any, head: ColumnHead) -> Any:
    """Unit of the times: that of the scene, else that of the header; None where neither names one."""
    if head.unit and head.unit_name is None:
        what = f"the header gives the times in {head.unit[:20]}, which is no unit of time"
        if named is None or isinstance(named, str):
            raise refusal(what, value=head.words(), remedy="name the column of the times: time_column")
    if named is None:
        return head.unit_name
    if isinstance(named, str) and head.unit_name is not None and named_unit(named, True) not in (None, head.unit_name):
        what = f"the header gives the times in {head.unit_name}"
        remedy = "omit time_unit, or write the factor to s where the header is wrong"
        raise refusal(what, value=f'time_unit = "{named}"', remedy=remedy)
    return named


def _value_unit(named: Any, head: ColumnHead, system: UnitSystem) -> Any:
    """Unit of the values: that of the scene; None where the numbers of the file are those of the scene."""
    if not system.measurable or (named is not None and not isinstance(named, str)):
        return named
    if named is None:
        if not head.unit or (head.unit_name is not None and factor(head.unit_name, system) == 1.0):
            return head.unit_name
        if head.unit_name:
            key = f'value_unit = "{head.unit_name}", '
        else:
            key = ""
        remedy = f'{key}the factor to the units of the scene, or "1" where the numbers are to be taken as they are'
        what = f"the header gives the values in {head.unit[:20]}, and the scene does not say what they are"
        raise refusal(what, value=head.words(), remedy=f"write {remedy}")
    if head.unit_name is not None and named != "1" and named_unit(named, False) not in (None, head.unit_name):
        what = f"the header gives the values in {head.unit_name}"
        remedy = f'value_unit = "{head.unit_name}", another column, or the factor where the header is wrong'
        raise refusal(what, value=f'value_unit = "{named}", {head.words()}', remedy=remedy)
    return named


def _check_axis(times: NDArray[np.float64], gaps: str, start: str, shift: float) -> None:
    """Refuse holes, and samples before t = 0, in one message."""
    steps = np.diff(times)
    median = float(np.median(steps))
    found = []
    values = []
    remedies = []
    holes = np.flatnonzero(steps > _HOLE * median)
    if holes.size and len(times) >= FEWEST_SAMPLES and gaps == GAPS[0]:
        i = int(holes[0])
        if len(holes) > 1:
            more = f" and {len(holes) - 1} more"
        else:
            more = ""
        found.append(f"samples are missing from {times[i]:.6g} s to {times[i + 1]:.6g} s{more}")
        values.append(f"an interval of {steps[i] / median:.3g} medians")
        remedies.append('gaps = "linear" takes straight lines there')
    moved = _moved(times, start, shift)
    first = float(times[0]) + moved
    before = int(np.count_nonzero(times + moved < -_BEFORE * median))
    if before and start != "cut":
        found.append(f"{before} of {len(times)} samples are before t = 0, where the run starts")
        values.append(f"the first one at {first:.6g} s")
        advice = 'start = "record" moves t = 0 to the first sample, '
        if start == "record":
            advice = ""
        remedies.append(f'{advice}shift = {max(0.0, shift - first):.6g} (s) the times, start = "cut" leaves them out')
    if found:
        raise refusal("; ".join(found), value=", ".join(values), remedy="; ".join(remedies))


def _moved(times: NDArray[np.float64], start: str, shift: float) -> float:
    """What the times of a record are moved by, s: by the shift, from its first sample where the run starts there."""
    if start == "record":
        return shift - float(times[0])
    return shift


def _placed(
    times: NDArray[np.float64], values: NDArray[np.float64], start: str, shift: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The record with t = 0 where the run has it; cut: with the value at t = 0 between the samples beside it."""
    moved = times + _moved(times, start, shift)
    if start != "cut" or moved[0] >= 0.0:
        return moved, values
    inside = moved > 0.0
    if not inside.any():
        last = f"the last one at {moved[-1]:.6g} s"
        raise refusal("all samples are before t = 0", value=last, remedy='start = "record", or shift')
    at_zero = float(np.interp(0.0, moved, values))
    return np.append(0.0, moved[inside]), np.append(at_zero, values[inside])


def peak_of(law: Any, end: float) -> tuple[float, float]:
    """Value of the largest magnitude of points with straight lines between them in [0, end], and its instant, s."""
    knots = np.asarray(law.times)
    t = np.concatenate(([0.0], knots[(knots > 0.0) & (knots < end)], [end]))
    values = np.asarray(law.sample(t))
    i = int(np.abs(values).argmax())
    return float(values[i]), float(t[i])


def inside_run(times: Sequence[float], end: float) -> tuple[float, float, int]:
    """First and last instant of a record inside [0, end], s, and the number of samples there."""
    knots = np.asarray(times)
    # with round-off of shifted times
    count = int(np.count_nonzero((knots >= -_ROUND_OFF * end) & (knots <= (1.0 + _ROUND_OFF) * end)))
    return max(0.0, float(knots[0])), min(end, float(knots[-1])), count


def misfits(law: Any, end: float) -> Iterator[str]:
    """What speaks against the times of a record that is inside the run [0, end], s."""
    span = float(law.times[-1] - law.times[0])
    ratio = span / end
    if law.units[0] is None and len(law.times) >= FEWEST_SAMPLES and not 1.0 / _THOUSANDTH < ratio < _THOUSANDTH:
        what = f"the record lasts {span:.4g} s, the run {end:.4g} s, and no unit of its times is named"
        yield f'{what}: if they are in ms, write time_unit = "ms"; if they are in s, time_unit = "s"'
    largest = float(np.abs(law.values).max())
    inside = abs(peak_of(law, end)[0])
    if inside < _SMALL_SHARE * largest:
        at = float(law.times[int(np.abs(np.asarray(law.values)).argmax())])
        what = (
            f"the largest value inside the run is {inside / largest:.2g} of that of the record, which is at {at:.4g} s"
        )
        yield f"{what}: time.end, time_unit and shift decide what is inside"


_THOUSANDTH: Final = 300.0
_SMALL_SHARE: Final = 0.5
