"""TCX: activities, courses and their trackpoints."""
