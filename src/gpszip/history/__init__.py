"""What a history of positions tells: stays, trips, traversals of edges, and what follows."""
