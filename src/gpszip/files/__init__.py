"""Atomic file output, temporary folders, deferred signals and readable disk errors."""
