"""The file format of archives."""
