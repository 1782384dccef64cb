"""Replay: a log is sent as if it came live, in the words of an app or a receiver."""
