"""Sources and sinks of bytes: files, URLs, zip archives and standard streams."""
