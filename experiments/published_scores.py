"""Published scores of nine methods on the HCI 4D benchmark.

``published_scores.csv`` contains table 1 of the OccCasNet paper (Chao et al., arXiv:2305.17710):
MSE x100 and BadPix in % on the twelve benchmark scenes, and the averages as printed there.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

FILE = Path(__file__).with_suffix(".csv")

MEASURES = ("badpix_0.07", "badpix_0.03", "badpix_0.01", "mse_x100")
"""Names of the measures, as in :mod:`occjax.evaluation`."""

PRINTED_AVERAGE = "average"
"""Key of the averages over the scenes, as the paper prints them.

Three averages differ from those of the paper's own scores by more than rounding: BadPix 0.03 of SPO
is printed as 32.71 instead of 22.30, BadPix 0.01 of FastLFnet as 56.45 instead of 56.42, and BadPix
0.07 of OccCasNet as 2.859 instead of 2.857.
"""

Scores = Mapping[str, float]
"""Score by measure."""


@cache
def published_scores() -> Mapping[str, Mapping[str, Scores]]:
    """Return the published scores of all methods, in the order of the paper's table.

    Returns:
        Scores by method, scene and measure. The scene :data:`PRINTED_AVERAGE` has the averages.

    Example:
        >>> published_scores()["OccCasNet"]["cotton"]["badpix_0.07"]
        0.263
    """
    table: dict[str, dict[str, Scores]] = {}
    with FILE.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            scores = {measure: float(row[measure]) for measure in MEASURES}
            table.setdefault(row["method"], {})[row["scene"]] = MappingProxyType(scores)
    return MappingProxyType({name: MappingProxyType(scenes) for name, scenes in table.items()})
