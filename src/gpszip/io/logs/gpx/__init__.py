"""GPX: tracks, routes and their times."""
