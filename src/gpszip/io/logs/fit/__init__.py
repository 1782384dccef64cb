"""Logs of watches and bicycle computers in FIT."""
