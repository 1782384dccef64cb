"""Logs that are tables: which column holds what, and how its values become a log."""
