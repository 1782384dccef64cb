"""What a history of positions tells: stays, trips, and the places that they join."""
