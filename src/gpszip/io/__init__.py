"""Reading and writing logs, road networks, maps and coresets."""
