"""The table of all experiments, from which help texts and documentation take their lists.

Importing it imports none of them.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ALL", "EXPERIMENTS", "Experiment", "experiments_named"]

#: Name that stands for all experiments.
ALL = "all"


@dataclass(frozen=True)
class Experiment:
    """One experiment.

    Parameters
    ----------
    name : str
        Name by which users choose it, and of its files.
    description : str
        What it shows.
    module : str
        Module with its function ``run``, which takes a
        :class:`~gpszip.experiments.experiment.Setting` and returns an
        :class:`~gpszip.experiments.experiment.Outcome`.
    needs_roads : bool, default False
        Whether logs of the user need a road network.
    """

    name: str
    description: str
    module: str
    needs_roads: bool = False


#: All experiments, in the order in which ``all`` runs them.
EXPERIMENTS: tuple[Experiment, ...] = (
    Experiment(
        "table-8.1",
        "compression of all logs: bzip2, the thesis's pipeline, the archive",
        "gpszip.experiments.table_8_1",
    ),
    Experiment(
        "table-8.2",
        "compression of the first 10 % to 100 % of the robot's log",
        "gpszip.experiments.table_8_2",
    ),
    Experiment(
        "figure-1.1",
        "density of the points of taxis, and zoomed in",
        "gpszip.experiments.figure_1_1",
    ),
    Experiment(
        "figure-1.2",
        "k segments, and k parts on m segments, in x, y and time",
        "gpszip.experiments.figure_1_2",
    ),
    Experiment(
        "figure-1.3",
        "a noisy log, and the segments that smooth it, over time",
        "gpszip.experiments.figure_1_3",
    ),
    Experiment(
        "figure-5.1",
        "gaps of a phone's log, joined and patched along roads",
        "gpszip.experiments.figure_5_1",
        needs_roads=True,
    ),
    Experiment(
        "figure-6.3",
        "cost over m, and its elbow",
        "gpszip.experiments.figure_6_3",
    ),
    Experiment(
        "figure-6.4",
        "the robot's log with the segments of several m",
        "gpszip.experiments.figure_6_4",
    ),
    Experiment(
        "figure-6.5",
        "from segments to a map",
        "gpszip.experiments.figure_6_5",
    ),
    Experiment(
        "figure-8.2",
        "the quadrotor's log, and its map by the thesis's pipeline",
        "gpszip.experiments.figure_8_2",
    ),
    Experiment(
        "figure-8.3",
        "the robot's log in x, y and time, in the colours of its segments",
        "gpszip.experiments.figure_8_3",
    ),
    Experiment(
        "figure-8.4",
        "maps of a phone's months, with the places of its person",
        "gpszip.experiments.figure_8_4",
    ),
    Experiment(
        "figure-8.5",
        "maps of a taxi at two errors, over the true roads",
        "gpszip.experiments.figure_8_5",
    ),
    Experiment(
        "figure-8.6",
        "maps of two taxis, and the map merged of them",
        "gpszip.experiments.figure_8_6",
    ),
    Experiment(
        "figure-8.7",
        "RMSE over m, and over the size of the coreset, for k = 200",
        "gpszip.experiments.figure_8_7",
    ),
    Experiment(
        "figure-8.8",
        "size of the output, and ratio, over the size of the input, of table 8.2",
        "gpszip.experiments.figure_8_8",
    ),
    Experiment(
        "peers",
        "rate against error of GPSZip, simplifiers and coders on the same logs",
        "gpszip.experiments.compare_peers",
    ),
    Experiment(
        "scaling",
        "time, memory and bytes over points, k, m, dimensions, workers and graphs",
        "gpszip.experiments.scaling",
    ),
    Experiment(
        "generators",
        "the generated logs over their true maps",
        "gpszip.experiments.generators",
    ),
)


def experiments_named(name: str) -> tuple[Experiment, ...]:
    """Return the experiments that a name stands for; none if there is no such name.

    Examples
    --------
    >>> [each.name for each in experiments_named("table-8.1")]
    ['table-8.1']
    >>> len(experiments_named("all")) == len(EXPERIMENTS)
    True
    """
    return tuple(each for each in EXPERIMENTS if name in (each.name, ALL))
