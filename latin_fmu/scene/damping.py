"""Keys damping_ratios of materials, springs and elastic layers, and table [damping] for all that say nothing."""

import math
from typing import Annotated, Any, Final, Self

from pydantic import BeforeValidator, model_validator

from .fields import Positive, Real, SceneTable, _as_list, about, refusal
from .strain_damping import PRECISION, WIDEST, StrainDamping, fitted, nearest

_LARGEST_RATIO: Final = 0.5
Band = Annotated[tuple[Positive, Positive], BeforeValidator(_as_list)]


def _check_band(first: float, last: float) -> None:
    """Refuse a band that is none, or too wide for the branches there are."""
    if first >= last:
        raise refusal("the second frequency must be above the first", value=[first, last])
    if last > WIDEST * first * (1 + 1e-9):
        raise refusal("the band is too wide", value=[first, last], allowed=f"up to {WIDEST:g} times the first")


class DampingRatios(SceneTable):
    """Damping ratios over a band of frequencies: from the first to the second, on a line in the logarithms.

    The damping belongs to strain (``strain_damping``): a mode has the ratio at its frequency, whatever the assembly is
    cut into, and the motion of a part as a whole is not damped. The modulus rises with frequency.
    """

    frequencies: Annotated[Band, about("ends of the band, ascending", "Hz")]
    ratios: Annotated[
        tuple[Positive, Positive], BeforeValidator(_as_list), about("ratios to the critical damping there, < 0.5", "1")
    ]

    @model_validator(mode="after")
    def _check_line(self) -> Self:
        """Refuse lines that no damping by strain follows."""
        (first, last), (low, high) = self.frequencies, self.ratios
        _check_band(first, last)
        if max(low, high) >= _LARGEST_RATIO:
            raise refusal("too large for a damped vibration", value=list(self.ratios), allowed=f"< {_LARGEST_RATIO}")
        least, most = low * first / last, low * last / first
        # round-off at the ends of the range, where one term is left
        if not (least * (1 - 1e-9) <= high <= most * (1 + 1e-9)) or self.damping.deviation > PRECISION:
            if high < low:
                word, bound = "falls", "from"
                closest = nearest(first, last, low, max(high, least))
            else:
                word, bound = "rises", "up to"
                closest = most
            raise refusal(
                f"the ratio {word} faster with frequency than that of any damping by strain",
                value=list(self.ratios),
                allowed=f"a second ratio {bound} {closest:.4g}, with these frequencies and the first ratio",
                remedy=f"ratios = [{low:g}, {closest:.4g}], or rayleigh_mass and rayleigh_stiffness",
            )
        return self

    @property
    def damping(self) -> StrainDamping:
        """The damping by strain."""
        return fitted(*self.frequencies, *self.ratios)

    @property
    def rayleigh(self) -> tuple[float, float]:
        """Coefficients a, s-1, and b, s, of a / (2 omega) + b omega / 2 = ratio at both frequencies."""
        first, last = (2.0 * math.pi * f for f in self.frequencies)
        low, high = self.ratios
        factor = 2.0 / (last**2 - first**2)
        a, b = factor * first * last * (low * last - high * first), factor * (high * last - low * first)
        return max(a, 0.0), max(b, 0.0)  # round-off at the ends of the range


class DampingTable(SceneTable):
    """One damping ratio for every material, spring and elastic layer that has no damping of its own.

    A mode of the assembly has this ratio within the band (`damping_ratios`), whatever it is cut into. Couplings have no
    strain to damp, and faces that may open, soft contacts among them, none that is always there.
    """

    ratio: Annotated[Real, about("ratio to the critical damping", "1", gt=0, lt=_LARGEST_RATIO)]
    band: Annotated[
        Band | None,
        about(
            "ends of the band in which the ratio holds; default: from a third of the lowest natural frequency of the "
            "tightened assembly to the highest frequency required by spectra, filters and loads",
            "Hz",
        ),
    ] = None

    @model_validator(mode="after")
    def _check_ends(self) -> Self:
        if self.band is not None:
            _check_band(*self.band)
        return self

    def completed(self, scene: Any) -> Any:
        """A `Scene` whose materials, springs and elastic layers have the ratio where they say nothing; the band must be
        known."""
        assert self.band is not None, "a band that is not known yet"
        ratios = DampingRatios(frequencies=self.band, ratios=(self.ratio, self.ratio))
        damped = {"damping_ratios": ratios}
        materials = {n: m if m.damping_keys else m.model_copy(update=damped) for n, m in scene.material.items()}
        springs = {n: s.model_copy(update=damped) if s.takes_ratio else s for n, s in scene.spring.items()}
        interfaces = {n: i.model_copy(update=damped) if i.takes_ratio else i for n, i in scene.interface.items()}
        return scene.model_copy(update={"material": materials, "spring": springs, "interface": interfaces})
