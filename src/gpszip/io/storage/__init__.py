"""Where bytes are read from and written to: files, URLs, archives and standard streams."""
