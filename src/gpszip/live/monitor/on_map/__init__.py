"""Events of agents on a known map: where they are, where they go, and what is unusual."""
