"""Compilation, and the compiled helpers that several packages share."""
