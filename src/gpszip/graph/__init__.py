"""The road map as a graph: canonical shortest paths, trees and routes."""
