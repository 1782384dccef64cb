"""Unpack the blocks of a page as its script does."""

import base64
import zlib

import numpy as np


def unpack(block):
    """Numbers of a block."""
    count, width = block["count"], block["bytes"]
    data = zlib.decompress(base64.b64decode(block["data"]), -15) if block["data"] else b""
    unsigned = [
        sum(data[plane * count + i] << (8 * plane) for plane in range(width)) for i in range(count)
    ]
    missing = [False] * count
    if block.get("nan"):
        missing = [value == 0 for value in unsigned]
        unsigned = [max(value - 1, 0) for value in unsigned]
    integers = [-(value + 1) // 2 if value % 2 else value // 2 for value in unsigned]
    for _ in range(block["order"]):
        total = 0
        for i, value in enumerate(integers):
            total += value
            integers[i] = total
    numbers = [integer * block["scale"] + block["offset"] for integer in integers]
    return np.where(missing, np.nan, np.array(numbers, float)) if count else np.zeros(0)


def unpack_lines(lines):
    """Lines as a list of arrays of shape (n, 2)."""
    points = np.column_stack([unpack(lines["x"]), unpack(lines["y"])])
    offsets = unpack(lines["offsets"]).astype(int)
    return [points[a:b] for a, b in zip(offsets[:-1], offsets[1:], strict=True)]
