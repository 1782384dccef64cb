"""What chapter 8 of the thesis states of its own logs, which were never published.

Numbers are those of tables 8.1 and 8.2. m is half of the nodes, and k at least the number of
transitions and one; the thesis prints neither.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["TABLE_8_1", "TABLE_8_2", "Published"]


@dataclass(frozen=True)
class Published:
    """One row of the thesis's tables.

    Parameters
    ----------
    log : str
        Its name.
    points, coreset : int
        Samples, and samples after the coreset.
    waypoints, nodes, edges : int
        Length of the compressed walk, and size of the map.
    bzip2, semantic, both, improvement : float
        Ratios of text sizes without times.
    rmse : float
        Metres.
    hours : float or None
        Running time; None where the thesis states none.
    """

    log: str
    points: int
    coreset: int
    waypoints: int
    nodes: int
    edges: int
    bzip2: float
    semantic: float
    both: float
    improvement: float
    rmse: float
    hours: float | None = None


#: Table 8.1.
TABLE_8_1 = (
    Published("robot", 72_273, 7_651, 52, 216, 258, 3.8, 237.0, 646.2, 167.4, 0.24, 7.4),
    Published("quadrotor", 12_000, 12_000, 100, 40, 21, 11.9, 328.5, 709.0, 59.7, 10.0, 2.1),
    Published("phone a", 26_249, 6_816, 907, 336, 622, 3.0, 10.5, 27.2, 9.1, 300.0, 9.7),
    Published("phone b", 26_249, 6_816, 291, 60, 119, 3.0, 54.81, 132.21, 44.2, 800.0),
    Published("taxi a", 4_281, 4_281, 103, 270, 292, 7.36, 12.1, 33.1, 4.5, 41.0, 2.3),
    Published("taxi b", 4_281, 4_281, 47, 40, 50, 7.36, 79.1, 171.0, 23.2, 200.0),
    Published("taxis", 16_340, 16_340, 677, 358, 551, 6.4, 26.8, 67.8, 10.6, 200.0, 14.5),
)

#: Table 8.2: the first 10 % to 100 % of the robot's log.
TABLE_8_2 = (
    Published("10 %", 7_227, 7_227, 2, 16, 15, 4.1, 380.4, 651.7, 158.1, 0.1905),
    Published("20 %", 14_454, 14_454, 3, 48, 47, 3.8, 254.9, 584.7, 152.3, 0.2130),
    Published("30 %", 21_681, 21_681, 4, 70, 69, 3.7, 263.0, 638.4, 170.0, 0.2190),
    Published("40 %", 28_909, 28_909, 5, 100, 105, 3.8, 243.4, 602.4, 158.1, 0.2171),
    Published("50 %", 36_136, 36_136, 13, 136, 141, 3.8, 213.8, 547.8, 143.5, 0.2155),
    Published("60 %", 43_363, 43_363, 10, 178, 194, 3.8, 195.8, 521.2, 135.9, 0.1923),
    Published("70 %", 50_591, 50_591, 24, 194, 215, 3.8, 200.5, 536.9, 137.9, 0.2033),
    Published("80 %", 57_818, 57_818, 28, 206, 238, 3.8, 211.6, 567.9, 147.0, 0.2235),
    Published("90 %", 65_045, 65_045, 23, 216, 255, 3.8, 229.6, 619.2, 160.4, 0.2089),
    Published("100 %", 72_273, 72_273, 52, 216, 258, 3.8, 237.0, 646.2, 167.4, 0.2360),
)
