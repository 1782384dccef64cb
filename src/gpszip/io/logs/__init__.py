"""Readers and writers of position logs, one file or package for each format."""
