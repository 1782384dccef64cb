"""Compiled loops of map matching: candidates, transitions, trellis, and backtrace."""
