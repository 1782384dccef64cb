"""Pictures of maps and logs, with matplotlib."""
