"""Compiled loops along walks."""
