"""Positions of one frame in another, composed of transforms.

Transforms form a tree: each frame has one parent. The way from one frame to another leads up to
their common ancestor and down again. Between stamps, translations are interpolated linearly and
rotations spherically.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError

__all__ = ["Link", "LinkTransforms", "compose", "find_chain", "interpolate", "rotate"]

#: Frames that messages list.
_MAX_LISTED = 20

#: Cosine of the angle between quaternions above which they are interpolated linearly: the sine of
#: the angle, by which is divided, would lose digits. The two differ by less than 1e-8 there.
_NEARLY_EQUAL = 1.0 - 1e-7

Floats = NDArray[np.float64]


class Link(NamedTuple):
    """A transform between neighbours on the way from one frame to another.

    Parameters
    ----------
    parent, child : str
        The frames of the transform.
    is_down : bool
        Whether the way leads from the parent to the child.
    """

    parent: str
    child: str
    is_down: bool


class LinkTransforms(NamedTuple):
    """The transforms of a link over time.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds, strictly increasing; one time for a static transform.
    positions : float64 array, shape (n, 3)
        Metres.
    orientations : float64 array, shape (n, 4)
        Unit quaternions x, y, z, w.
    is_static : bool
        Whether the transform holds for all times.
    """

    times: Floats
    positions: Floats
    orientations: Floats
    is_static: bool


def find_chain(
    parents: Mapping[str, Iterable[str]], start: str, end: str, where: str
) -> list[Link]:
    """Find the way from one frame to another.

    Parameters
    ----------
    parents : mapping of str to iterable of str
        The parents of each frame that is a child.
    start, end : str
        The frames.
    where : str
        Name of the log for messages.

    Raises
    ------
    InputError
        If a frame doesn't exist, the frames are not connected, a frame on the way has two parents,
        or frames are their own ancestors.

    Examples
    --------
    >>> chain = find_chain({"odom": ["map"], "base": ["odom"]}, "map", "base", "a.bag")
    >>> [(link.parent, link.child) for link in chain]
    [('map', 'odom'), ('odom', 'base')]
    """
    # Both frames have to exist.
    known = dict.fromkeys([*(p for some in parents.values() for p in some), *parents])
    for frame in (start, end):
        if frame not in known:
            raise InputError(
                f"has no frame {frame!r}", path=where, remedy=f"its frames: {_listed(known)}"
            )

    # Both ways to the root.
    up = _ancestors(parents, start, where)
    down = _ancestors(parents, end, where)
    if up[-1] != down[-1]:
        raise InputError(
            f"no transform connects {start!r} and {end!r}: {start!r} leads up to {up[-1]!r}, "
            f"{end!r} to {down[-1]!r}",
            path=where,
            remedy=f"name frames of one tree, of {_listed(known)}",
        )

    # What they share is left out, down to the common ancestor.
    while len(up) > 1 and len(down) > 1 and up[-2] == down[-2]:
        up.pop()
        down.pop()
    rising = [Link(parent, child, is_down=False) for child, parent in pairwise(up)]
    falling = [Link(parent, child, is_down=True) for child, parent in pairwise(down)]
    return rising + falling[::-1]


def _ancestors(parents: Mapping[str, Iterable[str]], frame: str, where: str) -> list[str]:
    """Return a frame and its ancestors up to the root."""
    way = [frame]
    while own := sorted(set(parents.get(way[-1], ()))):
        # A tree has one parent for each frame, ...
        if len(own) > 1:
            raise InputError(
                f"frame {way[-1]!r} has several parents: {_listed(own)}",
                path=where,
                remedy="name frames whose way does not lead through it",
            )

        # ... and no circles.
        if own[0] in way:
            loop = " -> ".join([*way[way.index(own[0]) :], own[0]])
            raise InputError(
                f"transforms go in a circle: {loop}",
                path=where,
                remedy="name a topic of poses instead: --topic NAME",
            )
        way.append(own[0])
    return way


def _listed(frames: Iterable[str]) -> str:
    names = list(frames)
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more


def compose(
    chain: Sequence[Link], transforms: Mapping[Link, LinkTransforms], times: Floats
) -> tuple[Floats, Floats]:
    """Compose the transforms of a chain.

    For each link, T <- T S if the way leads down and T <- T S^-1 if it leads up, with the link's
    transform S = (p, q) at the time: T = (p_T + q_T p q_T*, q_T q).

    Parameters
    ----------
    chain : sequence of Link
        From :func:`find_chain`.
    transforms : mapping of Link to LinkTransforms
        Those of each link.
    times : float64 array, shape (n,)
        Seconds, within the times of all links that are not static.

    Returns
    -------
    positions : float64 array, shape (n, 3)
        Metres.
    orientations : float64 array, shape (n, 4)
        Unit quaternions x, y, z, w.
    """
    position = np.zeros((len(times), 3))
    orientation = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
    for link in chain:
        p, q = interpolate(transforms[link], times)
        if not link.is_down:
            q = q * [-1.0, -1.0, -1.0, 1.0]
            p = -rotate(q, p)
        position = position + rotate(orientation, p)
        orientation = _product(orientation, q)
    return position, orientation


def interpolate(transforms: LinkTransforms, times: Floats) -> tuple[Floats, Floats]:
    """Return positions and orientations at times between those of the transforms.

    q(u) = (sin((1 - u) a) q0 + sin(u a) q1) / sin a, where a is the angle between q0 and q1.

    Parameters
    ----------
    transforms : LinkTransforms
        The transforms of a link.
    times : float64 array, shape (n,)
        Seconds.
    """
    # A static transform is the same at all times.
    if transforms.is_static or len(transforms.times) == 1:
        count = len(times)
        return np.tile(transforms.positions[-1], (count, 1)), np.tile(
            transforms.orientations[-1], (count, 1)
        )

    # The stamps around each time.
    after = np.clip(np.searchsorted(transforms.times, times), 1, len(transforms.times) - 1)
    before = after - 1
    begin = transforms.times[before]
    share = ((times - begin) / (transforms.times[after] - begin))[:, None]
    p0, p1 = transforms.positions[before], transforms.positions[after]

    # A quaternion and its negative are the same rotation: take the one on the shorter way.
    q0, q1 = transforms.orientations[before], transforms.orientations[after]
    cosine = (q0 * q1).sum(axis=1, keepdims=True)
    q1 = np.where(cosine < 0, -q1, q1)
    angle = np.arccos(np.minimum(np.abs(cosine), _NEARLY_EQUAL))
    sine = np.sin(angle)
    q = (np.sin((1 - share) * angle) * q0 + np.sin(share * angle) * q1) / sine
    return p0 + share * (p1 - p0), q / np.sqrt((q**2).sum(axis=1, keepdims=True))


def rotate(q: Floats, v: Floats) -> Floats:
    """Rotate vectors by unit quaternions: v + 2 w (u x v) + 2 u x (u x v) for q = (u, w).

    Parameters
    ----------
    q : float64 array, shape (n, 4)
        Quaternions x, y, z, w.
    v : float64 array, shape (n, 3)
        Vectors.
    """
    u, w = q[:, :3], q[:, 3:]
    turned = np.cross(u, v)
    rotated: Floats = v + 2 * (w * turned + np.cross(u, turned))
    return rotated


def _product(a: Floats, b: Floats) -> Floats:
    """Return the products of quaternions: the rotation b first, then a."""
    u, w, v, s = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    vector = w * v + s * u + np.cross(u, v)
    scalar = w * s - (u * v).sum(axis=1, keepdims=True)
    return np.concatenate([vector, scalar], axis=1)
