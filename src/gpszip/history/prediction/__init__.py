"""What follows a route: next edges, destinations and arrivals."""
