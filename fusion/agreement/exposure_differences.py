"""What clinicians use, from both sides over the very same time: bins, repetitions, percentiles."""

from dataclasses import dataclass

from fusion.agreement.pairing import Pairs
from fusion.exposure import Exposure, summarise_exposure

PERCENTILES = (10, 50, 90)


@dataclass(frozen=True, slots=True)
class FigureDifference:
    """One exposure figure on both sides, under its name in the summary; ``difference`` = ours - reference."""

    name: str
    ours: float
    reference: float

    @property
    def difference(self) -> float:
        """Ours less the reference's."""
        return self.ours - self.reference


def compare_exposure(pairs: Pairs) -> tuple[FigureDifference, ...]:
    """Set the figures of both sides beside each other; the metric filter is applied to both alike."""
    ours, reference = (_list_figures(summarise_exposure(side)) for side in pairs.to_elevations())
    return tuple(FigureDifference(name, ours[name], reference[name]) for name in ours)


def _list_figures(exposure: Exposure) -> dict[str, float]:
    bins = {f"time_{item.lower_deg:g}_{item.upper_deg:g}_percent": item.percent for item in exposure.bins}
    above = {f"time_above_{item.threshold_deg:g}_percent": item.percent for item in exposure.time_above}
    entries = {f"entries_above_{item.threshold_deg:g}": float(item.count) for item in exposure.entries}
    percentiles = {f"elevation_p{p}_deg": exposure.percentiles_deg[p] for p in PERCENTILES}
    return {**bins, **above, **entries, **percentiles}
