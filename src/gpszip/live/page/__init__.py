"""The live page: what a browser is told of agents, events and sources, and the server for it."""
