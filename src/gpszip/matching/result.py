"""Where the values of matching used to live."""

from gpszip.model.match import Break, Match, Matching, Piece, Route

__all__ = ["Break", "Match", "Matching", "Piece", "Route"]
