"""A bounded memory of fixes: which were stored lately, for 16 bytes each."""

from __future__ import annotations

import struct
from array import array
from enum import Enum

from gpszip.live.fix import Fix

__all__ = ["Seen", "Verdict"]

#: Fixes of one generation; between this and twice as many are remembered, in 64 MB.
_CAPACITY = 1 << 20

#: Slots for each fix: half of them stay free, so that a search takes about 1.5 steps.
_SLOTS_PER_FIX = 2

_MASK_64 = (1 << 64) - 1
_MASK_32 = (1 << 32) - 1


class Verdict(Enum):
    """What is known of a fix."""

    NEW = "new"
    #: The same agent, time and position.
    REPEAT = "repeat"
    #: The same agent and time at another position, with a better accuracy.
    BETTER = "better"
    #: The same agent and time at another position, with no better accuracy.
    WORSE = "worse"


class Seen:
    """Remembers agent, time, position and accuracy of the fixes stored last.

    Fixes are filed in two generations. When the newer one is full, the older one is forgotten.

    Parameters
    ----------
    capacity : int, default 1048576
        Fixes of one generation.

    Examples
    --------
    >>> seen = Seen(8)
    >>> fix = Fix("bus", "gpsd", 7.0, 8.0, (48.1, 11.5))
    >>> seen.judge(fix), seen.add(fix), seen.judge(fix)
    (<Verdict.NEW: 'new'>, None, <Verdict.REPEAT: 'repeat'>)
    """

    def __init__(self, capacity: int = _CAPACITY) -> None:
        self._capacity = capacity
        self._new = _Table(capacity)
        self._old = _Table(capacity)

    def judge(self, fix: Fix) -> Verdict:
        """Say what is known of a fix."""
        key = _key(fix)
        value = self._new.find(key) or self._old.find(key)
        return _compare(value, fix)

    def add(self, fix: Fix) -> None:
        """Remember a fix that was stored."""
        if self._new.count >= self._capacity:
            self._old, self._new = self._new, _Table(self._capacity)
        self._new.put(_key(fix), _value(fix))


class _Table:
    """Pairs of 64-bit numbers in open addressing; 0 is no key and no value."""

    def __init__(self, capacity: int) -> None:
        slots = 1 << (_SLOTS_PER_FIX * capacity - 1).bit_length()
        self._mask = slots - 1
        self._keys = array("Q", bytes(8 * slots))
        self._values = array("Q", bytes(8 * slots))
        self.count = 0

    def find(self, key: int) -> int:
        """Return the value of a key, 0 if there is none."""
        return self._values[self._slot(key)]

    def put(self, key: int, value: int) -> None:
        """Set the value of a key."""
        slot = self._slot(key)
        self.count += self._keys[slot] == 0
        self._keys[slot], self._values[slot] = key, value

    def _slot(self, key: int) -> int:
        """The slot of a key, or the free one that it gets."""
        keys, slot = self._keys, key & self._mask
        while keys[slot] not in (0, key):
            slot = (slot + 1) & self._mask
        return slot


def _key(fix: Fix) -> int:
    # Python salts hashes of texts, so that no sender can make fixes that share their slots. It
    # gives -1 and -2 one hash, so that times are hashed by their bytes; adding 0 turns -0 into 0.
    return (hash((fix.agent, struct.pack("<d", fix.time + 0.0))) & _MASK_64) or 1


def _value(fix: Fix) -> int:
    """Position and accuracy in 64 bits."""
    accuracy = -1.0 if fix.accuracy is None else min(fix.accuracy, 1e30)
    bits: int = struct.unpack("<I", struct.pack("<f", accuracy))[0]
    return _position_bits(fix) << 32 | bits


def _position_bits(fix: Fix) -> int:
    numbers = [number + 0.0 for number in fix.position]
    return hash(struct.pack(f"<{len(numbers)}d", *numbers)) & _MASK_32


def _compare(value: int, fix: Fix) -> Verdict:
    """Compare a remembered value with a fix at the same time."""
    if value == 0:
        return Verdict.NEW
    if value >> 32 == _position_bits(fix):
        return Verdict.REPEAT

    # An accuracy that is known is better than none.
    known: float = struct.unpack("<f", struct.pack("<I", value & _MASK_32))[0]
    if fix.accuracy is None or (0 <= known <= fix.accuracy):
        return Verdict.WORSE
    return Verdict.BETTER
