"""Readers and writers of logs and maps, one file for each format."""
