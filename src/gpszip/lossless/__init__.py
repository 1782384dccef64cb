"""Logs without loss: every column of numbers with the source's own digits."""
