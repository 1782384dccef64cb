"""The RMSE that experiments aim at."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gpszip.experiments.experiment import Setting
from gpszip.experiments.thesis_pipeline import at_elbow
from gpszip.mapping.thinning import reduce_to_coreset
from gpszip.model import Track
from gpszip.segmentation.evaluate import rmse

__all__ = ["target_rmse"]

#: Blocks of the coreset of a log of the user in which the elbow is looked for. With 8 samples each,
#: the search takes a few seconds.
_BLOCKS = 100

#: Least RMSE in metres, the resolution of the thesis's texts: a log may be fitted exactly.
_MIN_RMSE = 1e-3


def target_rmse(setting: Setting, track: Track, published: float) -> float:
    """Return the RMSE in metres that the setting asks for, or a default.

    Parameters
    ----------
    setting : Setting
        Its RMSE goes first.
    track : Track
        The log.
    published : float
        RMSE of the thesis, that of generated logs. For a log of the user it is the RMSE at the
        elbow of the cost (algorithms 3 and 4), of a coreset.

    Examples
    --------
    >>> track = Track("a", range(9), [[t, 0.0] for t in range(9)])
    >>> target_rmse(Setting(), track, 0.24), target_rmse(Setting((track,), rmse=2.0), track, 0.24)
    (0.24, 2.0)
    """
    if setting.rmse is not None:
        return setting.rmse
    return _at_elbow(track) if setting.logs else published


@lru_cache(maxsize=4)  # several experiments show the same log
def _at_elbow(track: Track) -> float:
    no_gaps = np.zeros(len(track) - 1, np.bool_)
    (coreset,), _ = reduce_to_coreset([track], [no_gaps], _BLOCKS)
    return max(rmse(at_elbow(coreset), coreset), _MIN_RMSE)
