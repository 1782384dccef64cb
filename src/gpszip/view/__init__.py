"""Pictures of maps and archives."""
