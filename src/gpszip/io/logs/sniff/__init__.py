"""Recognise log formats by the first bytes of a file, without importing their readers."""
