"""The monitor: from fixes of many agents to events."""
