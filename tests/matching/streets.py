"""Networks and drives for the tests of matching."""

import numpy as np

from gpszip.model import Network, Track


def network(nodes, pairs, forward=None, backward=None, *, plane=None, names=None, speeds=None):
    """A network of straight roads between pairs of nodes, open in both directions by default."""
    nodes, pairs = np.array(nodes, float), np.array(pairs, np.int32).reshape(-1, 2)
    both = np.ones(len(pairs), bool)
    return Network(
        nodes,
        pairs[:, 0].copy(),
        pairs[:, 1].copy(),
        2 * np.arange(len(pairs) + 1),
        nodes[pairs.ravel()],
        both if forward is None else np.array(forward),
        both if backward is None else np.array(backward),
        np.full(len(pairs), np.nan) if speeds is None else speeds,
        None,
        plane,
        names,
    )


def grid(blocks, block, *, centred=False):
    """Nodes and pairs of a grid of streets: those to the east, then those to the north.

    The node in column x and row y has the number ``x * (blocks + 1) + y``.
    """
    n = blocks + 1
    nodes = np.array([(x, y) for x in range(n) for y in range(n)], float)
    nodes = block * (nodes - blocks / 2 if centred else nodes)
    pairs = [(x * n + y, (x + 1) * n + y) for x in range(blocks) for y in range(n)]
    pairs += [(x * n + y, x * n + y + 1) for x in range(n) for y in range(blocks)]
    return nodes, pairs


def town(blocks=6, block=120.0):
    """The streets on which :func:`gpszip.testing.city.drives` drives."""
    return network(*grid(blocks, block, centred=True))


def sample_line(corners, speed, period):
    """Times and positions of samples at a constant speed along a line."""
    corners = np.array(corners, float)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    times = np.arange(0, along[-1] / speed + 1e-9, period)
    return times, np.stack([np.interp(speed * times, along, axis) for axis in corners.T], axis=1)


def drive(corners, speed=10.0, period=1.0, noise=0.0, seed=0, name="car"):
    """A track along a line, with noise."""
    times, positions = sample_line(corners, speed, period)
    errors = np.random.default_rng(seed).normal(0, 1, positions.shape) * noise
    return Track(name, times, positions + errors)
